"""What the page of a job says of it in a few words: what was run, and what each number means."""

from __future__ import annotations

import json
import math
import shlex
from functools import cache
from typing import TYPE_CHECKING, Any, NamedTuple

from service.display import flat
from simcore.errors import ScenarioError
from simcore.metric_definitions import METRICS
from simcore.scenario.scenario import Scenario

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

AXES = ("x", "y", "z")
_NO_CHANGE = ("name", "schema")  # fields in which two insertions may differ and be the same run
_USUAL_KINDS = {"controller": "ifem", "trajectory": "line"}
_LONGEST_COPY = 4000  # characters of a scenario that is offered to be copied
_METRICS = {metric.key: metric for metric in METRICS}
_PATH_WORDS = {
    "line": "a straight line",
    "sine": "a sine of {amplitude_mm:g} mm",
    "arc": "an arc with a radius of {radius_mm:g} mm",
    "waypoints": "a curve through {points} points",
    "reach": "a target without a path",
}


class Measure(NamedTuple):
    """One number of a result. odd: it lies outside of the range in which a sane run has it."""

    name: str
    value: Any
    unit: str
    definition: str
    sane_range: str
    odd: bool
    outside: str


class Difference(NamedTuple):
    """A field of a scenario that is not as it is without being set. default: None where its kind has none."""

    field: str
    value: Any
    default: Any


def path_words(scenario: Mapping[str, Any]) -> str:
    """The path in a line: its kind, from where to where, how long it takes."""
    path = scenario["trajectory"]
    words = _PATH_WORDS.get(path["kind"], path["kind"])
    known = {**path, "points": len(path.get("points_mm") or ())}
    try:
        words = words.format_map(known)
    except (KeyError, ValueError):
        words = str(path["kind"])
    end = path.get("target_mm") or (path.get("points_mm") or [None])[-1]
    ends = f"{_point(path.get('entry_mm'))} to {_point(end)} mm"
    speed = path.get("speed_mm_s")
    return f"{words}, {ends}" + (f", {speed:g} mm/s" if speed is not None else "")


def _point(values: Any) -> str:
    return "(" + ", ".join(f"{value:g}" for value in values) + ")" if values else "?"


def differences(scenario: dict[str, Any]) -> list[Difference]:
    """What was set: the fields that differ from the defaults of the same kinds, in the order of the scenario."""
    plain = dict(flat(_defaults(scenario["controller"]["kind"], scenario["trajectory"]["kind"])))
    return [
        Difference(name, value, plain.get(name))
        for name, value in flat(scenario)
        if name.split(".")[0] not in _NO_CHANGE and (name not in plain or plain[name] != value)
    ]


@cache
def _defaults(controller: str, trajectory: str) -> dict[str, Any]:
    """A scenario of these kinds with nothing else set; where a kind needs more than its name, all defaults."""
    try:
        return Scenario.load({"controller": {"kind": controller}, "trajectory": {"kind": trajectory}}).resolved()
    except (ScenarioError, ValueError):
        return Scenario().resolved()


def as_given(scenario: dict[str, Any]) -> dict[str, Any]:
    """The least to be said to get this scenario: kinds that are not the default ones, what was set, the name."""
    said: dict[str, Any] = {"name": scenario["name"]}
    for block, kind in _USUAL_KINDS.items():
        if scenario[block]["kind"] != kind:
            said[block] = {"kind": scenario[block]["kind"]}
    for field, value, _ in differences(scenario):
        *blocks, leaf = field.split(".")
        here = said
        for block in blocks:
            here = here.setdefault(block, {})
        here[leaf] = value
    return said


def ways_to_run(scenario: dict[str, Any], address: str) -> dict[str, str]:
    """The same insertion again, as text to copy: over HTTP, on the command line, in Python. address: of the service.
    Nothing for a scenario that is too long to be read."""
    text = json.dumps(as_given(scenario))
    if len(text) > _LONGEST_COPY:
        return {}
    body = json.dumps({"scenario": as_given(scenario)})
    return {
        "curl": f"curl -sf -X POST {address}/api/v1/jobs -H 'content-type: application/json' -d {shlex.quote(body)}",
        "Command line": f"echo {shlex.quote(text)} > mine.json\nneedlebench run mine.json --out results/mine",
        "Python": f"from needlebench import Scenario, run\n\nrollout = run(Scenario.load({as_given(scenario)!r}))",
    }


def measures(part: str, values: dict[str, Any]) -> Iterator[Measure]:
    """The numbers of a part of a result (`metrics`, `solver`), errors along x, y and z apart."""
    for name, value in flat(values):
        if isinstance(value, list):
            for axis, one in zip(AXES, value, strict=False):
                yield _measure(part, name, one, f" {axis}")
        elif name != "model":  # the model of a training has its own page
            yield _measure(part, name, value)


def _measure(part: str, name: str, value: Any, axis: str = "") -> Measure:
    known = _METRICS.get(f"{part}.{name}")
    if known is None:
        return Measure(f"{name}{axis}", value, "", "", "", odd=False, outside="")
    number = isinstance(value, bool | int | float) and math.isfinite(value)
    odd = number and not known.low <= value <= (math.inf if known.high is None else known.high)
    unit = "" if known.unit in ("1", "yes or no") else known.unit
    sane = "yes" if known.unit == "yes or no" else f"{known.sane_range} {unit}".rstrip()
    return Measure(f"{name}{axis}", value, unit, known.definition, sane, odd, known.outside)
