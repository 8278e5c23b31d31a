"""The built-in scenarios, and changes to a scenario by dotted path."""

from __future__ import annotations

import copy
import json
from typing import Any

from simcore.errors import Problem, ScenarioError
from simcore.scenario.point_rules import without_derived
from simcore.scenario.preset_data import PRESETS, unknown_preset
from simcore.scenario.scenario import Scenario


def preset_names() -> dict[str, str]:
    """Name -> one line on it, in the order in which a newcomer should meet them."""
    return {name: text for name, (text, _) in PRESETS.items()}


def preset(name: str) -> Scenario:
    """A built-in scenario by name. Raises ScenarioError for an unknown name."""
    if name not in PRESETS:
        raise ScenarioError([Problem("scenario", name, unknown_preset(name))])
    return Scenario.load({"name": name, **copy.deepcopy(PRESETS[name][1])})


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
