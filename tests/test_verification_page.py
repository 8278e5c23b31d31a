"""`verify` fails where it must, and its page tells what was measured."""

from __future__ import annotations

import math
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests import verification
from tests.verification import Case, page, verify

ROOT = Path(__file__).resolve().parents[1]
CASE: dict[str, Any] = {"expected": 2.0, "measured": 2.0, "tolerance": 0.1, "source": "Hooke"}


@pytest.fixture(autouse=True)
def ledger(monkeypatch: pytest.MonkeyPatch) -> list[Case]:
    """A ledger of its own, so that these toy cases are on no page."""
    own: list[Case] = []
    monkeypatch.setattr(verification, "recorded", own)
    return own


@pytest.mark.parametrize(
    "numbers",
    [
        {"measured": 2.1, "tolerance": 0.1 + 1e-12},
        {"measured": 1.9, "tolerance": 0.1 + 1e-12},
        {"measured": 2.2, "tolerance": 0.1 + 1e-12, "relative": True},
        {"expected": -2.0, "measured": -2.2, "tolerance": 0.1 + 1e-12, "relative": True},
        {"expected": 0.0, "measured": 0.0, "tolerance": 0.0},
        {"expected": [1.0, 2.0], "measured": [1.1, 2.0], "tolerance": 0.11},
        {"expected": 0.0, "measured": np.full((2, 3), 0.1)},
    ],
)
def test_within_its_tolerance_it_passes_and_is_recorded(ledger: list[Case], numbers: dict[str, Any]) -> None:
    verify("tissue", "bar", **{**CASE, **numbers})
    assert [case.passed for case in ledger] == [True]


@pytest.mark.parametrize(
    "numbers",
    [
        {"measured": 2.11},
        {"measured": 1.89},
        {"measured": 2.21, "relative": True},
        {"expected": 0.0, "measured": -0.11},
        {"measured": math.nan},
        {"measured": -math.inf},
        {"expected": math.nan, "measured": math.nan},
        {"expected": [1.0, 2.0, 3.0], "measured": [1.0, 2.2, 3.0]},
        {"expected": 0.0, "measured": [[0.0, math.nan], [0.0, 0.0]]},
        {"expected": 0.0, "measured": 1e-300, "tolerance": 0.0},
    ],
)
def test_beyond_its_tolerance_it_fails_and_is_recorded(ledger: list[Case], numbers: dict[str, Any]) -> None:
    with pytest.raises(AssertionError, match="bar: measured"):
        verify("tissue", "bar", **{**CASE, **numbers})
    assert [case.passed for case in ledger] == [False]


@pytest.mark.parametrize(
    "numbers",
    [
        {"part": "magic"},
        {"source": ""},
        {"tolerance": math.inf},
        {"tolerance": math.nan},
        {"tolerance": -1.0},
        {"expected": 0.0, "relative": True},
        {"expected": [1.0, 2.0], "measured": [1.0, 2.0, 3.0]},
        {"expected": [], "measured": []},
    ],
)
def test_a_case_that_says_nothing_is_refused(ledger: list[Case], numbers: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match=r"says nothing|needs a source|cannot be compared"):
        verify(**{"part": "tissue", "case": "bar", **CASE, **numbers})
    assert ledger == []


def test_the_worst_component_is_recorded(ledger: list[Case]) -> None:
    """Absolute: the largest difference; relative: the largest share; always a value that is not finite."""
    verify("needle", "a", expected=[100.0, 1.0], measured=[103.0, 1.5], tolerance=4, source="s", unit="mm")
    verify("needle", "b", expected=[100.0, 1.0], measured=[103.0, 1.5], tolerance=0.6, source="s", relative=True)
    with pytest.raises(AssertionError):
        verify("needle", "c", expected=0.0, measured=[9.0, math.nan, 0.0], tolerance=1, source="s")
    assert [(c.expected, c.measured, c.tolerance) for c in ledger] == [
        ("100 mm", "103 mm", "4 mm"),
        ("1", "1.5", "60 %"),
        ("0", "nan", "1"),
    ]


def test_the_test_is_named(ledger: list[Case]) -> None:
    verify("needle", "a", **CASE)
    assert ledger[0].test == "tests/test_verification_page.py::test_the_test_is_named"


def test_the_page_groups_by_part_and_counts(ledger: list[Case]) -> None:
    verify("needle", "bend", **CASE)
    verify("tissue", "sum |lambda|", **CASE)
    with pytest.raises(AssertionError):
        verify("tissue", "bar", **{**CASE, "measured": 3.0})
    lines = page(ledger, {"commit": "abc"}).splitlines()
    assert lines[:4] == ["# Verification", "", "- commit: abc", "- cases: 2 passed, 1 failed"]
    rows = [line for line in lines if line.startswith(("#", "|"))]
    test = "tests/test_verification_page.py::test_the_page_groups_by_part_and_counts"
    head = ["| case | expected | measured | tolerance | source | test |", "| --- | --- | --- | --- | --- | --- |"]
    assert rows == [
        "# Verification",
        "## tissue",
        *head,
        rf"| sum \|lambda\| | 2 | 2 | 0.1 | Hooke | {test} |",
        f"| bar | 2 | 3 **failed** | 0.1 | Hooke | {test} |",
        "## needle",
        *head,
        f"| bend | 2 | 2 | 0.1 | Hooke | {test} |",
    ]


TOY = """
from tests.verification import verify

def test_good():
    verify("tissue", "bar", expected=2, measured=2, tolerance=0.1, source="Hooke")

def test_bad():
    verify("control", "loop", expected=0, measured=2, tolerance=0.1, source="Nyquist", unit="mm")
    verify("control", "after it", expected=0, measured=0, tolerance=0.1, source="Nyquist")
"""


def toy_page(folder: Path, date: str) -> list[str]:
    """The lines of the page of a pytest session over `folder`; its two tests end as they must."""
    file = folder / date / "page.md"
    plain = [sys.executable, "-m", "pytest", "-p", "no:cacheprovider", "-c", str(folder / "pytest.ini")]
    options = ["-p", "tests.verification", "--verification", str(file), "--verification-date", date]
    alone = {**os.environ, "PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1"}
    done = subprocess.run([*plain, *options, str(folder)], cwd=ROOT, env=alone, capture_output=True, text=True)
    assert done.returncode == 1, done.stdout + done.stderr
    assert "loop: measured 2 mm, expected 0 mm, tolerance 0.1 mm (Nyquist)" in done.stdout
    return file.read_text().splitlines()


@pytest.mark.slow
def test_the_option_writes_the_page(tmp_path: Path) -> None:
    """Through pytest: failures on it, the date from outside, the rest the same in two runs."""
    (tmp_path / "test_toy.py").write_text(TOY)
    (tmp_path / "pytest.ini").write_text("[pytest]\n")
    first, second = (toy_page(tmp_path, date) for date in ("2026-01-01", "2026-01-02"))
    assert "- date: 2026-01-01" in first
    assert "- tests: 2 selected, 1 failed" in first
    assert "- cases: 1 passed, 1 failed" in first
    assert "| loop | 0 mm | 2 mm **failed** | 0.1 mm | Nyquist | test_toy.py::test_bad |" in first
    tables = [lines[lines.index("- tests: 2 selected, 1 failed") :] for lines in (first, second)]
    assert tables[0] == tables[1]


def test_the_header_says_where_it_was_made() -> None:
    about = verification.header("")
    assert list(about) == ["commit", "date", "versions", "machine"]
    assert about["date"] == "not given"
    assert "numpy " in about["versions"]
