"""Parameter grids: every combination of some values of some scenario fields, as a suite."""

from __future__ import annotations

import itertools
import json
import math
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

from benchmarks.cases import Case, Label, Suite
from benchmarks.grid.names import case_names, label, value_names
from simcore.arms import PLUGIN, REMOTE, Arm, arm_names, arm_of, makes_arm
from simcore.errors import Problem, ScenarioError
from simcore.scenario.presets import with_changes
from simcore.scenario.scenario import Scenario

MAXIMUM_CASES = 20_000
MAXIMUM_AXES = 50
SEED = "seed"
Json = dict[str, Any]
Axes = Mapping[str, Sequence[Any]]


def grid(base: Mapping[str, Any], axes: Axes, *, name: str = "grid") -> Suite:
    """The product of the axes over a base scenario, the last axis running fastest.

    base: scenario JSON. axes: dotted path of a field or block -> its values; `{"controller.kind": ["ifem",
    "open_loop"], "tissue.young_kpa": [5, 6]}` gives four cases. Blocks and kinds are set before the fields of a block.
    A case is named after its arm and the other values that set it apart, and labelled with the values of its axes,
    `arm`, `end_point`, and the kind of its path as `group` where there are several. Raises ScenarioError, which names
    the axis, or the field of the case that cannot be run; also for seeds that change nothing.
    """
    if problems := _faults(axes):
        raise ScenarioError(problems)
    ordered = sorted(axes, key=lambda path: (path.count("."), not path.endswith("kind")))  # stable: otherwise as given
    points = [dict(zip(axes, values, strict=True)) for values in itertools.product(*axes.values())]
    scenarios = [_scenario(base, point, ordered) for point in points]
    if problem := _seed_problem(axes, scenarios):
        raise ScenarioError([problem])
    arms = _arms(scenarios)
    names = arm_names(arms)
    places = _places(axes)
    ids = case_names([names[arm.id] for arm in arms], places)
    kinds = {one["trajectory"]["kind"] for one in scenarios}
    cases = []
    for i, (point, scenario, arm) in enumerate(zip(points, scenarios, arms, strict=True)):
        labels: dict[str, Label] = {path: label(value) for path, value in point.items()}
        labels |= {"arm": names[arm.id], "end_point": _end_point(scenario["trajectory"])}
        if len(kinds) > 1:
            labels["group"] = scenario["trajectory"]["kind"]
        named = scenario if "name" in axes else {**scenario, "name": ids[i]}
        cases.append(Case(ids[i], named, labels))
    return Suite(name, f"grid over {', '.join(axes) or 'nothing'}", tuple(cases))


def _scenario(base: Mapping[str, Any], point: Mapping[str, Any], ordered: Sequence[str]) -> Json:
    """The resolved scenario of a point."""
    changes = [f"{path}={json.dumps(point[path])}" for path in ordered]
    try:
        return Scenario.load(with_changes(dict(base), changes)).resolved()
    except ScenarioError as error:
        where = ", ".join(f"{path}={json.dumps(value)}" for path, value in point.items()) or "the base scenario"
        raise ScenarioError([Problem(p.field, p.value, f"{p.message} (at {where})") for p in error.problems]) from None


def _seed_problem(axes: Axes, scenarios: Sequence[Json]) -> Problem | None:
    """Seeds of cases in which nothing is random; a plug-in may draw from the seed as it likes."""
    if len(axes.get(SEED, ())) < 2 or any(_random(one) for one in scenarios):
        return None
    message = "has no effect while noise_mm = 0: each would repeat the same insertion; set noise_mm or sensing.noise_mm"
    return Problem(f"grid.{SEED}", list(axes[SEED]), message)


def _random(scenario: Json) -> bool:
    sensing = scenario["sensing"]
    drawn = scenario["noise_mm"] or sensing["noise_mm"] or sensing["tip"] == "registered"
    return bool(drawn) or scenario["controller"]["kind"] in (PLUGIN, REMOTE)


def _arms(scenarios: Sequence[Json]) -> list[Arm]:
    """The arm of each scenario; equal controllers among equal spacings are looked at once."""
    known: dict[str, Arm] = {}
    arms = []
    for one in scenarios:
        key = json.dumps([one["controller"], one["interaction"]], sort_keys=True)
        if key not in known:
            known[key] = arm_of(one)
        arms.append(known[key])
    return arms


def _places(axes: Axes) -> list[dict[str, str]]:
    """What sets each case apart besides its arm: the text of its value on every axis that has several."""
    texts = {path: value_names(path, values) for path, values in axes.items()}
    shown = [path for path in axes if not makes_arm(path) and len(axes[path]) > 1]
    numbers = itertools.product(*(range(len(values)) for values in axes.values()))
    return [
        {path: texts[path][number] for path, number in zip(axes, place, strict=True) if path in shown}
        for place in numbers
    ]


def _end_point(trajectory: Json) -> str:
    """Where a path ends, in mm; what leads to the same end point is not independent."""
    target = trajectory.get("target_mm") or (trajectory.get("points_mm") or [[]])[-1]
    return " ".join(f"{value:g}" for value in target)


def _faults(axes: Mapping[str, Sequence[Any]]) -> list[Problem]:
    if len(axes) > MAXIMUM_AXES:
        return [Problem("grid", len(axes), f"has too many fields, at most {MAXIMUM_AXES} are allowed")]
    problems = [Problem(f"grid.{path}", [], "must have at least one value") for path, v in axes.items() if not len(v)]
    count = math.prod(len(values) for values in axes.values())
    if count > MAXIMUM_CASES:
        problems.append(Problem("grid", count, f"gives too many insertions, at most {MAXIMUM_CASES} are allowed"))
    for path, values in axes.items():
        seen = Counter(json.dumps(value, sort_keys=True) for value in values)
        if doubled := min((text for text, times in seen.items() if times > 1), default=None):
            problems.append(Problem(f"grid.{path}", doubled, "is given twice: give each value once"))
    return problems
