"""The form of a scenario has all of its fields and limits; times and comparisons in words."""

from collections.abc import Iterator
from typing import Any

import pytest

from service.web import formatting
from service.web.form import Group, paths, scenario_form
from simcore.errors import ScenarioError
from simcore.scenario.presets import preset_names, with_changes
from simcore.scenario.scenario import Scenario

# ---- the form of a scenario


def _groups(groups: tuple[Group, ...]) -> Iterator[Group]:
    for group in groups:
        yield group
        yield from _groups(group.groups)


def test_the_form_has_every_field_of_the_scenario() -> None:
    known = set(paths())

    def leaves(data: dict[str, Any], prefix: str = "") -> Iterator[str]:
        for key, value in data.items():
            if isinstance(value, dict):
                yield from leaves(value, f"{prefix}{key}.")
            else:
                yield prefix + key

    for name in preset_names():
        scenario = with_changes(Scenario().resolved(), [])
        assert set(leaves(scenario)) - {"schema"} <= known, name
    assert {"controller.kind", "controller.model.young_kpa", "trajectory.amplitude_mm", "controller.poses"} <= known


def test_limits_of_the_form_are_those_of_the_scenario() -> None:
    """What the form calls out of range is refused, and the refusal names the field of the form."""
    checked = 0
    for group in _groups(scenario_form()):
        for entry in group.entries:
            if entry.entry not in ("number", "integer") or entry.maximum is None or entry.maximum > 1e15:
                continue
            changes = [f"{group.path}.kind={(entry.kinds or tuple(group.kinds))[-1]}"] if group.kinds else []
            if group.inside:
                changes.insert(0, f"{group.path.rpartition('.')[0]}.kind={group.inside[-1]}")
            with pytest.raises(ScenarioError) as caught:
                Scenario.load(with_changes({}, [*changes, f"{entry.path}={2 * entry.maximum + 1}"]))
            assert entry.path in {problem.field for problem in caught.value.problems}
            checked += 1
    assert checked > 30


# ---- words


@pytest.mark.parametrize(
    ("seconds", "text"),
    [(None, "–"), (4.2, "4.2 s"), (59.6, "60 s"), (200, "3 min 20 s"), (7500, "2 h 5 min"), (259200, "3 d")],
)
def test_times_in_words(seconds: float | None, text: str) -> None:
    assert formatting.span(seconds) == text


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({}, "A has a smaller RMSE than B, by 0.1000 mm"),
        ({"difference_mm": 0.1}, "B has a smaller RMSE than A, by 0.1000 mm"),
        ({"p_primary": 0.01, "p_holm": 0.4}, "within what chance would give"),
        ({"p_holm": 0.4, "equivalent": True}, "shown to be equivalent"),
        ({"p_holm": 0.06, "clusters": 5}, "5 end points are too few to tell this from chance"),
        ({}, "sign test over 20 end points of 40 pairs: p < 0.001, adjusted by Holm"),
        ({"unit": "case", "pairs": 1, "clusters": 1, "p_primary": None, "p_holm": None}, "1 case: nothing is tested"),
        ({"notes": ["1 case has no partner and left the test"]}, "Note: 1 case has no partner"),
        ({"difference_mm": 0.0}, "have the same RMSE"),
        ({"difference_mm": None, "difference_interval_mm": None}, "one of them failed"),
        ({"difference_interval_mm": [-0.2, None]}, "-0.2000 to unbounded"),
    ],
)
def test_a_comparison_in_words(changes: dict[str, Any], text: str) -> None:
    one = {
        "first": "A",
        "second": "B",
        "difference_mm": -0.1,
        "difference_interval_mm": [-0.2, -0.05],
        "clusters": 20,
        "pairs": 40,
        "p_primary": 0.0004,
        "p_holm": 0.0008,
        "fewest": 6,
        "unit": "end point",
        "notes": [],
        "equivalent": False,
    }
    assert text in formatting.sentence({**one, **changes})
