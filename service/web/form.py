"""The form of a scenario, built from its JSON schema: blocks become groups, kinds of a block become a choice."""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from functools import cache
from typing import Any

from simcore.scenario.scenario import Scenario

Json = dict[str, Any]

UNITS = {
    "_n_per_mm": "N/mm",
    "_kg_m3": "kg/m³",
    "_mm_s": "mm/s",
    "_deg_s": "°/s",
    "_per_s": "1/s",
    "_mm": "mm",
    "_kpa": "kPa",
    "_gpa": "GPa",
    "_n": "N",
    "_s": "s",
}
WORDS = {"dt": "time step", "rcm": "RCM", "sha256": "SHA-256"}
OPEN = ("", "tissue", "trajectory", "controller")  # groups that are unfolded at first
_TAG = "kind"


@dataclass(frozen=True)
class Entry:
    """One field. entry: number, integer, text, switch, choice, choices, vector, list or json; kinds: which have it.

    default, minimum, maximum: as in the schema, of each component for a vector.
    """

    path: str
    label: str
    unit: str
    hint: str
    entry: str
    default: Any
    minimum: float | None = None
    maximum: float | None = None
    choices: tuple[str, ...] = ()
    kinds: tuple[str, ...] = ()
    id: str = ""

    @property
    def default_text(self) -> str:
        """The default as it would be typed."""
        if self.default is None:
            return "derived"
        if isinstance(self.default, float | int) and not isinstance(self.default, bool):
            return f"{self.default:.15g}"
        return self.default if isinstance(self.default, str) else json.dumps(self.default)


@dataclass(frozen=True)
class Group:
    """A block. kinds: kind -> description, empty for a block without; kind: the default one."""

    path: str
    title: str
    hint: str
    entries: tuple[Entry, ...]
    groups: tuple[Group, ...] = ()
    kinds: dict[str, str] = field(default_factory=dict)
    kind: str = ""
    inside: tuple[str, ...] = ()  # kinds of the enclosing block that have it
    mark: str = ""

    @property
    def open(self) -> bool:
        """Whether it is unfolded at first."""
        return self.path in OPEN

    @property
    def id(self) -> str:
        """Its id in the page."""
        return (self.path.replace(".", "-") or "run") + self.mark


@cache
def scenario_form() -> tuple[Group, ...]:
    """All groups, the scenario's own fields first."""
    schema = Scenario.model_json_schema()
    maker = _Maker(schema.get("$defs", {}))
    properties = {name: part for name, part in schema["properties"].items() if name != "schema"}
    blocks = {name: part for name, part in properties.items() if maker.is_block(part)}
    own = {name: part for name, part in properties.items() if name not in blocks}
    general = Group("", "Run", "name, randomness, time step", tuple(maker.entry("", n, p) for n, p in own.items()))
    return (general, *(maker.group("", name, part) for name, part in blocks.items()))


def paths() -> list[str]:
    """Dotted names of all fields, kinds included: the possible axes of a grid."""
    names: dict[str, None] = {}

    def visit(group: Group) -> None:
        if group.kinds:
            names[f"{group.path}.{_TAG}"] = None
        names.update(dict.fromkeys(entry.path for entry in group.entries))
        for inner in group.groups:
            visit(inner)

    for group in scenario_form():
        visit(group)
    return list(names)


def label_of(name: str) -> tuple[str, str]:
    """young_kpa -> (Young, kPa)."""
    suffix = next((suffix for suffix in UNITS if name.endswith(suffix)), "")
    text = " ".join(WORDS.get(word, word) for word in name.removesuffix(suffix).split("_"))
    return text[:1].upper() + text[1:], UNITS.get(suffix, "")


class _Maker:
    """Follows references within one schema."""

    def __init__(self, definitions: Json) -> None:
        self._definitions = definitions

    def is_block(self, part: Json) -> bool:
        return bool(self._kinds(part)) or "properties" in self._resolved(part)

    def _resolved(self, part: Json) -> Json:
        name = part.get("$ref", "").rpartition("/")[2]
        schema: Json = self._definitions[name] if name else part
        return schema

    def _kinds(self, part: Json) -> dict[str, Json]:
        """Kind -> its schema, in the order of the union."""
        options = [self._resolved(option) for option in part.get("oneOf", [])]
        return {option["properties"][_TAG]["const"]: option for option in options}

    def group(self, prefix: str, name: str, part: Json, inside: tuple[str, ...] = (), mark: str = "") -> Group:
        """A block as a group. mark: sets it apart from one of the same path in another kind of the enclosing block."""
        path = f"{prefix}{name}"
        kinds = self._kinds(part)
        options = kinds or {"": self._resolved(part)}
        default = part.get("default") or {}
        fields: dict[str, list[tuple[Json, list[str]]]] = {}
        for kind, option in options.items():
            for key, one in option["properties"].items():
                if key != _TAG:
                    _add(fields.setdefault(key, []), one, kind)
        entries, groups = [], []
        for key, variants in fields.items():
            for number, (one, where) in enumerate(variants):
                shared = () if len(where) == len(options) else tuple(where)
                own = f"{mark}-{number}" if number else mark
                if self.is_block(one):
                    groups.append(self.group(f"{path}.", key, one, shared, own))
                else:
                    entries.append(self.entry(f"{path}.", key, one, shared, own))
        about = {kind: _first_sentence(option.get("description", "")) for kind, option in kinds.items()}
        title = label_of(name)[0]
        kind = default.get(_TAG, next(iter(kinds), ""))
        return Group(path, title, part.get("description", ""), tuple(entries), tuple(groups), about, kind, inside, mark)

    def entry(self, prefix: str, name: str, part: Json, kinds: tuple[str, ...] = (), mark: str = "") -> Entry:
        label, unit = label_of(name)
        path = f"{prefix}{name}"
        inner = next((one for one in part.get("anyOf", []) if one.get("type") != "null"), part)
        shape = _shape(inner)
        bounds = inner.get("prefixItems", [inner])[0] if shape == "vector" else inner
        return Entry(
            path=path,
            label=label,
            unit=unit,
            hint=part.get("description", ""),
            entry=shape,
            default=part.get("default"),
            minimum=bounds.get("minimum"),
            maximum=bounds.get("maximum"),
            choices=tuple(inner.get("enum") or inner.get("items", {}).get("enum") or ()),
            kinds=kinds,
            id="f-" + path.replace(".", "-") + mark,
        )


def _add(variants: list[tuple[Json, list[str]]], part: Json, kind: str) -> None:
    """Add a field; one that several kinds share is added once."""
    for known, kinds in variants:
        if known == part:
            kinds.append(kind)
            return
    variants.append((part, [kind]))


def _shape(part: Json) -> str:
    kind = part.get("type")
    if "enum" in part:
        return "choice"
    if kind == "array" and all(one.get("type") == "number" for one in part.get("prefixItems", [{}])):
        return "vector"
    if kind == "array":
        items = part.get("items", {})
        return "choices" if "enum" in items else "list" if items.get("type") == "string" else "json"
    return {"number": "number", "integer": "integer", "boolean": "switch", "string": "text"}.get(str(kind), "json")


def _first_sentence(text: str) -> str:
    return " ".join(text.split()).partition(". ")[0].rstrip(".")
