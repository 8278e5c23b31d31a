"""The tissue against identities: patch test, rigid motion, energy, stiffness, polar rotation, damping.

What is solved (bar, block, convergence order) is in the second half; its reference is assembled here.
"""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.linalg import polar
from scipy.spatial.transform import Rotation

from simcore.insertion.compliance import Compliance
from simcore.mesh.mesh import BoxMesh
from simcore.tissue.model import TissueModel, assemble_band
from tests.budget import examples
from tests.simcore.block import block, cold, held, relaxed, stiffness_times, surface_areas
from tests.simcore.reference import (
    MANUFACTURED_DIRECTION,
    MANUFACTURED_EDGE_M,
    QUADRATURE,
    manufactured,
    manufactured_load,
    small_strain_solution,
)
from tests.verification import verify

Vector = np.ndarray
E_PA, NU = 6300.0, 0.4  # the defaults of the scenario
LAME_PA, SHEAR_PA = E_PA * NU / ((1 + NU) * (1 - 2 * NU)), E_PA / (2 * (1 + NU))
quick = settings(max_examples=examples(100), deadline=None)
check = partial(verify, "tissue")


def dense_stiffness(model: TissueModel, rotations: Vector) -> Vector:
    units = np.eye(model.mesh.nodes_m.size).reshape(-1, *model.mesh.nodes_m.shape)
    return np.array([stiffness_times(model, unit, rotations).ravel() for unit in units]).T


def shaken(model: TissueModel, size_m: float = 1e-3, seed: int = 0) -> Vector:
    """Every node off its place by a normal deviate: strains of 10 %, rotations of several degrees."""
    return model.mesh.nodes_m + np.random.default_rng(seed).normal(scale=size_m, size=model.mesh.nodes_m.shape)


def random_rotations(model: TissueModel, seed: int = 0) -> Vector:
    turns = Rotation.random(len(model.mesh.tets), rng=np.random.default_rng(seed))
    return np.ascontiguousarray(turns.as_matrix().reshape(-1, 9))


def inner_nodes(model: TissueModel) -> Vector:
    mesh = model.mesh
    return np.setdiff1d(np.arange(len(mesh.nodes_m)), np.concatenate(list(mesh.faces.values())))


# identities


def test_patch() -> None:
    """Irons' patch test: affine displacement of the surface gives the uniform strain inside, without inner forces."""
    model = block(5.0)
    slope = np.array([[0.02, 0.05, -0.01], [0.03, -0.04, 0.02], [-0.06, 0.01, 0.03]])
    affine = model.mesh.nodes_m @ (np.eye(3) + slope).T
    forces, least, energy = held(model, affine)
    inside = inner_nodes(model)
    assert len(inside) > 100
    source, largest = "Irons 1966, patch test", np.abs(forces).max()
    text = "patch test: forces inside / on the surface, affine displacement of some 5 %"
    check(text, expected=0, measured=forces[inside] / largest, tolerance=1e-12, source=source)
    assert least == pytest.approx(np.linalg.det(np.eye(3) + slope), rel=1e-12)
    stretch = polar(np.eye(3) + slope)[1]
    strain = stretch - np.eye(3)
    density = SHEAR_PA * np.sum(strain**2) + 0.5 * LAME_PA * np.trace(strain) ** 2
    assert isinstance(model.mesh, BoxMesh)
    expected, text = density * model.mesh.size_m.prod(), "patch test: energy"
    check(text, expected=expected, measured=energy, tolerance=1e-12, relative=True, source=source, unit="J")


def test_patch_is_found_again_from_a_disturbed_start() -> None:
    """The inverse patch test: surface held in the affine state, the inside relaxes to it."""
    model = block(5.0, fixed_faces=("x_min", "x_max", "y_min", "y_max", "z_max"))
    affine = model.mesh.nodes_m @ (np.eye(3) + 0.03 * np.array([[1, 2, 0], [0, -1, 1], [1, 0, 1]])).T
    load, _, _ = held(model, affine)
    load[inner_nodes(model)] = 0.0
    free = (model.unknown >= 0)[:, None]
    start = np.where(free, affine + shaken(model, 2e-4) - model.mesh.nodes_m, affine)
    miss, text = relaxed(model, load, start) - affine, "inverse patch test: distance from the affine state"
    check(text, expected=0, measured=miss, tolerance=1e-12, source="Irons 1966, patch test", unit="m")


@pytest.mark.parametrize("degrees", [0.0, 1e-3, 30.0, 90.0, 179.9, 180.0])
def test_rigid_motion_is_free(degrees: float) -> None:
    """Frame indifference: neither force nor energy under any rotation and translation, from a cold start. Forces are
    shares of that of unit strain on one cell."""
    model, shares = block(), []
    for axis in np.array([[1, 0, 0], [0, 1, 0], [0, 0, 1], [0.6, -0.48, 0.64]]):
        turn = Rotation.from_rotvec(np.radians(degrees) * axis).as_matrix()
        forces, least, energy = held(model, model.mesh.nodes_m @ turn.T + [0.3, -0.2, 0.1])
        shares.append(np.abs(forces).max() / (E_PA * 0.01**2))
        assert energy < 1e-24
        assert least == pytest.approx(1.0, abs=1e-12)
    text = f"rigid motion, {degrees:g} degrees about four axes: largest force"
    check(text, expected=0, measured=shares, tolerance=1e-12, source="frame indifference, Truesdell and Noll")


def test_forces_turn_with_the_body() -> None:
    """Frame indifference away from rest: f(Q x) = Q f(x)."""
    model = block()
    x, turn = shaken(model), Rotation.from_rotvec([1.0, -2.0, 0.5]).as_matrix()
    plain, turned = held(model, x), held(model, x @ turn.T)
    np.testing.assert_allclose(turned[0], plain[0] @ turn.T, atol=1e-12 * np.abs(plain[0]).max())
    assert turned[2] == pytest.approx(plain[2], rel=1e-12)


def test_forces_are_the_gradient_of_the_energy() -> None:
    """f = dW/dx by central differences, at strains of 10 %; the exact polar rotation makes it so (McAdams 2011)."""
    model = block()
    x, step = shaken(model), 1e-7
    forces = held(model, x)[0]
    rng, misses = np.random.default_rng(1), []
    for _ in range(20):
        direction = rng.normal(size=x.shape)
        slope = (held(model, x + step * direction)[2] - held(model, x - step * direction)[2]) / (2 * step)
        misses.append((slope - np.sum(forces * direction)) / np.abs(forces).sum())
    text, source = (
        "forces against differences of the energy, strains of 10 %",
        "central differences; McAdams et al. 2011",
    )
    check(text, expected=0, measured=misses, tolerance=2e-8, source=source)


def test_forces_balance() -> None:
    """Newton's third law: no net force and no net moment of the inner forces of a deformed free body."""
    model = block()
    x = shaken(model)
    forces, _, _ = held(model, x)
    assert np.abs(forces.sum(axis=0)).max() < 1e-13 * np.abs(forces).sum()
    assert np.abs(np.cross(x, forces).sum(axis=0)).max() < 1e-13 * np.abs(forces).sum() * 0.05


@pytest.mark.slow
@pytest.mark.parametrize("turned", [False, True])
def test_rotated_stiffness_is_symmetric_and_semidefinite(turned: bool) -> None:
    """sum R_e K_e R_e^T: symmetric, no negative eigenvalue, translations in its null space; at rest rotations too."""
    model = block()
    matrix = dense_stiffness(model, random_rotations(model) if turned else cold(model))
    scale = np.abs(matrix).max()
    values, text = np.linalg.eigvalsh(matrix), f"stiffness, elements {'turned at random' if turned else 'at rest'}"
    source = "sum R K R^T, positive semi-definite (Mueller and Gross 2004)"
    for name, measured, tolerance in (
        ("asymmetry", (matrix - matrix.T) / scale, 1e-14),
        ("negative eigenvalues", min(values.min() / values.max(), 0.0), 1e-13),
    ):
        check(f"{text}: {name}", expected=0, measured=measured, tolerance=tolerance, source=source)
    assert np.count_nonzero(values < 1e-10 * values.max()) == (3 if turned else 6)
    for unit in np.eye(3):
        assert (
            np.abs(stiffness_times(model, np.tile(unit, (len(model.mesh.nodes_m), 1)), cold(model))).max()
            < 1e-13 * scale
        )


def test_rotated_stiffness_is_the_tangent_at_rest() -> None:
    """Without stress the dropped term dR vanishes: central differences of the forces at a rigidly turned rest state."""
    model = block()
    turn = Rotation.from_rotvec([0.7, -0.4, 1.1]).as_matrix()
    x, rotations = model.mesh.nodes_m @ turn.T, np.tile(turn.ravel(), (len(model.mesh.tets), 1))
    v, step = np.random.default_rng(2).normal(size=x.shape), 1e-6
    slope = (held(model, x + step * v)[0] - held(model, x - step * v)[0]) / (2 * step)
    product = stiffness_times(model, v, rotations)
    miss, text = (product - slope) / np.abs(product).max(), "tangent at a turned rest state against differences"
    check(text, expected=0, measured=miss, tolerance=1e-7, source="central differences of the forces")


@pytest.mark.slow
@pytest.mark.parametrize("faces", [("y_min", "y_max"), ("z_max",), ("x_min", "x_max", "y_min", "y_max", "z_max")])
def test_band_is_the_matrix_free_product(faces: tuple[str, ...]) -> None:
    """scale * sum R_e K_e R_e^T + diag on the free nodes, in band storage, against products with vectors."""
    model = block(fixed_faces=faces)
    rotations, rng = random_rotations(model), np.random.default_rng(3)
    diagonal = rng.uniform(0.1, 1.0, len(model.mesh.nodes_m))
    band: Vector = np.zeros((model.unknowns, model.band + 1))
    assemble_band(model.tetrahedra, rotations, model.unknown, 1.7, diagonal, band)
    v, free = np.zeros_like(model.mesh.nodes_m), model.unknown >= 0
    v[free] = rng.normal(size=(free.sum(), 3))
    expected = (1.7 * stiffness_times(model, v, rotations) + diagonal[:, None] * v)[free]
    ranked = np.empty((free.sum(), 3))
    ranked[model.unknown[free]] = v[free]
    full = from_lower_band(band.T)
    product = (full @ ranked.ravel()).reshape(-1, 3)[model.unknown[free]]
    np.testing.assert_allclose(product, expected, atol=1e-13 * np.abs(expected).max())


def from_lower_band(band: Vector) -> Vector:
    full = np.zeros((band.shape[1], band.shape[1]))
    for offset, row in enumerate(band):
        count = band.shape[1] - offset
        full += np.diag(row[:count], -offset)
        if offset:
            full += np.diag(row[:count], offset)
    return full


# polar rotation

ONE_CELL = block(10.0, (10.0, 10.0, 10.0), fixed_faces=("z_max",))
stretches = st.tuples(*[st.floats(0.15, 4.0)] * 3)
turns = arrays(np.float64, 3, elements=st.floats(-1.8, 1.8))  # up to 180 degrees


def polar_of(f: Vector, start: Vector) -> Vector:
    """The rotation that the tissue finds for a uniform deformation gradient, from a start (3, 3)."""
    rotations = np.tile(start.ravel(), (len(ONE_CELL.mesh.tets), 1))
    held(ONE_CELL, ONE_CELL.mesh.nodes_m @ f.T, rotations)
    return rotations[0].reshape(3, 3)


@pytest.mark.slow
@quick
@given(stretches, turns, turns, turns, st.booleans())
def test_polar_rotation_is_scipys(
    stretch: tuple[float, ...], turn: Vector, axes: Vector, start: Vector, warm: bool
) -> None:
    """The rotation of F = R S, from a cold (identity) or an arbitrary start, is that of scipy.linalg.polar."""
    principal = Rotation.from_rotvec(axes).as_matrix()
    f = Rotation.from_rotvec(turn).as_matrix() @ principal @ np.diag(stretch) @ principal.T
    found = polar_of(f, Rotation.from_rotvec(start).as_matrix() if warm else np.eye(3))
    np.testing.assert_allclose(found, polar(f)[0], atol=2e-13)


@quick
@given(stretches, turns)
def test_polar_rotation_of_an_inverted_element_stays_proper(stretch: tuple[float, ...], axes: Vector) -> None:
    """det F < 0: still a rotation, and the one nearest to F (largest tr R^T F; Kabsch 1976)."""
    values = np.sort(np.array(stretch))[::-1] * [1.0, 1.0, -1.0]
    principal = Rotation.from_rotvec(axes).as_matrix()
    f = principal @ np.diag(values) @ principal.T
    found = polar_of(f, np.eye(3))
    assert np.linalg.det(found) == pytest.approx(1.0, abs=1e-12)
    assert np.trace(found.T @ f) == pytest.approx(values.sum(), abs=1e-11)


# damping


@pytest.mark.parametrize("degrees", [0.0, 50.0, 180.0])
def test_damping_does_not_resist_a_rigid_motion(degrees: float) -> None:
    """spec of the tissue: C v = beta sum R_e K_e R_e^T v = 0 for v = a + omega x x of the turned, undeformed body."""
    model = block()
    turn = Rotation.from_rotvec(np.radians(degrees) * np.array([0.36, 0.48, 0.8])).as_matrix()
    x, rotations = model.mesh.nodes_m @ turn.T, cold(model)
    held(model, x, rotations)
    spin = np.cross([0.4, -1.0, 2.0], x) + np.array([1.0, 2.0, 3.0])
    stretching = stiffness_times(model, spin * [1.0, 1.0, 2.0], rotations)
    share = stiffness_times(model, spin, rotations) / np.abs(stretching).max()
    text = f"damping force of a rigid motion / of a stretching one, body turned by {degrees:g} degrees"
    check(text, expected=0, measured=share, tolerance=1e-12, source="frame indifference, spec of the tissue")


# solutions


def test_uniaxial_bar() -> None:
    """Hooke: sigma = E eps, lateral strain -nu eps; a diagonal stretch has R = I, so it is exact at 20 % too."""
    model, strain = block(5.0), 0.2
    x = model.mesh.nodes_m * [1 - NU * strain, 1 - NU * strain, 1 + strain]
    forces, _, _ = held(model, x)
    area, end = 0.02 * 0.03, model.mesh.faces["z_max"]
    force, text = forces[end, 2].sum(), "uniaxial bar, 20 % strain: end force"
    numbers = {"expected": E_PA * strain * area, "measured": force, "tolerance": 1e-12, "relative": True}
    check(text, **numbers, source="Hooke, sigma = E eps", unit="N")
    assert np.abs(forces[:, :2]).max() < 1e-13 * np.abs(forces).max()


def test_a_loaded_bar_stretches_by_hookes_law() -> None:
    """Hooke: u = sigma (L - z) / E for a bar held at one end, nu = 0: linear in z, so the mesh holds it exactly."""
    model = block(10.0, poisson=0.0, fixed_faces=("z_max",))
    traction = -0.01 * E_PA  # pulls the free face z = 0 towards -z: 1 % strain
    load = np.zeros_like(model.mesh.nodes_m)
    load[:, 2] = traction * surface_areas(model, "z_min")
    shift = relaxed(model, load, model.mesh.nodes_m) - model.mesh.nodes_m
    expected, text = -0.01 * (0.04 - model.mesh.nodes_m[:, 2]), "loaded bar, 1 % strain: displacement"
    check(text, expected=expected, measured=shift[:, 2], tolerance=1e-12, source="Hooke, u = sigma z / E", unit="m")
    assert np.abs(shift[:, :2]).max() < 1e-12


def test_small_loads_give_the_small_strain_solution() -> None:
    """Co-rotational elasticity is linear elasticity to first order: u(load) - u_linear falls with the load squared."""
    model = block(5.0)
    load = np.zeros_like(model.mesh.nodes_m)
    load[:, 0] = 100.0 * surface_areas(model, "z_min")
    load[:, 2] = 150.0 * surface_areas(model, "x_max")
    linear = small_strain_solution(model, E_PA, NU, load)
    errors = []
    for scale in (1e-3, 1e-2):
        u = relaxed(model, scale * load, model.mesh.nodes_m) - model.mesh.nodes_m
        errors.append(np.abs(u - scale * linear).max() / np.abs(scale * linear).max())
    source = "small-strain elements assembled apart (Zienkiewicz and Taylor)"
    text = "small loads: displacement against small-strain elasticity"
    check(text, expected=0, measured=errors[0], tolerance=1e-4, source=source)
    order = np.log10(errors[1] / errors[0])
    check(f"{text}, order of the difference", expected=1, measured=order, tolerance=0.1, source=source)


# convergence of a manufactured solution


def manufactured_error(cells: int) -> float:
    """Root mean square error of the displacement, through the code's own factor at rest."""
    model = block(
        1e3 * MANUFACTURED_EDGE_M / cells,
        (1e3 * MANUFACTURED_EDGE_M,) * 3,
        fixed_faces=("x_min", "x_max", "y_min", "y_max", "z_max"),
    )
    tets, free = model.mesh.tets, model.unknown >= 0
    points = np.einsum("qa,tai->tqi", QUADRATURE, model.mesh.nodes_m[tets])
    forces = manufactured_load(points.reshape(-1, 3), E_PA, NU).reshape(points.shape)
    load, u = np.zeros_like(model.mesh.nodes_m), np.zeros_like(model.mesh.nodes_m)
    np.add.at(load, tets, np.einsum("qa,tqi,t->tai", QUADRATURE, forces, model.volumes_m3 / 4))
    right = np.empty((model.unknowns // 3, 3))
    right[model.unknown[free]] = load[free]
    u[free] = Compliance(model, 1.0, 1).solve(right.ravel()).reshape(-1, 3)[model.unknown[free]]
    exact = manufactured(points.reshape(-1, 3), (0, 0, 0)).reshape((*points.shape[:2], 1)) * MANUFACTURED_DIRECTION
    miss = np.einsum("qa,tai->tqi", QUADRATURE, u[tets]) - exact
    return float(np.sqrt(np.mean(miss**2)))


def test_a_manufactured_solution_converges_with_second_order() -> None:
    """Linear elements: the L2 error falls with h^2 (Brenner and Scott); slope fitted over three meshes."""
    cells = np.array([6, 9, 12])
    errors = [manufactured_error(n) for n in cells]
    order = np.polyfit(np.log(1.0 / cells), np.log(errors), 1)[0]
    text, source = "manufactured solution: order of the L2 error", "linear elements, h^2 (Brenner and Scott)"
    check(text, expected=2, measured=order, tolerance=0.2, source=source)
