"""Trainings on a real service: followed, cancelled, killed; and a job that steers by what came out."""

from __future__ import annotations

import signal
from typing import TYPE_CHECKING

import pytest
from click.testing import CliRunner, Result

from service.cli.main import main
from service.client.client import Client
from service.settings import RUNNER
from tests.acceptance.server import Server, running_server, until
from tests.service.learned import dataset_bytes

if TYPE_CHECKING:
    from pathlib import Path

pytestmark = pytest.mark.slow

SLOW = 900  # nodes of an elm whose training takes seconds


def needlebench(*words: str | Path) -> Result:
    return CliRunner().invoke(main, [str(word) for word in words], env={"NEEDLEBENCH_URL": None})


@pytest.fixture
def data(tmp_path: Path) -> Path:
    path = tmp_path / "data.npz"
    path.write_bytes(dataset_bytes(insertions=20, rows=500))
    return path


def training(server: Server, data: Path) -> str:
    """The id of a training that is under way."""
    reference = server.client.upload(data).reference
    job = server.client.train_model(reference, nodes=SLOW)
    until(lambda: server.client.job(job.id).progress.step >= 1)
    return job.id


def test_a_model_is_trained_listed_steered_by_and_verified(tmp_path: Path, data: Path) -> None:
    with running_server(tmp_path / "data", runner=RUNNER, workers=1) as server:
        told = needlebench("models", "train", data, "--nodes", "9", "--name", "mine", "--wait", "--url", server.url)
        assert told.exit_code == 0, told.output
        model = server.client.models()[0]
        assert (model.source, model.kind, model.name) == ("trained", "elm", "mine.json")
        assert model.reference in told.output
        assert model.reference in needlebench("models", "list", "--url", server.url).output
        assert '"nodes": 9' in needlebench("models", "show", model.id, "--url", server.url).output
        out = tmp_path / "elm.json"
        assert needlebench("models", "fetch", model.id, "--out", out, "--url", server.url).exit_code == 0
        (tmp_path / "again.json").write_bytes(out.read_bytes())
        assert server.client.upload(tmp_path / "again.json").id == model.id
        steer = {
            "tissue": {"element_size_mm": 12},
            "trajectory": {"kind": "line", "target_mm": [18, 31, 3]},
            "recording": {"enabled": False},
            "controller": {"kind": "elm", "model": model.reference},
        }
        job = server.client.wait(server.client.submit(steer).id)
        assert job.state == "finished", job.error
        assert server.client.verify(job.id).verdict == "identical"
        assert [one["id"] for one in server.client.model(model.id).raw["used_by"]] == [job.id]
        assert needlebench("uploads", "--pin", model.reference, "--url", server.url).exit_code == 0
        kept = needlebench("uploads", "--delete", model.reference, "--url", server.url)
        assert (kept.exit_code, "is pinned" in kept.output) == (1, True)
        assert needlebench("uploads", "--unpin", model.id, "--url", server.url).exit_code == 0
        server.client.delete_upload(model.id)
        gone = needlebench("verify", job.id, "--url", server.url)
        assert (gone.exit_code, "which the service no longer has" in gone.output) == (2, True)
        trained = needlebench("verify", model.job or "", "--url", server.url)
        assert (trained.exit_code, "trained a model" in trained.output) == (2, True)


def test_a_running_training_is_cancelled(tmp_path: Path, data: Path) -> None:
    with running_server(tmp_path / "data", workers=1) as server:
        job = training(server, data)
        server.client.cancel(job)
        assert server.client.wait(job, timeout_s=60).state == "cancelled"
        assert {model.source for model in server.client.models()} == {"packaged"}


def test_a_training_survives_the_death_of_the_server(tmp_path: Path, data: Path) -> None:
    with running_server(tmp_path / "data", workers=1) as server:
        job = training(server, data)
        server.stop(signal.SIGKILL)
    with running_server(tmp_path / "data", workers=1) as server:
        done = server.client.wait(job, timeout_s=120)
        assert (done.state, done.attempt) == ("finished", 2)
        trained = [model for model in server.client.models() if model.source == "trained"]
        assert [model.job for model in trained] == [job]
        kinds = [event.kind for event in server.client.events(job)]
        assert kinds.count("finished") == 1
        assert "crashed" in kinds


def test_the_client_names_what_cannot_be_trained(tmp_path: Path) -> None:
    with running_server(tmp_path / "data", workers=1) as server:
        assert isinstance(server.client, Client)
        told = needlebench("models", "train", tmp_path / "missing.npz", "--url", server.url)
        assert (told.exit_code, "DATA" in told.output) == (2, True)
        told = needlebench("models", "train", f"artefact:{'0' * 64}.npz", "--kind", "linear", "--url", server.url)
        assert (told.exit_code, "is not an upload of this service" in told.output) == (2, True)
        assert set(server.client.controllers()) >= {"ifem", "elm", "plugin"}
