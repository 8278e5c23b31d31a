"""The beams against identities, differences and published large-rotation solutions."""

from __future__ import annotations

import math
from functools import partial
from typing import Any

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

from simcore.errors import Status
from simcore.needle.model import (
    NeedleModel,
    advance,
    cowper_coefficient,
    factor_blocks,
    rigid_move,
    solve_blocks,
    solve_static,
    straight,
)
from simcore.rotations import exp_map
from tests.simcore.needle.rods import EIGHTEEN_GAUGE, bent, dense, evaluate, loaded, unit_rod
from tests.verification import verify

Vector = np.ndarray
check = partial(verify, "needle")


# the section


def test_section_of_the_18_gauge_needle() -> None:
    # specification of the needle: EI = 2.07e-2 N m2, Cowper's coefficient 0.565
    stiffness, source = EIGHTEEN_GAUGE.bending_nm2, "specification of the needle"
    check("18G: EI", expected=2.07e-2, measured=stiffness, tolerance=5e-5, unit="N m2", source=source)
    assert EIGHTEEN_GAUGE.torsion_nm2 == pytest.approx(EIGHTEEN_GAUGE.bending_nm2 / 1.29, rel=1e-12)
    coefficient = cowper_coefficient(0.838 / 1.27, 0.29)
    check("18G: shear coefficient", expected=0.565, measured=coefficient, tolerance=5e-4, source="Cowper 1966")
    assert cowper_coefficient(0.0, 0.3) == pytest.approx(6 * 1.3 / (7 + 6 * 0.3), rel=1e-12)  # Cowper: solid circle
    assert cowper_coefficient(1.0, 0.3) == pytest.approx(2 * 1.3 / (4 + 3 * 0.3), rel=1e-12)  # Cowper: thin tube


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"length_m": 0.0}, "length_m = 0.0"),
        ({"axial_n": math.nan}, "axial_n = nan"),
        ({"shear_n": -1.0}, "shear"),
    ],
)
def test_an_impossible_section_is_refused(change: dict[str, float], message: str) -> None:
    section: dict[str, Any] = {
        "length_m": 1.0,
        "axial_n": 1.0,
        "bending_nm2": 1.0,
        "torsion_nm2": 1.0,
        "shear_n": 1.0,
    }
    with pytest.raises(ValueError, match=message):
        NeedleModel.from_section(elements=4, outer_radius_m=0.1, **{**section, **change})


# internal forces


@pytest.mark.parametrize("model", [EIGHTEEN_GAUGE, unit_rod(6, axial_n=50.0, shear_n=10.0)])
def test_tangent_is_the_derivative_of_the_forces(model: NeedleModel) -> None:
    x, R = bent(model)
    n, length = model.elements, model.element_length_m
    scale = np.tile([length] * 3 + [1.0] * 3, n + 1)  # makes forces and moments, metres and radians comparable
    exact = dense(*evaluate(model, x, R)[1:]) * scale[:, None] * scale
    differences = np.empty_like(exact)
    for j in range(6 * (n + 1)):
        sides = []
        for sign in (1.0, -1.0):
            dq, moved_x, moved_R = np.zeros((n + 1, 6)), x.copy(), R.copy()
            dq.flat[j] = sign * 1e-5 * scale[j]
            advance(moved_x, moved_R, dq)
            sides.append(evaluate(model, moved_x, moved_R)[0].ravel() * scale)
        differences[:, j] = (sides[0] - sides[1]) / 2e-5
    spins, misses = np.arange(6 * (n + 1)) % 6 > 2, []
    for block in (np.ix_(spins, spins), np.ix_(~spins, spins), np.ix_(spins, ~spins), np.ix_(~spins, ~spins)):
        misses.append((exact[block] - differences[block]).ravel() / np.abs(exact[block]).max())
    text = f"tangent of {model.elements} bent beams against differences, share of each of four blocks"
    source = "central differences; Battini and Pacoste 2002"
    check(text, expected=0, measured=np.concatenate(misses), tolerance=1e-6, source=source)


def test_rigid_motion_costs_nothing() -> None:
    model, rng, shares = EIGHTEEN_GAUGE, np.random.default_rng(5), []
    stiffness = np.array([model.axial_n] * 3 + [model.bending_nm2 / model.element_length_m] * 3)
    for _ in range(5):
        x, R = straight(model, rng.normal(size=3), Rotation.random(rng=rng).as_matrix())
        rounding = 4 * np.finfo(float).eps * np.abs(x).max() / model.element_length_m  # as a strain
        shares.append(evaluate(model, x, R)[0] / stiffness / rounding)
    text = "rigid motion: largest force and moment, in units of the rounding of the strain"
    check(text, expected=0, measured=shares, tolerance=1, source="frame indifference, Truesdell and Noll")


def test_forces_turn_with_the_needle() -> None:
    model = EIGHTEEN_GAUGE
    x, R = bent(model)
    before = evaluate(model, x, R)[0]
    turn = Rotation.random(rng=np.random.default_rng(7)).as_matrix()
    rigid_move(x, R, np.array([0.3, 0.0, -0.1]), turn @ R[0])
    expected = np.concatenate([before[:, :3] @ turn.T, before[:, 3:] @ turn.T], axis=1)
    miss, text = (
        (evaluate(model, x, R)[0] - expected) / model.axial_n,
        "forces of a bent needle turn with it, share of EA",
    )
    check(text, expected=0, measured=miss, tolerance=1e-11, source="frame indifference, Truesdell and Noll")


def test_mirrored_state_has_mirrored_forces() -> None:
    model = EIGHTEEN_GAUGE
    x, R = bent(model)
    mirror = np.diag([-1.0, 1.0, 1.0])
    forces, mirrored = evaluate(model, x, R)[0], evaluate(model, x @ mirror, mirror @ R @ mirror)[0]
    np.testing.assert_allclose(mirrored[:, :3], forces[:, :3] @ mirror, atol=1e-12 * np.abs(forces).max())
    np.testing.assert_allclose(mirrored[:, 3:], -forces[:, 3:] @ mirror, atol=1e-12 * np.abs(forces).max())


def test_internal_forces_and_moments_balance() -> None:
    x, R = bent(EIGHTEEN_GAUGE)
    f = evaluate(EIGHTEEN_GAUGE, x, R)[0]
    size = np.abs(f[:, :3]).max()
    assert size > 100.0
    assert np.abs(f[:, :3].sum(axis=0)).max() < 1e-12 * size
    moments = f[:, 3:] + np.cross(x - x[0], f[:, :3])
    assert np.abs(moments.sum(axis=0)).max() < 1e-12 * size * EIGHTEEN_GAUGE.length_m


# analytic and published solutions


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize(("shear_n", "name"), [(1e4, "slender"), (0.5, "shear-dominated")])
def test_small_tip_deflection_is_timoshenkos(axis: int, shear_n: float, name: str) -> None:
    # P L^3 / 3EI + P L / kGA, slope P L^2 / 2EI (Timoshenko & Gere); exact at the nodes whatever their number
    model, load = unit_rod(3, shear_n=shear_n), 1e-4
    x, R = straight(model, np.zeros(3), np.eye(3))
    solution = loaded(model, load * np.eye(6)[axis], 1, x, R)
    tip, slope = solution.x[-1, axis], solution.R[-1, axis, 2]
    text, source = f"cantilever, {name}, load along {'xy'[axis]}", "Timoshenko and Gere: P L^3 / 3 EI + P L / kGA"
    numbers: dict[str, Any] = {"tolerance": 1e-6, "relative": True, "source": source}
    check(f"{text}: tip deflection / L", expected=load / 3 + load / shear_n, measured=tip, **numbers)
    check(f"{text}: slope of the tip", expected=load / 2, measured=slope, **numbers)
    assert abs(solution.x[-1, 1 - axis]) < 1e-12


def test_stretch_and_twist_are_hookes() -> None:
    model = unit_rod(4, axial_n=20.0)
    x, R = straight(model, np.zeros(3), np.eye(3))
    solution = loaded(model, np.array([0, 0, 2.0, 0, 0, 0.7]), 1, x, R)
    turn = Rotation.from_matrix(solution.R[-1]).as_rotvec()
    check("stretch P L / EA", expected=1.1, measured=solution.x[-1, 2], tolerance=1e-10, source="Hooke")
    check("twist T L / GJ", expected=[0, 0, 0.7], measured=turn, tolerance=1e-10, source="Saint-Venant", unit="rad")


@pytest.mark.parametrize(
    ("load", "deflection", "shortening"),
    [(1, 0.30172, 0.05643), (2, 0.49346, 0.16064), (5, 0.71379, 0.38763), (10, 0.81061, 0.55500)],
)
def test_elastica(load: float, deflection: float, shortening: float) -> None:
    # P L^2 / EI = load; Bisshopp & Drucker 1945 and Mattiasson 1981 (reference numbers of the specification)
    model = unit_rod(40)
    x, R = straight(model, np.zeros(3), np.eye(3))
    tip = loaded(model, np.array([0, load, 0, 0, 0, 0.0]), 5, x, R).x[-1]
    text, source = f"elastica, P L^2 / EI = {load}", "Bisshopp and Drucker 1945, Mattiasson 1981"
    check(f"{text}: deflection / L", expected=deflection, measured=tip[1], tolerance=1.2e-4, source=source)
    check(f"{text}: shortening / L", expected=shortening, measured=1.0 - tip[2], tolerance=3e-5, source=source)
    assert abs(tip[0]) < 1e-10


def test_end_moment_rolls_the_needle_up_to_a_circle() -> None:
    # M = 2 pi EI / L; the nodes lie on a regular polygon whose perimeter is the length
    model = unit_rod(20)
    x, R = straight(model, np.zeros(3), np.eye(3))
    solution = loaded(model, np.array([0, 0, 0, 2 * np.pi, 0, 0]), 10, x, R)
    text, source = "roll-up by M = 2 pi EI / L: gap of the circle / L", "Euler: constant curvature M / EI"
    check(text, expected=0, measured=solution.x[-1] - solution.x[0], tolerance=1e-8, source=source)
    np.testing.assert_allclose(solution.R[-1], np.eye(3), atol=1e-8)
    radii = np.linalg.norm(solution.x[:-1] - solution.x[:-1].mean(axis=0), axis=1)
    expected, text = 1.0 / (40 * np.sin(np.pi / 20)), "roll-up: radius of the polygon of 20 beams / L"
    check(text, expected=expected, measured=radii, tolerance=1e-8, relative=True, source=source)


def arc(elements: int) -> tuple[NeedleModel, Vector, Vector]:
    """The 45-degree arc of radius 100 in the plane z = 0, from the origin along +y towards +x."""
    angles = np.linspace(0.0, np.pi / 4, elements + 1)
    x = 100.0 * np.stack([1.0 - np.cos(angles), np.sin(angles), np.zeros_like(angles)], axis=1)
    start = np.eye(3)[:, [2, 0, 1]]  # columns z, x, y: tangent along +y
    R = np.array([exp_map(np.array([0.0, 0.0, -a])) @ start for a in angles])
    half = 0.5 * angles[1]  # chord frames lie half an element's angle between those of their nodes
    chords = np.array([exp_map(np.array([0.0, 0.0, -a - half])) @ start for a in angles[:-1]])
    rest = np.stack([R[:-1].transpose(0, 2, 1) @ chords, R[1:].transpose(0, 2, 1) @ chords], axis=1)
    model = NeedleModel.from_section(
        length_m=elements * 200.0 * math.sin(half),
        elements=elements,
        axial_n=1e7,
        bending_nm2=1e7 / 12,
        torsion_nm2=8.333e5,
        shear_n=5 / 6 * 5e6,
        outer_radius_m=0.5,
        rest_frames=rest,
    )
    return model, x, R


def test_the_unloaded_arc_is_stress_free() -> None:
    model, x, R = arc(8)
    np.testing.assert_allclose(x[-1], [29.289, 70.711, 0.0], atol=1e-3)
    assert np.abs(evaluate(model, x, R)[0]).max() < 1e-13 * model.axial_n


def test_45_degree_bend() -> None:
    # E = 1e7, nu = 0, GJ = 8.333e5; rod: Reissner rod integrated independently (reference numbers of the specification)
    model, x, R = arc(16)
    rod = {300: (22.245, 58.779, 40.192), 600: (15.685, 47.150, 53.475)}
    bathe = {300: (22.5, 59.2, 39.5), 600: (15.9, 47.2, 53.4)}
    simo = {300: (22.33, 58.84, 40.08), 600: (15.79, 47.23, 53.37)}
    for load in (300, 600):
        tip = loaded(model, np.array([0, 0, load, 0, 0, 0.0]), load // 50, x, R).x[-1]
        text = f"45-degree bend, P = {load}, GJ = 8.333e5: tip"
        check(text, expected=rod[load], measured=tip, tolerance=0.02, source="Reissner rod integrated apart")
        check(
            text, expected=bathe[load], measured=tip, tolerance=0.02, relative=True, source="Bathe and Bolourchi 1979"
        )
        check(text, expected=simo[load], measured=tip, tolerance=0.01, relative=True, source="Simo and Vu-Quoc 1986")


def test_euler_buckling_load() -> None:
    # the load at which the tangent of the straight, compressed cantilever turns singular: pi^2 EI / 4 L^2
    model = unit_rod(16)
    x, R = straight(model, np.zeros(3), np.eye(3))

    def smallest_stiffness(load: float) -> float:
        s = loaded(model, np.array([0, 0, -load, 0, 0, 0.0]), 1, x, R)
        K = dense(*evaluate(model, s.x, s.R)[1:])[6:, 6:]
        np.testing.assert_allclose(K, K.T, atol=1e-9 * np.abs(K).max())
        return float(np.linalg.eigvalsh(K)[0])

    critical = brentq(smallest_stiffness, 1.0, 4.0, rtol=1e-8)
    numbers = {"expected": np.pi**2 / 4, "measured": critical, "tolerance": 0.01, "relative": True}
    check("buckling load of a cantilever, P L^2 / EI", **numbers, source="Euler, pi^2 / 4")


# solvers and moves


def test_block_solver_is_numpys() -> None:
    x, R = bent(EIGHTEEN_GAUGE)
    _, diag, upper, lower = evaluate(EIGHTEEN_GAUGE, x, R)
    rhs = np.random.default_rng(2).normal(size=(EIGHTEEN_GAUGE.elements, 6, 66))
    solution = rhs.copy()
    solve_blocks(*factor_blocks(diag[1:], upper[1:], lower[1:]), upper[1:], solution)
    expected = np.linalg.solve(dense(diag, upper, lower)[6:, 6:], rhs.reshape(-1, 66)).reshape(rhs.shape)
    for rows in (slice(0, 3), slice(3, 6)):
        np.testing.assert_allclose(solution[:, rows], expected[:, rows], atol=1e-9 * np.abs(expected[:, rows]).max())


def test_block_solver_pivots_inside_a_block() -> None:
    diag = np.stack([np.eye(6)[::-1], np.roll(np.eye(6), 1, axis=0)])  # zero diagonals
    off = np.zeros((1, 6, 6))
    rhs = np.arange(12.0).reshape(2, 6, 1)
    solution = rhs.copy()
    solve_blocks(*factor_blocks(diag, off, off), off, solution)
    np.testing.assert_allclose(np.einsum("nij,njk->nik", diag, solution), rhs, atol=1e-14)


def test_static_failures_have_names() -> None:
    model = unit_rod(4)
    x, R = straight(model, np.zeros(3), np.eye(3))
    external = np.zeros((5, 6))
    external[-1, 0] = 1.0
    assert solve_static(model, x, R, external, tolerance=1e-9, max_iterations=1).status is Status.NOT_CONVERGED
    external[-1, 0] = math.nan
    assert solve_static(model, x, R, external, tolerance=1e-9).status is Status.NOT_FINITE


def test_rigid_move_puts_the_base_exactly() -> None:
    x, R = bent(EIGHTEEN_GAUGE)
    shape = R[0].T @ (x - x[0]).T
    position, rotation = np.array([0.1, 0.2, 0.3]), Rotation.random(rng=np.random.default_rng(4)).as_matrix()
    rigid_move(x, R, position, rotation)
    assert (x[0] == position).all()
    assert (R[0] == rotation).all()
    np.testing.assert_allclose(R[0].T @ (x - x[0]).T, shape, atol=1e-15)


def test_many_moves_keep_the_rotations_orthonormal() -> None:
    x, R = bent(EIGHTEEN_GAUGE)
    rng = np.random.default_rng(8)
    for _ in range(2000):
        advance(x, R, rng.normal(scale=0.05, size=(len(x), 6)))
    np.testing.assert_allclose(R @ R.transpose(0, 2, 1), np.broadcast_to(np.eye(3), R.shape), atol=2e-15)
