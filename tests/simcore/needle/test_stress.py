"""The needle's strain against beams with a closed form."""

from __future__ import annotations

import math

import numpy as np
import pytest

from simcore.needle.model import NeedleModel, Tube, solve_static, straight
from simcore.needle.stress import largest_strain

TUBE = Tube(0.18, 20, 1.27e-3, 0.838e-3, 200e9, 0.29)
MODEL = NeedleModel.from_tube(TUBE)


def strained(force: list[float]) -> float:
    """Largest strain under a dead load (6,) N, N m at the tip."""
    x, R = straight(MODEL, np.zeros(3), np.eye(3))
    external = np.zeros((MODEL.elements + 1, 6))
    external[-1] = force
    found = solve_static(MODEL, x, R, external, tolerance=1e-9)
    assert found.status == "completed"
    return largest_strain(found.x, found.R, MODEL.section, MODEL.outer_radius_m)


def test_a_straight_needle_is_free_of_stress() -> None:
    x, R = straight(MODEL, np.ones(3), np.eye(3))
    assert largest_strain(x, R, MODEL.section, MODEL.outer_radius_m) == pytest.approx(0.0, abs=1e-12)


def test_a_moment_at_the_tip_bends_into_an_arc() -> None:
    """r kappa with kappa = M / EI everywhere: a quarter of a circle."""
    curvature = 0.5 * math.pi / TUBE.length_m
    strain = strained([0.0, 0.0, 0.0, MODEL.bending_nm2 * curvature, 0.0, 0.0])
    assert strain == pytest.approx(MODEL.outer_radius_m * curvature, rel=2e-3)


def test_a_force_across_the_tip_bends_most_at_the_base() -> None:
    """F L r / EI where it bends little; both directions across."""
    force = 1e-3
    expected = force * TUBE.length_m * MODEL.outer_radius_m / MODEL.bending_nm2
    for load in ([force, 0.0, 0.0], [0.0, -force, 0.0]):
        assert strained([*load, 0.0, 0.0, 0.0]) == pytest.approx(expected, rel=1e-3)


@pytest.mark.parametrize("pull_n", [5.0, -1.0])
def test_a_force_along_it_stretches_or_compresses(pull_n: float) -> None:
    """|N| / EA."""
    assert strained([0.0, 0.0, pull_n, 0.0, 0.0, 0.0]) == pytest.approx(abs(pull_n) / MODEL.axial_n, rel=1e-4)


def test_a_needle_that_is_curved_at_rest_has_no_stress_there() -> None:
    turn = 0.02
    half = np.array([[1.0, 0.0, 0.0], [0.0, math.cos(turn), -math.sin(turn)], [0.0, math.sin(turn), math.cos(turn)]])
    rest = np.tile(np.stack([np.eye(3), half.T]), (2, 1, 1, 1))
    curved = NeedleModel.from_section(
        length_m=0.02, elements=2, axial_n=1e5, bending_nm2=0.02, torsion_nm2=0.02, shear_n=np.inf,
        outer_radius_m=6e-4, rest_frames=rest,
    )  # fmt: skip
    x, _ = straight(curved, np.zeros(3), np.eye(3))
    R = np.stack([np.eye(3), half, half @ half])
    x[2] = x[1] + 0.01 * half[:, 2]
    assert largest_strain(x, R, curved.section, curved.outer_radius_m) == pytest.approx(0.0, abs=1e-12)
    straightened = largest_strain(*straight(curved, np.zeros(3), np.eye(3)), curved.section, curved.outer_radius_m)
    assert straightened > 1e-4
