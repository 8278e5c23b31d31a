"""What the sections of a Gmsh file give: nodes, elements of one type in the same groups, names, data."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from simcore.mesh.formats.cursor import integer
from simcore.mesh.formats.raw import CellBlock, FormatError, integers

if TYPE_CHECKING:
    from collections.abc import Callable

    from simcore.arrays import Floats, Ints

ELEMENTS: dict[int, tuple[str, int]] = {
    1: ("line", 2), 2: ("triangle", 3), 3: ("quad", 4), 4: ("tetra", 4), 5: ("hexahedron", 8), 6: ("wedge", 6),
    7: ("pyramid", 5), 8: ("line3", 3), 9: ("triangle6", 6), 10: ("quad9", 9), 11: ("tetra10", 10),
    12: ("hexahedron27", 27), 13: ("wedge18", 18), 14: ("pyramid14", 14), 15: ("vertex", 1), 16: ("quad8", 8),
    17: ("hexahedron20", 20), 18: ("wedge15", 15), 19: ("pyramid13", 13), 20: ("triangle9", 9),
    21: ("triangle10", 10), 22: ("triangle12", 12), 23: ("triangle15", 15), 26: ("line4", 4), 27: ("line5", 5),
    28: ("line6", 6), 29: ("tetra20", 20), 30: ("tetra35", 35), 31: ("tetra56", 56),
}  # fmt: skip


class Elements(NamedTuple):
    """Elements of one type in the same groups: numbers (k,), nodes (k, c) by number, groups of their dimension."""

    kind: int
    numbers: Ints
    nodes: Ints
    groups: tuple[int, ...]

    @property
    def block(self) -> CellBlock:
        """The cells, their nodes by number still."""
        return CellBlock(ELEMENTS[self.kind][0], self.nodes)


class Content:
    """What the sections of a file have given so far."""

    def __init__(self) -> None:
        self.names: list[tuple[int, int, str]] = []  # dimension, number, name
        self.entity_groups: dict[tuple[int, int], tuple[int, ...]] = {}
        self.numbers: list[Ints] = []
        self.points: list[Floats] = []
        self.elements: list[Elements] = []
        self.data: list[tuple[str, bool, Ints, Floats]] = []  # name, at the nodes, their numbers, values
        self.remarks: list[str] = []
        self.repeats = False  # whether an element of two groups is written twice

    def add_nodes(self, numbers: Any, points: Any) -> None:
        """Numbers (k,), points (k, 3). Raises FormatError for numbers that are not integers."""
        self.numbers.append(integers(numbers))
        self.points.append(np.asarray(points, np.float64))


def grouped(rows: list[tuple[int, int, int, list[int]]], fault: Callable[[str], FormatError]) -> list[Elements]:
    """Elements out of rows (number, type, group, node numbers)."""
    together: dict[tuple[int, int], tuple[list[int], list[list[int]]]] = {}
    for number, kind, group, nodes in rows:
        if kind not in ELEMENTS:
            raise fault(f"elements of Gmsh's type {kind} are not known")
        numbers, cells = together.setdefault((kind, group), ([], []))
        numbers.append(number)
        cells.append(nodes)
    return [
        Elements(kind, np.array(numbers, np.int64), np.array(cells, np.int64), (group,) if group else ())
        for (kind, group), (numbers, cells) in together.items()
    ]


def count_line(cursor: Any) -> int:
    """A line with one number that is not negative."""
    count = integer(cursor, cursor.line())
    if count < 0:
        raise cursor.fault(f"{count} is not a count")
    return count
