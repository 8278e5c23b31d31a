"""Tetrahedral meshes: the box of six tetrahedra a cell, in a mirrored pattern, and where a point lies in it."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import permutations

import numpy as np
from numpy.typing import NDArray

from simcore.compiled import kernel

Vector = NDArray[np.float64]
Indices = NDArray[np.int64]


@dataclass(frozen=True)
class BoxMesh:
    """A box [0, size] cut into cells of six tetrahedra (Kuhn), each cell the mirror image of its neighbours.

    Mirroring makes a mesh with an even number of cells along an axis symmetric in it, so that a reflected path gives
    a reflected tip. nodes_m: (n, 3) m, x fastest; tets: (t, 4), positively oriented; faces: name -> node indices.
    """

    size_m: Vector
    cells: tuple[int, int, int]
    nodes_m: Vector
    tets: Indices
    faces: dict[str, Indices]
    surface_triangles: Indices


def box_mesh(size_m: Vector, cells: tuple[int, int, int]) -> BoxMesh:
    """The mirrored Kuhn mesh of a box; six tetrahedra a cell."""
    axes = [np.linspace(0.0, edge, count + 1) for edge, count in zip(size_m, cells, strict=True)]
    z, y, x = np.meshgrid(axes[2], axes[1], axes[0], indexing="ij")
    nodes = np.column_stack([x.ravel(), y.ravel(), z.ravel()])
    tets = _oriented(nodes, _kuhn_tets(cells))
    return BoxMesh(np.asarray(size_m, float), cells, nodes, tets, _faces(cells), _surface(nodes, tets))


def _node_index(corner: Indices, cells: tuple[int, int, int]) -> Indices:
    """(n,) node numbers of the grid corners (n, 3)."""
    index: Indices = corner @ np.array([1, cells[0] + 1, (cells[0] + 1) * (cells[1] + 1)])
    return index


def _kuhn_tets(cells: tuple[int, int, int]) -> Indices:
    """(6 cells, 4) corners: each tetrahedron walks from a cell's corner to the opposite one, one axis at a time."""
    k, j, i = (a.ravel() for a in np.meshgrid(*(np.arange(c) for c in cells[::-1]), indexing="ij"))
    cell = np.column_stack([i, j, k])
    mirrored = cell % 2
    tets = []
    for order in permutations(range(3)):
        corner = mirrored.copy()
        corners = [corner.copy()]
        for axis in order:
            corner[:, axis] = 1 - mirrored[:, axis]
            corners.append(corner.copy())
        tets.append(np.stack([_node_index(cell + c, cells) for c in corners], axis=1))
    return np.stack(tets, axis=1).reshape(-1, 4)


def _oriented(nodes: Vector, tets: Indices) -> Indices:
    """Swap two corners wherever the volume is negative."""
    edges = nodes[tets[:, 1:]] - nodes[tets[:, :1]]
    flipped = np.linalg.det(edges) < 0
    tets[flipped] = tets[flipped][:, [0, 2, 1, 3]]
    return tets


def _faces(cells: tuple[int, int, int]) -> dict[str, Indices]:
    nx, ny, nz = cells
    grid = np.arange((nx + 1) * (ny + 1) * (nz + 1)).reshape(nz + 1, ny + 1, nx + 1)
    return {
        "x_min": grid[:, :, 0].ravel(),
        "x_max": grid[:, :, -1].ravel(),
        "y_min": grid[:, 0, :].ravel(),
        "y_max": grid[:, -1, :].ravel(),
        "z_min": grid[0].ravel(),
        "z_max": grid[-1].ravel(),
    }


def _surface(nodes: Vector, tets: Indices) -> Indices:
    """(triangles, 3): faces that belong to one tetrahedron only, seen counter-clockwise from outside."""
    triangles = np.concatenate([tets[:, [1, 2, 3]], tets[:, [0, 3, 2]], tets[:, [0, 1, 3]], tets[:, [0, 2, 1]]])
    _, first, count = np.unique(np.sort(triangles, axis=1), axis=0, return_index=True, return_counts=True)
    outer: Indices = triangles[np.sort(first[count == 1])]
    return outer


@kernel
def locate(point: Vector, size_m: Vector, cells: Indices, nodes: Indices, weights: Vector) -> None:
    """The four nodes around a point of the box and their linear shape functions there.

    point: (3,) m, rest space, moved onto the box if outside. nodes, weights: (4,), written.
    A point of a Kuhn cell lies in the tetrahedron that walks its axes in descending order of the local coordinates;
    the barycentric coordinates are the differences of the sorted local coordinates.
    """
    local = np.empty(3)
    corner = np.empty(3, np.int64)
    stride = np.empty(3, np.int64)
    stride[0] = 1
    stride[1] = cells[0] + 1
    stride[2] = (cells[0] + 1) * (cells[1] + 1)
    start = 0
    for a in range(3):
        scaled = min(max(point[a] / size_m[a], 0.0), 1.0) * cells[a]
        cell = min(int(scaled), cells[a] - 1)
        u = scaled - cell
        mirrored = cell % 2
        local[a] = 1.0 - u if mirrored == 1 else u
        corner[a] = -stride[a] if mirrored == 1 else stride[a]
        start += (cell + mirrored) * stride[a]
    first, second, third = 0, 1, 2
    if local[first] < local[second]:
        first, second = second, first
    if local[second] < local[third]:
        second, third = third, second
    if local[first] < local[second]:
        first, second = second, first
    nodes[0] = start
    nodes[1] = nodes[0] + corner[first]
    nodes[2] = nodes[1] + corner[second]
    nodes[3] = nodes[2] + corner[third]
    weights[0] = 1.0 - local[first]
    weights[1] = local[first] - local[second]
    weights[2] = local[second] - local[third]
    weights[3] = local[third]
