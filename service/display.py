"""Scenarios, results and their values as people read them."""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any

from simcore.scenario.scenario import Scenario


def job_text(scenario: Scenario, result: dict[str, Any] | None) -> str:
    """The scenario and, once there is one, the result, as Markdown."""
    lines = [f"# {scenario.name}", ""]
    lines += _result_lines(result) if result is not None else ["Running, or stopped early.", ""]
    defaults = dict(flat(Scenario().resolved()))
    rows = [(key, value) for key, value in flat(scenario.resolved()) if key != "controller.poses"]
    lines += ["## Scenario", "", "| field | value | |", "| --- | --- | --- |"]
    lines += [f"| {k} | {_cell(v)} | {'' if defaults.get(k) == v else 'set'} |" for k, v in rows]
    return "\n".join(lines) + "\n"


def _result_lines(result: dict[str, Any]) -> list[str]:
    lines = [f"**{result['status']}** {result.get('message', '')}", "", "| result | |", "| --- | --- |"]
    groups = ("metrics", "timing", "solver")
    lines += [f"| {key} | {_cell(value)} |" for group in groups for key, value in flat(result.get(group, {}))]
    return [*lines, f"| digest | `{result['digest']}` |", ""]


def plain_values(data: dict[str, Any], leave_out: tuple[str, ...] = ()) -> dict[str, Any]:
    """Nested JSON data as one level of strings, floats and booleans; lists as JSON text, nothing for null."""
    values: dict[str, Any] = {}
    for key, value in flat(data):
        if value is None or set(key.split(".")) & set(leave_out):
            continue
        number = isinstance(value, int | float) and not isinstance(value, bool)
        values[key] = float(value) if number else json.dumps(value) if isinstance(value, list) else value
    return values


def flat(data: dict[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """(dotted name, value) of every leaf of nested JSON objects."""
    for key, value in data.items():
        if isinstance(value, dict):
            yield from flat(value, f"{prefix}{key}.")
        else:
            yield prefix + key, value


def _cell(value: Any) -> str:
    return f"{value:.6g}" if isinstance(value, float) else json.dumps(value)


def shown(value: Any) -> str:
    """A value of a result: four significant digits, yes or no, a dash for None."""
    if value is None:
        return "-"
    if isinstance(value, bool):
        return "yes" if value else "no"
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def size_text(size: float) -> str:
    """Bytes in the unit that leaves one to three digits before the point."""
    for unit in ("B", "KB", "MB"):
        if size < 1000:
            return f"{size:.0f} {unit}" if unit == "B" else f"{size:.1f} {unit}"
        size /= 1000
    return f"{size:.1f} GB"
