"""Gmsh's .msh: 1, 2.x and 4.1 in full, 4.0 as text. Physical groups are read by name and number.

Group numbers count for each dimension on their own: `gmsh:physical=3` may be a surface and a volume.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from simcore.mesh.formats.cursor import BinaryCursor, TextCursor, integer
from simcore.mesh.formats.raw import CellBlock, FormatError, NumberArray, RawMesh, check_points, integers, rows_of

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
PLACES = ("point", "curve", "surface", "volume")


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


def read_gmsh(data: bytes) -> RawMesh:
    """The mesh in the content of a .msh file. Raises FormatError."""
    from simcore.mesh.formats import gmsh_old, gmsh_sections

    if data.lstrip()[:1] == b"(":
        raise FormatError("is a Fluent mesh; of the files that end in .msh, those of Gmsh are read")
    header = BinaryCursor(data)
    first = header.line()
    while first == "$Comments":
        header.skip_past(b"$EndComments")
        first = header.line()
    if first == "$NOD":
        return assembled(gmsh_old.read_first_format(TextCursor(data)))
    if first != "$MeshFormat":
        raise FormatError("line 1: is not $MeshFormat, with which a mesh of Gmsh begins")
    version, binary, size = _format_of(header)
    if not binary:
        return assembled(gmsh_sections.read_sections(TextCursor(data), version, 8))
    if version == "4.0":
        raise FormatError("is binary in Gmsh's format 4.0, which is read as text alone: save it as 4.1")
    header.order = "<" if data[header.at : header.at + 4] == b"\1\0\0\0" else ">"
    if header.numbers(1, np.int32)[0] != 1:
        raise header.fault("the number 1, which tells the order of the bytes, is missing")
    if header.line() != "$EndMeshFormat":
        raise header.fault("$EndMeshFormat is missing")
    return assembled(gmsh_sections.read_sections(header, version, size))


def _format_of(cursor: BinaryCursor) -> tuple[str, bool, int]:
    words = cursor.line().split()
    if len(words) != 3 or words[1] not in ("0", "1") or words[2] not in ("4", "8"):
        raise FormatError("line 2: is not a version, 0 or 1 for text or binary, and the size of a number")
    version = {"2": "2", "2.0": "2", "2.1": "2", "2.2": "2", "4": "4.0", "4.0": "4.0", "4.1": "4.1"}.get(words[0])
    if version is None:
        raise FormatError(f"line 2: is of Gmsh's format {words[0][:20]}; 1, 2, 4.0 and 4.1 are read: save it as 4.1")
    return version, words[1] == "1", int(words[2])


def assembled(content: Content) -> RawMesh:
    """The mesh that the sections describe. Raises FormatError for a node that is not there."""
    numbers = np.concatenate(content.numbers) if content.numbers else np.zeros(0, np.int64)
    points = np.concatenate(content.points) if content.points else np.zeros((0, 3))
    check_points(len(points))
    kept = [block for block in content.elements if len(block.nodes)]
    blocks = [
        CellBlock(elements.block.kind, rows_of(numbers, elements.nodes, f"a {elements.block.name}"))
        for elements in kept
    ]
    raw = RawMesh(points, blocks, remarks=content.remarks)
    raw.arrays += [_group_array(kept, dimension) for dimension in range(4)]
    _name_groups(raw, content.names, kept)
    for name, at_nodes, of, values in content.data:
        raw.arrays.append(_data_array(name, at_nodes, numbers if at_nodes else [b.numbers for b in kept], of, values))
    if content.repeats:
        _drop_repeated(raw, kept)
    return raw


def _group_array(blocks: list[Elements], dimension: int) -> NumberArray:
    values = [
        np.broadcast_to(np.array(block.groups, np.int64), (len(block.nodes), len(block.groups)))
        if block.block.dimension == dimension and block.groups
        else None
        for block in blocks
    ]
    return NumberArray(f"gmsh:{PLACES[dimension]}", "gmsh:physical", at_points=False, values=values)


def _name_groups(raw: RawMesh, names: list[tuple[int, int, str]], blocks: list[Elements]) -> None:
    found: dict[str, list[Ints]] = {}
    for dimension, number, name in names:
        cells = [
            block.nodes.ravel()
            for block, elements in zip(raw.blocks, blocks, strict=True)
            if elements.block.dimension == dimension and number in elements.groups
        ]
        found.setdefault(name, []).append(np.unique(np.concatenate(cells)) if cells else np.zeros(0, np.int64))
    for name, groups in found.items():
        filled = [nodes for nodes in groups if len(nodes)]
        if not filled:
            raw.refused[name] = "is a physical group without an element (Gmsh's format 2 loses them with Mesh.SaveAll)"
        elif len(filled) > 1:
            raw.refused[name] = "is the name of groups of different dimensions; each needs a name of its own"
        else:
            raw.cell_sets[name] = filled[0]


def _data_array(name: str, at_nodes: bool, numbers: Any, of: Ints, values: Floats) -> NumberArray:
    def placed(every: Ints) -> Floats:
        out = np.zeros(len(every))
        known = np.isin(of, every)
        if known.any():
            out[rows_of(every, of[known], "data")] = values[known]
        return out

    arrays = [placed(numbers)] if at_nodes else [placed(every) for every in numbers]
    return NumberArray(f"{'node' if at_nodes else 'element'}:{name}", name, at_points=at_nodes, values=arrays)


def _drop_repeated(raw: RawMesh, elements: list[Elements]) -> None:
    """Formats 1 and 2 write an element of several groups once for each of them: it is one tetrahedron."""
    tets = [i for i, block in enumerate(raw.blocks) if block.kind == "tetra"]
    if len({elements[i].groups for i in tets}) < 2:
        return
    rows = np.sort(np.concatenate([raw.blocks[i].nodes for i in tets]))
    owner = np.repeat(tets, [len(raw.blocks[i].nodes) for i in tets])
    _, first, same = np.unique(rows, axis=0, return_index=True, return_inverse=True)
    repeated = owner != owner[first[same.ravel()]]
    for i in tets:
        keep = ~repeated[owner == i]
        raw.blocks[i] = CellBlock("tetra", raw.blocks[i].nodes[keep])
        raw.arrays = [_without_rows(array, i, keep) for array in raw.arrays]


def _without_rows(array: NumberArray, block: int, keep: Any) -> NumberArray:
    if array.at_points or array.values[block] is None:
        return array
    values = list(array.values)
    values[block] = values[block][keep]
    return NumberArray(array.key, array.alias, array.at_points, values)


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
