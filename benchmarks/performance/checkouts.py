"""Two checkouts of this project against each other: the same short timings in turn, compared pair by pair.

Reports of two days differ by what else the machines did. Here each pair of runs is made within seconds, in fresh
processes that import one checkout each, so that the ratio of a pair is free of everything that changes more slowly.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy import stats

from benchmarks.measurements import Table
from benchmarks.performance import checkout_run
from simcore.errors import NeedlebenchError, Problem, ScenarioError

SCHEMA = "needlebench/checkouts/1"
ROUNDS, QUICK_ROUNDS = 9, 2
CONFIDENCE = 0.95
START = "start_s"
Clock = Callable[[], float]
Say = Callable[[str], None]


class CheckoutError(NeedlebenchError):
    """A run in a checkout failed, or was not made with the checkout's own code."""


@dataclass(frozen=True)
class Checkout:
    """A folder with the project's code, and the folder in which its compiled kernels are kept."""

    folder: Path
    kernels: Path


@dataclass(frozen=True)
class CheckoutRun:
    """One process. figures: key -> s or ms, as the key ends; digests: of the results, by scenario."""

    figures: dict[str, float]
    digests: dict[str, str]
    commit: str | None


@dataclass(frozen=True)
class PairedFigure:
    """One figure in both checkouts, a value for each pair of runs."""

    key: str
    old: tuple[float, ...]
    new: tuple[float, ...]

    @property
    def unit(self) -> str:
        """The end of its key."""
        return self.key.rpartition("_")[2]

    @property
    def ratios(self) -> list[float]:
        """New over old, pair by pair."""
        return [new / old for old, new in zip(self.old, self.new, strict=True)]


@dataclass(frozen=True)
class CheckoutComparison:
    """All pairs. same_results: whether every run of both gave the same digests."""

    figures: tuple[PairedFigure, ...]
    old_commit: str | None
    new_commit: str | None
    same_results: bool

    def as_json(self) -> dict[str, Any]:
        """Every value of every pair."""
        figures = {figure.key: {"old": figure.old, "new": figure.new} for figure in self.figures}
        commits = {"old": self.old_commit, "new": self.new_commit}
        return {"schema": SCHEMA, "commits": commits, "same_results": self.same_results, "figures": figures}


def timed_scenarios(*, quick: bool) -> dict[str, dict[str, Any]]:
    """The built-in `line` and `sine` in as few fields as define them, so that other versions of the format know them
    too; `quick`: the first tenth, in a coarse mesh."""
    target = [18.6, 32.0, 12.2] if quick else [24, 41, 122]
    line = {"kind": "line", "target_mm": target}
    sine = {"kind": "sine", "target_mm": target, "amplitude_mm": 0.1 if quick else 1.0}
    coarse = {"tissue": {"element_size_mm": 10.0}} if quick else {}
    return {name: {"name": name, "trajectory": path, **coarse} for name, path in (("line", line), ("sine", sine))}


def compare_checkouts(
    old: Path, new: Path, *, scratch: Path, say: Say, quick: bool = False, clock: Clock = time.perf_counter
) -> CheckoutComparison:
    """Warm both up, then run them in turn, changing which of a pair comes first.

    scratch: folder for compiled kernels. Raises ScenarioError for a folder that is not a checkout, CheckoutError for a
    run that fails.
    """
    sides = [_checkout(folder, scratch / name) for folder, name in ((old, "old"), (new, "new"))]
    scenarios = timed_scenarios(quick=quick)
    for side in sides:
        say(f"checkouts: compiling the kernels of {side.folder}")
        run_checkout(side, timed_scenarios(quick=True), clock=clock)
    runs: tuple[list[CheckoutRun], list[CheckoutRun]] = ([], [])
    rounds = QUICK_ROUNDS if quick else ROUNDS
    for number in range(rounds):
        for i in (0, 1) if number % 2 == 0 else (1, 0):
            say(f"checkouts: pair {number + 1} of {rounds}, {('old', 'new')[i]}")
            runs[i].append(run_checkout(sides[i], scenarios, clock=clock))
    return _comparison(*runs)


def _checkout(folder: Path, kernels: Path) -> Checkout:
    folder = folder.resolve()
    if not any((folder / name).is_file() for name in ("needlebench.py", "needlebench/__init__.py")):
        raise ScenarioError([Problem("--checkouts", str(folder), "is not a checkout: it has no module needlebench")])
    return Checkout(folder, kernels)


def run_checkout(side: Checkout, scenarios: dict[str, dict[str, Any]], *, clock: Clock) -> CheckoutRun:
    """All scenarios in one new process; start_s: from just before the process to the end of its first step."""
    side.kernels.mkdir(parents=True, exist_ok=True)
    environment = {"PYTHONPATH": str(side.folder), "NUMBA_CACHE_DIR": str(side.kernels)}
    started = clock()
    child = subprocess.Popen(
        [sys.executable, "-P", checkout_run.__file__],  # -P: the script's own folder is not searched for modules
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        cwd=side.kernels,
        env={**os.environ, **environment},
    )
    assert child.stdin is not None
    assert child.stdout is not None
    with child, child.stdin, child.stdout:
        child.stdin.write(json.dumps(scenarios))
        child.stdin.close()
        line = child.stdout.readline().strip()
        start_s = clock() - started
        rest = child.stdout.read()
    if line != checkout_run.FIRST_STEP or child.returncode != 0:
        raise CheckoutError(f"the run in {side.folder} ended with exit code {child.returncode}")
    report = json.loads(rest)
    if not Path(report["package"]).resolve().is_relative_to(side.folder):
        raise CheckoutError(f"the run in {side.folder} imported {report['package']} instead of the checkout's code")
    return CheckoutRun({START: start_s, **report["figures"]}, report["digests"], report["commit"])


def _comparison(old: list[CheckoutRun], new: list[CheckoutRun]) -> CheckoutComparison:
    figures = tuple(
        PairedFigure(key, tuple(run.figures[key] for run in old), tuple(run.figures[key] for run in new))
        for key in old[0].figures
    )
    same = all(run.digests == old[0].digests for run in (*old, *new))
    return CheckoutComparison(figures, old[0].commit, new[0].commit, same)


def median_interval(values: list[float], confidence: float = CONFIDENCE) -> tuple[float, float] | None:
    """Distribution-free interval of the median: the narrowest pair of order statistics, equally far from both ends,
    that holds it with the confidence. None for so few values that not even their whole range does (below six)."""
    # P(fewer than k of n values lie below the median) = binom.cdf(k - 1, n, 1/2): ppf gives the largest k allowed
    k = int(stats.binom.ppf((1.0 - confidence) / 2.0, len(values), 0.5))
    ordered = sorted(values)
    return (ordered[k - 1], ordered[-k]) if k > 0 else None


def checkout_table(comparison: CheckoutComparison) -> Table:
    """A row for each figure: medians and interquartile ranges, the median ratio of the pairs and its interval."""
    rows = tuple(_row(figure) for figure in comparison.figures)
    pairs = len(comparison.figures[0].old)
    commits = f"old: {_short(comparison.old_commit)}, new: {_short(comparison.new_commit)}"
    title = f"{pairs} pairs of runs; {commits}; results {'identical' if comparison.same_results else 'differ'}"
    head = ("figure", "unit", "old", "IQR", "new", "IQR", "new / old", "95 % from", "to")
    return Table(title, head, rows)


def _row(figure: PairedFigure) -> tuple[Any, ...]:
    low, high = median_interval(figure.ratios) or (None, None)
    name = figure.key.removesuffix(f"_{figure.unit}")
    sides = (value for side in (figure.old, figure.new) for value in (float(np.median(side)), _iqr(side)))
    return (name, figure.unit, *sides, float(np.median(figure.ratios)), low, high)


def _iqr(values: tuple[float, ...]) -> float:
    low, high = np.percentile(values, [25, 75])
    return float(high - low)


def _short(commit: str | None) -> str:
    if commit is None:
        return "unknown commit"
    head, dash, changed = commit.partition("-")
    return f"{head[:10]}{dash}{changed}"
