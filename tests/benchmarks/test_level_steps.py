"""Steps of a history: found where the level changes for good, and not where one value is off."""

from __future__ import annotations

import numpy as np

from benchmarks.level_steps import LevelStep, level_steps


def test_a_step_without_noise_is_found_at_its_place() -> None:
    assert level_steps([1.0] * 5 + [1.5] * 4) == [LevelStep(5, 1.0, 1.5)]
    assert level_steps([2.0] * 6 + [1.0] * 3 + [3.0] * 5) == [LevelStep(6, 2.0, 1.0), LevelStep(9, 1.0, 3.0)]


def test_one_outlier_a_drift_below_the_noise_and_a_short_history_are_no_steps() -> None:
    assert level_steps([1.0] * 6 + [9.0] + [1.0] * 6) == []
    assert level_steps([1.0, 1.0, 2.0]) == []
    assert level_steps([1.0] * 5 + [1.005] * 5) == []


def test_noise_hides_small_steps_and_not_large_ones() -> None:
    noise = np.random.default_rng(3).normal(0.0, 0.05, 60)
    quiet = [float(value) for value in 1.0 + noise]
    assert level_steps(quiet) == []
    (step,) = level_steps([value + (0.6 if i >= 35 else 0.0) for i, value in enumerate(quiet)])
    assert step.at == 35
    assert step.after - step.before > 0.5
