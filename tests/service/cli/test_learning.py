"""`needlebench dataset`, `train` and `example`: from nothing to a learned controller that steers."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from typing import TYPE_CHECKING

import numpy as np
import pytest
from click.testing import CliRunner, Result

from benchmarks.learning.training_insertions import Insertion, training_insertions
from service.cli import learning as cli_learn
from service.cli.main import main
from service.local import dataset_runs as local_many
from service.local.dataset_runs import InsertionCache
from simcore.learning import parse_model
from simcore.mesh.reader import load_mesh
from simcore.rollout.dataset import VARIABLES, load_dataset

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from pathlib import Path

    from benchmarks.cases import Case
    from service.local.case_runner import Where

COARSE = ("--set", "tissue.element_size_mm=12", "--set", "dt_s=0.05")


def invoke(*arguments: str | int | Path) -> Result:
    return CliRunner().invoke(main, [str(argument) for argument in arguments])


def table(seed: int) -> dict[str, np.ndarray]:
    rng = np.random.default_rng(seed)
    return {name: rng.normal(size=(30, 3)) for name in VARIABLES}


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """Insertions without a simulation."""

    def insertions(these: Sequence[Case], *, where: Where, cache: InsertionCache) -> Iterator[Insertion]:
        for case in these:
            done = Insertion(case, table(case.scenario["seed"]), "completed", "digest")
            cache.keep(done)
            yield done

    monkeypatch.setattr(local_many, "insertions", insertions)


@pytest.fixture
def data(tmp_path: Path, quick: None) -> Path:
    assert invoke("dataset", "--out", tmp_path / "data.npz", "--insertions", 12, "--samples", 300).exit_code == 0
    return tmp_path / "data.npz"


# ---- dataset


@pytest.mark.slow
def test_a_data_set_is_written_whole_and_its_parts_are_gone(data: Path) -> None:
    found = load_dataset(data)
    assert len(found.drawn) == 300
    assert len(found.end_point_m) == 12
    assert [path.name for path in data.parent.iterdir()] == ["data.npz"]


@pytest.mark.slow
def test_a_file_is_not_replaced_without_force(data: Path) -> None:
    before = data.read_bytes()
    refused = invoke("dataset", "--out", data, "--insertions", 2)
    assert refused.exit_code == 2
    assert "exists; use --force to replace it" in refused.output
    assert data.read_bytes() == before
    assert invoke("dataset", "--out", data, "--insertions", 2, "--force").exit_code == 0
    assert len(load_dataset(data).end_point_m) == 2


@pytest.mark.usefixtures("quick")
def test_fewer_steps_than_samples_are_said(tmp_path: Path) -> None:
    told = invoke("dataset", "--out", tmp_path / "few.npz", "--insertions", 2)
    assert "10000 samples were asked for, there are 60 steps" in told.output
    assert "2 insertions, 60 steps, 60 drawn (seed 0)" in told.output


def test_what_was_kept_is_found_again_and_only_that(tmp_path: Path) -> None:
    kept = InsertionCache(tmp_path / "parts")
    one, two = training_insertions(insertions=2, seed=0)
    kept.keep(Insertion(one, table(1), "completed", "abc"))
    again = kept.find(one)
    assert again is not None
    assert (again.status, again.digest) == ("completed", "abc")
    np.testing.assert_array_equal(again.table["tip_m"], table(1)["tip_m"])
    assert kept.find(two) is None
    assert kept.find(training_insertions(insertions=2, seed=1)[0]) is None
    next((tmp_path / "parts").glob("*.npz")).write_bytes(b"torn")
    assert kept.find(one) is None


@pytest.mark.slow
def test_real_insertions_a_model_of_them_and_a_run_by_it(tmp_path: Path) -> None:
    """Two workers; the same insertions in one process give the same bits; an ELM of them steers."""
    from simcore.rollout.dataset import table_one
    from simcore.rollout.rollout import run
    from simcore.scenario.scenario import Scenario

    done = invoke("dataset", "--out", tmp_path / "data.npz", "--insertions", 15, *COARSE)
    assert done.exit_code == 0, done.output
    found = load_dataset(tmp_path / "data.npz")
    middle = training_insertions(insertions=15, seed=0, changes=coarse_changes())[1]
    here = run(Scenario.load(middle.scenario))
    assert found.provenance["insertions"][1]["digest"] == here.digest
    np.testing.assert_array_equal(
        found.variables["base_step_m"][found.trajectory == 1], table_one(here.series)["base_step_m"]
    )
    model = tmp_path / "elm.json"
    assert invoke("train", "--data", tmp_path / "data.npz", "--out", model).exit_code == 0
    path = {"kind": "line", "target_mm": [20, 33, 60]}
    steered = {**middle.scenario, "noise_mm": 0.0, "trajectory": path}
    steered["controller"] = {"kind": "elm", "model": str(model)}
    assert run(Scenario.load(steered)).metrics["rmse_commanded_mm"] < 1.0


def coarse_changes() -> dict[str, object]:
    return {"tissue": {"element_size_mm": 12}, "dt_s": 0.05}


@pytest.mark.slow
@pytest.mark.skipif(os.name == "nt", reason="signals")
def test_an_interrupted_run_leaves_its_parts_and_no_process(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "service.cli", "dataset", "--out", str(tmp_path / "data.npz"), *COARSE]
    running = subprocess.Popen(command, stderr=subprocess.PIPE, text=True, start_new_session=True)
    try:
        parts, end = tmp_path / "data.npz.parts", time.monotonic() + 300
        while not list(parts.glob("*.npz")) and time.monotonic() < end and running.poll() is None:
            time.sleep(0.1)
        os.killpg(running.pid, signal.SIGINT)
        _, told = running.communicate(timeout=60)
    finally:
        running.kill()
    assert running.returncode == 130, told
    assert "interrupted" in told
    assert "Traceback" not in told
    assert list(parts.glob("*.npz"))
    assert not (tmp_path / "data.npz").exists()
    assert gone(running.pid, within_s=20)


def gone(group: int, *, within_s: float) -> bool:
    """Whether no process of the group is left."""
    end = time.monotonic() + within_s
    while time.monotonic() < end:
        try:
            os.killpg(group, 0)
        except ProcessLookupError:
            return True
        time.sleep(0.1)
    return False


# ---- train


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["elm", "linear", "neighbours", "mlp"])
def test_each_kind_is_trained_and_told(data: Path, kind: str) -> None:
    path = data.with_name("model.json")
    done = invoke("train", "--data", data, "--out", path, "--kind", kind, "--hidden", "4,3", "--split", "trajectory")
    assert done.exit_code == 0, done.output
    assert "RMSE of Delta P, mm" in done.output
    model = parse_model(path.read_bytes(), kind)
    assert model.provenance["split"] == "trajectory"
    assert f"test  {model.provenance['test_rows']:>7} rows" in done.output
    assert invoke("train", "--data", data, "--out", path, "--kind", kind).exit_code == 2


@pytest.mark.slow
def test_the_same_command_gives_the_same_file(data: Path) -> None:
    files = [data.with_name(f"{n}.json") for n in "abc"]
    for path, seed in zip(files, (1, 1, 2), strict=True):
        assert invoke("train", "--data", data, "--out", path, "--seed", seed, "--nodes", 7).exit_code == 0
    one, same, other = (path.read_bytes() for path in files)
    assert one == same != other
    assert json.loads(one)["settings"] == {"nodes": 7, "ridge": 1e-6, "weight_range": 1.0, "seed": 1}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--data", "none.npz"], "--data = 'none.npz': cannot be read as a data set: No such file"),
        (["--kind", "mlp", "--hidden", "a,b"], "--hidden = 'a,b': must be whole numbers"),
        (["--kind", "mlp", "--hidden", "0"], "hidden = [0]"),
        (["--kind", "tree"], "'tree' is not one of"),
    ],
)
def test_wrong_arguments_are_one_line(data: Path, arguments: list[str], message: str) -> None:
    done = invoke("train", "--data", data, "--out", data.with_name("model.json"), *arguments)
    assert done.exit_code == (1 if "hidden = [" in message else 2)
    assert message in done.output
    assert not data.with_name("model.json").exists()


@pytest.mark.slow
def test_without_scikit_learn_the_mlp_says_what_to_install(data: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "sklearn", None)
    (missing := data.with_name("none.npz")).unlink(missing_ok=True)
    done = invoke("train", "--data", missing, "--out", data.with_name("model.json"), "--kind", "mlp")
    assert done.exit_code == 1  # before the data set is looked for
    assert "pip install 'needlebench[baselines]'" in done.output


# ---- example


def test_the_example_is_short_and_says_how_to_register() -> None:
    text = invoke("example", "controller").output
    assert len(text.splitlines()) < 60
    assert '[project.entry-points."needlebench.controllers"]' in text
    compile(text, "mine.py", "exec")
    assert "needlebench example controller" in str(cli_learn.example.help)


@pytest.mark.slow
def test_the_example_runs_as_it_is_and_beats_the_rigid_needle(tmp_path: Path) -> None:
    (tmp_path / "mine.py").write_text(invoke("example", "controller").output)
    done = subprocess.run([sys.executable, tmp_path / "mine.py"], capture_output=True, text=True, check=True)
    rigid, plugin = done.stdout.splitlines()
    assert rigid.startswith("rigid completed")
    assert plugin.startswith("plugin completed")
    assert float(plugin.split()[-2]) < float(rigid.split()[-2])


@pytest.mark.slow
def test_the_example_mesh_is_small_and_has_named_groups(tmp_path: Path) -> None:
    """What is printed is a mesh that the reader takes, with every group that the help names."""
    text = invoke("example", "mesh").output
    assert len(text) < 100_000
    (tmp_path / "barrel.msh").write_text(text)
    names = ("top", "side", "base", "tissue")
    mesh = load_mesh(str(tmp_path / "barrel.msh"), unit_mm=1.0, names=names, sha256=None)
    assert len(mesh.nodes_m) == 488
    z = mesh.nodes_m[:, 2]
    np.testing.assert_allclose(z[mesh.sets["base"]], 0.06)
    assert z[mesh.sets["top"]].min() == 0.0
    assert len(mesh.sets["tissue"]) == len(mesh.nodes_m)
    assert "needlebench example mesh" in str(cli_learn.example.help)


@pytest.mark.slow
def test_a_needle_is_steered_in_the_example_mesh(tmp_path: Path) -> None:
    from simcore.rollout.rollout import run
    from simcore.scenario.scenario import Scenario

    (tmp_path / "barrel.msh").write_text(invoke("example", "mesh").output)
    tissue = {"mesh_file": str(tmp_path / "barrel.msh"), "fixed_sets": ["base"]}
    path = {"kind": "line", "entry_mm": [0, 0, 0], "target_mm": [4, 3, 45]}
    steered, pushed = (
        run(Scenario.load({"dt_s": 0.02, "tissue": tissue, "trajectory": path, "controller": {"kind": kind}}))
        for kind in ("ifem", "open_loop")
    )
    assert steered.success
    assert steered.metrics["rmse_commanded_mm"] < 0.05 * pushed.metrics["rmse_commanded_mm"]
