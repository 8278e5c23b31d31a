"""A constraint point as a small ball of tissue (our regularisation of the point of Duriez et al. 2009).

A point force on linear elasticity has no mesh limit: the displacement under it grows without bound as h -> 0. A point
is therefore the weighted mean of a ball of fixed rest radius, w_a = integral of k N_a / integral of k, with the kernel
k(r) = (1 - r^2 / rho^2)^2, cut at the surface of the block; the same weights carry its displacement and its force.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from simcore.compiled import kernel, resolved_by_type
from simcore.mesh.mesh import Mesh, locate
from simcore.mesh.tet_search import TetSearch, locate_in_tets, nearest_triangle, tet_around

if TYPE_CHECKING:
    from simcore.arrays import Floats, Ints

GRID = 4  # quadrature cells along a radius


class BallRule(NamedTuple):
    """What kernels know of a ball's quadrature: offsets (q, 3) m of its cells, kernel weights (q,), edge of a
    cell in m, 0 for a bare point, and the geometry of the mesh: BoxGeometry or TetSearch."""

    offsets_m: Floats
    strength: Floats
    cell_m: float
    geometry: Any


class Balls(NamedTuple):
    """The balls of a channel's elements: rest points (P, 3) m, and of each the nodes (P, K) that it touches with their
    weights (P, K), of which the first `touched` (P,) count."""

    rest_m: Floats
    nodes: Ints
    weights: Floats
    touched: Ints


@dataclass(frozen=True)
class Ball:
    """A ball in the mesh that it was made for; capacity: the largest number of nodes that its weights can touch."""

    radius_m: float
    rule: BallRule
    capacity: int

    @classmethod
    def of_radius(cls, radius_m: float, mesh: Mesh) -> Ball:
        """Midpoint rule on a grid that is symmetric under reflections; spread_mm = 0 gives the bare point."""
        if radius_m == 0.0:
            return cls(0.0, BallRule(np.zeros((1, 3)), np.ones(1), 0.0, mesh.geometry), 4)
        cell = radius_m / GRID
        axis = (np.arange(2 * GRID) - GRID + 0.5) * cell
        x, y, z = (a.ravel() for a in np.meshgrid(axis, axis, axis, indexing="ij"))
        square = (x * x + y * y + z * z) / radius_m**2
        inside = square < 1.0
        offsets = np.column_stack([x, y, z])[inside]
        capacity = min(mesh.nodes_touched(radius_m), len(mesh.nodes_m))
        return cls(radius_m, BallRule(offsets, (1.0 - square[inside]) ** 2, cell, mesh.geometry), capacity)


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
    centre: Floats, rule: BallRule, size_m: Floats, cells: Ints, slot: Ints, nodes: Ints, weights: Floats
) -> int:
    """Weights of the ball at `centre` (3,) m, rest space; returns their number k and writes nodes[:k], weights[:k].

    slot: (n,) scratch, all -1 on entry and on return.
    """
    offsets, kernel_weights, cell, _ = rule
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
    centre: Floats, rule: BallRule, search: TetSearch, slot: Ints, nodes: Ints, weights: Floats
) -> int:
    """`ball_weights` in a mesh of any shape. A quadrature cell counts with the share 1/2 + d / cell, between 0 and 1,
    where d is its depth below the surface: as in the box, away from its edges."""
    offsets, kernel_weights, cell, _ = rule
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


def fill_ball(centre: Floats, rule: BallRule, slot: Ints, nodes: Ints, weights: Floats) -> int:
    """Inside kernels: `ball_weights` or `ball_weights_in_tets`, by the type of the rule's geometry."""
    raise NotImplementedError


@resolved_by_type(fill_ball)
def _filler(centre, rule, slot, nodes, weights):  # type: ignore[no-untyped-def]
    def in_tets(centre, rule, slot, nodes, weights):  # type: ignore[no-untyped-def]
        return ball_weights_in_tets(centre, rule, rule.geometry, slot, nodes, weights)

    def in_box(centre, rule, slot, nodes, weights):  # type: ignore[no-untyped-def]
        size_m, cells = rule.geometry
        return ball_weights(centre, rule, size_m, cells, slot, nodes, weights)

    del centre, slot, nodes, weights  # only the type of the rule counts
    geometry = rule.types[rule.fields.index("geometry")]
    return in_tets if geometry.instance_class is TetSearch else in_box


@kernel
def weights_of_ball(centre: Floats, rule: BallRule, slot: Ints, nodes: Ints, weights: Floats) -> int:
    """`fill_ball`, to be called from outside of kernels."""
    return fill_ball(centre, rule, slot, nodes, weights)


@kernel
def displaced(rest: Floats, nodes: Ints, weights: Floats, count: int, x: Floats, x_rest: Floats, out: Floats) -> None:
    """Write out (3,) = X + sum_a w_a (x_a - X_a): where the material ball around the rest point X is now."""
    for i in range(3):
        out[i] = rest[i]
        for k in range(count):
            out[i] += weights[k] * (x[nodes[k], i] - x_rest[nodes[k], i])
