"""How far an experiment is, on lines: what was run before is not counted as work."""

from __future__ import annotations

from typing import TYPE_CHECKING

from benchmarks.cases import Case, Outcome
from benchmarks.paper.plan import Stage
from service.local.paper_progress import LINE_EVERY_S, Lines

if TYPE_CHECKING:
    import pytest


def test_the_time_left_is_that_of_what_was_not_run_before(capsys: pytest.CaptureFixture[str]) -> None:
    now = 0.0
    cases = [Case(name, {}, {}) for name in ("before", "first", "second", "third")]
    lines = Lines({"before": 0.0, "first": 10.0, "second": 10.0, "third": 20.0}, clock=lambda: now)
    lines.begin(Stage("experiments", tuple(cases)))
    for case, took_s in zip(cases, (LINE_EVERY_S, 40.0, 40.0, 80.0), strict=True):
        now += took_s
        lines.ended(Outcome(case, {}))
    assert capsys.readouterr().err.splitlines() == [
        "experiments: 4 insertions",
        "experiments: 1 of 4",
        "experiments: 2 of 4; 25 %, about 3.0 min left",
        "experiments: 3 of 4; 50 %, about 1.7 min left",
        "experiments: 4 of 4; 100 %, about 0 s left",
    ]
