"""A constraint point as a small ball of tissue (our regularisation of the point of Duriez et al. 2009).

A point force on linear elasticity has no mesh limit: the displacement under it grows without bound as h -> 0. A point
is therefore the weighted mean of a ball of fixed rest radius, w_a = integral of k N_a / integral of k, with the kernel
k(r) = (1 - r^2 / rho^2)^2, cut at the surface of the block; the same weights carry its displacement and its force.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from simcore.arrays import Floats, Ints
from simcore.compiled import kernel, resolved_by_type
from simcore.mesh.mesh import Mesh, locate
from simcore.mesh.tet_search import TetSearch, locate_in_tets, nearest_triangle, tet_around

GRID = 4  # quadrature cells along a radius


@dataclass(frozen=True)
class Ball:
    """The quadrature of a ball: offsets (q, 3) m, kernel weights (q,), cell edge m; a bare point for radius 0.

    capacity: the largest number of nodes that its weights can touch in the mesh it was made for.
    """

    offsets_m: Floats
    kernel: Floats
    cell_m: float
    capacity: int

    @classmethod
    def of_radius(cls, radius_m: float, mesh: Mesh) -> Ball:
        """Midpoint rule on a grid that is symmetric under reflections; spread_mm = 0 gives the bare point."""
        if radius_m == 0.0:
            return cls(np.zeros((1, 3)), np.ones(1), 0.0, 4)
        cell = radius_m / GRID
        axis = (np.arange(2 * GRID) - GRID + 0.5) * cell
        x, y, z = (a.ravel() for a in np.meshgrid(axis, axis, axis, indexing="ij"))
        square = (x * x + y * y + z * z) / radius_m**2
        inside = square < 1.0
        offsets = np.column_stack([x, y, z])[inside]
        capacity = min(mesh.nodes_touched(radius_m), len(mesh.nodes_m))
        return cls(offsets, (1.0 - square[inside]) ** 2, cell, capacity)


@kernel
def inside_fraction(point: Floats, size_m: Floats, cell: float) -> float:
    """Share of a quadrature cell that lies in the box, so that weights move continuously past the surface."""
    share = 1.0
    for a in range(3):
        for distance in (point[a], size_m[a] - point[a]):
            share *= min(max(0.5 + distance / cell, 0.0), 1.0)
    return share


@kernel
def ball_weights(
    centre: Floats,
    offsets: Floats,
    kernel_weights: Floats,
    cell: float,
    size_m: Floats,
    cells: Ints,
    slot: Ints,
    nodes: Ints,
    weights: Floats,
) -> int:
    """Weights of the ball at `centre` (3,) m, rest space; returns their number k and writes nodes[:k], weights[:k].

    slot: (n,) scratch, all -1 on entry and on return.
    """
    corner = np.empty(4, np.int64)
    shape = np.empty(4)
    point = np.empty(3)
    count, total = 0, 0.0
    for q in range(len(offsets)):
        for a in range(3):
            point[a] = centre[a] + offsets[q, a]
        strength = kernel_weights[q]
        if cell > 0.0:
            strength *= inside_fraction(point, size_m, cell)
        if strength == 0.0:
            continue
        locate(point, size_m, cells, corner, shape)
        total += strength
        for a in range(4):
            if slot[corner[a]] < 0:
                slot[corner[a]] = count
                nodes[count] = corner[a]
                weights[count] = 0.0
                count += 1
            weights[slot[corner[a]]] += strength * shape[a]
    for k in range(count):
        slot[nodes[k]] = -1
        weights[k] /= total
    return count


@kernel
def ball_weights_in_tets(
    centre: Floats,
    offsets: Floats,
    kernel_weights: Floats,
    cell: float,
    search: TetSearch,
    slot: Ints,
    nodes: Ints,
    weights: Floats,
) -> int:
    """`ball_weights` in a mesh of any shape. A quadrature cell counts with the share 1/2 + d / cell, between 0 and 1,
    where d is its depth below the surface: as in the box, away from its edges."""
    corner, shape, point = np.empty(4, np.int64), np.empty(4), np.empty(3)
    _, centre_depth = nearest_triangle(search, centre, shape[:3])
    tet, count, total = tet_around(search, centre, -1, shape), 0, 0.0
    if tet < 0:
        centre_depth = -centre_depth
    for q in range(len(offsets)):
        reach = 0.0
        for a in range(3):
            point[a] = centre[a] + offsets[q, a]
            reach += offsets[q, a] * offsets[q, a]
        strength = kernel_weights[q]
        if cell > 0.0 and centre_depth - np.sqrt(reach) < 0.5 * cell:
            _, depth = nearest_triangle(search, point, shape[:3])
            if tet_around(search, point, tet, shape) < 0:
                depth = -depth
            strength *= min(max(0.5 + depth / cell, 0.0), 1.0)
            if strength == 0.0:
                continue
        tet = locate_in_tets(search, point, tet, corner, shape)
        total += strength
        for a in range(4):
            if slot[corner[a]] < 0:
                slot[corner[a]] = count
                nodes[count] = corner[a]
                weights[count] = 0.0
                count += 1
            weights[slot[corner[a]]] += strength * shape[a]
    for k in range(count):
        slot[nodes[k]] = -1
        weights[k] /= total
    return count


def fill_ball(
    centre: Floats,
    offsets: Floats,
    kernel_weights: Floats,
    cell: float,
    geometry: Any,
    slot: Ints,
    nodes: Ints,
    weights: Floats,
) -> int:
    """Inside kernels: `ball_weights` or `ball_weights_in_tets`, by the type of a mesh's geometry."""
    raise NotImplementedError


@resolved_by_type(fill_ball)
def _filler(centre, offsets, kernel_weights, cell, geometry, slot, nodes, weights):  # type: ignore[no-untyped-def]
    def in_tets(centre, offsets, kernel_weights, cell, geometry, slot, nodes, weights):  # type: ignore[no-untyped-def]
        return ball_weights_in_tets(centre, offsets, kernel_weights, cell, geometry, slot, nodes, weights)

    def in_box(centre, offsets, kernel_weights, cell, geometry, slot, nodes, weights):  # type: ignore[no-untyped-def]
        size_m, cells = geometry
        return ball_weights(centre, offsets, kernel_weights, cell, size_m, cells, slot, nodes, weights)

    return in_tets if geometry.instance_class is TetSearch else in_box


@kernel
def weights_of_ball(
    centre: Floats,
    offsets: Floats,
    kernel_weights: Floats,
    cell: float,
    geometry: Any,
    slot: Ints,
    nodes: Ints,
    weights: Floats,
) -> int:
    """`fill_ball`, to be called from outside of kernels."""
    return fill_ball(centre, offsets, kernel_weights, cell, geometry, slot, nodes, weights)


@kernel
def displaced(rest: Floats, nodes: Ints, weights: Floats, count: int, x: Floats, x_rest: Floats, out: Floats) -> None:
    """out (3,) = X + sum_a w_a (x_a - X_a): where the material ball around the rest point X is now."""
    for i in range(3):
        out[i] = rest[i]
        for k in range(count):
            out[i] += weights[k] * (x[nodes[k], i] - x_rest[nodes[k], i])
