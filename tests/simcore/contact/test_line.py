"""The compliance of a needle's line: the cylinder's share against integrals, the mesh's share against the total, which
must depend neither on the ball nor on the mesh."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

import meshio
import numpy as np
import pytest
from scipy.integrate import quad
from scipy.stats import qmc

import simcore.contact.line_calibration as calibration
from simcore.contact.ball import Ball
from simcore.contact.channel import ChannelModel
from simcore.contact.line import SHORTEST_M, LineCoupling, coupled_length, cylinder_compliance, line_compliance
from simcore.contact.line_calibration import deficit_along, line_of_balls, line_weights, mesh_deficit
from simcore.contact.line_radius import LINE_RADIUS_OF_BALL
from simcore.mesh.mesh import box_mesh
from simcore.scenario.build import tissue_model
from simcore.scenario.scenario import Scenario
from simcore.tissue.quadratic import QuadraticTissue
from tests.simcore.block import block, block_scenario
from tests.simcore.reference import small_strain_solution
from tests.verification import verify

if TYPE_CHECKING:
    from pathlib import Path

    from simcore.tissue.model import TissueModel

Vector = np.ndarray
SIZE_MM, ENTRY_M = (24.0, 40.0, 60.0), np.array([0.012, 0.02, 0.0])
START_M, LENGTH_M, NEEDLE_M = 0.012, 0.036, 0.635e-3  # of the line of balls; radius of 18G
SHEAR_PA, NU = 2250.0, 0.4  # the defaults of the scenario: 6300 / 2.8
check = partial(verify, "coupled")


# the cylinder's share


def pairs_in_kernel(count: int) -> Vector:
    """(count, 2) distances across a line, of two points of the ball's kernel seen along it, in ball radii: from
    quasi-random numbers, radius by the share F = 1 - (1 - r^2)^(7/2) of the kernel (1 - r^2)^(5/2) within r."""
    u = qmc.Sobol(4, rng=np.random.default_rng(0)).random(count)
    r, turn = np.sqrt(1.0 - (1.0 - u[:, :2]) ** (2.0 / 7.0)), 2.0 * np.pi * u[:, 2:]
    points = r[:, :, None] * np.stack([np.cos(turn), np.sin(turn)], axis=-1)
    return np.asarray(points[:, 0] - points[:, 1])


def test_line_radius_of_a_ball_is_the_mean_of_its_kernel() -> None:
    """ln b = ln rho + int_0^1 ln r dF^2 (the mean of ln max of two radii), F(r) = 1 - (1 - r^2)^(7/2), by quadrature;
    and E ln |X - Y| itself over pairs of points; and F of the balls that the code integrates with."""

    def share(r: float) -> float:
        return float(1.0 - (1.0 - r * r) ** 3.5)

    def density(r: float) -> float:
        return float(7.0 * r * (1.0 - r * r) ** 2.5)

    mean = quad(lambda r: np.log(r) * 2.0 * share(r) * density(r), 0.0, 1.0)[0]
    text, source = "radius of a line of balls / radius of the ball", "ln b = E ln |X - Y| over the projected kernel"
    check(text, expected=np.exp(mean), measured=LINE_RADIUS_OF_BALL, tolerance=5e-5, source=source)
    pairs = np.exp(np.log(np.linalg.norm(pairs_in_kernel(2**16), axis=1)).mean())
    check(f"{text}, pairs of points", expected=pairs, measured=LINE_RADIUS_OF_BALL, tolerance=5e-4, source=source)
    rule = Ball.of_radius(1e-3, box_mesh(np.full(3, 0.01), (2, 2, 2))).rule
    far, weights = 1e3 * np.hypot(*rule.offsets_m[:, :2].T), rule.strength / rule.strength.sum()
    for radius in (0.3, 0.5, 0.7):
        within = weights[far < radius].sum()  # a grid of four cells a radius
        assert within == pytest.approx(share(radius), abs=0.06)


def kelvin_line(apart: Vector, poisson: float, along: bool, half_m: float = 1e3) -> Vector:
    """(k,) m of displacement per N/m and 1 / Pa of 1 / G: Kelvin's point solution, integrated along 2 half_m, at points
    apart (k, 2) across the line, in the direction of the load: first axis across it, or along it."""
    r, reach = np.linalg.norm(apart, axis=1), half_m
    far = np.sqrt(r**2 + reach**2)
    plain = 2.0 * np.arcsinh(reach / r)  # int dz / R
    pointed = plain - 2.0 * reach / far if along else 2.0 * (apart[:, 0] / r) ** 2 * reach / far  # int n_i^2 dz / R
    return np.asarray(((3.0 - 4.0 * poisson) * plain + pointed) / (16.0 * np.pi * (1.0 - poisson)))


@pytest.mark.parametrize("poisson", [0.0, 0.3, 0.4, 0.49])
@pytest.mark.parametrize("radius_m", [2e-3, 4e-3, 6e-3])
def test_cylinder_compliance_is_the_difference_of_kelvins_integrals(poisson: float, radius_m: float) -> None:
    """The load on a ring of the needle's radius and the mean displacement there, less the same over the balls: A ln(b /
    a) across the line, ln(b / a) / (2 pi G) along it."""
    turn = 2.0 * np.pi * (np.arange(4096) + 0.5) / 4096  # of the distance of two points of a ring, with its direction
    size = 2.0 * NEEDLE_M * np.abs(np.sin(0.5 * turn))
    balls = radius_m * pairs_in_kernel(2**16)
    found = cylinder_compliance(shear_pa=SHEAR_PA, poisson=poisson, needle_radius_m=NEEDLE_M, ball_radius_m=radius_m)
    text, source = f"line around the needle, ball of {1e3 * radius_m:g} mm, nu = {poisson:g}", "Kelvin, integrated"
    for along, name in ((False, "across"), (True, "along")):
        ring = np.mean([kelvin_line(np.stack(p, 1), poisson, along) for p in ((size, 0 * size), (0 * size, size))])
        expected = (ring - kelvin_line(balls, poisson, along).mean()) / SHEAR_PA
        numbers: dict[str, Any] = {"expected": expected, "measured": found[along], "tolerance": 2e-3, "unit": "m2/N"}
        check(f"{text}: compliance {name}", **numbers, relative=True, source=source)


def test_compliance_of_a_point_is_that_of_the_line_over_its_length() -> None:
    """G / l, turned into the shaft's frame: across and along do not mix."""
    rng = np.random.default_rng(0)
    root, frame = rng.normal(size=(3, 3)), np.linalg.qr(rng.normal(size=(3, 3)))[0]
    line = LineCoupling(False, 1e-4 * root @ root.T, True, 1.27e-3, 1e-3)
    out = np.empty((3, 3))
    line_compliance(line, frame, 2e-3, out)
    full = frame @ line.compliance_m2_per_n @ frame.T / 2e-3
    np.testing.assert_allclose(out[:2, :2], full[:2, :2], rtol=1e-12)
    assert out[2, 2] == pytest.approx(full[2, 2], rel=1e-12)
    assert np.abs(out[[0, 1, 2, 2], [2, 2, 0, 1]]).max() == 0.0


def test_the_surface_holds_the_bevel_before_the_channel_does() -> None:
    """The entry is coupled over its tributary length and what of the bevel is still outside, so that its length is the
    bevel's when the tip touches and the tributary one once the bevel is in. Others stand for more than nothing."""
    line = LineCoupling(False, np.eye(3), True, 1.27e-3, 1e-3)
    lengths = [
        coupled_length(line, 1, tributary, inserted) for tributary, inserted in ((0, 0), (2e-4, 1e-3), (1e-3, 2e-3))
    ]
    np.testing.assert_allclose(lengths, [1.27e-3, 4.7e-4, 1e-3], rtol=1e-12)
    assert [coupled_length(line, element, 0.0, 0.0) for element in (2, 7)] == [SHORTEST_M, SHORTEST_M]
    assert coupled_length(line, 3, 2e-3, 0.0) == 2e-3


# the mesh's share


@dataclass(frozen=True)
class Line:
    """A straight line of balls in a tissue, each standing for half a ball's radius."""

    tissue: TissueModel
    channel: ChannelModel
    centres_m: Vector

    @classmethod
    def in_tissue(cls, tissue: TissueModel, radius_m: float, entry_m: Vector = ENTRY_M) -> Line:
        channel = ChannelModel.of(
            spacing_m=3e-3,
            bevel_m=2.0 * NEEDLE_M,
            spread_m=radius_m,
            longest_m=0.1,
            mesh=tissue.mesh,
            entry_m=entry_m,
            hard=False,
        )
        step = 0.5 * radius_m
        depths = START_M + step * (np.arange(round(LENGTH_M / step)) + 0.5)
        return cls(tissue, channel, entry_m + depths[:, None] * channel.inward)

    @property
    def poisson(self) -> float:
        return self.tissue.lambda_pa / (2.0 * (self.tissue.lambda_pa + self.tissue.mu_pa))

    def mesh_m2_per_n(self) -> Vector:
        """(3,) u: what the linear mesh gives way along x, y, z under a uniform line load, by small-strain elasticity
        that the tests assemble."""
        young = 2.0 * self.tissue.mu_pa * (1.0 + self.poisson)
        weights = line_weights(QuadraticTissue.of(self.tissue), self.channel, self.centres_m)
        weights = QuadraticTissue.of(self.tissue).restricted(np.tile(weights[:, None], 3))[:, 0]
        loads = (LENGTH_M * weights[:, None] * unit for unit in np.eye(3))
        moves = [small_strain_solution(self.tissue, young, self.poisson, load) for load in loads]
        return np.array([weights @ move[:, i] for i, move in enumerate(moves)])

    def cylinder_m2_per_n(self) -> float:
        return cylinder_compliance(
            shear_pa=self.tissue.mu_pa,
            poisson=self.poisson,
            needle_radius_m=NEEDLE_M,
            ball_radius_m=self.channel.ball.radius_m,
        )[0]

    def total_mm(self) -> Vector:
        """(2,) mm per N/mm across the line: mesh + what it owes + cylinder."""
        owed = np.diag(deficit_along(self.tissue, self.channel, self.centres_m))
        return np.asarray(1e6 * (self.mesh_m2_per_n()[:2] + owed[:2] + self.cylinder_m2_per_n()))


CASES: dict[str, dict[str, Any]] = {
    "default": {},
    "nu 0.3": {"poisson": 0.3},
    "nu 0.45": {"poisson": 0.45},
    "held at x": {"fixed_faces": ("x_min", "x_max")},
    "held behind": {"fixed_faces": ("z_max",)},
}


@pytest.mark.slow
@pytest.mark.parametrize("name", CASES)
def test_the_total_depends_neither_on_the_ball_nor_on_the_mesh(name: str) -> None:
    """u_mesh + G for balls of 4 and 6 mm on meshes of 8 and 6 mm: within 3 % of each other, where the linear meshes
    alone are short of the quadratic ones by more than 8 %. 3 % is what is left of the mesh
    in the quadratic reference and of the walls, 12 mm off, in the cylinder of an infinite tissue; nearer to
    incompressible (nu = 0.45) the reference leaves more, 4 %, and walls held across the thin side 5 %."""
    lines = [Line.in_tissue(block(h, SIZE_MM, **CASES[name]), r) for h in (8.0, 6.0) for r in (4e-3, 6e-3)]
    totals = np.array([line.total_mm() for line in lines])
    meshes = np.array([line.mesh_m2_per_n()[:2] for line in lines])
    text, source = f"compliance of the needle's line, {name}", "a property of the tissue: no ball, no mesh"
    shares = totals / totals[-1]
    tolerance = {"nu 0.45": 0.04, "held at x": 0.05}.get(name, 0.03)
    check(f"{text}: ball 4, 6, h 8, 6 mm", expected=1, measured=shares, tolerance=tolerance, source=source)
    cylinders = np.array([line.cylinder_m2_per_n() for line in lines])[:, None]
    short = 1.0 - meshes / (1e-6 * totals - cylinders)
    assert short.min() > 0.08


@pytest.mark.slow
def test_what_the_mesh_owes_is_symmetric_and_scales_with_softness() -> None:
    """(3, 3), not negative: quadratic elements contain the linear ones; with 1 / E at the same nu."""
    stiff, soft = (Line.in_tissue(block(10.0, SIZE_MM, young_kpa=young), 6e-3) for young in (6.3, 3.15))
    owed, twice = (deficit_along(line.tissue, line.channel, line.centres_m) for line in (stiff, soft))
    np.testing.assert_allclose(owed, owed.T, atol=1e-7 * owed.max())
    assert np.linalg.eigvalsh(owed).min() > 0.0
    np.testing.assert_allclose(twice, 2.0 * owed, rtol=1e-6, atol=1e-7 * owed.max())


def test_the_line_goes_from_the_entry_through_the_tissue() -> None:
    """Whole balls, half a radius apart; their weights add up to one and have the line's centroid."""
    tissue = block(10.0, SIZE_MM)
    line = Line.in_tissue(tissue, 6e-3)
    centres = line_of_balls(line.channel, tissue, ENTRY_M)
    np.testing.assert_allclose(centres[:, :2], np.tile(ENTRY_M[:2], (len(centres), 1)), atol=1e-12)
    np.testing.assert_allclose(np.diff(centres[:, 2]), 3e-3, atol=1e-12)
    assert centres[0, 2] == pytest.approx(6e-3)
    assert 0.054 - 3e-3 < centres[-1, 2] <= 0.054 + 1e-9
    quadratic = QuadraticTissue.of(tissue)
    weights = line_weights(quadratic, line.channel, centres)
    assert weights.sum() == pytest.approx(1.0, abs=1e-12)
    nodes = quadratic.prolonged(tissue.mesh.nodes_m)
    np.testing.assert_allclose(weights @ nodes, centres.mean(axis=0), atol=1e-9)


@pytest.mark.slow
def test_a_result_from_the_cache_is_the_computed_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """In memory, in the user's folder and computed: the same bits; another E takes the same file, another nu, ball or
    entry another one; a folder that cannot be written costs time alone."""
    monkeypatch.setattr(calibration, "user_cache", lambda: tmp_path / "made when it is needed")
    monkeypatch.setattr(calibration, "_found", {})
    line = Line.in_tissue(block(10.0, SIZE_MM), 6e-3)
    computed = mesh_deficit(line.tissue, line.channel, ENTRY_M)
    folder = tmp_path / "made when it is needed"
    assert len(list(folder.iterdir())) == 1
    np.testing.assert_array_equal(mesh_deficit(line.tissue, line.channel, ENTRY_M), computed)
    monkeypatch.setattr(calibration, "_found", {})
    solve = calibration.deficit_along
    monkeypatch.setattr(calibration, "deficit_along", None)  # it may not be computed again
    np.testing.assert_array_equal(mesh_deficit(line.tissue, line.channel, ENTRY_M), computed)
    soft = Line.in_tissue(block(10.0, SIZE_MM, young_kpa=3.15), 6e-3)
    np.testing.assert_allclose(mesh_deficit(soft.tissue, soft.channel, ENTRY_M), 2.0 * computed, rtol=1e-12)
    monkeypatch.setattr(calibration, "deficit_along", solve)
    other = Line.in_tissue(block(10.0, SIZE_MM, poisson=0.3), 4e-3)
    for tissue, channel in ((other.tissue, line.channel), (line.tissue, other.channel)):
        assert not np.allclose(mesh_deficit(tissue, channel, ENTRY_M), computed, rtol=1e-3, atol=0.0)
    assert len(list(folder.iterdir())) == 3
    monkeypatch.setattr(calibration, "_found", {})
    monkeypatch.setattr(calibration, "user_cache", lambda: next(folder.iterdir()))  # a file where a folder should be
    np.testing.assert_array_equal(mesh_deficit(line.tissue, line.channel, ENTRY_M), computed)


@pytest.mark.slow
def test_a_mesh_file_of_the_block_is_calibrated_like_the_block(tmp_path: Path) -> None:
    """The same tetrahedra read from a file: the same deficit up to what the file's search for points rounds."""
    mesh = box_mesh(1e-3 * np.array(SIZE_MM), (2, 4, 6))
    meshio.Mesh(1e3 * mesh.nodes_m, [("tetra", mesh.tets)]).write(tmp_path / "block.vtk")
    plain = block_scenario().tissue
    data = block_scenario(tissue={"mesh_file": str(tmp_path / "block.vtk"), "fixed_faces": ["y_min", "y_max"]})
    assert isinstance(data, Scenario)
    lines = [Line.in_tissue(tissue_model(tissue), 6e-3) for tissue in (plain, data.tissue)]
    owed = [deficit_along(line.tissue, line.channel, line.centres_m) for line in lines]
    np.testing.assert_allclose(owed[1], owed[0], rtol=1e-6, atol=1e-6 * owed[0].max())
    totals = np.array([line.total_mm() for line in lines])
    np.testing.assert_allclose(totals[1], totals[0], rtol=1e-5)


@pytest.mark.slow
def test_the_total_in_the_papers_block_does_not_depend_on_ball_and_mesh() -> None:
    """h = 8, 6, 5 mm, balls of 4 and 6 mm, over 36 mm from 12 mm below the surface."""
    entry = np.array([0.018, 0.031, 0.0])
    tissues = [block(h, (36.0, 62.0, 122.0)) for h in (8.0, 6.0, 5.0)]
    totals = np.array([Line.in_tissue(t, r, entry).total_mm() for t in tissues for r in (4e-3, 6e-3)])
    text, source = "compliance of the needle's line, the paper's block", "a property of the tissue: no ball, no mesh"
    shares = totals / totals[-1]
    check(f"{text}: ball 4, 6, h 8, 6, 5 mm", expected=1, measured=shares, tolerance=0.03, source=source)
