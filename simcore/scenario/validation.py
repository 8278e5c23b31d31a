"""Turns pydantic's errors into problems that name the field, the value and the allowed range."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, get_args

from pydantic import BaseModel, ValidationError
from pydantic.fields import FieldInfo
from pydantic_core import ErrorDetails, from_json

from simcore.errors import Problem, ScenarioError

MAXIMUM_PROBLEMS = 20
MAXIMUM_NAME = 60

Location = tuple[int | str, ...]


def problems_of(error: ValidationError, model: type[BaseModel], text: str | bytes) -> list[Problem]:
    """One problem for each wrong field of `text`, which was validated as `model`; the first 20 of very many."""
    details = _without_echoes(error.errors(include_url=False))
    if any(item["type"] == "json_invalid" for item in details):
        return [Problem("scenario", "text", f"is not JSON: {details[0]['msg'].removeprefix('Invalid JSON: ')}")]
    data = from_json(text)
    problems: list[Problem] = []
    for item in details[:MAXIMUM_PROBLEMS]:
        cause = item.get("ctx", {}).get("error")
        problems += (
            cause.problems if isinstance(cause, ScenarioError) else [_problem(item, _find(model, data, item["loc"]))]
        )
    if len(details) > MAXIMUM_PROBLEMS:
        problems.append(Problem("scenario", f"{len(details)} problems", f"the first {MAXIMUM_PROBLEMS} are named"))
    return problems


def _without_echoes(details: list[ErrorDetails]) -> list[ErrorDetails]:
    """A list that is too short only because its items were wrong is no error of its own."""
    wrong = {item["loc"][:depth] for item in details for depth in range(1, len(item["loc"]))}
    return [item for item in details if item["type"] != "too_short" or item["loc"] not in wrong]


@dataclass(frozen=True)
class _Place:
    """Where an error is: its dotted name, the value there, the model that has the field, the field."""

    name: str
    value: Any
    holder: type[BaseModel] | None
    field: FieldInfo | None


def _find(model: type[BaseModel], data: Any, location: Location) -> _Place:
    """Follow pydantic's location; the tag that it adds to it below a union of kinds is not a field."""
    here: type[BaseModel] | None = model
    holder: type[BaseModel] | None = None
    field: FieldInfo | None = None
    tags: dict[str, type[BaseModel]] = {}
    name = ""
    for step in location:
        if step in tags:
            here, tags = tags[str(step)], {}
            continue
        data = _item(data, step)
        if isinstance(step, int):
            name += f"[{step}]"
            continue
        name += f".{_shown(step)}" if name else _shown(step)
        holder, field = here, _field(here, step) if here else None
        models = _models(field) if field else []
        here = models[0] if len(models) == 1 else None
        tags = {m.model_fields["kind"].default: m for m in models} if len(models) > 1 else {}
    return _Place(name or "scenario", data, holder, field)


def _problem(item: ErrorDetails, place: _Place) -> Problem:
    if item["type"] == "extra_forbidden":
        known = sorted(info.alias or name for name, info in place.holder.model_fields.items()) if place.holder else []
        return Problem(place.name, place.value, f"unknown field; known here: {', '.join(known)}")
    if item["type"] == "union_tag_invalid":
        kinds = item["ctx"]["expected_tags"].replace("'", "")
        return Problem(f"{place.name}.kind", _item(place.value, "kind"), f"must be one of {kinds}")
    if item["type"] == "union_tag_not_found":
        return Problem(f"{place.name}.kind", None, f"is missing; it must be one of {', '.join(_kinds(place.field))}")
    message = item["msg"].replace("Input should", "should").replace("Field required", "is missing")
    message = message.replace("Tuple", "list").replace("String", "text").replace(" after validation", "")
    allowed = place.field.description if place.field and not _models(place.field) else None
    return Problem(place.name, place.value, f"{message} (allowed: {allowed})" if allowed else message)


def _item(data: Any, step: int | str) -> Any:
    try:
        return data[step]
    except (KeyError, IndexError, TypeError):
        return None


def _field(model: type[BaseModel], name: str) -> FieldInfo | None:
    return next((info for key, info in model.model_fields.items() if name == (info.alias or key)), None)


def _models(field: FieldInfo) -> list[type[BaseModel]]:
    """The model of a block, the models of a union of kinds, nothing for a plain value."""
    members: list[Any] = [field.annotation]
    while any(get_args(member) for member in members):  # unions, lists, annotations
        members = [part for member in members for part in get_args(member) or (member,)]
    return [member for member in members if isinstance(member, type) and issubclass(member, BaseModel)]


def _kinds(field: FieldInfo | None) -> list[str]:
    """The kinds of a union."""
    return [model.model_fields["kind"].default for model in _models(field)] if field else []


def _shown(name: str) -> str:
    """A field's name on one line: whatever stands in the input."""
    name = name if name.isprintable() else repr(name)
    return name if len(name) <= MAXIMUM_NAME else name[: MAXIMUM_NAME - 3] + "..."
