"""The block of tissue with small cells along a straight path and large ones at the walls, as a mesh file.

The cells are those of the box, moved in each layer: the middle column of nodes follows the path, and distances from it
grow like a sinh. The order of the nodes along each axis stays, so every tetrahedron keeps its orientation, wherever in
the block the path ends. A layer of the surface stays in its plane.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from simcore.mesh.mesh import box_mesh

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

    from simcore.mesh.mesh import BoxMesh

    Vector = NDArray[np.float64]

EVEN = 1e-8  # a grading below which the cells are even to rounding
LEAST_SHARE = 0.1  # of an edge: how near to a wall the small cells follow the path


def graded_block(
    size_mm: Vector, cells: tuple[int, int, int], start_mm: Vector, end_mm: Vector, grading: float
) -> tuple[BoxMesh, Vector]:
    """The box that it is made of, and its nodes (n, 3) mm. grading: 0 = even cells; at g the cells at the path are
    g / sinh g of even ones."""
    box = box_mesh(size_mm, cells)
    nodes = box.nodes_m.copy()
    share = np.clip((nodes[:, 2] - start_mm[2]) / (end_mm[2] - start_mm[2]), 0.0, 1.0)[:, None]
    centre = start_mm[:2] + share * (end_mm - start_mm)[:2]
    for axis in range(2):
        edge = size_mm[axis]
        middle = np.clip(centre[:, axis], LEAST_SHARE * edge, (1.0 - LEAST_SHARE) * edge)
        along = 2.0 * box.nodes_m[:, axis] / edge - 1.0  # -1 at one wall, 0 in the middle column, 1 at the other
        even = grading < EVEN  # sinh(g a) / sinh(g) is a there, and the numbers of the quotient may be too small
        far = np.abs(along) if even else np.sinh(grading * np.abs(along)) / np.sinh(grading)
        nodes[:, axis] = middle + np.where(along < 0.0, -middle, edge - middle) * far
    return box, nodes


def write_medit(file: Path, nodes_mm: Vector, tets: NDArray[np.int64]) -> None:
    """A .mesh file of tetrahedra."""
    with file.open("w", encoding="ascii") as out:
        out.write(f"MeshVersionFormatted 2\nDimension 3\nVertices\n{len(nodes_mm)}\n")
        out.writelines(f"{x:.17g} {y:.17g} {z:.17g} 0\n" for x, y, z in nodes_mm)
        out.write(f"Tetrahedra\n{len(tets)}\n")
        out.writelines(f"{a} {b} {c} {d} 0\n" for a, b, c, d in tets + 1)
        out.write("End\n")
