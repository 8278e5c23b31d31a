"""Tetrahedral meshes: what the simulator asks of any of them, and the built-in box of six tetrahedra a cell."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cached_property
from itertools import permutations
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from simcore.compiled import kernel
from simcore.mesh.edges import determinants
from simcore.mesh.surface import surface_of

if TYPE_CHECKING:
    from simcore.arrays import Floats, Ints


class BoxGeometry(NamedTuple):
    """What kernels know of a box: edges (3,) m and cells (3,)."""

    size_m: Floats
    cells: Ints


@dataclass(frozen=True)
class Mesh(ABC):
    """A tetrahedral mesh at rest, world frame: the box, or one from a file (`tet_mesh`).

    nodes_m: (n, 3) m; tets: (t, 4), positively oriented; surface_triangles: (s, 3), counter-clockwise from outside;
    faces: flat sides x_min ... z_max of the bounding box that the mesh has -> their nodes; sets: named nodes of a file.
    """

    nodes_m: Floats
    tets: Ints
    surface_triangles: Ints
    faces: dict[str, Ints]
    sets: dict[str, Ints]

    @property
    @abstractmethod
    def geometry(self) -> Any:
        """The tables of its kernels: BoxGeometry or TetSearch."""

    @abstractmethod
    def locate(self, point_m: Floats) -> tuple[Ints, Floats]:
        """The four nodes around a point (3,) m and its linear shape functions (4,); outside, those of the nearest
        point of the mesh."""

    @abstractmethod
    def node_orders(self, held: Ints) -> list[Ints]:
        """Orders of all nodes but the held ones that keep coupled nodes close (a narrow band)."""

    @abstractmethod
    def nodes_touched(self, radius_m: float) -> int:
        """A bound on the number of nodes whose shape functions reach into a ball of radius_m anywhere."""

    @abstractmethod
    def inward_normal(self, point_m: Floats) -> Floats:
        """(3,) unit normal, into the mesh, of the surface nearest to a point (3,) m."""

    @abstractmethod
    def outside_by(self, points_m: Floats) -> Floats:
        """(n,) m: distances of points (n, 3), rest space, from the mesh; 0 inside."""

    def material(self, points_m: Floats) -> MaterialPoints:
        """The material points that are at points_m (k, 3) m at rest."""
        nodes, weights = zip(*(self.locate(point) for point in points_m), strict=True)
        return MaterialPoints(points_m, np.array(nodes), np.array(weights))


@dataclass(frozen=True)
class MaterialPoints:
    """Points fixed in the material: rest_m (k, 3) m, carried by nodes (k, 4) with weights (k, 4)."""

    rest_m: Floats
    nodes: Ints
    weights: Floats

    def positions(self, x: Floats, rest_nodes_m: Floats) -> Floats:
        """(k, 3) m where they are when the nodes are at x (n, 3) m."""
        shifts = x[self.nodes] - rest_nodes_m[self.nodes]
        moved: Floats = self.rest_m + np.einsum("ka,kai->ki", self.weights, shifts)
        return moved


@dataclass(frozen=True)
class BoxMesh(Mesh):
    """A box [0, size] cut into cells of six tetrahedra (Kuhn), each cell the mirror image of its neighbours.

    Mirroring makes a mesh with an even number of cells along an axis symmetric in it, so that a reflected path gives
    a reflected tip. Its nodes are numbered x fastest; the entry face is z = 0.
    """

    size_m: Floats
    cells: tuple[int, int, int]

    @cached_property
    def geometry(self) -> BoxGeometry:
        """Edges and cells."""
        return BoxGeometry(self.size_m, np.array(self.cells))

    def locate(self, point_m: Floats) -> tuple[Ints, Floats]:
        """In the tetrahedron of the point's cell; a point outside is moved onto the box."""
        nodes, weights = np.empty(4, np.int64), np.empty(4)
        locate(point_m, *self.geometry, nodes, weights)
        return nodes, weights

    def node_orders(self, held: Ints) -> list[Ints]:
        """Plane by plane along the longest axis."""
        slowest_last = np.argsort(self.cells, kind="stable")
        order = np.lexsort([self.nodes_m[:, axis] for axis in slowest_last])
        return [order[~np.isin(order, held)]]

    def nodes_touched(self, radius_m: float) -> int:
        """Of the cells that a cube of twice the radius can cut."""
        edges = self.size_m / self.cells
        return int(np.prod(np.floor(2 * radius_m / edges) + 3))

    def inward_normal(self, point_m: Floats) -> Floats:
        """Of the entry face, wherever the point is."""
        del point_m
        return np.array([0.0, 0.0, 1.0])

    def outside_by(self, points_m: Floats) -> Floats:
        """(n,) m: distances of points (n, 3), rest space, from the box; 0 inside."""
        beyond = points_m - np.minimum(np.maximum(points_m, 0.0), self.size_m)
        return np.asarray(np.linalg.norm(beyond, axis=1)) if beyond.any() else np.zeros(len(points_m))


def box_mesh(size_m: Floats, cells: tuple[int, int, int]) -> BoxMesh:
    """The mirrored Kuhn mesh of a box; six tetrahedra a cell."""
    axes = [np.linspace(0.0, edge, count + 1) for edge, count in zip(size_m, cells, strict=True)]
    z, y, x = np.meshgrid(axes[2], axes[1], axes[0], indexing="ij")
    nodes = np.column_stack([x.ravel(), y.ravel(), z.ravel()])
    tets = oriented(nodes, _kuhn_tets(cells))
    return BoxMesh(nodes, tets, surface_of(tets), _faces(cells), {}, np.asarray(size_m, float), cells)


def _node_index(corner: Ints, cells: tuple[int, int, int]) -> Ints:
    """(n,) node numbers of the grid corners (n, 3)."""
    index: Ints = (corner * np.array([1, cells[0] + 1, (cells[0] + 1) * (cells[1] + 1)])).sum(axis=-1)
    return index


def _kuhn_tets(cells: tuple[int, int, int]) -> Ints:
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


def oriented(nodes: Floats, tets: Ints) -> Ints:
    """Swap two corners wherever the volume is negative; tets is changed."""
    edges = nodes[tets[:, 1:]] - nodes[tets[:, :1]]
    flipped = determinants(edges) < 0
    tets[flipped] = tets[flipped][:, [0, 2, 1, 3]]
    return tets


def _faces(cells: tuple[int, int, int]) -> dict[str, Ints]:
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


@kernel
def locate(point: Floats, size_m: Floats, cells: Ints, nodes: Ints, weights: Floats) -> None:
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
