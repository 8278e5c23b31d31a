"""Where a point lies in an arbitrary tetrahedral mesh, and how far from its surface: kernels on bounding trees."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from simcore.compiled import kernel
from simcore.linear_algebra.entries import copy_entries
from simcore.mesh.bounding_tree import LEAF, BoundingTree, squared_distance
from simcore.mesh.edges import edge_inverses

if TYPE_CHECKING:
    from simcore.arrays import Floats, Ints

STACK = 64  # deeper than any tree that fits into memory
INSIDE = -1e-12  # smallest shape function of a point that counts as inside: rounding


class TetSearch(NamedTuple):
    """Tables of a mesh for the kernels below.

    tets (t, 4); origins (t, 3) m, their first corners; inverses (t, 3, 3) 1/m: the last three shape functions at p are
    inverse (p - origin); triangles (s, 3, 3) m and their nodes triangle_nodes (s, 3); then the two trees.
    """

    tets: Ints
    origins: Floats
    inverses: Floats
    tet_low: Floats
    tet_high: Floats
    tet_items: Ints
    triangles: Floats
    triangle_nodes: Ints
    triangle_low: Floats
    triangle_high: Floats
    triangle_items: Ints

    @classmethod
    def of(cls, nodes_m: Floats, tets: Ints, surface: Ints) -> TetSearch:
        """Build the tables; surface: (s, 3) nodes of the surface triangles."""
        corners, triangles = nodes_m[tets], nodes_m[surface]
        t, s = BoundingTree.of(corners), BoundingTree.of(triangles)
        inverses = edge_inverses(nodes_m, tets)[1]
        origins = np.ascontiguousarray(corners[:, 0])
        return cls(tets, origins, inverses, t.low, t.high, t.items, triangles, surface, s.low, s.high, s.items)


@kernel
def shape_functions(search: TetSearch, tet: int, point: Floats, weights: Floats) -> float:
    """Write the four linear shape functions of a tetrahedron at a point (3,) m; returns the smallest."""
    weights[0] = 1.0
    for a in range(3):
        value = 0.0
        for i in range(3):
            value += search.inverses[tet, a, i] * (point[i] - search.origins[tet, i])
        weights[a + 1] = value
        weights[0] -= value
    return float(min(min(weights[0], weights[1]), min(weights[2], weights[3])))


@kernel
def tet_around(search: TetSearch, point: Floats, guess: int, weights: Floats) -> int:
    """The tetrahedron around a point (3,) m, tried first: `guess` (-1 = none); -1 outside. weights: (4,), written."""
    if guess >= 0 and shape_functions(search, guess, point, weights) >= 0.0:
        return guess
    stack, top = np.empty(STACK, np.int64), 1
    stack[0] = 1
    leaves = len(search.tet_items)
    best, best_least = -1, INSIDE
    trial = np.empty(4)
    while top > 0:
        top -= 1
        box = stack[top]
        if squared_distance(point, search.tet_low[box], search.tet_high[box]) > 0.0:
            continue
        if box < leaves:
            stack[top], stack[top + 1] = 2 * box + 1, 2 * box
            top += 2
            continue
        for k in range(LEAF):
            tet = search.tet_items[box - leaves, k]
            if tet < 0:
                continue
            least = shape_functions(search, tet, point, trial)
            if least >= best_least:
                best, best_least = tet, least
                copy_entries(trial, weights)
                if least >= 0.0:
                    return int(tet)
    return best


@kernel
def nearest_on_triangle(point: Floats, triangle: Floats, weights: Floats) -> float:
    """Squared distance of a point (3,) from a triangle (3, 3); weights (3,) of the nearest point, written.

    After Ericson, Real-Time Collision Detection (2005), section 5.1.5: by the region of the plane it projects to.
    """
    a, b, c = triangle[0], triangle[1], triangle[2]
    d1, d2, d3, d4, d5, d6 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(3):
        ab, ac = b[i] - a[i], c[i] - a[i]
        d1 += ab * (point[i] - a[i])
        d2 += ac * (point[i] - a[i])
        d3 += ab * (point[i] - b[i])
        d4 += ac * (point[i] - b[i])
        d5 += ab * (point[i] - c[i])
        d6 += ac * (point[i] - c[i])
    va, vb, vc = d3 * d6 - d5 * d4, d5 * d2 - d1 * d6, d1 * d4 - d3 * d2
    v, w = 0.0, 0.0
    if d1 <= 0.0 and d2 <= 0.0:
        pass
    elif d3 >= 0.0 and d4 <= d3:
        v = 1.0
    elif d6 >= 0.0 and d5 <= d6:
        w = 1.0
    elif vc <= 0.0 and d1 >= 0.0 and d3 <= 0.0:
        v = d1 / (d1 - d3)
    elif vb <= 0.0 and d2 >= 0.0 and d6 <= 0.0:
        w = d2 / (d2 - d6)
    elif va <= 0.0 and d4 >= d3 and d5 >= d6:
        w = (d4 - d3) / ((d4 - d3) + (d5 - d6))
        v = 1.0 - w
    else:
        v, w = vb / (va + vb + vc), vc / (va + vb + vc)
    weights[0], weights[1], weights[2] = 1.0 - v - w, v, w
    square = 0.0
    for i in range(3):
        square += (weights[0] * a[i] + v * b[i] + w * c[i] - point[i]) ** 2
    return square


@kernel
def nearest_triangle(search: TetSearch, point: Floats, weights: Floats) -> tuple[int, float]:
    """The surface triangle nearest to a point (3,) m, and its distance in m; weights (3,): of the nearest point."""
    stack, top = np.empty(STACK, np.int64), 1
    stack[0] = 1
    leaves = len(search.triangle_items)
    best, nearest = -1, np.inf
    trial = np.empty(3)
    while top > 0:
        top -= 1
        box = stack[top]
        if squared_distance(point, search.triangle_low[box], search.triangle_high[box]) >= nearest:
            continue
        if box < leaves:
            near, far = 2 * box, 2 * box + 1
            if squared_distance(point, search.triangle_low[far], search.triangle_high[far]) < squared_distance(
                point, search.triangle_low[near], search.triangle_high[near]
            ):
                near, far = far, near
            stack[top], stack[top + 1] = far, near
            top += 2
            continue
        for k in range(LEAF):
            triangle = search.triangle_items[box - leaves, k]
            if triangle < 0:
                continue
            square = nearest_on_triangle(point, search.triangles[triangle], trial)
            if square < nearest:
                best, nearest = triangle, square
                copy_entries(trial, weights)
    return best, np.sqrt(nearest)


@kernel
def locate_in_tets(search: TetSearch, point: Floats, guess: int, nodes: Ints, weights: Floats) -> int:
    """The four nodes around a point (3,) m and their shape functions, written; returns the tetrahedron.

    Outside the mesh, -1: three nodes of the nearest surface triangle and the weights of the nearest point (the fourth
    weight is zero).
    """
    tet = tet_around(search, point, guess, weights)
    if tet >= 0:
        for a in range(4):
            nodes[a] = search.tets[tet, a]
        return tet
    triangle, _ = nearest_triangle(search, point, weights[:3])
    for a in range(3):
        nodes[a] = search.triangle_nodes[triangle, a]
    nodes[3], weights[3] = nodes[0], 0.0
    return -1


@kernel
def outside_by(search: TetSearch, points: Floats, out: Floats) -> None:
    """Write out (k,) m: distance of each point (k, 3) m from the mesh, 0 inside."""
    shape = np.empty(4)
    for k in range(len(points)):
        out[k] = 0.0
        if tet_around(search, points[k], -1, shape) < 0:
            _, out[k] = nearest_triangle(search, points[k], shape[:3])
