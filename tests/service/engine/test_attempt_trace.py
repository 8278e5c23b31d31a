"""What is kept of the way of an attempt that ended early."""

from __future__ import annotations

from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

from service.engine.attempt_trace import COURSE, MOST_POINTS, AttemptTrace, Point, kept_course

if TYPE_CHECKING:
    from pathlib import Path

JOB: Any = SimpleNamespace(id="a", attempt=1)
AGAIN: Any = SimpleNamespace(id="a", attempt=2)


def at(depth_mm: float) -> dict[str, Any]:
    return {"depth_mm": depth_mm, "tip_error_mm": 0.5 * depth_mm, "insertion_force_n": None}


def test_it_comes_back_as_it_was_and_is_of_its_own_attempt(tmp_path: Path) -> None:
    trace = AttemptTrace()
    for depth_mm in (0.0, 1.0, 2.5):
        trace.add(JOB, at(depth_mm))
    trace.keep(AGAIN, tmp_path)
    assert kept_course(tmp_path) == ()
    trace.keep(JOB, tmp_path)
    assert kept_course(tmp_path) == tuple(Point(d, 0.5 * d, None, None) for d in (0.0, 1.0, 2.5))
    assert [path.name for path in tmp_path.iterdir()] == [COURSE]


def test_nothing_hangs_on_it(tmp_path: Path) -> None:
    """No folder, a file that somebody else wrote, a value that JSON does not have: no plot, and no error."""
    trace = AttemptTrace()
    trace.add(JOB, at(1.0))
    trace.keep(JOB, tmp_path / "none")
    for text in ("", "[", "[1]", "[[1]]", "{}", "null", "[[1, 2, 3, 4, 5]]"):
        (tmp_path / COURSE).write_text(text)
        assert kept_course(tmp_path) == (), text
    (tmp_path / COURSE).unlink()
    trace.add(JOB, at(float("nan")))
    trace.keep(JOB, tmp_path)
    assert kept_course(tmp_path) == ()


def test_it_is_bounded() -> None:
    trace = AttemptTrace()
    for depth_mm in range(3 * MOST_POINTS):
        trace.add(JOB, at(depth_mm))
    points = trace.points_of(JOB)
    assert len(points) <= MOST_POINTS
    assert points[-1].depth_mm == 3 * MOST_POINTS - 1
