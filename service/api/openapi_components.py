"""Schemas of the document that are made from the simulation itself: the scenario's own, and one of all metrics."""

from __future__ import annotations

from typing import Any

from simcore.metric_definitions import METRICS, Metric
from simcore.scenario.scenario import Scenario

_REFERENCE = "#/components/schemas/{model}"
_NULL = {"type": "null"}
_WHERE = {  # schema -> its property -> the part of a result, or the scenario, that it holds
    "JobView": {"scenario": "Scenario"},
    "ScenarioInfo": {"scenario": "Scenario"},
    "MetricsView": {"metrics": "Metrics", "timing": "Timing"},
}


def add_components(schemas: dict[str, Any]) -> None:
    """Add them, and refer to them from where a scenario, metrics or timing stand."""
    scenario = Scenario.model_json_schema(ref_template=_REFERENCE)
    made = {**scenario.pop("$defs"), "Scenario": scenario}
    made |= {name: _of_result(part) for name, part in (("Metrics", "metrics"), ("Timing", "timing"))}
    if taken := made.keys() & schemas.keys():
        raise ValueError(f"two schemas are called {', '.join(sorted(taken))}")
    schemas |= made
    for holder, properties in _WHERE.items():
        for name, component in properties.items():
            _refer(schemas[holder]["properties"], name, component)
    chosen = schemas["JobRequest"]["properties"]["scenario"]
    chosen["anyOf"] = [_reference("Scenario"), *(one for one in chosen["anyOf"] if one["type"] == "string")]


def _reference(component: str) -> dict[str, str]:
    return {"$ref": _REFERENCE.format(model=component)}


def _refer(properties: dict[str, Any], name: str, component: str) -> None:
    before = properties[name]
    nullable = any(one == _NULL for one in before.get("anyOf", ()))
    kept = {key: value for key, value in before.items() if key in ("title", "description")}
    allowed = [_reference(component), *([_NULL] if nullable else [])]
    properties[name] = {**kept, "anyOf": allowed}


def _of_result(part: str) -> dict[str, Any]:
    """The schema of the numbers below one key of a result; blocks of them are objects of their own."""
    whole: dict[str, Any] = {"type": "object", "properties": {}, "description": f"`{part}` of a result."}
    for metric in METRICS:
        root, *names = metric.key.split(".")
        if root != part:
            continue
        holder = whole
        for name in names[:-1]:
            inner = {"anyOf": [{"type": "object", "properties": {}}, _NULL]}
            holder = holder["properties"].setdefault(name, inner)["anyOf"][0]
        holder["properties"][names[-1]] = _schema_of(metric)
    return whole


def _schema_of(metric: Metric) -> dict[str, Any]:
    """Null where a run did not come so far; along x, y and z where it is of an axis each."""
    number = {"type": "boolean"} if metric.unit == "yes or no" else {"type": "number"}
    each = {"type": "array", "items": {"anyOf": [{"type": "number"}, _NULL]}}
    unit = "" if metric.unit in ("1", "yes or no") else f" Unit: {metric.unit}."
    text = f"{metric.definition[:1].upper()}{metric.definition[1:]}.{unit} A sane run has {metric.sane_range}."
    return {"anyOf": [number, each, _NULL], "description": text, "x-unit": metric.unit}
