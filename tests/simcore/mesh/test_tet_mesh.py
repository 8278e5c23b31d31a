"""Point location in tetrahedra of any shape: against all tetrahedra and triangles tried one by one, and the box."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray
from scipy.spatial import Delaunay

from simcore.contact.ball import Ball, weights_of_ball
from simcore.mesh.bounding_tree import LEAF, BoundingTree
from simcore.mesh.mesh import Mesh, box_mesh
from simcore.mesh.numbering import free_node_order, half_bandwidth
from simcore.mesh.quality import fault_of_mesh
from simcore.mesh.tet_mesh import TetMesh
from tests.budget import examples

Vector = NDArray[np.float64]
Indices = NDArray[np.int64]

SIZE_M = np.array([0.036, 0.062, 0.122])
BOX = box_mesh(SIZE_M, (4, 6, 12))
AS_TETS = TetMesh.of(BOX.nodes_m, BOX.tets, {})
quick = settings(max_examples=examples(100), deadline=None)
shares = arrays(np.float64, 3, elements=st.floats(0.0, 1.0))


def pebble() -> TetMesh:
    """An ellipsoid of random points, Delaunay-meshed: irregular, convex, flat tetrahedra included."""
    rng = np.random.default_rng(4)
    directions = rng.normal(size=(200, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    inner = 0.9 * rng.uniform(size=(150, 1)) ** (1 / 3) * directions[:150]
    points = np.concatenate([directions, inner]) * [0.03, 0.04, 0.06]
    return TetMesh.of(points, np.asarray(Delaunay(points).simplices, np.int64), {})


PEBBLE = pebble()


@pytest.mark.parametrize("count", [1, 7, 8, 9, 300])
def test_every_item_is_in_one_leaf_of_the_tree(count: int) -> None:
    """And every box holds its children, the leaves their items."""
    corners = np.random.default_rng(count).normal(size=(count, 3, 3))
    tree = BoundingTree.of(corners)
    leaves = len(tree.items)
    assert sorted(tree.items[tree.items >= 0]) == list(range(count))
    assert (len(tree.low), tree.items.shape[1]) == (2 * leaves, LEAF)
    for node in range(1, leaves):
        assert (tree.low[node] <= tree.low[2 * node : 2 * node + 2]).all()
        assert (tree.high[node] >= tree.high[2 * node : 2 * node + 2]).all()
    for leaf, items in enumerate(tree.items):
        for item in items[items >= 0]:
            assert (tree.low[leaves + leaf] <= corners[item]).all()
            assert (tree.high[leaves + leaf] >= corners[item]).all()


@pytest.mark.slow
@quick
@given(shares)
def test_locate_is_the_inverse_of_the_shape_functions(share: Vector) -> None:
    """In the pebble: not negative, sum 1, sum N_a X_a = X over one of its tetrahedra, for every point inside."""
    tet = int(share[0] * (len(PEBBLE.tets) - 1))
    mix = np.array([share[1], share[2], 0.5, 0.1])
    point = mix / mix.sum() @ PEBBLE.nodes_m[PEBBLE.tets[tet]]
    nodes, weights = PEBBLE.locate(point)
    assert weights.min() >= -1e-12
    assert weights.sum() == pytest.approx(1.0, abs=1e-14)
    np.testing.assert_allclose(weights @ PEBBLE.nodes_m[nodes], point, atol=1e-15)
    assert tuple(sorted(nodes)) in {tuple(t) for t in np.sort(PEBBLE.tets)}
    assert PEBBLE.outside_by(point[None])[0] < 1e-14


@pytest.mark.slow
@quick
@given(shares)
def test_outside_it_is_the_nearest_point_of_the_surface(share: Vector) -> None:
    """No point of a dense sample of the surface is nearer, and the answer lies on the surface."""
    point = (share - 0.5) * 0.3
    nodes, weights = PEBBLE.locate(point)
    nearest, distance = weights @ PEBBLE.nodes_m[nodes], PEBBLE.outside_by(point[None])[0]
    if distance == 0.0:
        return
    assert weights.min() >= -1e-12
    assert weights[3] == 0.0
    assert distance == pytest.approx(np.linalg.norm(point - nearest), rel=1e-12)
    assert tuple(sorted(nodes[:3])) in {tuple(t) for t in np.sort(PEBBLE.surface_triangles)}
    sample = np.linspace(0.0, 1.0, 9)
    corners = PEBBLE.nodes_m[PEBBLE.surface_triangles]
    grid = [
        u * corners[:, 0] + v * corners[:, 1] + (1 - u - v) * corners[:, 2]
        for u in sample
        for v in sample
        if u + v <= 1
    ]
    assert distance <= np.linalg.norm(np.concatenate(grid) - point, axis=1).min() + 1e-15


def test_inside_and_outside_of_the_pebble() -> None:
    """A convex body: inside is where every surface plane is behind."""
    points = np.random.default_rng(0).uniform(-0.06, 0.06, (2000, 3))
    a, b, c = np.swapaxes(PEBBLE.nodes_m[PEBBLE.surface_triangles], 0, 1)
    normals = np.cross(b - a, c - a)
    depths = ((points[:, None] - a) * normals).sum(axis=2) / np.linalg.norm(normals, axis=1)
    inside = (depths <= 0.0).all(axis=1)
    assert 100 < inside.sum() < 1900
    np.testing.assert_array_equal(PEBBLE.outside_by(points) == 0.0, inside)


def test_normals_point_into_the_mesh() -> None:
    """At the middle of every triangle: a little along the normal is inside, against it outside."""
    middles = PEBBLE.nodes_m[PEBBLE.surface_triangles].mean(axis=1)
    normals = np.array([PEBBLE.inward_normal(point) for point in middles])
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0, atol=1e-15)
    assert not PEBBLE.outside_by(middles + 1e-6 * normals).any()
    np.testing.assert_allclose(PEBBLE.outside_by(middles - 1e-6 * normals), 1e-6, rtol=1e-6)


@quick
@given(arrays(np.float64, 3, elements=st.floats(-1.0, 2.0)))
def test_the_box_as_tetrahedra_locates_as_the_box(share: Vector) -> None:
    """Also outside: both take the nearest point."""
    point = share * SIZE_M
    for mesh in (BOX, AS_TETS):
        nodes, weights = mesh.locate(point)
        nearest = np.clip(share, 0.0, 1.0) * SIZE_M
        # the parts of a triangle are told apart by differences of squares: half the digits are left near an edge
        np.testing.assert_allclose(weights @ mesh.nodes_m[nodes], nearest, atol=2e-9)


def ball(mesh: Mesh, centre: Vector, radius_m: float) -> Vector:
    """(n,) weights of all nodes."""
    quadrature = Ball.of_radius(radius_m, mesh)
    slot = np.full(len(mesh.nodes_m), -1)
    nodes, weights = np.zeros(quadrature.capacity, np.int64), np.zeros(quadrature.capacity)
    count = weights_of_ball(centre, quadrature.rule, slot, nodes, weights)
    assert count <= quadrature.capacity
    assert (slot == -1).all()
    full = np.zeros(len(mesh.nodes_m))
    full[nodes[:count]] = weights[:count]
    return full


@pytest.mark.slow
@quick
@given(shares, st.sampled_from([0.0, 0.004, 0.007]))
def test_balls_in_the_box_as_tetrahedra_are_those_of_the_box(share: Vector, radius_m: float) -> None:
    """Up to and beyond the faces z = 0 and z = 122 mm, away from the edges of the box."""
    centre: Vector = (0.25 + 0.5 * share) * SIZE_M
    centre[2] = -0.002 + share[2] * (SIZE_M[2] + 0.004)
    # a point this near to a face counts as on it in the search of tetrahedra, and not in the box
    np.testing.assert_allclose(ball(AS_TETS, centre, radius_m), ball(BOX, centre, radius_m), atol=1e-8)


@pytest.mark.slow
@quick
@given(shares, st.sampled_from([0.0, 0.004, 0.012]))
def test_a_ball_anywhere_reproduces_linear_fields(share: Vector, radius_m: float) -> None:
    """Deep inside: weights of sum 1, none negative, whose mean place is the centre."""
    centre = (share - 0.5) * 0.02
    weights = ball(PEBBLE, centre, radius_m)
    assert weights.min() >= -1e-14
    assert weights.sum() == pytest.approx(1.0, abs=1e-13)
    np.testing.assert_allclose(weights @ PEBBLE.nodes_m, centre, atol=1e-15)


@pytest.mark.slow
def test_weights_move_continuously_out_of_the_mesh() -> None:
    """A ball that is pulled out through the surface: steps of 1 um never change a weight by more than 1 in 1000."""
    start, normal = np.array([0.0, 0.0, 0.05]), np.array([0.0, 0.0, 1.0])
    steps = np.array([ball(PEBBLE, start + z * normal, 0.004) for z in np.arange(0.0, 0.01, 1e-6)[::10]])
    jumps = np.abs(np.diff(steps, axis=0)).max(axis=1)
    assert np.abs(steps[-1] - steps[0]).max() > 1e-4
    assert jumps.max() < 1e-2


@pytest.mark.parametrize("mesh", [AS_TETS, PEBBLE])
def test_the_numbering_is_complete_and_narrow(mesh: TetMesh) -> None:
    """Every free node once; the box is numbered as narrowly as the built-in one, the pebble far below its size."""
    held = np.flatnonzero(mesh.nodes_m[:, 1] <= np.quantile(mesh.nodes_m[:, 1], 0.15))
    for order in mesh.node_orders(held):
        assert sorted([*order, *held]) == list(range(len(mesh.nodes_m)))
    unknown = free_node_order(mesh, held)
    band = half_bandwidth(mesh.tets, unknown)
    if mesh is AS_TETS:
        assert band <= half_bandwidth(BOX.tets, free_node_order(BOX, held))
    assert band < 0.6 * 3 * (unknown >= 0).sum()


def test_flat_sides() -> None:
    """The box has six, with the nodes of its faces; the pebble has none."""
    assert set(AS_TETS.faces) == set(BOX.faces)
    for face, nodes in BOX.faces.items():
        np.testing.assert_array_equal(AS_TETS.faces[face], np.sort(nodes))
    assert PEBBLE.faces == {}


def test_flat_tetrahedra_are_found() -> None:
    """Delaunay's pebble has slivers; the box has none."""
    assert "flat tetrahedra" in str(fault_of_mesh(PEBBLE.nodes_m, PEBBLE.tets))
    assert fault_of_mesh(BOX.nodes_m, BOX.tets) is None
