"""Quadratic tetrahedra, which the linear ones are measured against: patch, quadratic fields, bounds, order."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

import numpy as np
import pytest

from simcore.tissue.quadratic import QuadraticTissue, add_quadratic_diagonal, add_quadratic_forces, quadratic_shapes
from tests.simcore.block import block, cold, stiffness_times
from tests.simcore.reference import (
    MANUFACTURED_DIRECTION,
    MANUFACTURED_EDGE_M,
    QUADRATURE,
    manufactured,
    manufactured_load,
    small_strain_solution,
)
from tests.verification import verify

if TYPE_CHECKING:
    from simcore.tissue.model import TissueModel

Vector = np.ndarray
E_PA, NU = 6300.0, 0.4  # the defaults of the scenario
LAME_PA, SHEAR_PA = E_PA * NU / ((1 + NU) * (1 - 2 * NU)), E_PA / (2 * (1 + NU))
WALLS = ("x_min", "x_max", "y_min", "y_max", "z_max")
check = partial(verify, "tissue")


def forces(quadratic: QuadraticTissue, moves: Vector) -> Vector:
    """(n + e, 3) N: K u, on held nodes too."""
    t, out = quadratic.linear, np.zeros_like(moves)
    add_quadratic_forces(quadratic.tets, t.gradients, t.volumes_m3, t.mu_pa, t.lambda_pa, moves, out)
    return out


def places(quadratic: QuadraticTissue) -> Vector:
    """(n + e, 3) m: corners, then midside nodes."""
    return quadratic.prolonged(quadratic.linear.mesh.nodes_m)


def inner(quadratic: QuadraticTissue) -> Vector:
    """Numbers of the nodes that are not on the surface of the box."""
    x = places(quadratic)
    off = np.minimum(x - x.min(axis=0), x.max(axis=0) - x).min(axis=1)
    return np.flatnonzero(off > 1e-9)


def random_load(model: TissueModel, seed: int = 0) -> tuple[QuadraticTissue, Vector]:
    quadratic = QuadraticTissue.of(model)
    return quadratic, np.random.default_rng(seed).normal(size=(len(quadratic.held), 3))


def test_patch_of_quadratic_tetrahedra() -> None:
    """Irons' patch test: no inner forces under an affine displacement; on linear fields both elements agree."""
    model = block(5.0)
    quadratic = QuadraticTissue.of(model)
    slope = 1e-3 * np.array([[0.02, 0.05, -0.01], [0.03, -0.04, 0.02], [-0.06, 0.01, 0.03]])
    found = forces(quadratic, places(quadratic) @ slope.T)
    inside, largest = inner(quadratic), np.abs(found).max()
    assert len(inside) > 500
    text = "quadratic tetrahedra, patch test: forces inside / on the surface"
    check(text, expected=0, measured=found[inside] / largest, tolerance=1e-12, source="Irons 1966, patch test")
    linear = stiffness_times(model, model.mesh.nodes_m @ slope.T, cold(model))
    np.testing.assert_allclose(quadratic.restricted(found), linear, atol=1e-12 * largest)


def test_a_quadratic_field_is_exact() -> None:
    """u_i = x^T H_i x: its strain is linear, the body force that it needs constant, and K u is that force's load in
    every inner node, -V / 20 in a corner and V / 5 in a midside node of each tetrahedron."""
    quadratic = QuadraticTissue.of(block(5.0))
    second = np.random.default_rng(1).normal(size=(3, 3, 3))
    second += np.swapaxes(second, 1, 2)  # of u_i by x_j x_k
    moves = 0.5 * np.einsum("ijk,nj,nk->ni", second, *[places(quadratic)] * 2)
    divergence = np.einsum("jji->i", second)
    body = -(SHEAR_PA * np.einsum("ijj->i", second) + (SHEAR_PA + LAME_PA) * divergence)
    shares = np.array([-0.05] * 4 + [0.2] * 6)
    load = np.zeros_like(moves)
    np.add.at(load, quadratic.tets, np.einsum("t,a,i->tai", quadratic.linear.volumes_m3, shares, body))
    inside = inner(quadratic)
    miss = (forces(quadratic, moves) - load)[inside] / np.abs(load[inside]).max()
    text, source = "quadratic tetrahedra under a quadratic field: forces against its body force", "div sigma + b = 0"
    check(text, expected=0, measured=miss, tolerance=1e-9, source=source)


def test_rigid_motion_needs_no_force_and_the_diagonal_is_that_of_the_matrix() -> None:
    quadratic = QuadraticTissue.of(block(10.0))
    x, turn = places(quadratic), np.cross(np.eye(3), [0.3, -0.2, 0.5])
    scale = np.abs(forces(quadratic, np.abs(x))).max()
    assert np.abs(forces(quadratic, x @ turn + [0.1, 0.2, 0.3])).max() < 1e-12 * scale
    t, diagonal = quadratic.linear, np.zeros((len(x), 3))
    add_quadratic_diagonal(quadratic.tets, t.gradients, t.volumes_m3, t.mu_pa, t.lambda_pa, diagonal)
    for node in (0, len(t.mesh.nodes_m) // 2, len(t.mesh.nodes_m), len(x) - 1):
        for axis in range(3):
            unit = np.zeros_like(x)
            unit[node, axis] = 1.0
            assert forces(quadratic, unit)[node, axis] == pytest.approx(diagonal[node, axis], rel=1e-12)


def test_both_solutions_are_those_of_their_own_equations() -> None:
    """The quadratic one leaves no residual, of the relative size that it promises; the linear one is the small-strain
    solution that the tests assemble, under the same load on its nodes."""
    model = block(10.0)
    quadratic, load = random_load(model)
    load = quadratic.held_back(load)
    moves, linear = quadratic.solve(load)
    assert np.abs(moves[quadratic.held]).max() == 0.0
    assert np.linalg.norm(load - quadratic.stiffness_times(moves)) <= 1.1e-9 * np.linalg.norm(load)
    expected = quadratic.prolonged(small_strain_solution(model, E_PA, NU, quadratic.restricted(load)))
    miss, text = (linear - expected) / np.abs(expected).max(), "linear answer beside the quadratic one"
    check(text, expected=0, measured=miss, tolerance=1e-8, source="small-strain elasticity assembled in the tests")


@pytest.mark.slow
@pytest.mark.parametrize("faces", [("y_min", "y_max"), ("z_max",)])
@pytest.mark.parametrize("poisson", [0.0, 0.4, 0.49])
def test_quadratic_tetrahedra_are_never_stiffer(faces: tuple[str, ...], poisson: float) -> None:
    """They contain the linear ones, so that the work of any load is at least that of the linear answer (Ritz); the
    difference u2 - u1 is orthogonal in energy to the linear answer (Galerkin)."""
    model = block(10.0, fixed_faces=faces, poisson=poisson)
    for seed in range(5):
        quadratic, load = random_load(model, seed)
        moves, linear = quadratic.solve(load)
        work, least = np.vdot(load, moves), np.vdot(load, linear)
        assert work > least > 0.0
        assert abs(np.vdot(quadratic.stiffness_times(linear), moves - linear)) < 1e-6 * work


def manufactured_errors(cells: int) -> tuple[float, float]:
    """Errors in the energy norm and of the nodal values (root mean square), against the exact nodal values."""
    edge_mm = 1e3 * MANUFACTURED_EDGE_M
    model = block(edge_mm / cells, (edge_mm,) * 3, fixed_faces=WALLS)
    quadratic, tets = QuadraticTissue.of(model), model.mesh.tets
    points = np.einsum("qa,tai->tqi", QUADRATURE, model.mesh.nodes_m[tets])
    body = manufactured_load(points.reshape(-1, 3), E_PA, NU).reshape(points.shape)
    load = np.zeros((len(quadratic.held), 3))
    shapes = quadratic_shapes(QUADRATURE)
    np.add.at(load, quadratic.tets, np.einsum("qa,tqi,t->tai", shapes, body, model.volumes_m3 / 4))
    moves, _ = quadratic.solve(load)
    exact = manufactured(places(quadratic), (0, 0, 0))[:, None] * MANUFACTURED_DIRECTION
    miss = moves - exact
    energy = np.sqrt(np.vdot(miss, forces(quadratic, miss)) / np.vdot(exact, forces(quadratic, exact)))
    return float(energy), float(np.sqrt(np.mean(miss**2) / np.mean(exact**2)))


@pytest.mark.slow
def test_quadratic_tetrahedra_converge_with_their_order() -> None:
    """Energy norm like h^2, displacement like h^3 (Brenner and Scott); linear ones have h and h^2."""
    cells = np.array([4, 6, 8])
    errors = np.log([manufactured_errors(n) for n in cells])
    orders = np.polyfit(np.log(1.0 / cells), errors, 1)[0]
    text, source = "quadratic tetrahedra, manufactured solution: order of the", "h^2 and h^3 (Brenner and Scott)"
    check(f"{text} energy norm", expected=2, measured=orders[0], tolerance=0.2, source=source)
    check(f"{text} displacement", expected=3, measured=orders[1], tolerance=0.3, source=source)
