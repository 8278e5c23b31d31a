"""The progress file: what it tells, and how seldom it is written."""

from __future__ import annotations

from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from service.files.replace_text import replace_text
from service.worker import progress
from service.worker.progress import ProgressFile
from simcore.scenario.scenario import Scenario

if TYPE_CHECKING:
    from pathlib import Path


def record(step: int, **values: Any) -> Any:
    """A step record with what progress reads: the tip 0.3 mm beside the path and 0.4 mm behind its target."""
    target = np.array([0.018, 0.031, 0.010])
    known = {
        "target_m": target,
        "depth_m": 0.0096,
        "tip_m": target + np.array([0.0003, 0.0, -0.0004]),
        "insertion_force_n": 1.25,
    }
    return SimpleNamespace(step=step, **{**known, **values})


def scene(steps: int = 10, **trajectory: Any) -> Any:
    line = np.array([[0.018, 0.031, 0.0], [0.018, 0.031, 0.122]])
    return SimpleNamespace(scenario=Scenario.load({"trajectory": trajectory}), steps=steps, path_m=line)


@pytest.mark.parametrize(("frame", "lateral_mm"), [("world", 0.3), ("tissue", None)])
def test_it_tells_error_and_force(tmp_path: Path, frame: str, lateral_mm: float | None) -> None:
    told = ProgressFile(tmp_path, clock=iter(range(10)).__next__)
    told.begin(scene(frame=frame), record(0))
    told.step(record(5))
    found = progress.read(tmp_path)
    assert found is not None
    assert (found["step"], found["fraction"], found["depth_mm"]) == (5, 0.5, 9.6)
    assert (found["tip_error_mm"], found["insertion_force_n"]) == (0.5, 1.25)
    assert found["cross_track_mm"] == lateral_mm


def test_the_error_is_that_of_rmse_mm(tmp_path: Path) -> None:
    """Against the target that the command of the step was made for, that of the record before."""
    moments = iter(range(10))
    told = ProgressFile(tmp_path, clock=lambda: float(next(moments)))
    aim = np.array([0.0, 0.0, 0.01])
    told.begin(scene(), record(0, target_m=aim))
    told.step(record(1, target_m=aim + np.array([0, 0, 0.001]), tip_m=aim + np.array([0.0002, 0, 0])))
    assert (progress.read(tmp_path) or {})["tip_error_mm"] == 0.2


def test_the_last_step_of_a_run_that_stopped_early_is_told(tmp_path: Path) -> None:
    told = ProgressFile(tmp_path, clock=lambda: 0.0)
    told.begin(scene(), record(0))
    told.step(record(1))
    told.step(record(2, depth_m=0.0042))
    assert (progress.read(tmp_path) or {})["step"] == 0
    told.end(SimpleNamespace(status="inverted"))  # type: ignore[arg-type]
    last = progress.read(tmp_path) or {}
    assert (last["step"], last["depth_mm"]) == (2, 4.2)


def test_it_is_written_twice_a_second_at_most_and_at_the_end(tmp_path: Path) -> None:
    moments = [0.0]
    told = ProgressFile(tmp_path, clock=lambda: moments[0])
    told.begin(scene(steps=1001), record(0))
    seen = set()
    for step in range(1, 1002):
        moments[0] = 1e-3 * step
        told.step(record(step))
        seen.add((progress.read(tmp_path) or {})["step"])
    assert seen == {0, 500, 1000, 1001}


@pytest.mark.parametrize(
    "text",
    [
        '{"step": NaN}',
        '{"step": -Infinity}',
        '{"step": 1',
        "[1]",
        "[" * 50_000,
        '{"a": "' + "x" * 70_000 + '"}',
        "\x00",
    ],
)
def test_progress_that_cannot_be_stored_is_none(tmp_path: Path, text: str) -> None:
    (tmp_path / progress.NAME).write_text(text)
    assert progress.read(tmp_path) is None


def test_half_a_surrogate_pair_in_progress_is_a_question_mark(tmp_path: Path) -> None:
    (tmp_path / progress.NAME).write_text(r'{"note": "\ud800"}')
    assert progress.read(tmp_path) == {"note": "?"}


def test_a_progress_that_has_not_changed_is_not_read_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    reader = progress.ProgressReader(tmp_path)
    assert reader.latest() is None
    replace_text(tmp_path / progress.NAME, '{"step": 1}')
    assert reader.latest() == {"step": 1}
    reads: list[Path] = []
    read = progress.read

    def counted(folder: Path) -> Any:
        reads.append(folder)
        return read(folder)

    monkeypatch.setattr(progress, "read", counted)
    assert reader.latest() == {"step": 1}
    assert reads == []
    replace_text(tmp_path / progress.NAME, '{"step": 2}')
    assert (reader.latest(), len(reads)) == ({"step": 2}, 1)
