"""A needle in a narrow tissue is a beam on an elastic foundation (Hetenyi 1946).

The walls of a prismatic block, 10 mm from the needle on four sides, are held: what the tissue feels at one depth, it
does not feel some 5 mm deeper, so that it is Winkler's foundation for a needle that bends over 25 mm and more. Friction
and cutting are off, the base enters as far as the surface and is then shifted sideways without turning.
The foundation's compliance is that of the mesh under the line of balls and, in series, that of the line around the
needle, G; hard rows have the mesh alone.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from scipy.sparse.linalg import factorized

from simcore.scenario.build import insertion_of
from simcore.scenario.scenario import Scenario, Tissue
from tests.simcore.block import AHEAD, advanced, moved, straight_poses, travel
from tests.simcore.reference import small_strain_matrix
from tests.verification import verify

if TYPE_CHECKING:
    from simcore.insertion.insertion import Insertion, InsertionState

Vector = np.ndarray
SIDE_MM, SPACING_MM, PUSH_M = 20.0, 5.0, 1e-4
THIN = {"outer_diameter_mm": 0.7, "inner_diameter_mm": 0.0}
COUPLINGS: dict[str, dict[str, Any]] = {
    "compliant line": {},  # the default: a free tip, balls of 6 mm
    "hard rows": {"line_compliance": False, "tip": "held", "spread_mm": 4.0},
}
foundation = partial(verify, "coupled", source="Hetenyi 1946, beam of finite length on Winkler's foundation")


@dataclass(frozen=True)
class Lying:
    """A straight needle inserted to its base, without forces; then the same with the base shifted along x."""

    insertion: Insertion
    rest: InsertionState
    pushed: InsertionState

    @property
    def deflection_m(self) -> Vector:
        """(m + 1,) of the needle's nodes along x."""
        shift: Vector = self.pushed.bodies.needle_x[:, 0] - self.rest.bodies.needle_x[:, 0]
        return shift


def lying(length_mm: float, needle: dict[str, float], coupling: dict[str, Any]) -> Lying:
    faces, middle = ["x_min", "x_max", "y_min", "y_max"], 0.5 * SIDE_MM
    nothing = {"friction": 0, "adhesion_n_per_mm": 0, "cutting_n": 0, "puncture_n": 0}
    size = [SIDE_MM, SIDE_MM, length_mm + 20.0]
    insertion = insertion_of(
        Scenario.load(
            {
                "tissue": {"size_mm": size, "element_size_mm": 5, "fixed_faces": faces},
                "needle": {"length_mm": length_mm, "elements": 32, **needle},
                "interaction": {"spacing_mm": SPACING_MM, **nothing, **coupling},
                "trajectory": {"entry_mm": [middle, middle, 0], "target_mm": [middle, middle, length_mm - 20.0]},
                "solver": {"force_tolerance_n": 1e-6, "violation_tolerance_mm": 1e-7},
            }
        )
    )
    start = insertion.initial_state(AHEAD)
    rest = travel(insertion, start, straight_poses(start.base, np.arange(1.0, length_mm + 0.5) * 1e-3))[-1]
    return Lying(insertion, rest, advanced(insertion, rest, moved(rest.base, np.array([PUSH_M, 0.0, 0.0]))))


def foundation_stiffness(case: Lying) -> float:
    """k in Pa: force per length and deflection of a uniform push of all shaft points, without a needle, by small-strain
    elasticity assembled in the tests, each point with the line's G over its length in series; the middle half of the
    points, away from entry and tip."""
    tissue, channel, line = case.insertion.tissue, case.rest.channel, case.insertion.model.line
    material = Tissue()
    matrix = small_strain_matrix(tissue.mesh.nodes_m, tissue.mesh.tets, material.young_kpa * 1e3, material.poisson)
    free = np.repeat(tissue.unknown >= 0, 3)
    solve = factorized(matrix[free][:, free].tocsc())
    elements = channel.active_elements()
    elements = elements[elements > 0] if line.free_tip else elements
    loads = np.zeros((len(elements), *tissue.mesh.nodes_m.shape))
    for load, e in zip(loads, elements, strict=True):
        used = channel.touched[e]
        np.add.at(load[:, 0], channel.nodes[e, :used], channel.weights[e, :used])
    loads = loads.reshape(len(elements), -1)[:, free]
    compliance = loads @ np.array([solve(load) for load in loads]).T
    compliance += np.eye(len(elements)) * line.compliance_m2_per_n[0, 0] / (SPACING_MM * 1e-3)
    forces = np.linalg.solve(compliance, np.ones(len(elements)))
    inner = np.abs(channel.depth_m[elements] / case.rest.inserted_m - 0.5) < 0.25
    return float(forces[inner].mean() / (SPACING_MM * 1e-3))


def hetenyi(k_pa: float, bending_nm2: float, length_m: float, x_m: Vector) -> Vector:
    """(4, n) deflection m and its first three derivatives of a beam, EI y'''' + k y = 0: shifted by PUSH_M, not turned
    there, free at x = L."""
    b = (k_pa / (4.0 * bending_nm2)) ** 0.25
    roots = b * np.array([-1 + 1j, -1 - 1j, 1 + 1j, 1 - 1j])

    def rows(x: float, orders: list[int]) -> Vector:
        return np.array([roots**n * np.exp(roots * x) for n in orders])

    ends = np.concatenate([rows(0.0, [0, 1]), rows(length_m, [2, 3])])
    shares = np.linalg.solve(ends, np.array([PUSH_M, 0.0, 0.0, 0.0], complex))
    return np.array([(rows(x, [0, 1, 2, 3]) @ shares).real for x in np.atleast_1d(x_m)]).T


@pytest.mark.slow
@pytest.mark.parametrize(("needle", "name"), [({}, "18G"), (THIN, "0.7 mm wire")])
@pytest.mark.parametrize("length_mm", [80.0, 160.0])
@pytest.mark.parametrize("coupling", COUPLINGS)
def test_needle_on_an_elastic_foundation(coupling: str, length_mm: float, needle: dict[str, float], name: str) -> None:
    """Deflection curve, tip, and the robot's force and moment, with k measured apart; spec has 1 / b."""
    case = lying(length_mm, needle, COUPLINGS[coupling])
    bending, k = case.insertion.needle.bending_nm2, foundation_stiffness(case)
    decay_mm = 1e3 * (4.0 * bending / k) ** 0.25
    x = np.linspace(0.0, length_mm * 1e-3, case.insertion.needle.elements + 1)
    y = hetenyi(k, bending, length_mm * 1e-3, x)
    text = f"{coupling}, {name}, {length_mm:g} mm long, 1/b = {decay_mm:.1f} mm, base shifted by 0.1 mm"
    shares = 100.0 * case.deflection_m / PUSH_M, 100.0 * y[0] / PUSH_M
    wrench, unit = case.pushed.base_wrench, "% of the shift"
    foundation(f"{text}: deflection curve", expected=shares[1], measured=shares[0], tolerance=5, unit=unit)
    foundation(f"{text}: tip", expected=shares[1][-1], measured=shares[0][-1], tolerance=5, unit=unit)
    force, moment = bending * y[3, 0], -bending * y[2, 0]
    foundation(f"{text}: force", expected=force, measured=wrench[0], tolerance=0.04, relative=True, unit="N")
    foundation(f"{text}: moment", expected=moment, measured=wrench[4], tolerance=0.03, relative=True, unit="N m")
