"""Parameter grids: the product, its labels, and what is wrong with an axis."""

from __future__ import annotations

from typing import Any

import pytest

from benchmarks.grid.suite import MAXIMUM_CASES, grid
from simcore.errors import ScenarioError

NOISY = {"noise_mm": 0.25}


def test_a_grid_is_the_product_and_names_its_points() -> None:
    suite = grid(NOISY, {"seed": [3, 4], "controller.gain": [0.5, 1.0]})
    assert [(c.labels["seed"], c.labels["controller.gain"]) for c in suite.cases] == [
        (3, 0.5),
        (3, 1),
        (4, 0.5),
        (4, 1),
    ]
    assert [c.scenario["seed"] for c in suite.cases] == [3, 3, 4, 4]
    assert [c.id for c in suite.cases][:2] == ["ifem gain 0.5, seed 3", "ifem gain 1.0, seed 3"]
    assert [c.scenario["name"] for c in suite.cases] == [c.id for c in suite.cases]


def test_names_say_what_differs_and_nothing_else() -> None:
    axes: dict[str, list[Any]] = {
        "controller.kind": ["ifem", "elm"],
        "tissue.young_kpa": [5.5, 6.3],
        "dt_s": [0.02],
        "seed": [3, 4],
    }
    assert grid(NOISY, axes).cases[-1].id == "elm, E 6.3, seed 4"
    paths = [{"kind": "line", "target_mm": [18, 31, 60]}, {"kind": "sine", "target_mm": [18, 31, 60]}]
    found = grid({}, {"controller": [{"kind": "rigid"}, {"kind": "open_loop"}], "trajectory": paths}).cases
    assert [c.id for c in found] == [
        "rigid, line to 18 31 60",
        "rigid, sine to 18 31 60",
        "open_loop, line to 18 31 60",
        "open_loop, sine to 18 31 60",
    ]
    assert [(c.labels["group"], c.labels["end_point"]) for c in found[:2]] == [
        ("line", "18 31 60"),
        ("sine", "18 31 60"),
    ]


def test_names_are_unique_and_good_for_files_whatever_the_values_are() -> None:
    paths = [{"kind": "sine", "target_mm": [18, 31, 60], "amplitude_mm": mm} for mm in (0.5, 1.0)]
    regions = [[], [{"kind": "plane", "point_mm": [0, 0, 122], "normal": [0, 0, 1], "within_mm": 1.0}] * 9]
    found = grid({}, {"trajectory": paths, "tissue.fixed_regions": regions}).cases
    assert len({c.id for c in found}) == 4
    assert all(len(c.id) <= 100 and not set(c.id) & set('/\\:*?"<>|') for c in found)


def test_seeds_that_change_nothing_are_refused_as_replicates() -> None:
    with pytest.raises(ScenarioError, match=r"grid\.seed = \[0, 1\]: has no effect while noise_mm = 0"):
        grid({}, {"seed": [0, 1]})
    assert len(grid({}, {"seed": [1]}).cases) == 1
    assert len(grid({}, {"seed": [0, 1], "noise_mm": [0.1]}).cases) == 2


def test_two_settings_are_two_arms_and_a_delay_is_none() -> None:
    suite = grid({}, {"controller.gain": [0.5, 1.0], "controller.delay_s": [0.0, 0.05]})
    assert [c.labels["arm"] for c in suite.cases] == ["ifem gain 0.5"] * 2 + ["ifem gain 1.0"] * 2
    assert suite.cases[1].id == "ifem gain 0.5, delay 0.05"


def test_a_kind_is_set_before_the_fields_of_its_block() -> None:
    suite = grid({}, {"trajectory.amplitude_mm": [0.5, 1.0], "trajectory.kind": ["sine"]})
    assert [c.scenario["trajectory"]["amplitude_mm"] for c in suite.cases] == [0.5, 1.0]


def test_controllers_are_the_arms() -> None:
    suite = grid({}, {"controller.kind": ["ifem", "open_loop"]})
    assert [c.labels["arm"] for c in suite.cases] == ["ifem", "open_loop"]


def test_the_same_grid_is_the_same_suite() -> None:
    axes = {"tissue.young_kpa": [5.5, 6.3]}
    assert grid({}, axes).sha256 == grid({}, axes).sha256 != grid({"seed": 1}, axes).sha256


@pytest.mark.slow
@pytest.mark.parametrize(
    ("axes", "field", "words"),
    [
        ({"seed": []}, "grid.seed", "at least one"),
        ({"seed": [1, 1]}, "grid.seed", "twice"),
        ({"seed": list(range(MAXIMUM_CASES + 1))}, "grid", str(MAXIMUM_CASES)),
        ({"dt_s": [0.01, 7]}, "dt_s", "dt_s=7"),
        ({"tissue.colour": ["red"]}, "tissue.colour", "tissue.colour"),
    ],
)
def test_what_is_wrong_is_named(axes: dict[str, list[object]], field: str, words: str) -> None:
    with pytest.raises(ScenarioError) as refused:
        grid({}, axes)
    assert [p.field for p in refused.value.problems] == [field]
    assert words in str(refused.value)
