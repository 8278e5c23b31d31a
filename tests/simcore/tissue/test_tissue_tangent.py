"""The tissue's exact tangent against central differences of its forces, deformed, turned and damped."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from simcore.scenario.build import tissue_model
from simcore.scenario.scenario import Tissue
from simcore.tissue.model import elastic_forces, rotated_stiffness_times
from simcore.tissue.tangent import Dynamics, tangent_times
from tests.verification import verify

Vector = NDArray[np.float64]

MODEL = tissue_model(Tissue(size_mm=(20.0, 30.0, 20.0), element_size_mm=10.0))
DT_S = 0.01


def deformed() -> tuple[Vector, Vector]:
    """Positions (n, 3) m under large turns and strains, min det F about 0.5, and positions a step earlier."""
    rng = np.random.default_rng(3)
    rest = MODEL.mesh.nodes_m
    now = rest + 4e-3 * np.sin(70.0 * rest[:, [2, 0, 1]]) + 4e-4 * rng.normal(size=rest.shape)
    return now, now - 1e-4 * rng.normal(size=rest.shape)


def material(rotations: Vector) -> tuple[NDArray[np.int64], Vector, Vector, float, float, Vector]:
    return MODEL.mesh.tets, MODEL.gradients, MODEL.volumes_m3, MODEL.mu_pa, MODEL.lambda_pa, rotations


def forces(x: Vector, x_old: Vector, rotations: Vector, beta: float) -> Vector:
    """(unknowns,) N: elastic and damping forces of the free nodes; `rotations` becomes those of x."""
    elastic, damping = np.zeros_like(x), np.zeros_like(x)
    least, _ = elastic_forces(x, *material(rotations), elastic)
    assert least > 0.3
    rotated_stiffness_times((x - x_old) / DT_S, *material(rotations), damping)
    free = MODEL.unknown >= 0
    return (elastic + beta * damping)[free][np.argsort(MODEL.unknown[free])].ravel()


INERTIA = np.linspace(1.0, 2.0, len(MODEL.mesh.nodes_m))


def products(moves: Vector, beta: float, inertia: Vector) -> Vector:
    x, x_old = deformed()
    rotations = np.tile(np.eye(3).ravel(), (len(MODEL.mesh.tets), 1))
    forces(x, x_old, rotations, beta)
    return tangent_times(moves, x, x_old, MODEL.tetrahedra, rotations, MODEL.unknown, Dynamics(inertia, beta, DT_S))


@pytest.mark.parametrize("beta", [0.0, 0.003])
def test_tangent_equals_central_differences(beta: float) -> None:
    moves = np.random.default_rng(5).normal(size=(3, MODEL.unknowns))
    (x, x_old), step = deformed(), 1e-7
    rotations = np.tile(np.eye(3).ravel(), (len(MODEL.mesh.tets), 1))
    free, misses = MODEL.unknown >= 0, []
    for move, product in zip(moves, products(moves, beta, INERTIA), strict=True):
        full = np.zeros_like(x)
        full[free] = move.reshape(-1, 3)[MODEL.unknown[free]]
        ahead, behind = (forces(x + side * step * full, x_old, rotations, beta) for side in (1.0, -1.0))
        inertia = np.repeat(INERTIA[free][np.argsort(MODEL.unknown[free])], 3)
        expected = (ahead - behind) / (2.0 * step) + inertia * move
        misses.append((product - expected) / np.abs(expected).max())
    text = f"exact tangent with dR against differences, min det F 0.5, beta = {beta:g} s"
    source = "central differences of elastic, damping and inertial forces"
    verify("tissue", text, expected=0, measured=misses, tolerance=1e-6, source=source)


def test_elastic_tangent_is_symmetric() -> None:
    matrix = products(np.eye(MODEL.unknowns), 0.0, np.zeros_like(INERTIA))
    share, text = (matrix - matrix.T) / np.abs(matrix).max(), "exact tangent with dR: asymmetry"
    verify("tissue", text, expected=0, measured=share, tolerance=1e-12, source="second derivative of an energy")


@pytest.mark.parametrize("shortening", [0.0, 0.1])
def test_a_compressed_column_has_an_indefinite_tangent(shortening: float) -> None:
    """Why it is never factored: a column between two held faces buckles, one at rest does not."""
    column = tissue_model(Tissue(size_mm=(10.0, 90.0, 10.0), element_size_mm=10.0))
    x = column.mesh.nodes_m * [1.0, 1.0 - shortening, 1.0]
    rotations, still = np.tile(np.eye(3).ravel(), (len(column.mesh.tets), 1)), Dynamics(np.zeros(len(x)), 0.0, DT_S)
    matrix = tangent_times(np.eye(column.unknowns), x, x, column.tetrahedra, rotations, column.unknown, still)
    lowest = np.linalg.eigvalsh(matrix)[0]
    assert bool(lowest > 0.0) is (shortening == 0.0)
