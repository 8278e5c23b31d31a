"""Cells as VTK lists them, whatever file they come from."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from simcore.mesh.formats.raw import NAMES, CellBlock, FormatError, NumberArray, RawMesh

if TYPE_CHECKING:
    from simcore.arrays import Floats, Ints

CELLS: dict[int, tuple[str, int]] = {
    1: ("vertex", 1), 3: ("line", 2), 5: ("triangle", 3), 8: ("quad", 4), 9: ("quad", 4), 10: ("tetra", 4),
    11: ("hexahedron", 8), 12: ("hexahedron", 8), 13: ("wedge", 6), 14: ("pyramid", 5), 15: ("wedge10", 10),
    16: ("wedge12", 12), 21: ("line3", 3), 22: ("triangle6", 6), 23: ("quad8", 8), 24: ("tetra10", 10),
    25: ("hexahedron20", 20), 26: ("wedge15", 15), 27: ("pyramid13", 13), 29: ("hexahedron27", 27),
    30: ("quad6", 6), 31: ("wedge12", 12), 32: ("wedge18", 18), 33: ("hexahedron24", 24), 34: ("triangle7", 7),
}  # fmt: skip
LOOSE = {2: "poly-vertices", 4: "poly-lines", 6: "strips", 7: "polygons", 0: "empty cells"}  # of any number of points


def mesh_of_cells(
    points: Floats, connectivity: Ints, offsets: Ints, types: Ints, data: list[tuple[bool, str, Any]]
) -> RawMesh:
    """Points (n, 3); nodes of all cells one after the other; where each cell begins and the last ends (c + 1,); VTK's
    types (c,); arrays (at the points, name, values). Raises FormatError."""
    if ((offsets < 0) | (offsets > len(connectivity))).any():
        raise FormatError(f"has cells whose offsets are not from 0 to {len(connectivity)}, the count of their nodes")
    counts = np.diff(offsets)
    if len(offsets) != len(types) + 1 or offsets[0] != 0 or offsets[-1] != len(connectivity) or (counts < 0).any():
        raise FormatError("has cells whose offsets, types and nodes do not fit together")
    outside = (connectivity < 0) | (connectivity >= len(points))
    blocks, members, remarks = [], [], []
    for kind in np.unique(types):
        its = np.flatnonzero(types == kind)
        if int(kind) in LOOSE:
            remarks.append(f"{len(its)} {LOOSE[int(kind)]} are left out")
            continue
        name, corners = CELLS.get(int(kind), ("", 0))
        if not name:
            raise FormatError(f"must hold linear tetrahedra; it holds cells of VTK's type {kind}")
        if (counts[its] != corners).any():
            raise FormatError(f"has a {name} of {counts[its][counts[its] != corners][0]} nodes")
        places = offsets[its][:, None] + np.arange(corners)
        if outside[places].any():
            wrong = connectivity[places][outside[places]][0]
            raise FormatError(f"has a {NAMES.get(name, name)} with node {wrong}; its points are 0 to {len(points) - 1}")
        blocks.append(CellBlock(name, connectivity[places]))
        members.append(its)
    raw = RawMesh(points, blocks, remarks=remarks)
    for at_points, name, values in data:
        if len(values) != (expected := len(points) if at_points else len(types)):
            at = "points" if at_points else "cells"
            raise FormatError(f"has the array {name!r} with {len(values)} numbers for {expected} {at}")
        of = [values] if at_points else [values[its] for its in members]
        raw.arrays.append(NumberArray(f"{'point' if at_points else 'cell'}:{name}", name, at_points, of))
    return raw
