"""The frozen unit L0: that it is right, and that it stays what it is."""

from __future__ import annotations

import hashlib
import inspect

import numpy as np
import pytest

from benchmarks.performance import reference_kernels
from benchmarks.performance.reference_kernels import (
    ReferenceStep,
    _deformed,
    _dissection,
    _frozen_kernel,
    _sparsest_factor,
    _stiffness,
)
from simcore.mesh.mesh import BoxMesh
from simcore.rotations import exp_map
from simcore.scenario.build import tissue_model
from simcore.scenario.scenario import Tissue
from simcore.tissue.model import TissueModel, elastic_forces

EDGES_MM = (18.0, 10.0)


@pytest.fixture(scope="module", params=EDGES_MM)
def model(request: pytest.FixtureRequest) -> TissueModel:
    return tissue_model(Tissue(element_size_mm=request.param))


@pytest.fixture(scope="module")
def box(model: TissueModel) -> BoxMesh:
    assert isinstance(model.mesh, BoxMesh)
    return model.mesh


@pytest.fixture(scope="module")
def unit(model: TissueModel, box: BoxMesh) -> ReferenceStep:
    held = np.flatnonzero(model.unknown < 0)
    return ReferenceStep(box, held, mu_pa=model.mu_pa, lambda_pa=model.lambda_pa)


def test_forces_are_those_of_the_simulator(model: TissueModel, unit: ReferenceStep) -> None:
    expected = np.zeros_like(model.mesh.nodes_m)
    rotations = np.tile(np.eye(3).ravel(), (len(model.mesh.tets), 1))
    material = (model.gradients, model.volumes_m3, model.mu_pa, model.lambda_pa)
    least, energy = elastic_forces(unit.position_m, model.mesh.tets, *material, rotations, expected)
    assert np.abs(expected).max() > 1e-2
    np.testing.assert_allclose(unit.evaluate(), expected, rtol=0.0, atol=1e-10)
    mine = reference_kernels.plain_forces(unit.position_m, model.mesh.tets, *material, rotations, unit.forces)
    assert mine == pytest.approx((least, energy), rel=1e-12)


def test_a_turned_block_is_free_of_forces(unit: ReferenceStep) -> None:
    turned = unit.mesh.nodes_m @ exp_map(np.array([0.3, -0.8, 0.5])).T
    rotations = np.tile(np.eye(3).ravel(), (len(unit.mesh.tets), 1))
    forces = np.ones_like(turned)
    material = (unit.gradients, unit.volumes_m3, unit.mu_pa, unit.lambda_pa)
    reference_kernels.plain_forces(turned, unit.mesh.tets, *material, rotations, forces)
    assert np.abs(forces).max() < 1e-12


def test_the_matrix_is_the_derivative_of_the_forces_at_rest(
    model: TissueModel, box: BoxMesh, unit: ReferenceStep
) -> None:
    free = np.flatnonzero(model.unknown >= 0)
    move = np.zeros_like(model.mesh.nodes_m)
    move[free] = 1e-7 * np.random.default_rng(1).normal(size=(len(free), 3))
    rotations = np.tile(np.eye(3).ravel(), (len(model.mesh.tets), 1))
    forces = np.zeros_like(move)
    material = (unit.gradients, unit.volumes_m3, unit.mu_pa, unit.lambda_pa)
    reference_kernels.plain_forces(model.mesh.nodes_m + move, model.mesh.tets, *material, rotations, forces)
    linear = _stiffness(box, *material) @ move.ravel()
    held = np.setdiff1d(np.arange(len(move)), free)
    difference = np.delete(linear.reshape(-1, 3) - forces, held, axis=0)
    assert np.abs(difference).max() < 1e-4 * np.abs(forces).max()


def test_the_back_solve_solves(unit: ReferenceStep) -> None:
    residual = unit.matrix @ unit.solve() - unit.right
    assert np.abs(residual).max() < 1e-10 * np.abs(unit.right).max()


def test_dissection_is_a_permutation_with_its_last_plane_last(model: TissueModel, box: BoxMesh) -> None:
    free = np.flatnonzero(model.unknown >= 0)
    order = _dissection(box, free)
    assert sorted(order) == list(range(len(free)))
    last = model.mesh.nodes_m[free[order[-4:]], 2]
    assert np.ptp(last) == 0.0
    assert 0.0 < last[0] < box.size_m[2]


def test_the_unit_is_frozen() -> None:
    """Whoever changes the kernels or the matrix of L0 moves every figure that was ever given in it."""
    parts = (
        reference_kernels.ReferenceStep.solve,
        reference_kernels.ReferenceStep.evaluate,
        reference_kernels.plain_polar_rotation.py_func,  # type: ignore[attr-defined]
        reference_kernels.plain_forces.py_func,  # type: ignore[attr-defined]
        _frozen_kernel,
        _stiffness,
        _sparsest_factor,
        _dissection,
        _deformed,
    )
    code = "".join("".join(inspect.getsource(part).split()) for part in parts)
    assert reference_kernels.UNIT == "L0/1"
    assert hashlib.sha256(code.encode()).hexdigest()[:16] == "e480d8a303748bb7"
