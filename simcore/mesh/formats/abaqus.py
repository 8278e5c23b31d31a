"""Abaqus's .inp, as common exporters write it: one part or none, nodes, elements, sets.

A keyword that brings a mesh about in another way (copies, generators, other files) is refused, never passed over.
"""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING

import numpy as np

from simcore.mesh.formats.abaqus_keywords import DATA, element_rows, keywords, kind_of
from simcore.mesh.formats.abaqus_sets import ASSEMBLY, PART, Numbered, SetReader, put_sets
from simcore.mesh.formats.raw import NAMES, CellBlock, FormatError, RawMesh, check_points

if TYPE_CHECKING:
    from simcore.mesh.formats.abaqus_keywords import Keyword

MAKERS = ("NCOPY", "NGEN", "NFILL", "NMAP", "ELGEN", "ELCOPY", "SYSTEM", "PARAMETER", "IMPORT")
MEANT = (*DATA, *MAKERS, "INCLUDE", "PART")  # an abbreviation of one of these must not be passed over
_SHORTEST = 3


def _abbreviates(name: str, keyword: str) -> bool:
    return name != keyword and keyword.startswith(name)


def read_abaqus(data: bytes) -> RawMesh:
    """The mesh in the content of an .inp file. Raises FormatError."""
    reader = _Reader()
    for keyword in keywords(data):
        if keyword.name == "INCLUDE" or (keyword.name in DATA and {"INPUT", "FILE"} & keyword.parameters.keys()):
            raise keyword.fault(f"*{keyword.name[:30]} takes its data from another file, which is never read")
        if len(keyword.name) >= _SHORTEST and any(_abbreviates(keyword.name, name) for name in MEANT):
            raise keyword.fault(f"*{keyword.name} is no keyword: spell it out")
        if keyword.name in MAKERS:
            raise keyword.fault(f"*{keyword.name} is not read: every node and element must be written out")
        reader.read(keyword)
    return reader.mesh()


class _Reader:
    """Takes the keywords one by one; `mesh` is what they made."""

    def __init__(self) -> None:
        self.points: list[tuple[float, float, float]] = []
        self.cells: dict[str, list[tuple[int, tuple[int, ...]]]] = {}  # kind -> (line, numbers of the nodes)
        self.numbered = {PART: Numbered(), ASSEMBLY: Numbered()}
        self.sets = SetReader()
        self.shift = (0.0, 0.0, 0.0)
        self.parts = 0
        self.ignored: Counter[str] = Counter()

    def read(self, keyword: Keyword) -> None:
        """Raises FormatError."""
        if keyword.name in ("NSET", "ELSET"):
            self.sets.read(keyword)
        elif keyword.name == "NODE":
            self._read_nodes(keyword)
        elif keyword.name == "ELEMENT":
            self._read_elements(keyword)
        elif keyword.name == "PART":
            self.parts += 1
            if self.parts > 1:
                raise keyword.fault("holds a second part; one part is read")
        elif keyword.name in ("ASSEMBLY", "END INSTANCE"):
            self.sets.where = ASSEMBLY
        elif keyword.name == "INSTANCE":
            self._read_instance(keyword)
        elif keyword.name == "END ASSEMBLY":
            self.sets.where = PART

    def _read_instance(self, keyword: Keyword) -> None:
        if self.sets.instance is not None:
            raise keyword.fault("holds a second instance of a part; one is read")
        self.sets.instance, self.sets.where = keyword.parameters.get("NAME", ""), PART
        rows = [keyword.floats(line, fields) for line, fields in keyword.data]
        if len(rows) > 1 or (rows and len(rows[0]) > 3):
            raise keyword.fault("the instance is turned; one that is moved at most is read", keyword.data[-1][0])
        if rows:
            x, y, z = [*rows[0], 0.0, 0.0, 0.0][:3]
            self.shift = (x, y, z)

    def _read_nodes(self, keyword: Keyword) -> None:
        system = keyword.parameters.get("SYSTEM", "R").upper()
        if system != "R":
            raise keyword.fault(f"nodes in the system {system[:10]} are not read, those in rectangular coordinates are")
        nodes, numbers = self.numbered[self.sets.where].nodes, []
        for line, fields in keyword.data:
            number = keyword.integer(line, fields[0])
            x, y, z = [*keyword.floats(line, fields[1:4]), 0.0, 0.0, 0.0][:3]
            if number in nodes:
                raise keyword.fault(f"node {number} is defined a second time", line)
            nodes[number] = len(self.points)
            self.points.append((x, y, z))
            numbers.append(number)
        check_points(len(self.points))
        if name := keyword.parameters.get("NSET"):
            self.sets.name_nodes(name, numbers, keyword.line)

    def _read_elements(self, keyword: Keyword) -> None:
        kind, corners = kind_of(keyword)
        elements, numbers = self.numbered[self.sets.where].elements, []
        for line, row in element_rows(keyword, corners):
            number, nodes = row[0], tuple(row[1:])
            if number in elements:
                raise keyword.fault(f"element {number} is defined a second time", line)
            if kind is not None and self.sets.where == ASSEMBLY:
                raise keyword.fault("elements of the assembly itself are not read", line)
            elements[number] = nodes
            numbers.append(number)
            if kind is not None:
                self.cells.setdefault(kind, []).append((line, nodes))
        if kind is None:
            self.ignored[keyword.parameters["TYPE"].upper()[:20]] += len(numbers)
        if name := keyword.parameters.get("ELSET"):
            self.sets.name_elements(name, numbers, keyword.line)

    def mesh(self) -> RawMesh:
        """What was read. Raises FormatError for a number that the file does not define."""
        points = np.array(self.points, np.float64).reshape(-1, 3)
        blocks, rows_of_nodes = [], self.numbered[PART].nodes
        points[list(rows_of_nodes.values())] += self.shift
        for kind, cells in self.cells.items():
            rows = []
            for line, nodes in cells:
                missing = next((node for node in nodes if node not in rows_of_nodes), None)
                if missing is not None:
                    name = NAMES.get(kind, kind)
                    raise FormatError(f"line {line}: has a {name} with node {missing}, which the file does not define")
                rows.append([rows_of_nodes[node] for node in nodes])
            blocks.append(CellBlock(kind, np.array(rows, np.int64)))
        raw = RawMesh(points, blocks, ignores_case=True)
        raw.remarks = [f"{count} elements of type {kind} are left out" for kind, count in self.ignored.items()]
        put_sets(raw, self.sets, self.numbered)
        return raw
