"""Schemas of the document that are made from the simulation itself: the scenario's own, and those of a result."""

from __future__ import annotations

from typing import Any

from simcore.metric_definitions import METRICS, Metric
from simcore.scenario.scenario import Scenario

_REFERENCE = "#/components/schemas/{model}"
_NULL = {"type": "null"}
_METRICS = ("Metrics", "TrainingMetrics")
_WHERE: dict[str, dict[str, tuple[str, ...]]] = {  # schema -> its property -> what it holds, one of these
    "JobSummary": {"metrics": _METRICS},
    "JobView": {"scenario": ("Scenario",), "metrics": _METRICS, "result": ("InsertionResult", "TrainingResult")},
    "ScenarioInfo": {"scenario": ("Scenario",)},
    "MetricsView": {"metrics": _METRICS, "timing": ("Timing", "TrainingTiming")},
}
_PARTS = {"Metrics": "metrics", "Timing": "timing", "SolverFigures": "solver"}  # schema -> part of a result
_TEXT, _COUNT = {"type": "string"}, {"type": "integer"}
_RMSE = {"type": "number", "x-unit": "mm", "minimum": 0}


def add_components(schemas: dict[str, Any]) -> None:
    """Add them, and refer to them from where a scenario, metrics or timing stand."""
    scenario = Scenario.model_json_schema(ref_template=_REFERENCE)
    made = {**scenario.pop("$defs"), "Scenario": scenario}
    made |= {name: _of_result(part) for name, part in _PARTS.items()} | _results()
    if taken := made.keys() & schemas.keys():
        raise ValueError(f"two schemas are called {', '.join(sorted(taken))}")
    schemas |= made
    for holder, properties in _WHERE.items():
        for name, allowed in properties.items():
            _refer(schemas[holder]["properties"], name, allowed)
    chosen = schemas["JobRequest"]["properties"]["scenario"]
    chosen["anyOf"] = [_reference("Scenario"), *(one for one in chosen["anyOf"] if one["type"] == "string")]


def _reference(component: str) -> dict[str, str]:
    return {"$ref": _REFERENCE.format(model=component)}


def _refer(properties: dict[str, Any], name: str, components: tuple[str, ...]) -> None:
    before = properties[name]
    nullable = any(one == _NULL for one in before.get("anyOf", ()))
    kept = {key: value for key, value in before.items() if key in ("title", "description")}
    allowed = [*map(_reference, components), *([_NULL] if nullable else [])]
    properties[name] = {**kept, "anyOf": allowed}


def _results() -> dict[str, Any]:
    """The whole content of result.json: of an insertion, of a training."""
    common = {
        "status": {**_TEXT, "description": "completed, or why the run ended early."},
        "message": {**_TEXT, "description": "What ended it; empty for completed."},
        "digest": {"anyOf": [_TEXT, _NULL], "description": "SHA-256 of the states, or of the model."},
        "warnings": {"type": "array", "items": _TEXT, "description": "What calls for a second look."},
        "provenance": {"type": "object", "description": "Versions, machine, commit, and the scenario as it was run."},
    }
    lists = {name: {"type": "array"} for name in ("faces", "sets", "regions")}
    held = {"type": "object", "properties": {**lists, "nodes": _COUNT}, "description": "What of the tissue was held."}
    figures = {part: _reference(name) for name, part in _PARTS.items()}
    trained = {"model": _TEXT, "train_rmse_mm": _RMSE, "test_rmse_mm": _RMSE, "train_rows": _COUNT, "test_rows": _COUNT}
    timing = {"fit_s": {"type": "number", "x-unit": "s", "minimum": 0}}
    model = {"type": "object", "description": "The model: its id, size, settings and origin."}
    of_training = {"metrics": _reference("TrainingMetrics"), "timing": _reference("TrainingTiming"), "model": model}
    return {
        "InsertionResult": _object("The result of an insertion.", {**common, **figures, "held": held}),
        "TrainingResult": _object("The result of a training.", {**common, **of_training}),
        "TrainingMetrics": _object("`metrics` of a training: errors of the pose, held-out rows apart.", trained),
        "TrainingTiming": _object("`timing` of a training.", timing),
    }


def _object(description: str, properties: dict[str, Any]) -> dict[str, Any]:
    return {"type": "object", "description": description, "properties": properties}


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
    sane = {"minimum": metric.low, **({} if metric.high is None else {"maximum": metric.high})}
    return {"anyOf": [number, each, _NULL], "description": text, "x-unit": metric.unit, "x-sane-range": sane}
