"""The compliance of a needle's line against the needle itself: a rigid cylinder bonded into a hole that is meshed.

In plane strain, by a closed form and by scikit-fem (Gustafsson and McBain 2020), a code of others: the needle's hole is
in the mesh, which the plant's meshes could never afford. Ours is taken in the middle third of a line that is loaded
all through the block: the ends, where the block is not in plane strain, are three quarters of its width away.
"""

from __future__ import annotations

from functools import cache, partial
from typing import TYPE_CHECKING

import numpy as np
import pytest
from skfem import Basis, ElementTriP2, ElementVector, MeshTri, condense, solve
from skfem.models.elasticity import lame_parameters, linear_elasticity

from simcore.contact.channel import ChannelModel
from simcore.contact.line import cylinder_compliance
from simcore.contact.line_calibration import deficit_along, line_weights
from simcore.tissue.quadratic import QuadraticTissue
from tests.simcore.block import block
from tests.simcore.reference import small_strain_solution
from tests.verification import verify

if TYPE_CHECKING:
    from collections.abc import Callable

Vector = np.ndarray
check = partial(verify, "coupled")

YOUNG_PA, NEEDLE_M = 6300.0, 0.635e-3  # the defaults of the scenario: tissue, radius of 18G
SIZE_MM, ENTRY_MM = (36.0, 62.0, 84.0), (18.0, 31.0)  # the paper's cross-section, entered in its middle


def bonded_disc_in_ring(a: float, b: float, poisson: float) -> float:
    """m2/N: deflection per line load of a rigid disc of radius a, bonded to a ring that is held at radius b.

    Plane strain, Kolosov and Muskhelishvili: 2 G u = kappa phi - z conj(phi') - conj(psi) with phi = A ln z + C z^2,
    psi = -kappa A conj(ln z) + B / z^2, displacement constant on both circles; kappa = 3 - 4 nu.
    """
    shear, kappa = YOUNG_PA / (2.0 * (1.0 + poisson)), 3.0 - 4.0 * poisson
    bracket = kappa * np.log(b / a) - (b * b - a * a) / (kappa * (a * a + b * b))
    return float(bracket / (8.0 * np.pi * shear * (1.0 - poisson)))


def plane_mesh(outer: Vector, around: int, layers: int) -> MeshTri:
    """Between the needle's hole and outer (around, 2) m, a closed curve about the origin; layers grow outwards."""
    angles = np.arctan2(outer[:, 1], outer[:, 0])
    inner = NEEDLE_M * np.column_stack([np.cos(angles), np.sin(angles)])
    share = np.geomspace(1.0, 1.0 + np.linalg.norm(outer, axis=1).mean() / NEEDLE_M, layers + 1) - 1.0
    share = (share / share[-1])[:, None, None]
    points = (inner + share * (outer - inner)).reshape(-1, 2)
    ring, layer = np.meshgrid(np.arange(around), np.arange(layers))
    corner = [(layer + i) * around + (ring + j) % around for i, j in ((0, 0), (1, 0), (1, 1), (0, 1))]
    a, b, c, d = (one.ravel() for one in corner)
    return MeshTri(points.T, np.hstack([np.array([a, b, c]), np.array([a, c, d])]))


def deflection_per_load(mesh: MeshTri, poisson: float, held: Callable[[Vector], Vector]) -> Vector:
    """(2,) m2/N along x and y: the hole's rim is moved as a whole, the reaction is the line load. held: whether each of
    some points (2, k) of the outer edge is."""
    basis = Basis(mesh, ElementVector(ElementTriP2()))
    stiffness = linear_elasticity(*lame_parameters(YOUNG_PA, poisson)).assemble(basis)
    edges = mesh.boundary_facets()
    middle = mesh.p[:, mesh.facets[:, edges]].mean(axis=1)
    on_rim = np.hypot(*middle) < 1.01 * NEEDLE_M
    rim, outside = basis.get_dofs(edges[on_rim]), basis.get_dofs(edges[~on_rim & held(middle)])
    fixed = np.union1d(rim.all(), outside.all())
    out = np.empty(2)
    for axis in range(2):
        moved = np.zeros(basis.N)
        moved[rim.all(f"u^{axis + 1}")] = 1.0
        u = solve(*condense(stiffness, np.zeros(basis.N), x=moved, D=fixed))
        out[axis] = 1.0 / (u @ (stiffness @ u))
    return out


def rectangle(width: float, height: float, around: int) -> Vector:
    """(around, 2) points of its edge, seen from its middle at even angles but with its corners among them."""
    corner = np.arctan2(height, width)
    turn = 2.0 * np.pi * np.arange(around) / around - np.pi
    for angle in (corner, np.pi - corner, -corner, corner - np.pi):
        turn[np.argmin(np.abs(turn - angle))] = angle
    direction = np.column_stack([np.cos(turn), np.sin(turn)])
    reach = np.min(0.5 * np.array([width, height]) / np.maximum(np.abs(direction), 1e-12), axis=1)
    return np.asarray(reach[:, None] * direction)


@pytest.mark.slow
@pytest.mark.parametrize("poisson", [0.0, 0.4])
def test_the_meshed_hole_gives_the_closed_form_of_a_ring(poisson: float) -> None:
    """The reference itself: scikit-fem on a ring held at 15 mm."""
    turn = 2.0 * np.pi * np.arange(128) / 128
    ring = 0.015 * np.column_stack([np.cos(turn), np.sin(turn)])
    found = deflection_per_load(plane_mesh(ring, 128, 40), poisson, lambda points: np.full(points.shape[1], True))
    expected = bonded_disc_in_ring(NEEDLE_M, 0.015, poisson)
    text, source = f"rigid disc in a ring, nu = {poisson:g}: deflection per load, scikit-fem", "Muskhelishvili"
    check(text, expected=expected, measured=found, tolerance=2e-3, unit="m2/N", relative=True, source=source)


@cache
def hole_in_block(poisson: float) -> tuple[float, float]:
    """m2/N of the paper's block in plane strain, held at y_min and y_max."""
    width, height = 1e-3 * np.array(SIZE_MM[:2])
    mesh = plane_mesh(rectangle(width, height, 112), 112, 32)
    x, y = deflection_per_load(mesh, poisson, lambda points: np.abs(points[1]) > 0.5 * height * 0.9999)
    return float(x), float(y)


def line_in_block(element_mm: float, radius_m: float, poisson: float) -> Vector:
    """(2,) m2/N: the plant's compliance along x and y, mesh + what the mesh owes + cylinder, in the middle third of a
    line of balls that is loaded from face to face."""
    tissue = block(element_mm, SIZE_MM, poisson=poisson)
    entry_m = 1e-3 * np.array([*ENTRY_MM, 0.0])
    sizes = {"spacing_m": 3e-3, "bevel_m": 2.0 * NEEDLE_M, "spread_m": radius_m, "longest_m": 0.084}
    channel = ChannelModel.of(**sizes, mesh=tissue.mesh, entry_m=entry_m, hard=False)
    length, step = 1e-3 * SIZE_MM[2], 0.5 * radius_m
    count = round(length / step)
    centres = entry_m + (length / count * (np.arange(count) + 0.5))[:, None] * channel.inward
    middle = centres[count // 3 : 2 * count // 3]
    quadratic = QuadraticTissue.of(tissue)
    load, here = (
        quadratic.restricted(np.tile(line_weights(quadratic, channel, balls)[:, None], 3))[:, 0]
        for balls in (centres, middle)
    )
    moves = (small_strain_solution(tissue, YOUNG_PA, poisson, length * load[:, None] * unit) for unit in np.eye(3)[:2])
    mesh_part = np.array([here @ move[:, axis] for axis, move in enumerate(moves)])
    shear = YOUNG_PA / (2.0 * (1.0 + poisson))
    around = {"shear_pa": shear, "poisson": poisson, "needle_radius_m": NEEDLE_M, "ball_radius_m": radius_m}
    owed = np.diag(deficit_along(tissue, channel, middle))[:2]
    return np.asarray(mesh_part + owed + cylinder_compliance(**around)[0])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("element_mm", "radius_m", "poisson"), [(8.0, 6e-3, 0.4), (6.0, 6e-3, 0.4), (6.0, 4e-3, 0.4), (8.0, 6e-3, 0.0)]
)
def test_the_line_is_as_compliant_as_a_needle_whose_hole_is_meshed(
    element_mm: float, radius_m: float, poisson: float
) -> None:
    """No number of the plant is fitted to this one."""
    found = line_in_block(element_mm, radius_m, poisson)
    text = f"needle's line, nu = {poisson:g}, h {element_mm:g}, ball {1e3 * radius_m:g} mm: compliance"
    check(
        f"{text} along x, y",
        expected=np.array(hole_in_block(poisson)),
        measured=found,
        unit="m2/N",
        tolerance=0.04,
        relative=True,
        source="scikit-fem, the hole meshed, plane strain",
    )
