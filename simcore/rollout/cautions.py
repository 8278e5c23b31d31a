"""What a run showed that calls for a second look: beside what its scenario warns of, and beside its status."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from simcore.rollout.authority import authority_warnings

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from simcore.scenario.scenario import Scenario

    Series = Mapping[str, NDArray[Any]]

FOLD_DET_F = 0.5  # below it the tissue beside the entry is folded rather than pushed aside
FOLD_NEAR_M = 10e-3  # of the entry
MOST_STEPS = 0.5


def run_warnings(series: Series, scenario: Scenario) -> list[str]:
    """A line for each caution; none for a run without a step."""
    if len(series["t_s"]) < 2:
        return []
    return [
        *_yielding(series, scenario),
        *_entry_fold(series, scenario),
        *_limited(series),
        *authority_warnings(series, scenario.controller),
    ]


def _yielding(series: Series, scenario: Scenario) -> list[str]:
    stress_mpa, allowed = 1e-6 * series["needle_stress_pa"], scenario.needle.yield_mpa
    if not (passed := np.flatnonzero(stress_mpa >= allowed)).size:
        return []
    depth_mm = 1e3 * series["depth_m"][passed[0]]
    return [
        f"the needle's stress reaches {stress_mpa.max():.0f} MPa and passes needle.yield_mpa = {allowed:g} at a depth "
        f"of {depth_mm:.1f} mm: it would stay bent, the run is outside the model and no success"
    ]


def _entry_fold(series: Series, scenario: Scenario) -> list[str]:
    away_m = np.linalg.norm(series["min_det_f_at_m"] - 1e-3 * np.array(scenario.trajectory.entry_mm), axis=1)
    folded = np.where(away_m <= FOLD_NEAR_M, series["min_det_f"], np.inf)
    worst = int(folded.argmin())
    if folded[worst] >= FOLD_DET_F:
        return []
    return [
        f"the tissue folds at the entry: det F falls to {folded[worst]:.2f}, {1e3 * away_m[worst]:.1f} mm from it, at "
        f"a depth of {1e3 * series['depth_m'][worst]:.1f} mm"
    ]


def _limited(series: Series) -> list[str]:
    share = float(series["limited"][1:].mean())
    if share <= MOST_STEPS:
        return []
    return [f"the robot's speed limits acted in {100 * share:.0f} % of the steps: they decide what the needle does"]
