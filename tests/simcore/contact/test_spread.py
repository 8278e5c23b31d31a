"""The ball of a constraint point: partition of unity, linear-exact, continuous, bounded, with a mesh limit."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from simcore.contact.ball import Ball, ball_weights, displaced
from simcore.insertion.compliance import Compliance
from simcore.mesh.mesh import BoxMesh, box_mesh, locate
from tests.budget import examples
from tests.simcore.block import block
from tests.verification import verify

Vector = np.ndarray
SIZE_M = np.array([0.036, 0.062, 0.122])
CELLS = (5, 6, 7)
MESH = box_mesh(SIZE_M, CELLS)
RADIUS_M = 4e-3
shares = arrays(np.float64, 3, elements=st.floats(0.0, 1.0))
quick = settings(max_examples=examples(100), deadline=None)


def ball_at(centre: Vector, radius_m: float = RADIUS_M, mesh: BoxMesh = MESH) -> Vector:
    """(n,) weights over all nodes; fails if the ball outgrows its capacity or leaves its scratch dirty."""
    ball = Ball.of_radius(radius_m, mesh)
    slot = np.full(len(mesh.nodes_m), -1)
    nodes, weights = np.full(ball.capacity, -1), np.full(ball.capacity, np.nan)
    count = ball_weights(centre, ball.rule, mesh.size_m, np.array(mesh.cells), slot, nodes, weights)
    assert count <= ball.capacity
    assert (slot == -1).all()
    assert len(set(nodes[:count])) == count
    full = np.zeros(len(mesh.nodes_m))
    full[nodes[:count]] = weights[:count]
    return full


@pytest.mark.slow
@quick
@given(shares, st.sampled_from([0.0, 1e-3, 4e-3, 12e-3]))
def test_weights_are_a_partition_of_unity(share: Vector, radius_m: float) -> None:
    """Not negative and of sum 1 wherever the centre is, surface and corners included."""
    weights = ball_at(share * SIZE_M, radius_m)
    assert weights.min() >= -1e-16
    assert weights.sum() == pytest.approx(1.0, abs=1e-14)


@pytest.mark.slow
@quick
@given(shares)
def test_linear_fields_are_reproduced_inside(share: Vector) -> None:
    """A symmetric kernel and linear shape functions: sum w_a X_a = centre, a ball radius (and a half cell) inside."""
    margin = RADIUS_M * (1 + 1 / 8)
    centre = margin + share * (SIZE_M - 2 * margin)
    np.testing.assert_allclose(ball_at(centre) @ MESH.nodes_m, centre, atol=1e-15)


@pytest.mark.slow
@quick
@given(shares)
def test_at_the_surface_the_ball_moves_inward_only(share: Vector) -> None:
    """Cut at the face z = 0: the weighted place lies deeper than the centre, by less than half a radius."""
    centre = np.array([*(RADIUS_M * 1.2 + share[:2] * (SIZE_M[:2] - 2.4 * RADIUS_M)), 0.0])
    offset = ball_at(centre) @ MESH.nodes_m - centre
    np.testing.assert_allclose(offset[:2], 0.0, atol=1e-15)
    assert 0.1 * RADIUS_M < offset[2] < 0.5 * RADIUS_M


@pytest.mark.slow
@quick
@given(shares, arrays(np.float64, 3, elements=st.floats(-1.0, 1.0)))
def test_weights_move_continuously(share: Vector, direction: Vector) -> None:
    """Lipschitz in the centre, past element faces and past the surface: a move of 1 nm changes weights by < 3e-6."""
    centre = share * SIZE_M
    change = ball_at(np.clip(centre + 1e-9 * direction, 0.0, SIZE_M)) - ball_at(centre)
    assert np.abs(change).sum() < 3e-6


@pytest.mark.slow
@quick
@given(st.tuples(*[st.integers(1, 8)] * 3), shares, st.just(0.0) | st.floats(1e-6, 20e-3))
def test_capacity_is_never_exceeded(cells: tuple[int, int, int], share: Vector, radius_m: float) -> None:
    """The promised bound on touched nodes, for any mesh, centre and radius of the scenario's range."""
    ball_at(share * SIZE_M, radius_m, box_mesh(SIZE_M, cells))


@quick
@given(shares)
def test_radius_zero_is_the_bare_point(share: Vector) -> None:
    """Duriez et al. 2009: the shape functions of the tetrahedron around the point."""
    nodes, shape = np.empty(4, np.int64), np.empty(4)
    locate(share * SIZE_M, SIZE_M, np.array(CELLS), nodes, shape)
    expected = np.zeros(len(MESH.nodes_m))
    np.add.at(expected, nodes, shape)
    np.testing.assert_allclose(ball_at(share * SIZE_M, 0.0), expected, atol=1e-16)


def test_displacement_is_the_weighted_mean() -> None:
    """p(X) = X + sum w_a u_a, so that a material ball starts at its centre, at the surface as well."""
    ball, slot = Ball.of_radius(RADIUS_M, MESH), np.full(len(MESH.nodes_m), -1)
    nodes, weights, out = np.empty(ball.capacity, np.int64), np.empty(ball.capacity), np.empty(3)
    centre = np.array([0.018, 0.031, 0.0])
    place = (ball.rule, SIZE_M, np.array(CELLS), slot, nodes, weights)
    count = ball_weights(centre, *place)
    u = np.random.default_rng(0).normal(size=MESH.nodes_m.shape)
    displaced(centre, nodes, weights, count, MESH.nodes_m + u, MESH.nodes_m, out)
    np.testing.assert_allclose(out, centre + ball_at(centre) @ u, atol=1e-15)


def entry_compliances(radius_m: float, cells: Vector) -> Vector:
    """(len(cells),) m/N along z at the middle of the free face of a 24 mm cube."""
    values = []
    for n in cells:
        model = block(24.0 / n, (24.0, 24.0, 24.0))
        assert isinstance(model.mesh, BoxMesh)
        weights = ball_at(np.array([0.012, 0.012, 0.0]), radius_m, model.mesh)
        free, right = model.unknown >= 0, np.zeros((model.unknowns // 3, 3))
        right[model.unknown[free], 2] = weights[free]
        values.append(right.ravel() @ Compliance(model, 1.0, 1).solve(right.ravel()))
    return np.array(values)


@pytest.mark.slow
def test_entry_compliance_has_a_mesh_limit_only_with_a_radius() -> None:
    """h = 6, 3, 2 mm, the entry always at a node of the same pattern. With a ball of 4 mm the second
    increment is to the first at most as 1 to 3 (first order in h); a bare point (Boussinesq) grows like 1 / h."""
    cells = np.array([4, 8, 12])
    ball, point = np.diff(entry_compliances(RADIUS_M, cells)), np.diff(entry_compliances(0.0, cells))
    text, source = "entry compliance, h = 6, 3, 2 mm: second increment / first", "spec of the interaction"
    for name, increments, expected, tolerance in (("ball of 4 mm", ball, 0, 0.33), ("bare point", point, 1, 0.05)):
        share = increments[1] / increments[0]
        verify("coupled", f"{text}, {name}", expected=expected, measured=share, tolerance=tolerance, source=source)
