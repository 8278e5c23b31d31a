"""Hard rows against SOFA, a simulator of others: the same base poses, points and axial forces, the same equilibria.

tests/data/sofa/README.md says how SOFA's were found. Here the solver's own iteration starts from a straight needle and
tissue at rest; only the axial staircases are replaced by the prescribed forces.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from simcore.contact.channel import Channel, Phase
from simcore.insertion.iteration import begin
from simcore.insertion.solver import problem_of
from simcore.insertion.state import Bodies, Goal, Guess, Iterate, Pose
from simcore.insertion.step_kernel import CONVERGED, Allowed, iterate
from simcore.needle.model import straight
from simcore.scenario.build import insertion_of
from simcore.scenario.scenario import Scenario
from tests.simcore.block import relaxed
from tests.verification import verify

if TYPE_CHECKING:
    from simcore.insertion.insertion import Insertion

Vector = np.ndarray
ARCHIVE = Path(__file__).parents[2] / "data" / "sofa" / "equilibria.npz"
BANDS_MM = {"siney-0-2": 5e-3, "siney-0-3": 1e-2, "demo-def-1": 1e-3, "demo-def-3": 2e-3}  # else 2.2e-4 and a little
BAND_MM = 2.3e-4
NO_BREAK_M = -1.0  # a breakpoint behind the base: every point slides
ITERATIONS = 100
check = partial(verify, "coupled", source="SOFA v26.06, FastTetrahedralCorotationalForceField and BeamAdapter")


@dataclass(frozen=True)
class Case:
    """One equilibrium: its base, points, prescribed axial forces (N), and what SOFA found, in m and N."""

    name: str
    base: Pose
    nodes: Vector
    weights: Vector
    rest_m: Vector
    axial_n: Vector
    start: dict[str, Vector]  # where the solution starts, as in the archive; empty = at rest
    needle_m: Vector
    force_n: Vector
    displacement_m: Vector


@cache
def archive() -> dict[str, Vector]:
    with np.load(ARCHIVE) as arrays:
        return dict(arrays)


def needle_rotations(poses: Vector) -> Vector:
    """(k, 3, 3) with the needle along the third column, of poses (k, 7) with it along the first."""
    turned: Vector = Rotation.from_quat(poses[:, 3:]).as_matrix()[:, :, [1, 2, 0]]
    return turned


def case_of(name: str) -> Case:
    found = {key.removeprefix(f"{name}/"): value for key, value in archive().items() if key.startswith(f"{name}/")}
    base, rest_m = found["base_pose_mm_xyzw"], found["point_rest_mm"] * 1e-3
    return Case(
        name=name,
        base=Pose(base[:3] * 1e-3, needle_rotations(base[None])[0]),
        nodes=found["point_nodes"],
        weights=found["point_weights"],
        rest_m=rest_m,
        axial_n=found.get("axial_force_n", np.zeros(len(rest_m))),
        start={key.removeprefix("start/"): value for key, value in found.items() if key.startswith("start/")},
        needle_m=found["sofa/needle_mm_xyzw"][:, :3] * 1e-3,
        force_n=found["sofa/force_n"],
        displacement_m=found["sofa/displacement_mm"].astype(float) * 1e-3,
    )


@pytest.fixture(scope="module")
def insertion() -> Insertion:
    """The default block and needle, hard rows, the tip held."""
    interaction = {"line_compliance": False, "tip": "held", "spread_mm": 4.0}
    solver = {"force_tolerance_n": 1e-8, "violation_tolerance_mm": 1e-7}
    return insertion_of(Scenario.load({"interaction": interaction, "solver": solver}), keeps_tissue=False)


def channel_of(insertion: Insertion, case: Case) -> Channel:
    """A channel whose elements are the case's points, with their first arc lengths: those along a straight needle."""
    channel = insertion.initial_state(case.base.rotation[:, 2]).channel.copy()
    n, k = case.nodes.shape
    channel.phase, channel.count = Phase.INSERTED, n
    channel.nodes[:], channel.weights[:] = 0, 0.0
    channel.nodes[:n, :k], channel.weights[:n, :k], channel.touched[:n] = case.nodes, case.weights, k
    channel.rest_m[:n] = case.rest_m
    channel.depth_m[:n] = np.linalg.norm(case.rest_m - case.rest_m[1], axis=1)
    channel.arc_m[:n] = (case.rest_m - case.base.position_m) @ case.base.rotation[:, 2]
    if case.start:
        channel.arc_m[:n] = case.start["arc_mm"] * 1e-3
    channel.created[:n] = channel.active[:n] = True
    return channel


def first_bodies(insertion: Insertion, case: Case) -> Bodies:
    """Where the solution starts."""
    rest = insertion.tissue.mesh.nodes_m
    x, needle_x, needle_R = rest.copy(), *straight(insertion.needle, case.base.position_m, case.base.rotation)
    if case.start:
        poses = case.start["needle_mm_xyzw"]
        x = rest + case.start["displacement_mm"] * 1e-3
        needle_x, needle_R = poses[:, :3] * 1e-3, needle_rotations(poses)
    return Bodies(x, np.zeros_like(rest), needle_x, np.ascontiguousarray(needle_R), np.zeros((len(needle_x), 6)))


def equilibrium(insertion: Insertion, case: Case) -> Iterate:
    """Solved by the iteration of a step, to the solver's tolerances."""
    model, workspace, n = insertion.model, insertion.workspace, len(case.rest_m)
    start = first_bodies(insertion, case)
    workspace.blocks.evaluate(start.x, workspace.held_n)
    workspace.compliance.refactor(workspace.blocks.rotations())
    guess = Guess(start.copy(), case.start.get("force_n", np.zeros((n, 3))), np.zeros(n, np.int64))
    active, at = begin(model, workspace, channel_of(insertion, case), guess, Goal(case.base))
    active.stair.sign[:], active.stair.breaks[:], active.stair.extra[:] = 0.0, NO_BREAK_M, case.axial_n[:, None]
    allowed = Allowed(model.tolerances.force_n, model.tolerances.violation_m, ITERATIONS)
    ended, _, missing = iterate(*problem_of(model, workspace, start, active, at), allowed)
    assert ended == CONVERGED, f"{case.name} did not converge in {ITERATIONS} iterations: {missing}"
    return at


def test_the_mesh_is_the_one_that_sofa_had(insertion: Insertion) -> None:
    mesh = insertion.tissue.mesh
    np.testing.assert_allclose(mesh.nodes_m, archive()["mesh_nodes_mm"] * 1e-3, atol=1e-15)
    np.testing.assert_array_equal(mesh.tets, archive()["mesh_tets"])
    np.testing.assert_array_equal(np.flatnonzero(insertion.tissue.unknown < 0), np.sort(archive()["held_nodes"]))


@pytest.mark.slow
@pytest.mark.parametrize("name", [str(name) for name in archive()["cases"]])
def test_the_coupled_equilibrium_is_that_of_sofa(insertion: Insertion, name: str) -> None:
    """Tip within the band, needle and tissue within three of it; forces within 1e-4 N for a band of 2.3e-4 mm."""
    case = case_of(name)
    at = equilibrium(insertion, case)
    band = BANDS_MM.get(name, BAND_MM)
    apart = 1e3 * np.linalg.norm(at.bodies.needle_x - case.needle_m, axis=1)
    text = f"{name}, {len(case.rest_m)} points"
    check(f"{text}: tip", expected=0.0, measured=apart[-1], tolerance=band, unit="mm")
    check(f"{text}: needle", expected=0.0, measured=apart.max(), tolerance=3 * band, unit="mm")
    moved = at.bodies.x - insertion.tissue.mesh.nodes_m
    tissue = 1e3 * np.linalg.norm(moved - case.displacement_m, axis=1).max()
    check(f"{text}: tissue", expected=0.0, measured=tissue, tolerance=3 * band, unit="mm")
    force = np.abs(at.force_n - case.force_n).max()
    check(f"{text}: forces", expected=0.0, measured=force, tolerance=1e-4 * band / BAND_MM, unit="N")


@pytest.mark.slow
@pytest.mark.parametrize("name", ["sine-0-1", "demo-0-3", "kick-0-0", "siney-0-2"])
def test_the_tissue_alone_deforms_as_in_sofa(insertion: Insertion, name: str) -> None:
    """Under the forces of the points as dead loads: the exact rotation of each tetrahedron in both codes."""
    case, load = case_of(name), np.zeros_like(insertion.tissue.mesh.nodes_m)
    forces = archive()[f"{name}/tissue_alone/force_n"]
    for nodes, weights, force in zip(case.nodes, case.weights, forces, strict=True):
        np.add.at(load, nodes, weights[:, None] * force)
    load[insertion.tissue.unknown < 0] = 0.0
    rest = insertion.tissue.mesh.nodes_m
    found = 1e3 * (relaxed(insertion.tissue, load, rest) - rest)
    expected = archive()[f"{name}/tissue_alone/displacement_mm"]
    assert np.abs(expected).max() > 1.0
    check(f"{name}, tissue alone", expected=expected, measured=found, tolerance=2e-7, unit="mm")
