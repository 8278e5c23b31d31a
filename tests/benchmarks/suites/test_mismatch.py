"""`mismatch-v1`: one thing is off at a time, by as much as the sources say, and for every controller alike."""

from __future__ import annotations

import json
from collections import Counter
from typing import TYPE_CHECKING, Any

import pytest

from benchmarks.bundles.tasks import task_of
from benchmarks.paper.scale import SCALES
from benchmarks.paper.suites import resolve_cases
from benchmarks.suites.mismatch import CONDITIONS, mismatch_cases

if TYPE_CHECKING:
    from benchmarks.cases import Case

MODELS = {"elm": "default"}


@pytest.fixture(scope="module")
def smoke() -> list[Case]:
    return resolve_cases(mismatch_cases(SCALES["smoke"], MODELS))


def one(condition: str, arm: str) -> dict[str, Any]:
    cases = mismatch_cases(SCALES["full"], MODELS)
    return next(c.scenario for c in cases if (c.labels["condition"], c.labels["arm"]) == (condition, arm))


def test_every_condition_has_every_arm_along_every_path() -> None:
    counts = Counter((c.labels["condition"], c.labels["arm"]) for c in mismatch_cases(SCALES["full"], MODELS))
    assert set(counts.values()) == {40}
    assert len(counts) == len(CONDITIONS) * 5


def test_the_task_of_a_condition_and_path_is_the_same_for_every_arm(smoke: list[Case]) -> None:
    tasks: dict[tuple[Any, Any], set[str]] = {}
    for case in smoke:
        tasks.setdefault((case.labels["condition"], case.labels["group"]), set()).add(task_of(case.scenario))
    assert {len(found) for found in tasks.values()} == {1}
    assert len({next(iter(found)) for found in tasks.values()}) == len(tasks) == 6


def test_models_stay_where_they_were_while_the_plant_moves() -> None:
    for condition in CONDITIONS:
        believed = one(condition.name, "ifem")["controller"]["model"]
        assert believed == {
            "kind": "separate", "young_kpa": 6.3, "friction": 0.1, "element_size_mm": 6.0, "spacing_mm": 3.0,
        }  # fmt: skip
    assert one("stiff", "ifem")["tissue"]["young_kpa"] == pytest.approx(6.3 * 1.2)
    assert one("soft", "elm")["tissue"]["young_kpa"] == pytest.approx(6.3 * 0.8)
    assert one("sticky", "rigid")["interaction"]["friction"] == pytest.approx(0.1406, abs=1e-4)
    assert one("smooth", "rigid")["interaction"]["adhesion_n_per_mm"] == pytest.approx(0.01 * 6.3 / 10.6, abs=1e-5)
    assert one("late-command", "elm")["controller"]["delay_s"] == 0.05


def test_every_single_condition_moves_one_block_and_the_last_all_of_them() -> None:
    nominal = one("nominal", "elm")

    def moved(name: str) -> set[str]:
        other = one(name, "elm")
        return {key for key in other if json.dumps(other[key]) != json.dumps(nominal.get(key))} - {"name"}

    singles = {condition.name: moved(condition.name) for condition in CONDITIONS[1:-1]}
    assert {name: len(blocks) for name, blocks in singles.items()} == dict.fromkeys(singles, 1)
    assert moved("all") == set.union(*singles.values())


@pytest.mark.parametrize("scale", ["full", "quick", "smoke"])
def test_images_and_delays_are_whole_steps(scale: str) -> None:
    for case in mismatch_cases(SCALES[scale], MODELS):
        dt_s = case.scenario["dt_s"]
        assert 0.05 / dt_s == pytest.approx(round(0.05 / dt_s))
        rate = case.scenario.get("sensing", {}).get("rate_hz")
        assert rate is None or 1.0 / (rate * dt_s) == pytest.approx(round(1.0 / (rate * dt_s)))
