"""A tetrahedral mesh of any shape: point location on trees, narrow-band numbering, normals of its surface."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import reverse_cuthill_mckee
from scipy.spatial import cKDTree

from simcore.linear_algebra.products import norm, times
from simcore.mesh.edges import determinants
from simcore.mesh.mesh import Mesh, oriented
from simcore.mesh.surface import surface_of
from simcore.mesh.tet_search import TetSearch, locate_in_tets, nearest_triangle, outside_by

if TYPE_CHECKING:
    from simcore.arrays import Floats, Ints

FLAT = 1e-6  # a node so near to a side of the bounding box, relative to its longest edge, lies in it


@dataclass(frozen=True)
class TetMesh(Mesh):
    """A mesh given by its nodes and tetrahedra."""

    search: TetSearch

    @property
    def geometry(self) -> TetSearch:
        """The search trees."""
        return self.search

    @classmethod
    def of(cls, nodes_m: Floats, tets: Ints, sets: dict[str, Ints]) -> TetMesh:
        """Build from nodes (n, 3) m and tetrahedra (t, 4) in any orientation, none degenerate."""
        tets = oriented(nodes_m, np.array(tets, np.int64))
        surface = surface_of(tets)
        return cls(nodes_m, tets, surface, _flat_sides(nodes_m, surface), sets, TetSearch.of(nodes_m, tets, surface))

    @property
    def size_m(self) -> Floats:
        """(3,) m edges of the bounding box."""
        return np.asarray(np.ptp(self.nodes_m, axis=0))

    @property
    def element_size_m(self) -> float:
        """Edge of the cube that six tetrahedra of mean volume fill, as in the box mesh."""
        edges = self.nodes_m[self.tets[:, 1:]] - self.nodes_m[self.tets[:, :1]]
        return float(np.cbrt(determinants(edges).mean()))

    def locate(self, point_m: Floats) -> tuple[Ints, Floats]:
        """In the tetrahedron around the point; outside, in the one of the nearest point of the surface."""
        nodes, weights = np.empty(4, np.int64), np.empty(4)
        locate_in_tets(self.search, point_m, -1, nodes, weights)
        return nodes, weights

    def outside_by(self, points_m: Floats) -> Floats:
        """(k,) m: distance of points (k, 3) m from the mesh, 0 inside."""
        out = np.empty(len(points_m))
        outside_by(self.search, np.ascontiguousarray(points_m), out)
        return out

    def nearest_on_surface(self, point_m: Floats) -> tuple[int, Floats]:
        """The surface triangle nearest to a point (3,) m, and the nearest point (3,) m on it."""
        weights = np.empty(3)
        triangle, _ = nearest_triangle(self.search, point_m, weights)
        return int(triangle), times(self.search.triangles[triangle].T, weights)

    def inward_normal(self, point_m: Floats) -> Floats:
        """Of the surface triangle nearest to the point."""
        a, b, c = self.search.triangles[self.nearest_on_surface(point_m)[0]]
        outward = np.cross(b - a, c - a)
        normal: Floats = -outward / norm(outward)
        return normal

    def node_orders(self, held: Ints) -> list[Ints]:
        """Reverse Cuthill-McKee on the graph of the free nodes; plane by plane along the longest side, like the box."""
        count = len(self.nodes_m)
        pairs = self.tets[:, np.array([[a, b] for a in range(4) for b in range(4)])].reshape(-1, 2)
        graph = coo_array((np.ones(len(pairs), np.int8), (pairs[:, 0], pairs[:, 1])), shape=(count, count)).tocsr()
        free = np.setdiff1d(np.arange(count), held)
        order = reverse_cuthill_mckee(graph[free][:, free].tocsr(), symmetric_mode=True)
        planes = np.round(self.nodes_m[free] / (FLAT * self.size_m.max()))
        sweep = np.lexsort([planes[:, axis] for axis in np.argsort(self.size_m, kind="stable")])
        return [free[order], free[sweep]]

    def nodes_touched(self, radius_m: float) -> int:
        """All nodes that a ball touches are within its diameter and two longest edges of any one of them."""
        longest = max(np.linalg.norm(self.nodes_m[self.tets[:, a]] - self.nodes_m[self.tets[:, b]], axis=1).max()
                      for a in range(4) for b in range(a))  # fmt: skip
        counts = cKDTree(self.nodes_m).query_ball_point(
            self.nodes_m, 2.5 * radius_m + 2.0 * longest, return_length=True
        )
        return int(counts.max())


def _flat_sides(nodes_m: Floats, surface: Ints) -> dict[str, Ints]:
    """Sides of the bounding box in which at least one surface triangle lies -> the nodes in them."""
    low, high = nodes_m.min(axis=0), nodes_m.max(axis=0)
    close = FLAT * (high - low).max()
    sides = {}
    for axis, letter in enumerate("xyz"):
        for name, end in ((f"{letter}_min", low[axis]), (f"{letter}_max", high[axis])):
            within = np.abs(nodes_m[:, axis] - end) <= close
            if within[surface].all(axis=1).any():
                sides[name] = np.flatnonzero(within)
    return sides
