"""Figures, the stored report and the comparison of two."""

from __future__ import annotations

import copy
import json
import math
from typing import TYPE_CHECKING, Any

import pytest

from benchmarks.bench_comparison import Verdict, compare, regressions, table
from benchmarks.bench_report import FIGURE_FIELDS, SCHEMA, busy, document, load_report
from benchmarks.measurements import TARGETS, Part, Table, Target, figure, figure_table, missing_figure
from simcore.errors import ScenarioError

if TYPE_CHECKING:
    from pathlib import Path

DATE = "2026-01-02T03:04:05+00:00"


def report(**figures: tuple[str, list[float]]) -> dict[str, Any]:
    """figures: key with __ for . -> better and values."""
    made = tuple(
        figure(key.replace("__", "."), "ms", values, better=better)  # type: ignore[arg-type]
        for key, (better, values) in figures.items()
    )
    return document({"made": Part(made)}, date=DATE, quick=False, load_before=0.1, load_after=None)


# ---- figures


def test_median_iqr_and_target() -> None:
    made = figure("start.warm_s", "s", [1.0, 2.0, 3.0, 4.0, 100.0])
    assert (made.median, made.iqr, made.met) == (3.0, 2.0, False)
    assert figure("start.warm_s", "s", [1.0]).met is True
    assert figure("realtime.line", "x", [3.9], better="higher").met is False
    assert figure("realtime.line", "x", [4.0], better="higher").met is True
    assert figure("unknown", "s", [2.5]).met is None
    assert figure("unknown", "s", [2.5], target=Target(2.0)).met is False


def test_what_was_not_measured_has_no_value_and_says_why() -> None:
    made = missing_figure("start.cold_s", "s", "left out")
    assert made.as_json() == {
        "median": None,
        "iqr": None,
        "runs": 0,
        "unit": "s",
        "better": "lower",
        "target": {"at_most": 15.0},
        "met": None,
        "note": "left out",
    }
    assert figure("one run", "s", [1.0]).iqr is None


def test_targets_are_those_of_the_specification() -> None:
    bounds = {key: (target.sense, target.bound) for key, target in TARGETS.items()}
    assert bounds == {
        "step.line.plant_in_limits": ("at_most", 0.9),
        "step.sine.plant_in_limits": ("at_most", 1.0),
        "step.line.in_limits": ("at_most", 1.1),
        "step.sine.in_limits": ("at_most", 1.2),
        "step.sine.exact_in_limits": ("at_most", 15.0),
        "jacobian.perturbation.in_limits": ("at_most", 12.0),
        "realtime.line": ("at_least", 4.0),
        "realtime.sine": ("at_least", 4.0),
        "step.sine.p99_over_median": ("at_most", 5.0),
        "scaling.depth.ratio": ("at_most", 1.5),
        "recording.ratio": ("at_most", 1.05),
        "recording.realtime": ("at_least", 3.8),
        "throughput.two_over_one": ("at_least", 1.9),
        "start.warm_s": ("at_most", 1.0),
        "start.cold_s": ("at_most", 15.0),
        "memory.1617_mb": ("at_most", 400.0),
        "memory.4743_mb": ("at_most", 700.0),
    }


def test_tables_as_markdown() -> None:
    made = Table("t", ("name", "value"), (("a", 1.23456), ("b", None)))
    assert made.markdown() == "| name | value |\n| --- | ---: |\n| a | 1.235 |\n| b | - |\n"
    row = figure_table({"p": Part((figure("start.warm_s", "s", [3.0]),))}).rows[0]
    assert row == ("start.warm_s", 3.0, None, 1, "s", "<= 1", "missed", "")


# ---- the report


def test_report_has_schema_origin_and_figures() -> None:
    made = report(a__b=("lower", [1.0, 2.0]))
    assert made["schema"] == SCHEMA == "needlebench/bench/1"
    assert made["date"] == DATE
    assert {"python", "numpy", "scipy", "numba"} <= set(made["versions"])
    assert set(made["machine"]) == {"cpu", "cpu_count", "platform", "threads", "load_before", "load_after"}
    assert set(made["figures"]["a.b"]) == set(FIGURE_FIELDS)
    assert json.loads(json.dumps(made, allow_nan=False)) == made


def test_a_report_is_read_back_and_other_files_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "report.json"
    made = report(a__b=("lower", [1.0, 2.0]))
    path.write_text(json.dumps(made))
    assert load_report(path) == made
    broken = copy.deepcopy(made)
    del broken["figures"]["a.b"]["iqr"]
    for text, why in (
        ("{", "not readable"),
        ("[]", "not a report"),
        ('{"schema": "needlebench/bench/2", "figures": {}}', "not a report"),
        (json.dumps(broken), "lacks iqr"),
    ):
        path.write_text(text)
        with pytest.raises(ScenarioError, match=why):
            load_report(path)
    with pytest.raises(ScenarioError, match="not readable"):
        load_report(tmp_path / "absent.json")


def test_a_busy_machine_is_named() -> None:
    assert busy(None) is None
    assert busy(0.1) is None
    assert "load average 2.50" in (busy(2.5) or "")


# ---- comparison


def verdicts(a: dict[str, Any], b: dict[str, Any]) -> dict[str, Verdict]:
    return {change.key: change.verdict for change in compare(a, b)}


def test_a_report_equals_itself() -> None:
    made = report(x=("lower", [1.0, 1.1]), y=("higher", [3.0]))
    changes = compare(made, made)
    assert {change.verdict for change in changes} == {Verdict.SAME}
    assert regressions(changes) == []


def test_changes_count_beyond_the_quartiles_of_both() -> None:
    steady, loose = [1.0, 1.0, 1.0, 1.0], [0.8, 0.9, 1.1, 1.2]
    a = report(steady=("lower", steady), loose=("lower", loose))
    b = report(steady=("lower", [1.05] * 4), loose=("lower", [v + 0.1 for v in loose]))
    assert verdicts(a, b) == {"steady": Verdict.WORSE, "loose": Verdict.SAME}
    assert verdicts(b, a) == {"steady": Verdict.BETTER, "loose": Verdict.SAME}
    far = report(steady=("lower", [1.02] * 4), loose=("lower", [v + 1.0 for v in loose]))
    assert verdicts(a, far) == {"steady": Verdict.SAME, "loose": Verdict.WORSE}


def test_more_is_better_where_the_figure_says_so() -> None:
    a, b = report(x=("higher", [2.0, 2.0])), report(x=("higher", [3.0, 3.0]))
    assert verdicts(a, b) == {"x": Verdict.BETTER}
    (change,) = regressions(compare(b, a))
    assert change.percent == pytest.approx(-100.0 / 3.0)


def test_a_single_run_has_to_differ_by_more() -> None:
    a = report(x=("lower", [1.0]))
    assert verdicts(a, report(x=("lower", [1.1]))) == {"x": Verdict.SAME}
    assert verdicts(a, report(x=("lower", [1.3]))) == {"x": Verdict.WORSE}


def test_what_only_one_report_has_is_shown_and_is_no_regression() -> None:
    a, b = report(x=("lower", [1.0]), gone=("lower", [1.0])), report(x=("lower", [1.0]), new=("lower", [1.0]))
    assert verdicts(a, b) == {"x": Verdict.SAME, "gone": Verdict.ONLY_A, "new": Verdict.ONLY_B}
    assert regressions(compare(a, b)) == []
    empty = report(x=("lower", []), gone=("lower", [1.0]))
    assert verdicts(a, empty)["x"] is Verdict.ONLY_A
    assert verdicts(empty, empty) == {"gone": Verdict.SAME}
    assert table(compare(a, b)).rows[1][:4] == ("gone", 1.0, None, "")


def test_quick_and_full_reports_do_not_compare() -> None:
    a = report(x=("lower", [1.0]))
    with pytest.raises(ScenarioError, match="do not compare"):
        compare(a, {**a, "quick": True})
    with pytest.raises(ScenarioError, match="do not compare"):
        compare(a, {**a, "limit": "L0/2"})


@pytest.mark.parametrize("broken", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("better", ["lower", "higher"])
def test_figures_that_are_no_numbers_never_win(broken: float, better: str) -> None:
    sound, odd = report(x=(better, [1.0])), report(x=(better, [1.0]))
    odd["figures"]["x"]["median"] = broken
    assert verdicts(sound, odd) == {"x": Verdict.WORSE}
    assert verdicts(odd, sound) == {"x": Verdict.ONLY_B}
    assert verdicts(odd, odd) == {"x": Verdict.SAME}
