"""Every number of the scenario model, found in its own schema, and what a refusal must look like."""

from __future__ import annotations

import copy
import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import pytest

from simcore.errors import ScenarioError
from simcore.scenario.scenario import Scenario

if TYPE_CHECKING:
    from collections.abc import Iterator

Json = dict[str, Any]
Path = tuple[str | int, ...]

STRAIGHT_IN = [0.0, 0.0, -100.0, 1.0, 0.0, 0.0, 0.0]
KINDS: list[Json] = [
    {},
    {"trajectory": {"kind": "sine"}},
    {"trajectory": {"kind": "arc"}},
    {"trajectory": {"kind": "waypoints"}},
    {"trajectory": {"kind": "reach"}},
    {"controller": {"kind": "replay", "poses": [STRAIGHT_IN]}},
    {"controller": {"kind": "open_loop"}},
    {"controller": {"kind": "ifem", "model": {"kind": "separate"}}},
]


def refusal(data: Any) -> ScenarioError:
    """The error of a scenario that must be refused; one line for each problem."""
    with pytest.raises(ScenarioError) as caught:
        Scenario.load(data)
    error = caught.value
    assert str(error).splitlines() == [str(problem) for problem in error.problems]
    assert all(line.isprintable() for line in str(error).splitlines())
    return error


def refusal_or_none(data: Any) -> ScenarioError | None:
    try:
        Scenario.load(data)
    except ScenarioError as error:
        return error
    return None


def refused(data: Any, field: str, *words: str) -> None:
    """Assert that exactly one problem is found: on this field, with its value, its message holding all words."""
    (problem,) = refusal(data).problems
    assert problem.field == field
    value = value_at(data, field)
    assert problem.value == value or (value != value and problem.value != problem.value)
    for word in words:
        assert word in problem.message


def value_at(data: Any, field: str) -> Any:
    for name in re.findall(r"[^.\[\]]+", field):
        data = data[int(name) if name.isdigit() else name]
    return data


def replay(*poses: Any) -> Json:
    return {"controller": {"kind": "replay", "poses": list(poses)}}


# ---- the fields, found in the model's own schema


@dataclass(frozen=True)
class NumberField:
    """A number somewhere in the schema, and a valid scenario that has it."""

    path: Path
    schema: Json
    base: Json
    holder: str  # what the error names when the value is refused by a rule between fields
    optional: bool  # null stands for a derived value

    @property
    def name(self) -> str:
        return "".join(f"[{n}]" if isinstance(n, int) else f".{n}" for n in self.path).lstrip(".")

    def with_value(self, value: Any) -> Json:
        data = copy.deepcopy(self.base)
        at: Any = data
        for name in self.path[:-1]:
            at = at[name]
        at[self.path[-1]] = value
        return data


def numbers(
    node: Json, defs: Json, base: Json, at: Any, path: Path = (), optional: bool = False
) -> Iterator[tuple[Path, Json, bool]]:
    """Path and schema of every number of a model, following the kinds that `at`, a resolved scenario, has."""
    if "$ref" in node:
        yield from numbers(defs[node["$ref"].rsplit("/", 1)[1]], defs, base, at, path)
    elif "discriminator" in node:
        yield from numbers({"$ref": node["discriminator"]["mapping"][at["kind"]]}, defs, base, at, path)
    elif "anyOf" in node:
        for option in node["anyOf"]:
            yield from numbers(option, defs, base, at, path, optional={"type": "null"} in node["anyOf"])
    elif node.get("type") == "object":
        for name, field in node["properties"].items():
            yield from numbers(field, defs, base, at[name], (*path, name))
    elif node.get("type") == "array":
        for i, item in enumerate((node.get("prefixItems") or [node["items"]])[: len(at or [])]):
            yield from numbers(item, defs, base, at[i], (*path, i))
    elif node.get("type") in ("number", "integer"):
        yield path, node, optional


def every_number() -> dict[str, NumberField]:
    schema = Scenario.model_json_schema()
    found: dict[str, NumberField] = {}
    for base in (Scenario.load(kind).resolved() for kind in KINDS):
        for path, node, optional in numbers(schema, schema["$defs"], base, base):
            names = [name for name in path if isinstance(name, str)]
            field = NumberField(path, node, base, ".".join(names), optional)
            kind = base[names[0]].get("kind") if isinstance(base[names[0]], dict) else None
            found[f"{field.name} ({kind})" if kind else field.name] = field
    return found


NUMBERS = every_number()
every_number_field = pytest.mark.parametrize("field", NUMBERS.values(), ids=NUMBERS.keys())
