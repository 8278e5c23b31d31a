"""The built-in scenarios, and changes to a scenario by dotted path."""

from __future__ import annotations

import copy
import json
from typing import Any

from simcore.errors import Problem, ScenarioError
from simcore.scenario.rules import without_derived
from simcore.scenario.scenario import Scenario
from simcore.scenario.suggestions import did_you_mean

_PRESETS: dict[str, tuple[str, dict[str, Any]]] = {
    "demo": (
        "I-FEM, full depth, a bowed path on which the tissue visibly moves",
        {
            "seed": 1,
            "trajectory": {"kind": "sine", "target_mm": [18, 31, 122], "amplitude_mm": 3.0, "periods": 0.5},
        },
    ),
    "line": (
        "I-FEM along a straight oblique line, full depth",
        {"trajectory": {"kind": "line", "target_mm": [24, 41, 122]}},
    ),
    "sine": (
        "I-FEM along the same line with a sine overlay of 1.0 mm",
        {"trajectory": {"kind": "sine", "target_mm": [24, 41, 122], "amplitude_mm": 1.0}},
    ),
    "replay": (
        "prescribed base poses: push 30 mm straight in, hold, pull 1.5 mm back, push again",
        {
            "trajectory": {"kind": "line", "target_mm": [18, 31, 30]},
            "controller": {
                "kind": "replay",
                "poses": [
                    [18.0, 31.0, round(-180.0 + depth, 6), 1.0, 0.0, 0.0, 0.0]
                    for depth in [
                        *(0.1 * (i + 1) for i in range(300)),
                        *(30.0 for _ in range(20)),
                        *(30.0 - 0.05 * (i + 1) for i in range(30)),
                        *(28.5 + 0.05 * (i + 1) for i in range(30)),
                    ]
                ],
            },
        },
    ),
}


def preset_names() -> dict[str, str]:
    """Name -> one line on it, in the order in which a newcomer should meet them."""
    return {name: text for name, (text, _) in _PRESETS.items()}


def preset(name: str) -> Scenario:
    """A built-in scenario by name. Raises ScenarioError for an unknown name."""
    if name not in _PRESETS:
        raise ScenarioError([Problem("scenario", name, _unknown(name))])
    return Scenario.load({"name": name, **copy.deepcopy(_PRESETS[name][1])})


def _unknown(name: str) -> str:
    return f"is not a built-in scenario: {', '.join(_PRESETS)}{did_you_mean(name, _PRESETS)}"


def start(name: str) -> dict[str, Any]:
    """A built-in scenario as JSON to change: every field, null where others settle it. Raises ScenarioError."""
    return without_derived(preset(name).resolved())


def with_changes(data: dict[str, Any], changes: list[str]) -> dict[str, Any]:
    """Scenario JSON with `PATH=VALUE` changes applied left to right.

    VALUE is JSON, else a string. Setting a `kind` replaces its block by the defaults of the new kind.
    Raises ScenarioError for a change that names no field.
    """
    data = copy.deepcopy(data)
    for change in changes:
        path, sign, value = change.partition("=")
        if not sign or not path.strip():
            raise ScenarioError([Problem("--set", change, "must be PATH=VALUE, as in tissue.young_kpa=5.5")])
        _apply(data, path.strip().split("."), _parsed(value))
    return data


def _parsed(value: str) -> Any:
    try:
        return json.loads(value)
    except (ValueError, RecursionError):
        return value


def _apply(data: dict[str, Any], path: list[str], value: Any) -> None:
    *blocks, leaf = path
    holder = data
    for block in blocks:
        holder = holder.setdefault(block, {})
        if not isinstance(holder, dict):
            raise ScenarioError([Problem(".".join(path), value, f"{block} holds a value, not fields")])
    if leaf == "kind" and holder.get("kind") != value:
        holder.clear()
    holder[leaf] = value
