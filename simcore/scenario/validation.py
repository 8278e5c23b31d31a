"""Turns pydantic's errors into problems that name the field, the value and the allowed range."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Any, get_args

from pydantic import BaseModel, ValidationError
from pydantic.fields import FieldInfo
from pydantic_core import ErrorDetails, from_json

from simcore.errors import Problem, ScenarioError
from simcore.scenario.suggestions import as_list, did_you_mean, in_another_unit, unit_of

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
    root: type[BaseModel]

    @property
    def leaf(self) -> str:
        """The last part of the name, without the number of an item."""
        return re.sub(r"\[\d+\]", "", self.name.rpartition(".")[2])


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
    return _Place(name or "scenario", data, holder, field, model)


def _problem(item: ErrorDetails, place: _Place) -> Problem:
    if item["type"] == "extra_forbidden":
        return Problem(place.name, place.value, _unknown_field(place))
    if item["type"] == "union_tag_invalid":
        kinds = item["ctx"]["expected_tags"].replace("'", "")
        kind = _item(place.value, "kind")
        return Problem(f"{place.name}.kind", kind, f"must be one of {kinds}{did_you_mean(kind, kinds.split(', '))}")
    if item["type"] == "union_tag_not_found":
        return Problem(f"{place.name}.kind", None, f"is missing; it must be one of {', '.join(_kinds(place.field))}")
    message = item["msg"].removeprefix("Value error, ").replace("Input should", "should")
    message = message.replace("Field required", "is missing")
    message = message.replace("Tuple", "list").replace("String", "text").replace(" after validation", "")
    message = message.replace("valid array", "list")
    allowed = _with_unit(place) if place.field and not _models(place.field) else None
    return Problem(
        place.name, place.value, message + (f" (allowed: {allowed})" if allowed else "") + _guess(item, place)
    )


def _unknown_field(place: _Place) -> str:
    """What is known there instead, and where a field of that name is."""
    known = sorted(info.alias or name for name, info in place.holder.model_fields.items()) if place.holder else []
    leaf = place.name.rpartition(".")[2]
    elsewhere = [path for path in _paths(place.root) if path.rpartition(".")[2] == leaf and path != place.name]
    meant = f"; did you mean {elsewhere[0]}?" if elsewhere else did_you_mean(leaf, known)
    return f"unknown field; known here: {', '.join(known)}{meant}"


def _paths(model: type[BaseModel], prefix: str = "") -> list[str]:
    """Dotted names of all fields."""
    paths = []
    for name, info in model.model_fields.items():
        path = prefix + (info.alias or name)
        inner = [found for one in _models(info) for found in _paths(one, f"{path}.")]
        paths += inner or [path]
    return list(dict.fromkeys(paths))


def _with_unit(place: _Place) -> str | None:
    """The description of a field; a range in it has its unit."""
    text = place.field.description if place.field else None
    unit = unit_of(place.leaf)
    return f"{text} {unit}" if text and unit and text[-1].isdigit() else text


def _guess(item: ErrorDetails, place: _Place) -> str:
    if item["type"] in ("greater_than_equal", "less_than_equal"):
        low, high = _range_of(place)
        return in_another_unit(place.leaf, place.value, low, high)
    if item["type"] in ("tuple_type", "list_type"):
        return as_list(place.value)
    if item["type"] == "literal_error" and place.field is not None:
        return did_you_mean(place.value, re.findall(r"'([^']+)'", item["ctx"]["expected"]))
    return ""


def _range_of(place: _Place) -> tuple[float | None, float | None]:
    """The bounds of a number, or of each number of a list."""
    if place.field is None:
        return None, None
    notes, parts = list(place.field.metadata), [place.field.annotation]
    while parts:
        part = parts.pop()
        notes += [inner for note in getattr(part, "__metadata__", ()) for inner in getattr(note, "metadata", [note])]
        parts += get_args(part)[:1]
    low = next((float(note.ge) for note in notes if getattr(note, "ge", None) is not None), None)
    high = next((float(note.le) for note in notes if getattr(note, "le", None) is not None), None)
    return low, high


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
