"""Needles and rods that the tests bend, and how they are bent."""

from __future__ import annotations

import math

import numpy as np
from scipy.spatial.transform import Rotation

from simcore.errors import Status
from simcore.needle.beam import BeamForces, internal
from simcore.needle.model import (
    NeedleModel,
    StaticSolution,
    solve_static,
    straight,
)
from simcore.rotations import exp_map
from simcore.scenario.build import needle_model
from simcore.scenario.scenario import Needle

EIGHTEEN_GAUGE = needle_model(Needle())
RIGID = 1e6  # EA and kGA of the inextensible rods: EI / (EA L^2) = 1e-6


def unit_rod(elements: int, *, axial_n: float = RIGID, shear_n: float = math.inf) -> NeedleModel:
    """EI = GJ = L = 1."""
    return NeedleModel.from_section(
        length_m=1.0,
        elements=elements,
        axial_n=axial_n,
        bending_nm2=1.0,
        torsion_nm2=1.0,
        shear_n=shear_n,
        outer_radius_m=0.01,
    )


def evaluate(model: NeedleModel, x: np.ndarray, R: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    out = BeamForces.of_size(model.elements)
    internal(x, R, model.section, out)
    return out


def dense(diag: np.ndarray, upper: np.ndarray, lower: np.ndarray) -> np.ndarray:
    n = len(diag)
    K = np.zeros((n, 6, n, 6))
    K[range(n), :, range(n)] = diag
    K[range(n - 1), :, range(1, n)] = upper
    K[range(1, n), :, range(n - 1)] = lower
    return K.reshape(6 * n, 6 * n)


def bent(model: NeedleModel, seed: int = 1) -> tuple[np.ndarray, np.ndarray]:
    """A state with bending, torsion, stretch and shear: neighbouring nodes turned by about 0.3 rad."""
    rng = np.random.default_rng(seed)
    x, R = straight(model, np.array([0.1, -0.2, 0.3]), Rotation.random(rng=rng).as_matrix())
    for i in range(1, len(x)):
        R[i] = exp_map(rng.normal(scale=0.17, size=3)) @ R[i - 1]
        x[i] = x[i - 1] + model.element_length_m * (R[i, :, 2] + rng.normal(scale=1e-3, size=3))
    return x, R


def loaded(model: NeedleModel, load: np.ndarray, steps: int, x: np.ndarray, R: np.ndarray) -> StaticSolution:
    """Equilibrium under a tip load (6,), raised in equal steps; tolerance 1e-11 of the largest stiffness."""
    external = np.zeros((model.elements + 1, 6))
    tolerance = 1e-11 * max(model.axial_n, model.bending_nm2 / model.element_length_m)
    for fraction in np.arange(1, steps + 1) / steps:
        external[-1] = fraction * np.asarray(load)
        solution = solve_static(model, x, R, external, tolerance=tolerance)
        assert solution.status is Status.COMPLETED, solution.status
        x, R = solution.x, solution.R
    return solution
