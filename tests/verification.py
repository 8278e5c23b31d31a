"""Verification cases: a test states what it expects and what it measured, and `--verification FILE` makes a page of it.

`verify` asserts and records. The page is Markdown, a table for each part of the model; apart from its header two runs
of the same tests on one machine write the same page.
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, get_args

import numpy as np

from simcore.provenance import provenance

if TYPE_CHECKING:
    import pytest
    from numpy.typing import ArrayLike, NDArray

Part = Literal["tissue", "needle", "coupled", "control", "forces", "reproducibility"]
PARTS: tuple[str, ...] = get_args(Part)
COLUMNS = ("case", "expected", "measured", "tolerance", "source", "test")
recorded: list[Case] = []


@dataclass(frozen=True)
class Case:
    """One row of the page, numbers as text."""

    part: str
    case: str
    expected: str
    measured: str
    tolerance: str
    source: str
    test: str
    passed: bool


def verify(
    part: Part,
    case: str,
    *,
    expected: ArrayLike,
    measured: ArrayLike,
    tolerance: float,
    source: str,
    relative: bool = False,
    unit: str = "",
) -> None:
    """Assert |measured - expected| <= tolerance in every component, and record the worst one.

    relative: the tolerance is a share of |expected|, component by component. An error has expected = 0. Values that are
    not finite fail. Raises ValueError for a case that could not be printed or could not fail.
    """
    __tracebackhide__ = True
    goal, found = _aligned(expected, measured)
    if part not in PARTS or not source:
        raise ValueError(f"a case needs a source and one of the parts {', '.join(PARTS)}; not {part!r}, {source!r}")
    if not (0.0 <= tolerance < np.inf) or (relative and (goal == 0.0).any()):
        raise ValueError(f"tolerance {tolerance:g} (relative: {relative}) of expected {goal} says nothing")
    with np.errstate(invalid="ignore"):
        miss = np.abs(found - goal) / (np.abs(goal) if relative else 1.0)
    worst = int(np.argmax(np.where(np.isnan(miss), np.inf, miss)))
    allowed = f"{_text(100 * tolerance)} %" if relative else _text(tolerance, unit)
    shown = _text(found[worst], unit, 6) if goal[worst] else _text(abs(found[worst]), unit)
    values = (_text(goal[worst], unit, 6), shown, allowed)
    passed = bool((miss <= tolerance).all())
    recorded.append(Case(part, case, *values, source, _running_test(), passed))
    assert passed, f"{case}: measured {values[1]}, expected {values[0]}, tolerance {values[2]} ({source})"


def _aligned(expected: ArrayLike, measured: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Both (k,), k >= 1; a scalar counts for every component of the other."""
    goal, found = np.asarray(expected, dtype=float), np.asarray(measured, dtype=float)
    if found.size == 0 or not (goal.shape == found.shape or goal.ndim == 0 or found.ndim == 0):
        raise ValueError(f"shapes {goal.shape} expected and {found.shape} measured cannot be compared")
    goal, found = np.broadcast_arrays(goal, found)
    return goal.ravel(), found.ravel()


def _text(value: float, unit: str = "", digits: int = 3) -> str:
    return f"{value + 0.0:.{digits}g} {unit}".strip()


def _running_test() -> str:
    return os.environ.get("PYTEST_CURRENT_TEST", "").rpartition(" ")[0]


# the page


def page(cases: list[Case], header: dict[str, str]) -> str:
    """Markdown: header, then a table for each part that has cases, in the order in which they were recorded."""
    failed = sum(not case.passed for case in cases)
    lines = ["# Verification", "", *(f"- {name}: {value}" for name, value in header.items())]
    lines += [f"- cases: {len(cases) - failed} passed, {failed} failed", ""]
    lines += ["Made by `make verification`. An array is shown by its worst component; errors have 0 expected.", ""]
    for part in PARTS:
        lines += _table(part, [case for case in cases if case.part == part])
    return "\n".join(lines)


def _table(part: str, cases: list[Case]) -> list[str]:
    if not cases:
        return []
    rows = [f"| {' | '.join(COLUMNS)} |", f"|{' --- |' * len(COLUMNS)}"]
    for case in cases:
        cells = [str(getattr(case, name)) for name in COLUMNS]
        cells[2] += "" if case.passed else " **failed**"
        rows.append(f"| {' | '.join(cell.replace('|', chr(92) + '|') for cell in cells)} |")
    return [f"## {part}", "", *rows, ""]


def header(date: str) -> dict[str, str]:
    """Commit, date, versions, machine."""
    about: dict[str, Any] = provenance({"seed": 0})
    return {
        "commit": about["commit"] or "unknown",
        "date": date or "not given",
        "versions": ", ".join(f"{name} {version}" for name, version in about["versions"].items()),
        "machine": f"{about['cpu']}, {about['cpu_count']} cores, {about['platform']}",
    }


# the pytest plugin


def pytest_addoption(parser: pytest.Parser) -> None:
    group = parser.getgroup("verification")
    group.addoption("--verification", metavar="FILE", type=Path, help="write the page of verification cases to FILE")
    group.addoption(
        "--verification-date",
        metavar="DATE",
        default=os.environ.get("SOURCE_DATE", ""),
        help="date in its header; default: the variable SOURCE_DATE",
    )


def pytest_sessionfinish(session: pytest.Session) -> None:
    file: Path | None = session.config.getoption("--verification")
    if file is not None:
        about = header(session.config.getoption("--verification-date"))
        tests = {"tests": f"{session.testscollected} selected, {session.testsfailed} failed"}
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(page(recorded, {**about, **tests}), encoding="utf-8")
