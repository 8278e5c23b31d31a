"""How each cell did: tip error with what it was paid with, over all insertions and over those inside of the budget."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from benchmarks.paper import statistics
from benchmarks.paper.statistics import Interval, bootstrap_median, wilson
from benchmarks.paper.table import BESIDE, Row

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from benchmarks.settling.cells import Cell

BUDGET_MM = 2.5  # [ours] of rcm_max_mm, fixed before any result: an axis through the entry costs 1.5 to 2.1 mm
OUTCOME = "rmse_commanded_mm"
CROSS_TRACK = "cross_track_rmse_mm"  # what is left of it without the lag along the path that a delay makes


def within_budget(row: Row) -> bool:
    """Whether the shaft stayed within BUDGET_MM of the entry in every step that was made. A failure that measured
    nothing is inside: it counts as a failure there, and nowhere else."""
    error = row.metrics.get("rcm_max_mm")
    if error is None or not math.isfinite(error):
        return row.failed
    return bool(error <= BUDGET_MM)


@dataclass(frozen=True)
class Estimate:
    """A median over end points, each the median of its directions, and its interval; infinite where failures are."""

    median: float
    interval: Interval


@dataclass(frozen=True)
class CellScore:
    """One cell. over_budget: insertions outside of the budget, failed or not. rmse_mm: over all insertions, failures
    worst; rmse_inside_mm: over those inside of the budget; cross_track_mm: of the distance from the path, over all.
    beside: metrics of `table.BESIDE` over stable insertions."""

    cell: str
    arm: str
    plant: str
    delay_ms: float
    rows: str
    insertions: int
    end_points: int
    failed: int
    over_budget: int
    inside: float
    inside_interval: Interval
    rmse_mm: Estimate
    rmse_inside_mm: Estimate
    cross_track_mm: Estimate
    beside: Mapping[str, Estimate]
    yielded: int


def score(cell: Cell, mine: Sequence[Row]) -> CellScore:
    """Of one cell's rows; without any, all medians are NaN."""
    kept = [row for row in mine if within_budget(row)]
    stable = [row for row in mine if row.stable]
    return CellScore(
        cell=cell.name,
        arm=cell.arm,
        plant=cell.plant.name,
        delay_ms=1e3 * cell.delay_s,
        rows=cell.rows_title,
        insertions=len(mine),
        end_points=len({row.end_point for row in mine}),
        failed=sum(row.failed for row in mine),
        over_budget=len(mine) - len(kept),
        inside=len(kept) / len(mine) if mine else math.nan,
        inside_interval=wilson(len(kept), len(mine)),
        rmse_mm=estimate(mine, [row.ranked(OUTCOME) for row in mine]),
        rmse_inside_mm=estimate(kept, [row.ranked(OUTCOME) for row in kept]),
        cross_track_mm=estimate(mine, [row.ranked(CROSS_TRACK) for row in mine]),
        beside={metric: _measured(stable, metric) for metric in BESIDE},
        yielded=sum(bool(row.yielded) for row in mine),
    )


def _measured(stable: Sequence[Row], metric: str) -> Estimate:
    known = [row for row in stable if row.metrics.get(metric) is not None and math.isfinite(row.metrics[metric])]
    return estimate(known, [float(row.metrics[metric]) for row in known])


def estimate(mine: Sequence[Row], values: Sequence[float]) -> Estimate:
    """Median and interval of one value for each row, end points as the unit."""
    medians = statistics.cluster_medians(np.array(values, float), [row.end_point for row in mine])
    return Estimate(statistics.middle(medians), bootstrap_median(medians))
