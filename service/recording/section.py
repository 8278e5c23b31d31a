"""The drawable parts of a tetrahedral mesh: its surface, its sharp edges and a cut along the path.

Everything is expressed by material points, computed once on the rest shape: a deformed state gives their
positions by indexing, or by one interpolation along an edge. Row = node, metres, world frame.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from simcore.arrays import Floats, Ints

_SHARP_COSINE = 0.77  # edges between faces that meet at more than 40 degrees are drawn


@dataclass(frozen=True)
class Surface:
    """The nodes on the surface and the triangles between them, renumbered."""

    nodes: Ints  # (v,) into the mesh
    triangles: Ints  # (t, 3) into `nodes`
    normals: Floats  # (v, 3) unit, outward, rest shape
    edges: Ints  # (e, 2) into the mesh: where the surface is sharp


@dataclass(frozen=True)
class Section:
    """A plane cut through the rest shape; its points stay with the material."""

    ends: Ints  # (s, 2) the mesh edge that carries each point
    weights: Floats  # (s,) position = (1 - w) first + w second
    triangles: Ints  # (t, 3)
    plane_m: Floats  # (s, 2) coordinates in the plane of the rest shape, origin at the entry, second along the path

    def positions(self, nodes_m: Floats) -> Floats:
        """(s, 3) where the points are when the mesh is at nodes_m (n, 3)."""
        first, second = nodes_m[self.ends[:, 0]], nodes_m[self.ends[:, 1]]
        return first + self.weights[:, None] * (second - first)


def surface(rest_m: Floats, triangles: Ints) -> Surface:
    """The drawable surface of a mesh with nodes rest_m (n, 3) and outward surface triangles (t, 3)."""
    nodes, numbered = np.unique(triangles, return_inverse=True)
    numbered = numbered.reshape(triangles.shape)
    corners = rest_m[triangles]
    areas = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals = np.zeros((len(nodes), 3))
    for corner in range(3):
        np.add.at(normals, numbered[:, corner], areas)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return Surface(nodes, numbered, normals, _sharp_edges(triangles, areas))


def _sharp_edges(triangles: Ints, areas: Floats) -> Ints:
    """(e, 2) edges whose two triangles meet at an angle."""
    unit = areas / np.linalg.norm(areas, axis=1, keepdims=True)
    sides = np.sort(np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]]), axis=1)
    owner = np.tile(np.arange(len(triangles)), 3)
    order = np.lexsort((sides[:, 1], sides[:, 0]))
    first, second = order[0::2], order[1::2]  # a closed surface has each edge twice
    cosine = np.einsum("ij,ij->i", unit[owner[first]], unit[owner[second]])
    edges: Ints = sides[first[cosine < _SHARP_COSINE]]
    return edges


def path_plane(path_m: Floats) -> tuple[Floats, Floats, Floats]:
    """Unit vectors (along, across, normal) of the plane of a path (p, 3); of a straight one, world x is across."""
    along = (path_m[-1] - path_m[0]) / np.linalg.norm(path_m[-1] - path_m[0])
    offsets = path_m - path_m[0]
    offsets = offsets - np.outer(offsets @ along, along)
    sideways = offsets[np.argmax(np.linalg.norm(offsets, axis=1))]
    if np.linalg.norm(sideways) < 1e-6:
        sideways = np.eye(3)[np.argmin(np.abs(along))]
    across = sideways - (sideways @ along) * along
    across /= np.linalg.norm(across)
    return along, across, np.cross(along, across)


def section(rest_m: Floats, tets: Ints, path_m: Floats, *, behind_m: float) -> Section:
    """The cut of a mesh (nodes rest_m (n, 3), tets (t, 4)) with the plane of the path (p, 3), moved back a little."""
    along, across, normal = path_plane(path_m)
    height = (rest_m - path_m[0]) @ normal + behind_m
    height[np.abs(height) < 1e-9] = 0.0  # a node in the plane counts as above it
    above = height[tets] >= 0.0
    ordered = np.take_along_axis(tets, np.argsort(~above, axis=1, kind="stable"), axis=1)
    count = above.sum(axis=1)
    one, two, three = (ordered[count == k] for k in (1, 2, 3))
    sides = np.concatenate(  # (triangles, 3 corners, 2 ends): the mesh edges that each triangle's corners lie on
        [
            one[:, [[0, 1], [0, 2], [0, 3]]],
            three[:, [[3, 0], [3, 1], [3, 2]]],
            two[:, [[0, 2], [0, 3], [1, 3]]],
            two[:, [[0, 2], [1, 3], [1, 2]]],
        ]
    )
    ends, numbered = np.unique(np.sort(sides, axis=2).reshape(-1, 2), axis=0, return_inverse=True)
    triangles = numbered.reshape(-1, 3)
    weights = height[ends[:, 0]] / (height[ends[:, 0]] - height[ends[:, 1]])
    cut = Section(ends, weights, triangles, np.zeros((len(ends), 2)))
    points = cut.positions(rest_m)
    edges = points[triangles]
    area = np.linalg.norm(np.cross(edges[:, 1] - edges[:, 0], edges[:, 2] - edges[:, 0]), axis=1)
    plane = np.stack([(points - path_m[0]) @ across, (points - path_m[0]) @ along], axis=1)
    return Section(ends, weights, triangles[area > 1e-12], plane)
