"""What a reader takes from a file: points, cells, and what the file says of them."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from simcore.arrays import Floats, Ints

MAXIMUM_POINTS = 2_000_000
DIMENSIONS = {"vertex": 0, "line": 1, "triangle": 2, "quad": 2, "tetra": 3, "hexahedron": 3, "wedge": 3, "pyramid": 3}


class FormatError(Exception):
    """A file that is not read; says why and where."""


NAMES = {"tetra": "tetrahedron"}  # in sentences


@dataclass(frozen=True)
class CellBlock:
    """Cells of one kind: nodes (k, corners), rows of the points.

    kind: a name of DIMENSIONS, with the number of its nodes behind it if that is not the number of its corners.
    """

    kind: str
    nodes: Ints

    @property
    def name(self) -> str:
        """The kind in a sentence."""
        return NAMES.get(self.kind, self.kind)

    @property
    def dimension(self) -> int:
        """0 for points to 3 for solids; -1 for what has no place in a mesh."""
        return DIMENSIONS.get(self.kind.rstrip("0123456789"), -1)


@dataclass(frozen=True)
class NumberArray:
    """Numbers at the points or at the cells.

    key: its own name. alias: a name that it may share with other arrays. values: one array (n,) at the points, else
    one of (k,) or (k, g) for each block of cells, None for a block without.
    """

    key: str
    alias: str
    at_points: bool
    values: Sequence[Any]

    @property
    def of_integers(self) -> bool:
        """Whether its numbers are integers."""
        return all(values is None or values.dtype.kind in "iu" for values in self.values)


@dataclass
class RawMesh:
    """A file's points (n, 3) in its unit of length, its cells and its names.

    node_sets: rows of the points. cell_sets: rows of the points of the cells in each. refused: names that the file has
    and that cannot be taken, with the reason. remarks: what was left out. ignores_case: whether capitals matter.
    """

    points: Floats
    blocks: list[CellBlock]
    node_sets: dict[str, Ints] = field(default_factory=dict)
    cell_sets: dict[str, Ints] = field(default_factory=dict)
    arrays: list[NumberArray] = field(default_factory=list)
    refused: dict[str, str] = field(default_factory=dict)
    remarks: list[str] = field(default_factory=list)
    ignores_case: bool = False


def rows_of(numbers: Ints, wanted: Ints, what: str, of: str = "nodes") -> Ints:
    """Rows of the points, or of what else `of` names, that have the numbers `wanted`, in its shape.

    Raises FormatError for a number that none has and for one that two have.
    """
    order = np.argsort(numbers, kind="stable")
    ascending = numbers[order]
    twice = np.flatnonzero(ascending[1:] == ascending[:-1])
    if len(twice):
        raise FormatError(f"has two {of} with the number {ascending[twice[0]]}")
    if not len(wanted):
        return np.zeros(wanted.shape, np.int64)
    if not len(ascending):
        raise FormatError(f"has {what} with node {wanted.flat[0]} and no nodes")
    place = np.minimum(np.searchsorted(ascending, wanted), len(ascending) - 1)
    missing = ascending[place] != wanted
    if missing.any():
        raise FormatError(f"has {what} with node {wanted[missing][0]}, which it does not define")
    return np.asarray(order[place], np.int64)


def check_points(count: int) -> None:
    """Raises FormatError for more points than are read, before they are."""
    if count < 0 or count > MAXIMUM_POINTS:
        raise FormatError(f"announces {count} points, at most {MAXIMUM_POINTS} are read, those of no cell included")


def integers(values: Any) -> Ints:
    """Integers, which text may have given as floats. Raises FormatError."""
    values = np.asarray(values)
    if values.dtype.kind == "f":
        wrong = ~(np.abs(values) < 2.0**53)
        wrong[~wrong] = values[~wrong] % 1.0 != 0.0
        if wrong.any():
            raise FormatError(f"has {values[wrong][0]:g} as a number that must be an integer")
    whole: Ints = values.astype(np.int64)
    return whole
