"""Models over HTTP: what there is to steer by, and trainings, which are jobs like any other."""

from __future__ import annotations

import hashlib
import io
import json
import threading
from typing import TYPE_CHECKING, Any, get_args

import numpy as np
import pytest
from click.testing import CliRunner
from starlette.testclient import TestClient

from service.admission.training_request import ModelKind
from service.api.context import Service
from service.cli.main import main
from service.engine.slot import Signals, Slot
from service.files.upload_names import SCHEME
from service.settings import Limits
from service.store.job import Outcome
from service.worker.training_job import SETTINGS, STAGES, train_job
from simcore.learning.trained import PACKAGED, REGRESSORS, parse_model
from tests.service.http import finish, finish_training, idle_service
from tests.service.learned import dataset_bytes, model_bytes

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

pytestmark = pytest.mark.slow

JOBS, MODELS, UPLOADS = "/api/v1/jobs", "/api/v1/models", "/api/v1/uploads"
Both = tuple[TestClient, Service]


@pytest.fixture
def both(tmp_path: Path) -> Iterator[Both]:
    with idle_service(tmp_path / "data") as pair:
        yield pair


def sent(http: TestClient, data: bytes, name: str = "data.npz", kind: str = "dataset") -> Any:
    answer = http.post(UPLOADS, params={"kind": kind, "name": name}, content=data)
    assert answer.status_code in (200, 201), answer.text
    return answer.json()


def train(http: TestClient, **request: Any) -> Any:
    request.setdefault("data", sent(http, dataset_bytes())["reference"])
    return http.post(f"{MODELS}/train", json=request)


# ---- what there is


def test_the_models_that_come_along_say_how_they_were_trained(both: Both) -> None:
    http, _ = both
    items = http.get(MODELS).json()["items"]
    assert [item["id"] for item in items] == ["elm", "linear", "mlp"]
    elm = items[0]
    data = (PACKAGED / "elm.json").read_bytes()
    assert (elm["source"], elm["reference"], elm["nodes"], elm["seed"]) == ("packaged", "default", 25, 0)
    assert (elm["sha256"], elm["bytes"]) == (hashlib.sha256(data).hexdigest(), len(data))
    assert (elm["train_rows"], elm["test_rows"], len(elm["test_rmse_mm"])) == (9000, 1000, 3)
    assert elm["tissue"]["young_kpa"] == 6.3
    assert elm["needle"]["length_mm"] == 180.0
    assert http.get(elm["url"]).content == data
    detail = http.get(f"{MODELS}/elm").json()
    assert detail["provenance"]["insertions"] == 105
    assert {name: detail[name] for name in elm} == elm


def test_a_model_that_was_sent_in_is_listed_and_its_users_are_known(both: Both) -> None:
    http, service = both
    model = sent(http, model_bytes("linear"), "mine.json", "model")
    first = http.get(MODELS).json()["items"][0]
    assert (first["id"], first["reference"], first["source"]) == (model["id"], model["reference"], "uploaded")
    assert (first["kind"], first["name"], first["job"]) == ("linear", "mine.json", None)
    used = {"name": "mine", "controller": {"kind": "linear", "model": model["reference"]}}
    job = http.post(JOBS, json={"scenario": used})
    assert job.status_code == 202, job.text
    http.post(JOBS, json={"scenario": {"name": "theirs", "controller": {"kind": "linear"}}})
    assert [one["name"] for one in http.get(f"{MODELS}/{model['id']}").json()["used_by"]] == ["mine"]
    assert [one["name"] for one in http.get(f"{MODELS}/linear").json()["used_by"]] == ["theirs"]
    assert http.get(f"{MODELS}/elm").json()["used_by"] == []
    wrong = http.post(JOBS, json={"scenario": {"controller": {"kind": "elm", "model": model["reference"]}}})
    assert (wrong.status_code, wrong.json()["errors"][0]["field"]) == (422, "controller.model")
    finish(service)


@pytest.mark.parametrize("model_id", ["forest", "neighbours", "train", "0" * 64 + ".json"])
def test_what_is_no_model_is_404(both: Both, model_id: str) -> None:
    assert both[0].get(f"{MODELS}/{model_id}").status_code == 404


def test_a_mesh_or_a_data_set_is_no_model(both: Both) -> None:
    http, _ = both
    data = sent(http, dataset_bytes())
    assert http.get(f"{MODELS}/{data['id']}").status_code == 404
    assert len(http.get(MODELS).json()["items"]) == 3
    assert [one["id"] for one in http.get(UPLOADS, params={"kind": "dataset"}).json()["items"]] == [data["id"]]
    assert http.get(UPLOADS, params={"kind": "mesh"}).json()["items"] == []


def test_a_model_that_says_strange_things_of_itself_is_listed_without_them(both: Both) -> None:
    http, _ = both
    told = json.loads(model_bytes("linear"))
    told["provenance"] = {"test_rmse_mm": ["<b>", None, 1], "train_rows": True, "trained_on": [1], "split": {"a": 1}}
    told["provenance"] |= {"test_rows": 10**400, "train_rmse_mm": [10**400, 0, 0], "data_sha256": 5}
    model = sent(http, json.dumps(told).encode(), "odd.json", "model")
    found = http.get(f"{MODELS}/{model['id']}").json()
    names = ("test_rmse_mm", "train_rmse_mm", "train_rows", "test_rows", "tissue", "needle", "split", "data_sha256")
    for name in names:
        assert found[name] is None, name
    told["provenance"]["trained_on"] = {"tissue": {"young_kpa": 10**400, "size_mm": 5}, "needle": {"length_mm": "<b>"}}
    other = sent(http, json.dumps(told).encode(), "odder.json", "model")
    for address in (f"/models/{model['id']}", f"/models/{other['id']}", "/models"):
        page = http.get(address)
        assert page.status_code == 200
        assert "<b>" not in page.text


def test_every_kind_of_controller_is_told_with_its_schema(both: Both) -> None:
    http, _ = both
    items = {item["kind"]: item for item in http.get("/api/v1/controllers").json()["items"]}
    learned = {kind for kind, item in items.items() if item["learned"]}
    assert learned == set(REGRESSORS)
    assert {"ifem", "open_loop", "replay", "plugin", "frozen", "rigid"} <= set(items) - learned
    assert items["ifem"]["defaults"]["model"] == {"kind": "shared"}
    assert items["elm"]["defaults"] == {"kind": "elm", "model": "default", "model_sha256": None, "delay_s": 0.0}
    for item in items.values():
        assert item["description"]
        assert item["schema"]["properties"]["kind"]["default"] == item["kind"]


# ---- training


def test_the_settings_of_a_kind_are_those_of_its_regressor() -> None:
    assert set(get_args(ModelKind)) == set(SETTINGS) == set(REGRESSORS)
    for kind, names in SETTINGS.items():
        assert set(REGRESSORS[kind]().settings()) == set(names)


@pytest.mark.parametrize(
    ("request_", "settings"),
    [
        ({"kind": "elm", "nodes": 7, "seed": 3}, {"nodes": 7, "ridge": 1e-6, "weight_range": 1.0, "seed": 3}),
        ({"kind": "linear", "ridge": 0.5, "split": "trajectory"}, {"ridge": 0.5}),
        ({"kind": "neighbours", "neighbours": 2, "samples": 20}, {"neighbours": 2}),
    ],
)
def test_a_training_is_a_job_whose_model_can_be_named_at_once(
    both: Both, request_: dict[str, Any], settings: dict[str, Any]
) -> None:
    http, service = both
    answer = train(http, **request_)
    assert answer.status_code == 202, answer.text
    queued = answer.json()
    assert answer.headers["location"] == f"{JOBS}/{queued['id']}"
    assert (queued["kind"], queued["state"], queued["scenario"]) == ("training", "queued", None)
    assert queued["training"]["settings"] == settings
    assert queued["progress"]["steps"] == len(STAGES)
    finish_training(service)
    done = http.get(f"{JOBS}/{queued['id']}").json()
    assert (done["state"], done["links"]["recording"], done["links"]["series"]) == ("finished", None, None)
    model = http.get(done["links"]["model"]).json()
    assert (model["source"], model["job"], model["kind"]) == ("trained", queued["id"], request_["kind"])
    assert model["settings"] == settings
    assert model["split"] == request_.get("split", "sample")
    assert model["data_sha256"] == queued["training"]["data"][len(SCHEME) : len(SCHEME) + 64]
    assert done["metrics"]["test_rmse_mm"] == model["test_rmse_mm"]
    assert model["train_rows"] == request_.get("samples", 40 if request_.get("split") else 72)
    steer = {"controller": {"kind": model["kind"], "model": model["reference"]}}
    job = http.post(JOBS, json={"scenario": steer})
    assert job.status_code == 202, job.text
    assert job.json()["scenario"]["controller"]["model_sha256"] == model["sha256"]
    assert http.get(done["links"]["metrics"]).json()["digest"] == model["sha256"]
    assert http.get(f"/recordings/{queued['id']}.rrd").status_code == 404
    assert {"model.json", "result.json"} == {a["name"] for a in http.get(done["links"]["artefacts"]).json()["items"]}


def test_the_model_is_that_of_the_command_line(both: Both, tmp_path: Path) -> None:
    http, service = both
    (tmp_path / "data.npz").write_bytes(dataset_bytes())
    words = ["train", "--data", str(tmp_path / "data.npz"), "--out", str(tmp_path / "elm.json"), "--nodes", "9"]
    assert CliRunner().invoke(main, [*words, "--seed", "4"]).exit_code == 0
    train(http, nodes=9, seed=4)
    job = finish_training(service)
    assert job.result is not None
    ours = (tmp_path / "elm.json").read_bytes()
    assert job.result["digest"] == hashlib.sha256(ours).hexdigest()
    assert http.get(f"{MODELS}/{job.result['model']['id']}/content").content == ours
    assert parse_model(ours, "elm").provenance == job.result["model"]["provenance"]


def test_an_attempt_after_a_death_makes_the_same_model_and_keeps_it_once(both: Both) -> None:
    """Killed after the model was kept and before the job had finished."""
    http, service = both
    made = train(http).json()["id"]
    job = service.store.claim()
    assert job is not None
    folder = service.settings.data / job.folder
    folder.mkdir(parents=True)
    spec = {**(job.spec or {}), "job_id": job.id, "files": str(service.settings.uploads)}
    first = train_job(spec, folder)
    service.uploads.keep_made(folder / "model.json", job, first["model"])
    (recovered,) = service.store.recover()
    assert (recovered.state, recovered.kind) == ("queued", "training")
    again = finish_training(service)
    assert again.result is not None
    assert (again.id, again.attempt, again.result["digest"]) == (made, 2, first["digest"])
    trained = [one for one in http.get(MODELS).json()["items"] if one["source"] == "trained"]
    assert [one["job"] for one in trained] == [made]


def test_a_model_that_finds_no_room_is_told(tmp_path: Path) -> None:
    data = dataset_bytes()
    with idle_service(tmp_path, limits=Limits(uploads_mb=1e-6 * (len(data) + 100))) as (http, service):
        train(http, data=sent(http, data)["reference"])
        job = service.store.claim()
        assert job is not None
        folder = tmp_path / job.folder
        folder.mkdir(parents=True)
        spec = {**(job.spec or {}), "job_id": job.id, "files": str(service.settings.uploads)}
        signals = Signals(threading.Event(), threading.Event(), threading.Condition())
        slot = Slot(service.settings, service.store, signals, service.monitor, service.uploads, 0)
        done = slot._finish(job, Outcome(state="finished", result=train_job(spec, folder)))
        assert (done.state, done.error_kind, done.result) == ("failed", "disk", None)
        assert "at most" in (done.error or "")
        assert {path.suffix for path in service.settings.uploads.iterdir()} == {".npz"}


def test_the_same_key_is_the_same_training(both: Both) -> None:
    http, _ = both
    body = {"data": sent(http, dataset_bytes())["reference"]}
    headers = {"Idempotency-Key": "once"}
    first, again = (http.post(f"{MODELS}/train", json=body, headers=headers).json()["id"] for _ in range(2))
    assert first == again
    assert http.post(f"{MODELS}/train", json={**body, "nodes": 3}, headers=headers).status_code == 422


@pytest.mark.parametrize(
    ("request_", "field"),
    [
        ({"kind": "linear", "nodes": 5}, "nodes"),
        ({"kind": "neighbours", "seed": 1}, "seed"),
        ({"nodes": 0}, "nodes"),
        ({"nodes": 10_001}, "nodes"),
        ({"ridge": -1.0}, "ridge"),
        ({"kind": "forest"}, "kind"),
        ({"split": "time"}, "split"),
        ({"samples": 1}, "samples"),
        ({"data": "data.npz"}, "data"),
        ({"data": "artefact:" + "0" * 64 + ".npz"}, "data"),
        ({"kind": "mlp", "hidden": [0]}, "hidden.0"),
        ({"name": "\x07"}, "name"),
        ({"more": 1}, "more"),
    ],
)
def test_what_cannot_be_trained_is_named(both: Both, request_: dict[str, Any], field: str) -> None:
    told = train(both[0], **request_)
    assert told.status_code == 422, told.text
    assert [error["field"] for error in told.json()["errors"]] == [field]


def test_only_a_data_set_can_be_learned_from(both: Both) -> None:
    http, _ = both
    model = sent(http, model_bytes("linear"), "mine.json", "model")
    told = train(http, data=model["reference"])
    assert (told.status_code, told.json()["errors"][0]["field"]) == (422, "data")
    one = sent(http, dataset_bytes(insertions=1))
    told = train(http, data=one["reference"], split="trajectory")
    assert (told.status_code, told.json()["errors"][0]["field"]) == (422, "split")
    assert "0 rows to learn from" in told.json()["detail"]


def test_a_training_beyond_the_limits_is_refused_with_its_estimate(tmp_path: Path) -> None:
    with idle_service(tmp_path, limits=Limits(job_memory_mb=700)) as (http, _):
        told = train(http, nodes=10_000)
        assert (told.status_code, told.json()["errors"][0]["field"]) == (422, "nodes")
        assert "at most 700 are allowed here (estimate: 72 rows" in told.json()["detail"]
        wide = train(http, kind="mlp", hidden=[1000] * 5)
        assert (wide.status_code, wide.json()["errors"][0]["field"]) == (422, "hidden")


def test_a_data_set_stays_while_a_training_waits_for_it(both: Both) -> None:
    http, service = both
    data = sent(http, dataset_bytes())
    train(http, data=data["reference"])
    assert http.delete(f"{UPLOADS}/{data['id']}").status_code == 409
    finish_training(service)
    assert http.delete(f"{UPLOADS}/{data['id']}").status_code == 204


def test_a_training_is_no_measure_of_an_insertion(both: Both) -> None:
    http, service = both
    train(http)
    finish_training(service)
    assert service.store.latest_finished(10) == []


# ---- retry of what cannot run again


def test_a_retry_without_its_upload_is_409_and_names_the_field(both: Both) -> None:
    http, service = both
    model = sent(http, model_bytes("linear"), "mine.json", "model")
    steer = {"controller": {"kind": "linear", "model": model["reference"]}}
    insertion = http.post(JOBS, json={"scenario": steer}).json()["id"]
    data = sent(http, dataset_bytes())
    training = train(http, data=data["reference"]).json()["id"]
    for _ in range(2):
        job = service.store.claim()
        assert job is not None
        service.store.finish(job, Outcome(state="failed", error_kind="exception", error="no"))
    assert http.post(f"{JOBS}/{insertion}/retry").status_code == 202
    http.post(f"{JOBS}/{insertion}/cancel")
    for upload, job_id, field in ((model, insertion, "controller.model"), (data, training, "data")):
        assert http.delete(f"{UPLOADS}/{upload['id']}").status_code == 204
        told = http.post(f"{JOBS}/{job_id}/retry")
        assert (told.status_code, told.headers["content-type"]) == (409, "application/problem+json")
        (error,) = told.json()["errors"]
        assert (error["field"], error["value"]) == (field, upload["reference"])
        assert http.get(f"{JOBS}/{job_id}").json()["state"] in ("failed", "cancelled")
    sent(http, dataset_bytes())
    assert http.post(f"{JOBS}/{training}/retry").status_code == 202


# ---- scopes


def test_scopes_reach_as_far_as_they_say(tmp_path: Path) -> None:
    with idle_service(tmp_path, api_key="operator") as (http, _):
        operator = {"Authorization": "Bearer operator"}

        def key(scope: str) -> dict[str, str]:
            made = http.post("/api/v1/keys", json={"scope": scope}, headers=operator).json()["key"]
            return {"Authorization": f"Bearer {made}"}

        reader, one, other = key("read"), key("submit"), key("submit")
        query = {"kind": "dataset", "name": "data.npz"}
        assert http.post(UPLOADS, params=query, content=dataset_bytes(), headers=reader).status_code == 403
        data = http.post(UPLOADS, params=query, content=dataset_bytes(), headers=one).json()
        body = {"data": data["reference"]}
        assert http.get(MODELS).status_code == 401
        assert http.post(f"{MODELS}/train", json=body).status_code == 401
        assert http.get(MODELS, headers=reader).status_code == 200
        assert http.post(f"{MODELS}/train", json=body, headers=reader).status_code == 403
        assert http.post(f"{MODELS}/train", json=body, headers=other).status_code == 202
        assert http.post(f"{UPLOADS}/{data['id']}/pin", headers=reader).status_code == 403
        assert http.post(f"{UPLOADS}/{data['id']}/pin", headers=other).status_code == 403
        assert http.post(f"{UPLOADS}/{data['id']}/pin", headers=one).json()["pinned"] is True
        assert http.delete(f"{UPLOADS}/{data['id']}/pin", headers=other).status_code == 403
        assert http.delete(f"{UPLOADS}/{data['id']}", headers=operator).status_code == 409
        assert http.delete(f"{UPLOADS}/{data['id']}/pin", headers=one).status_code == 204


def test_a_job_folder_holds_progress_and_result(tmp_path: Path) -> None:
    uploads = tmp_path / "uploads"
    uploads.mkdir()
    data = dataset_bytes()
    name = f"{hashlib.sha256(data).hexdigest()}.npz"
    (uploads / name).write_bytes(data)
    settings = {"nodes": 5, "ridge": 1e-6, "weight_range": 1.0, "seed": 0}
    training = {"data": f"{SCHEME}{name}", "kind": "elm", "settings": settings, "split": "sample", "samples": None}
    folder = tmp_path / "job"
    folder.mkdir()
    result = train_job({"training": training, "job_id": "a", "files": str(uploads)}, folder)
    assert json.loads((folder / "result.json").read_text()) == result
    assert json.loads((folder / "progress.json").read_text()) == {"fraction": 1.0, "step": 3, "steps": 3}
    regressor = parse_model((folder / "model.json").read_bytes(), "elm").regressor
    with np.load(io.BytesIO(data)) as file:
        rows = file["test_by_sample"]
        X = np.hstack([file["base_position_m"][rows], file["tip_error_m"][rows]])
        error_mm = 1e3 * (regressor.predict(X) - file["base_step_m"][rows])
    assert result["metrics"]["test_rmse_mm"] == pytest.approx(np.sqrt(np.mean(error_mm**2, axis=0)).tolist())
