"""Turns pydantic's errors into problems that name the field, the value and the allowed range."""

from __future__ import annotations

import json
from collections.abc import Iterable
from typing import Any

from pydantic import BaseModel, ValidationError

from simcore.errors import Problem, ScenarioError


def problems_of(error: ValidationError, model: type[BaseModel], text: str | bytes) -> list[Problem]:
    """One problem for each wrong field of `text`, which was validated as `model`."""
    problems: list[Problem] = []
    for item in error.errors(include_url=False, include_context=True):
        cause = item.get("ctx", {}).get("error")
        if isinstance(cause, ScenarioError):
            problems.extend(cause.problems)
        elif item["type"].startswith("json_"):
            problems.append(Problem("scenario", "text", f"is not JSON: {item['msg']}"))
        else:
            problems.append(_problem(item, model, json.loads(text)))
    return problems


def _problem(item: Any, model: type[BaseModel], data: Any) -> Problem:
    names = _without_tags(item["loc"], data)
    field = _dotted(names) or "scenario"
    value = _value_at(data, names)
    if item["type"] == "extra_forbidden":
        known = ", ".join(sorted(_fields_beside(model, data, names)))
        return Problem(field, value, f"unknown field; known here: {known}")
    if item["type"] in ("union_tag_invalid", "union_tag_not_found"):
        kinds = item["ctx"].get("expected_tags", "").replace("'", "") or "line, sine / ifem, replay, open_loop"
        got = value.get("kind") if isinstance(value, dict) else value
        return Problem(f"{field}.kind", got, f"must be one of {kinds}")
    message = item["msg"].replace("Input should", "should").removeprefix("Value error, ")
    allowed = _description(model, data, names)
    return Problem(field, value, f"{message} (allowed: {allowed})" if allowed else message)


def _without_tags(loc: Iterable[str | int], data: Any) -> list[str | int]:
    """pydantic puts the tag of a union into the location: drop it, it is not a field."""
    names: list[str | int] = []
    at = data
    for step in loc:
        if isinstance(at, dict) and at.get("kind") == step and step not in at:
            continue
        names.append(step)
        at = _value_at(at, [step])
    return names


def _dotted(names: list[str | int]) -> str:
    text = ""
    for name in names:
        text += f"[{name}]" if isinstance(name, int) else f".{name}" if text else name
    return text


def _value_at(data: Any, names: Iterable[str | int]) -> Any:
    for name in names:
        try:
            data = data[name]
        except (KeyError, IndexError, TypeError):
            return None
    return data


def _model_at(model: type[BaseModel], data: Any, names: list[str | int]) -> type[BaseModel] | None:
    """The pydantic model that holds the last of `names`."""
    here: type[BaseModel] | None = model
    for depth, name in enumerate(names[:-1]):
        info = _field(here, name) if here is not None else None
        if info is None:
            return None
        block = _value_at(data, names[: depth + 1])
        here = _choose(info.annotation, block)
    return here


def _field(model: type[BaseModel], name: str | int) -> Any:
    for key, info in model.model_fields.items():
        if name in (key, info.alias) and (info.alias is None or name == info.alias):
            return info
    return None


def _choose(annotation: Any, block: Any) -> type[BaseModel] | None:
    """The model meant by an annotation: itself, or the member of a union whose kind the block names."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return annotation
    kind = block.get("kind") if isinstance(block, dict) else None
    for member in getattr(annotation, "__args__", ()):
        if isinstance(member, type) and issubclass(member, BaseModel) and member.model_fields["kind"].default == kind:
            return member
    return None


def _fields_beside(model: type[BaseModel], data: Any, names: list[str | int]) -> list[str]:
    holder = _model_at(model, data, names)
    return [info.alias or key for key, info in holder.model_fields.items()] if holder else []


def _description(model: type[BaseModel], data: Any, names: list[str | int]) -> str:
    fields = [name for name in names if isinstance(name, str)]
    holder = _model_at(model, data, list(fields)) if fields else None
    info = _field(holder, fields[-1]) if holder else None
    return (info.description or "") if info else ""
