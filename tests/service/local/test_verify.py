"""A result is run again: the same, nearly the same, and not the same are told apart."""

from __future__ import annotations

import json
import shutil
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from click.testing import CliRunner, Result

from service.cli.main import main
from service.local.verify import CannotVerifyError, changed, check_arm, compare, first_difference
from service.store.job import Outcome
from service.worker.attempt import run_job
from service.worker.specs import InsertionSpec
from simcore.arms import arm_of
from simcore.rollout import artefacts
from simcore.rollout.digest import digest
from simcore.rollout.rollout import run
from simcore.scenario.scenario import Scenario
from tests.service.http import idle_service
from tests.service.learned import model_bytes

if TYPE_CHECKING:
    from pathlib import Path

    from simcore.rollout.result import Rollout

SHORT: dict[str, Any] = {
    "name": "short",
    "tissue": {"element_size_mm": 10},
    "trajectory": {"kind": "line", "target_mm": [18, 31, 3]},
    "recording": {"enabled": True, "every_steps": 7},
}


@pytest.fixture(scope="module")
def rollout() -> Rollout:
    return run(Scenario.load(SHORT))


def needlebench(*words: str) -> Result:
    return CliRunner().invoke(main, words, env={"NEEDLEBENCH_URL": None})


def stored(rollout: Rollout, folder: Path, **changes: Any) -> Path:
    """The result's files, with arrays changed: the digest fits them."""
    artefacts.write(rollout, folder)
    series = {**rollout.series, **changes}
    np.savez(folder / "series.npz", **series)
    result = json.loads((folder / "result.json").read_text())
    (folder / "result.json").write_text(json.dumps({**result, "digest": digest(series)}))
    return folder / "result.json"


@pytest.mark.slow
def test_an_untouched_result_is_identical(rollout: Rollout, tmp_path: Path) -> None:
    told = needlebench("verify", str(stored(rollout, tmp_path)))
    assert (told.exit_code, told.output.splitlines()[0]) == (0, "identical: every bit of every state")
    assert rollout.digest in told.output


@pytest.mark.slow
def test_a_last_bit_is_equal_and_a_micrometre_is_different(rollout: Rollout, tmp_path: Path) -> None:
    tip = rollout.series["tip_m"].copy()
    tip[5, 2] += 5e-10
    near = needlebench("verify", str(stored(rollout, tmp_path / "near", tip_m=tip)), "--json")
    verdict = json.loads(near.output)
    assert (near.exit_code, verdict["verdict"], verdict["first"]["step"]) == (0, "equal", 5)
    assert verdict["tip_mm"] == pytest.approx(5e-7)
    tip[9, 0] += 1e-6
    far = needlebench("verify", str(stored(rollout, tmp_path / "far", tip_m=tip)))
    assert far.exit_code == 1
    assert far.output.startswith("different\n")
    assert "first difference   step 5, tip_m" in far.output
    assert "up to 0.001 mm away" in far.output


def test_without_the_series_only_the_digest_is_compared(rollout: Rollout, tmp_path: Path) -> None:
    path = stored(rollout, tmp_path, depth_m=rollout.series["depth_m"] + 1)
    (tmp_path / "series.npz").unlink()
    told = needlebench("verify", str(path))
    assert told.exit_code == 1
    assert "no series.npz was found" in told.output


def test_another_end_is_different_however_near_the_tip_is(rollout: Rollout) -> None:
    result = {**rollout.result(), "digest": "0", "status": "not_converged"}
    verdict = compare(result, rollout.series, rollout)
    assert (verdict.verdict, verdict.tip_mm) == ("different", 0.0)


@pytest.mark.parametrize("content", ["[]", "{}", '{"digest": "a"}', "no json", '{"provenance": {"scenario": {}}}'])
def test_what_is_no_result_is_bad_input(tmp_path: Path, content: str) -> None:
    path = tmp_path / "result.json"
    path.write_text(content)
    told = needlebench("verify", str(path))
    assert (told.exit_code, "RESULT" in told.output) == (2, True)


@pytest.fixture(scope="module")
def steered(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    """A data folder with a job that steered by an uploaded model, and the id of the job."""
    data = tmp_path_factory.mktemp("steered")
    with idle_service(data) as (http, service):
        query = {"kind": "model", "name": "mine.json"}
        model = http.post("/api/v1/uploads", params=query, content=model_bytes("linear")).json()
        controller = {"kind": "linear", "model": model["reference"]}
        http.post("/api/v1/jobs", json={"scenario": {**SHORT, "controller": controller}})
        job = service.store.claim()
        assert job is not None
        folder = data / job.folder
        spec = InsertionSpec(job_id=job.id, scenario=(job.spec or {})["scenario"], files=service.settings.uploads)
        folder.mkdir(parents=True)
        service.store.finish(job, Outcome(state="finished", result=run_job(spec.to_json(), folder)))
    return data, job.id


@pytest.mark.slow
def test_a_job_that_names_an_upload_is_run_again_from_its_data_folder(steered: tuple[Path, str]) -> None:
    data, job_id = steered
    told = needlebench("verify", job_id, "--data", str(data))
    assert (told.exit_code, told.output.splitlines()[0]) == (0, "identical: every bit of every state")
    told = needlebench("verify", str(data / "jobs" / job_id / "1" / "result.json"))
    assert told.output.startswith("identical")
    told = needlebench("verify", "0123456789abcdef", "--data", str(data))
    assert (told.exit_code, "there is no job" in told.output) == (2, True)


@pytest.mark.slow
def test_a_result_whose_upload_cannot_be_found_says_so(steered: tuple[Path, str], tmp_path: Path) -> None:
    data, job_id = steered
    for name in ("result.json", "series.npz"):
        shutil.copy(data / "jobs" / job_id / "1" / name, tmp_path / name)
    result = str(tmp_path / "result.json")
    lost = needlebench("verify", result)
    assert lost.exit_code == 2
    assert "controller.model" in lost.output
    assert "is an upload of a service" in lost.output
    assert "--data" in lost.output
    (tmp_path / "empty").mkdir()
    empty = needlebench("verify", result, "--data", str(tmp_path / "empty"))
    assert (empty.exit_code, "does not have it" in empty.output) == (2, True)
    assert needlebench("verify", result, "--data", str(data)).output.startswith("identical")
    nothing = needlebench("verify", job_id, "--data", str(tmp_path / "empty"))
    assert (nothing.exit_code, "is not a data folder" in nothing.output) == (2, True)


def test_neither_a_file_nor_an_id(tmp_path: Path) -> None:
    told = needlebench("verify", str(tmp_path / "missing.json"))
    assert (told.exit_code, "neither a file nor the id of a job" in told.output) == (2, True)


def test_the_first_difference_is_found_among_arrays_of_several_shapes() -> None:
    arrays = {"depth_m": np.zeros(4), "target_m": np.zeros((4, 2)), "violation_m": np.full(4, np.nan)}
    before = {**arrays, "plant_s": np.zeros(4)}  # a clock reading, which is not compared
    now = {name: array.copy() for name, array in before.items()}
    assert first_difference(before, now) is None
    now["plant_s"][0], now["depth_m"][3], now["target_m"][2] = 1.0, 5.0, [0.0, -2.0]
    found = first_difference(before, now)
    assert found is not None
    assert (found.array, found.step, found.before, found.now, found.largest) == ("target_m", 2, 0.0, -2.0, 2.0)
    now["violation_m"][1] = 1.0
    found = first_difference(before, now)
    assert found is not None
    assert (found.array, found.step) == ("violation_m", 1)


def test_what_changed_since_is_named() -> None:
    then = {"commit": "a", "cpu": "x", "versions": {"numpy": "1", "numba": "2"}}
    now = {"commit": "b", "cpu": "x", "versions": {"numpy": "1", "numba": "3", "scipy": "4"}}
    assert changed(then, now) == {"commit": ["a", "b"], "numba": ["2", "3"], "scipy": [None, "4"]}


def test_a_broken_series_is_named(rollout: Rollout, tmp_path: Path) -> None:
    path = stored(rollout, tmp_path)
    (tmp_path / "series.npz").write_bytes(b"PK broken")
    told = needlebench("verify", str(path))
    assert told.exit_code == 2
    assert "series.npz cannot be read" in told.output
    with pytest.raises(CannotVerifyError):
        compare({"digest": "0"}, None, rollout)


@pytest.mark.slow
def test_another_processor_or_blas_is_listed_and_blamed_for_nothing(rollout: Rollout, tmp_path: Path) -> None:
    path = stored(rollout, tmp_path)
    result = json.loads(path.read_text())
    origin = result["provenance"]
    assert origin["llvm_cpu"]
    assert {"blas_core", "blas_version"} <= origin.keys()
    same = needlebench("verify", str(path))
    assert "another processor" not in same.stderr
    path.write_text(json.dumps({**result, "digest": "0" * 64}))
    assert "another processor" not in needlebench("verify", str(path)).stderr
    features = f"{origin['llvm_features']} avx9000"
    path.write_text(json.dumps({**result, "provenance": {**origin, "blas_core": "P5", "llvm_features": features}}))
    other = needlebench("verify", str(path))
    assert other.exit_code == 0
    assert "another processor" not in other.stderr
    assert f"blas_core          P5 -> {origin['blas_core']}" in other.stdout
    assert "llvm_features      with avx9000 -> without" in other.stdout
    path.write_text(json.dumps({**json.loads(path.read_text()), "digest": "0" * 64}))
    told = "the kernels or the BLAS are for another processor than then, which alone changes no bit"
    assert told in needlebench("verify", str(path)).stderr


def test_a_run_that_was_steered_from_another_process_cannot_be_verified() -> None:
    arm = arm_of(Scenario.load({"controller": {"kind": "remote", "name": "mine"}}).resolved())
    with pytest.raises(CannotVerifyError, match="'mine' steered from another process"):
        check_arm({}, arm)
