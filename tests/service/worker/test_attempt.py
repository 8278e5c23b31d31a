"""An attempt in this process, with the real simulation and a plug-in that goes wrong."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import pytest

from needlebench import Scenario
from service.settings import RUNNER
from service.worker.attempt import WorkerStop, execute
from service.worker.failures import MOST_CHARACTERS, described, described_with_place, storable
from service.worker.specs import InsertionSpec
from simcore import plugins

if TYPE_CHECKING:
    from pathlib import Path


def attempt(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, error: BaseException) -> Any:
    class Faulty:
        def command(self, _observation: Any) -> Any:
            raise error

    monkeypatch.setitem(plugins._registered, "faulty", lambda *_: Faulty())
    wanted = {
        "trajectory": {"kind": "line", "target_mm": [18, 31, 10]},
        "controller": {"kind": "plugin", "name": "faulty"},
        "tissue": {"element_size_mm": 10},
    }
    scenario = Scenario.load(wanted).resolved()
    spec = InsertionSpec(job_id="a", scenario=scenario, files=tmp_path)
    return execute(RUNNER, spec.to_json(), str(tmp_path / "1"))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("error", "told"),
    [
        (SystemExit(3), "SystemExit: 3 (controller 'faulty', step 0) ("),
        (KeyboardInterrupt(), "KeyboardInterrupt (controller 'faulty', step 0) ("),
        (GeneratorExit(), "GeneratorExit (controller 'faulty', step 0) ("),
    ],
)
def test_what_ends_a_process_is_reported_and_the_recording_closed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, error: BaseException, told: str
) -> None:
    report = attempt(tmp_path, monkeypatch, error)
    assert (report.result, report.error_kind) == (None, "exception")
    assert report.error.startswith(told)
    assert "(test_attempt.py, line " in report.error
    assert {file["name"] for file in report.artefacts} == {"recording.rrd", "job.log"}
    assert type(error).__name__ in (tmp_path / "1" / "job.log").read_text()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("error", "told"),
    [(StopIteration(), "StopIteration ("), (ValueError("\ud800"), "ValueError: \\ud800 (")],
)
def test_what_a_plug_in_raises_is_an_end_by_name_with_all_files(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, error: BaseException, told: str
) -> None:
    report = attempt(tmp_path, monkeypatch, error)
    assert report.result["status"] == "controller_failed"
    assert report.result["message"].startswith(f"step 1 of 100, depth 0.0 mm: controller 'faulty': {told}")
    assert "(test_attempt.py, line " in report.result["message"]
    assert {"result.json", "series.npz", "recording.rrd"} <= {file["name"] for file in report.artefacts}


def test_a_stop_is_no_fault_of_the_job(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    codes: list[int] = []

    def end(code: int) -> None:
        codes.append(code)
        raise SystemExit(code)

    monkeypatch.setattr("os._exit", end)
    with pytest.raises(SystemExit):
        attempt(tmp_path, monkeypatch, WorkerStop())
    assert codes == [143]


def test_a_message_is_short_and_can_be_encoded_whatever_it_was() -> None:
    assert storable("tip \u00b5m") == "tip \u00b5m"
    assert storable("\ud800" * 10_000).encode().startswith(b"\\ud800\\ud800")
    assert storable("x" * 3000) == "x" * MOST_CHARACTERS + "... (3000 characters)"
    assert described(KeyError("a")) == "KeyError: 'a'"
    assert described(type("E" * 5000, (Exception,), {})()).endswith("... (5000 characters)")
    assert described_with_place(ValueError("never raised")) == "ValueError: never raised"
