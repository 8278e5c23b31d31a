"""Medit's .mesh as text, versions 1 to 4. Reference numbers count for each kind of cell on their own."""

from __future__ import annotations

import numpy as np

from simcore.mesh.formats.cursor import TextCursor, integer
from simcore.mesh.formats.raw import CellBlock, FormatError, NumberArray, RawMesh, check_points, integers

CELLS = {
    "Edges": ("line", 2),
    "Triangles": ("triangle", 3),
    "Quadrilaterals": ("quad", 4),
    "Tetrahedra": ("tetra", 4),
    "Hexahedra": ("hexahedron", 8),
    "Hexaedra": ("hexahedron", 8),
    "Prisms": ("wedge", 6),
    "Pyramids": ("pyramid", 5),
}
SKIPPED = {  # numbers of an entry
    "Corners": 1, "Ridges": 1, "RequiredVertices": 1, "RequiredEdges": 1, "RequiredTriangles": 1,
    "RequiredQuadrilaterals": 1, "RequiredTetrahedra": 1, "Normals": 3, "Tangents": 3, "NormalAtVertices": 2,
    "NormalAtTriangleVertices": 3, "NormalAtQuadrilateralVertices": 3, "TangentAtVertices": 2, "TangentAtEdges": 3,
    "SubDomainFromMesh": 4, "SubDomainFromGeom": 4,
}  # fmt: skip


def read_medit(data: bytes) -> RawMesh:
    """The mesh in the content of a .mesh file. Raises FormatError."""
    cursor = TextCursor(data, comment=b"#")
    if cursor.word() != "MeshVersionFormatted":
        raise cursor.fault("is not MeshVersionFormatted, with which a text of Medit begins")
    if cursor.word() not in ("1", "2", "3", "4"):
        raise cursor.fault("is no version from 1 to 4")
    raw, refs = RawMesh(np.zeros((0, 3)), []), list[NumberArray]()
    while not cursor.at_end:
        word = cursor.word()
        if word == "End":
            break
        _read_section(cursor, raw, refs, word)
    for block in raw.blocks:
        if len(block.nodes) and (block.nodes.min() < 0 or block.nodes.max() >= len(raw.points)):
            wrong = block.nodes.max() if block.nodes.max() >= len(raw.points) else block.nodes.min()
            raise FormatError(f"has a {block.name} with node {int(wrong) + 1}; its points are 1 to {len(raw.points)}")
    raw.arrays = [
        ref if ref.at_points else NumberArray(ref.key, ref.alias, at_points=False, values=_padded(ref, len(raw.blocks)))
        for ref in refs
    ]
    return raw


def _read_section(cursor: TextCursor, raw: RawMesh, refs: list[NumberArray], word: str) -> None:
    if word == "Dimension":
        if cursor.word() != "3":
            raise cursor.fault("must be of dimension 3")
    elif word == "Vertices":
        _read_points(cursor, raw, refs)
    elif word in CELLS:
        _read_cells(cursor, raw, refs, word)
    elif word in SKIPPED:
        cursor.numbers(SKIPPED[word] * _count(cursor), np.float64)
    else:
        raise cursor.fault(f"{word[:40]!r} is no section that is read")


def _padded(ref: NumberArray, blocks: int) -> list[object]:
    """The values of one block, and None for the others."""
    return [*ref.values, *[None] * (blocks - len(ref.values))]


def _read_points(cursor: TextCursor, raw: RawMesh, refs: list[NumberArray]) -> None:
    count = _count(cursor)
    check_points(count)
    if len(raw.points):
        raise cursor.fault("Vertices come a second time")
    rows = cursor.numbers(4 * count, np.float64).reshape(count, 4)
    raw.points = rows[:, :3]
    refs.append(NumberArray("medit:vertices", "medit:ref", at_points=True, values=[integers(rows[:, 3])]))


def _read_cells(cursor: TextCursor, raw: RawMesh, refs: list[NumberArray], word: str) -> None:
    kind, corners = CELLS[word]
    count = _count(cursor)
    rows = cursor.numbers((corners + 1) * count, np.int64).reshape(count, corners + 1)
    values = [*[None] * len(raw.blocks), rows[:, corners]]
    raw.blocks.append(CellBlock(kind, rows[:, :corners] - 1))
    refs.append(NumberArray(f"medit:{word.lower()}", "medit:ref", at_points=False, values=values))


def _count(cursor: TextCursor) -> int:
    count = integer(cursor, cursor.word())
    if count < 0:
        raise cursor.fault(f"{count} is not a count")
    return count
