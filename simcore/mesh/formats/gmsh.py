"""Gmsh's .msh: 1, 2.x and 4.1 in full, 4.0 as text. Physical groups are read by name and number.

Group numbers count for each dimension on their own: `gmsh:physical=3` may be a surface and a volume.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from simcore.mesh.formats.cursor import BinaryCursor, TextCursor
from simcore.mesh.formats.gmsh_old import read_first_format
from simcore.mesh.formats.gmsh_sections import read_sections
from simcore.mesh.formats.raw import CellBlock, FormatError, NumberArray, RawMesh, check_points, rows_of

if TYPE_CHECKING:
    from simcore.arrays import Floats, Ints
    from simcore.mesh.formats.gmsh_content import Content, Elements

PLACES = ("point", "curve", "surface", "volume")


def read_gmsh(data: bytes) -> RawMesh:
    """The mesh in the content of a .msh file. Raises FormatError."""
    if data.lstrip()[:1] == b"(":
        raise FormatError("is a Fluent mesh; of the files that end in .msh, those of Gmsh are read")
    header = BinaryCursor(data)
    first = header.line()
    while first == "$Comments":
        header.skip_past(b"$EndComments")
        first = header.line()
    if first == "$NOD":
        return assembled(read_first_format(TextCursor(data)))
    if first != "$MeshFormat":
        raise FormatError("line 1: is not $MeshFormat, with which a mesh of Gmsh begins")
    version, binary, size = _format_of(header)
    if not binary:
        return assembled(read_sections(TextCursor(data), version, 8))
    if version == "4.0":
        raise FormatError("is binary in Gmsh's format 4.0, which is read as text alone: save it as 4.1")
    header.order = "<" if data[header.at : header.at + 4] == b"\1\0\0\0" else ">"
    if header.numbers(1, np.int32)[0] != 1:
        raise header.fault("the number 1, which tells the order of the bytes, is missing")
    if header.line() != "$EndMeshFormat":
        raise header.fault("$EndMeshFormat is missing")
    return assembled(read_sections(header, version, size))


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
        every = [numbers] if at_nodes else [elements.numbers for elements in kept]
        raw.arrays.append(_data_array(name, at_nodes, every, of, values))
        if unknown := int(np.count_nonzero(~np.isin(of, np.concatenate([*every, np.zeros(0, np.int64)])))):
            what = "nodes" if at_nodes else "elements"
            raw.remarks.append(f"{unknown} numbers of {name[:100]!r} are left out: their {what} are not in the file")
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
            raw.refused[name] = "is the name of several groups; each needs a name of its own"
        else:
            raw.cell_sets[name] = filled[0]


def _data_array(name: str, at_nodes: bool, numbers: list[Ints], of: Ints, values: Floats) -> NumberArray:
    """numbers: of the nodes, or of each block's elements. of: those that have the values. Raises FormatError."""
    what = "nodes" if at_nodes else "elements"
    if len(np.unique(of)) < len(of):
        raise FormatError(f"has data of the name {name[:40]!r} that give two values to one of the {what}")

    def placed(every: Ints) -> Floats:
        out = np.zeros(len(every))
        known = np.isin(of, every)
        if known.any():
            out[rows_of(every, of[known], "data", what)] = values[known]
        return out

    arrays = [placed(every) for every in numbers]
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
