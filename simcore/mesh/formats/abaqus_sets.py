"""The sets of an .inp: numbers, ranges, other sets; a name that comes again adds to its set."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from simcore.mesh.formats.raw import MAXIMUM_POINTS, FormatError

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from simcore.arrays import Ints
    from simcore.mesh.formats.abaqus_keywords import Keyword
    from simcore.mesh.formats.raw import RawMesh

MAXIMUM_MEMBERS = 8 * MAXIMUM_POINTS
MOST_SETS, LONGEST_NAME = 1000, 200
PART, ASSEMBLY = "part", "assembly"  # where a number counts: each has its own node 1


@dataclass
class Members:
    """A set as the file spells its name, with the numbers of its members by where they count."""

    name: str
    line: int
    numbers: dict[str, set[int]] = field(default_factory=lambda: {PART: set(), ASSEMBLY: set()})
    used_at: int | None = None  # line of a set that took its members

    def add(self, where: str, numbers: Iterable[int], line: int) -> None:
        """Raises FormatError where another set took its members before."""
        count = sum(len(of) for of in self.numbers.values())
        self.numbers[where].update(numbers)
        self.line = line
        if self.used_at is not None and sum(len(of) for of in self.numbers.values()) > count:
            raise FormatError(
                f"line {line}: the set {self.name!r} grows after line {self.used_at} has taken its members"
            )


@dataclass
class Sets:
    """Node sets and element sets, by name in small letters, of the part or of the assembly."""

    of_nodes: dict[str, Members] = field(default_factory=dict)
    of_elements: dict[str, Members] = field(default_factory=dict)


@dataclass
class SetReader:
    """Reads *NSET and *ELSET, and what *NODE and *ELEMENT say of sets. where: what the file describes at the moment."""

    where: str = PART
    instance: str | None = None
    sets: dict[str, Sets] = field(default_factory=lambda: {PART: Sets(), ASSEMBLY: Sets()})
    nodes_of_sets: list[tuple[Members, Members, str, int]] = field(default_factory=list)  # node set, element set

    def name_nodes(self, name: str, numbers: list[int], line: int) -> None:
        """*NODE, NSET=name."""
        _at(self.sets[self.where].of_nodes, name, line).add(self.where, numbers, line)

    def name_elements(self, name: str, numbers: list[int], line: int) -> None:
        """*ELEMENT, ELSET=name."""
        _at(self.sets[self.where].of_elements, name, line).add(self.where, numbers, line)

    def read(self, keyword: Keyword) -> None:
        """*NSET or *ELSET. Raises FormatError."""
        name = keyword.parameters.get(keyword.name, "")
        if not name:
            raise keyword.fault(f"*{keyword.name} needs {keyword.name}=")
        where = self._where(keyword)
        target = _at(self._table(self.where, keyword), name, keyword.line)
        if "GENERATE" in keyword.parameters:
            target.add(where, _generated(keyword), keyword.line)
        else:
            for line, fields in keyword.data:
                for text in fields:
                    if text:
                        self._take(target, keyword, where, line, text.strip('"'))
        if keyword.name == "NSET" and (elements := keyword.parameters.get("ELSET")):
            source = self.sets[self.where].of_elements.get(elements.casefold())
            if source is None:
                raise keyword.fault(f"the set {elements[:40]!r} is not defined before this line")
            source.used_at = target.used_at = keyword.line
            self.nodes_of_sets.append((target, source, where, keyword.line))

    def _table(self, where: str, keyword: Keyword) -> dict[str, Members]:
        return self.sets[where].of_nodes if keyword.name == "NSET" else self.sets[where].of_elements

    def _where(self, keyword: Keyword) -> str:
        """Whose numbers the members are."""
        instance = keyword.parameters.get("INSTANCE")
        if instance is None:
            return self.where
        if self.instance is None or instance.casefold() != self.instance.casefold():
            raise keyword.fault(f"the instance {instance[:40]!r} is not in the file")
        return PART

    def _take(self, target: Members, keyword: Keyword, where: str, line: int, text: str) -> None:
        """A number, or the name of a set; `Organ-1.12` is number 12 of the instance Organ-1."""
        instance, dot, rest = text.partition(".")
        scopes = [where, self.where]
        if dot and self.instance is not None and instance.casefold() == self.instance.casefold():
            text, where, scopes = rest, PART, [PART]
        if re.fullmatch(r"[0-9]{1,17}", text):
            target.add(where, [int(text)], line)
            return
        found = [self._table(scope, keyword).get(text.casefold()) for scope in scopes]
        source = next((members for members in found if members is not None), None)
        if source is None or source is target:
            raise keyword.fault(f"{text[:40]!r} is neither a number nor a set that is defined before this line", line)
        source.used_at = line
        for of, numbers in source.numbers.items():
            target.add(of, numbers, line)


def _at(table: dict[str, Members], name: str, line: int) -> Members:
    if len(name) > LONGEST_NAME or (len(table) >= MOST_SETS and name.casefold() not in table):
        allowed = f"at most {MOST_SETS} sets are allowed, with names of at most {LONGEST_NAME} characters"
        raise FormatError(f"line {line}: {allowed}")
    return table.setdefault(name.casefold(), Members(name, line))


def _generated(keyword: Keyword) -> list[int]:
    """Lines `first, last, increment`."""
    numbers: list[int] = []
    for line, fields in keyword.data:
        row = [keyword.integer(line, text) for text in fields if text]
        first, last, step = [*row, 1][:3] if len(row) in (2, 3) else (1, 0, 0)
        if step < 1 or last < first or (last - first) % step:
            raise keyword.fault(f"{', '.join(fields)[:60]!r} is not first, last, increment", line)
        if (last - first) // step + len(numbers) > MAXIMUM_MEMBERS:
            raise keyword.fault(f"holds more than {MAXIMUM_MEMBERS} members", line)
        numbers += range(first, last + 1, step)
    return numbers


@dataclass
class Numbered:
    """What the numbers of one place stand for: rows of the points, nodes of the elements."""

    nodes: dict[int, int] = field(default_factory=dict)
    elements: dict[int, tuple[int, ...]] = field(default_factory=dict)


def put_sets(raw: RawMesh, reader: SetReader, numbered: dict[str, Numbered]) -> None:
    """The sets as rows of the points; a name with two meanings is refused when asked for. Raises FormatError for a
    member that the file does not define."""
    for target, source, where, line in reader.nodes_of_sets:
        nodes = {node for element in _elements(source, where, numbered[where]) for node in element}
        target.numbers[where].update(nodes)
        target.line = line
    for where in (PART, ASSEMBLY):
        for members in reader.sets[where].of_nodes.values():
            rows = [row for of, level in numbered.items() for row in _rows(members, of, level)]
            _keep(raw, raw.node_sets, members.name, rows)
        for members in reader.sets[where].of_elements.values():
            rows = [
                level.nodes[node]
                for of, level in numbered.items()
                for element in _elements(members, of, level)
                for node in element
                if node in level.nodes
            ]
            _keep(raw, raw.cell_sets, members.name, rows)


def _rows(members: Members, where: str, level: Numbered) -> Iterator[int]:
    for number in members.numbers[where]:
        if number not in level.nodes:
            raise FormatError(f"line {members.line}: has a set with node {number}, which the file does not define")
        yield level.nodes[number]


def _elements(members: Members, where: str, level: Numbered) -> Iterator[tuple[int, ...]]:
    for number in members.numbers[where]:
        if number not in level.elements:
            raise FormatError(f"line {members.line}: has a set with element {number}, which the file does not define")
        yield level.elements[number]


def _keep(raw: RawMesh, sets: dict[str, Ints], name: str, members: list[int]) -> None:
    rows = np.unique(np.array(members, np.int64))
    other = next((key for key in sets if key.casefold() == name.casefold()), None)
    if other is not None and not np.array_equal(sets[other], rows):
        raw.refused[other] = "is a set of the part and another one of the assembly; each needs a name of its own"
        return
    sets[name if other is None else other] = rows
