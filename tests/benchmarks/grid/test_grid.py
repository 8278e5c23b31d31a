"""Parameter grids: the product, its labels, and what is wrong with an axis."""

from __future__ import annotations

import pytest

from benchmarks.grid.suite import MAXIMUM_CASES, grid
from simcore.errors import ScenarioError


def test_a_grid_is_the_product_and_names_its_points() -> None:
    suite = grid({"name": "x"}, {"seed": [3, 4], "controller.gain": [0.5, 1.0]})
    assert [(c.labels["seed"], c.labels["controller.gain"]) for c in suite.cases] == [
        (3, 0.5),
        (3, 1),
        (4, 0.5),
        (4, 1),
    ]
    assert [c.scenario["seed"] for c in suite.cases] == [3, 3, 4, 4]
    assert len({c.id for c in suite.cases}) == 4


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
