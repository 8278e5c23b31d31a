"""Parameter grids: every combination of some values of some scenario fields, as a suite."""

from __future__ import annotations

import itertools
import json
import math
from collections import Counter
from typing import TYPE_CHECKING, Any

from benchmarks.cases import Case, Label, Suite
from simcore.errors import Problem, ScenarioError
from simcore.scenario.presets import with_changes
from simcore.scenario.scenario import Scenario

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

MAXIMUM_CASES = 20_000
MAXIMUM_AXES = 50


def grid(base: Mapping[str, Any], axes: Mapping[str, Sequence[Any]], *, name: str = "grid") -> Suite:
    """The product of the axes over a base scenario, the last axis running fastest.

    base: scenario JSON. axes: dotted path of a field -> its values; `{"controller.kind": ["ifem", "open_loop"],
    "seed": [0, 1]}` gives four cases. Axes over a `kind` are set before the fields of its block. Each case is labelled
    with the values of its axes and, so that analyses pair controllers, with `arm`. Raises ScenarioError, which names
    the axis, or the field of the case that cannot be run.
    """
    if problems := _faults(axes):
        raise ScenarioError(problems)
    ordered = sorted(axes, key=lambda path: not path.endswith("kind"))  # stable: otherwise as given
    cases = [
        _case(index, base, axes, dict(zip(axes, values, strict=True)), ordered)
        for index, values in enumerate(itertools.product(*axes.values()))
    ]
    return Suite(name, f"grid over {', '.join(axes) or 'nothing'}", tuple(cases))


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


def _case(
    index: int, base: Mapping[str, Any], axes: Mapping[str, Sequence[Any]], point: dict[str, Any], ordered: list[str]
) -> Case:
    changes = [f"{path}={json.dumps(point[path])}" for path in ordered]
    try:
        scenario = Scenario.load(with_changes(dict(base), changes))
    except ScenarioError as error:
        where = ", ".join(f"{path}={json.dumps(value)}" for path, value in point.items()) or "the base scenario"
        raise ScenarioError([Problem(p.field, p.value, f"{p.message} (at {where})") for p in error.problems]) from None
    labels: dict[str, Label] = {path: label(value) for path, value in point.items()}
    labels.setdefault("arm", scenario.controller.kind)
    if paths := [path for path in axes if path.startswith("trajectory.")]:
        labels["path"] = " ".join(f"{label(point[path])}" for path in paths)
    return Case(f"case-{index:05d}", scenario.resolved(), labels)


def label(value: Any) -> Label:
    """A value of an axis as the label of its cases."""
    return value if isinstance(value, str | int | float) and not isinstance(value, bool) else json.dumps(value)
