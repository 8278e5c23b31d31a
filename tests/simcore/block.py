"""A small coupled problem that every physics test can afford: 24 x 40 x 60 mm of tissue, a needle of eight beams."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from simcore.errors import Status
from simcore.insertion.compliance import Compliance
from simcore.insertion.state import Pose
from simcore.rotations import exp_map
from simcore.scenario.build import insertion_of, tissue_model
from simcore.scenario.scenario import Scenario, Tissue
from simcore.tissue.model import TissueModel, elastic_forces, rotated_stiffness_times

if TYPE_CHECKING:
    from collections.abc import Iterable

    from simcore.insertion.insertion import Insertion, InsertionState

Vector = NDArray[np.float64]

AHEAD = np.array([0.0, 0.0, 1.0])
TIGHT = {"force_tolerance_n": 1e-9, "violation_tolerance_mm": 1e-9}
BLOCK_MM = (24.0, 40.0, 60.0)
HARD = {"line_compliance": False, "tip": "held", "spread_mm": 4.0, "puncture_n": 0.1}  # Duriez et al. 2009, and a skin
FORWARD_M = np.arange(1, 61) * 5e-4
CURVED_M = np.concatenate([FORWARD_M, 0.03 - FORWARD_M[:30], 0.015 + FORWARD_M[:40]])  # push, pull, push beyond


def block_scenario(**blocks: Any) -> Scenario:
    """The small block at 10 mm (2 x 4 x 6 cells) with a tight solver; keywords update the scenario's blocks."""
    data: dict[str, Any] = {
        "tissue": {"size_mm": BLOCK_MM, "element_size_mm": 10.0},
        "needle": {"length_mm": 90.0, "elements": 8},
        "interaction": {"spacing_mm": 10.0},
        "trajectory": {"entry_mm": [12.0, 20.0, 0.0], "target_mm": [12.0, 20.0, 60.0]},
        "solver": dict(TIGHT),
    }
    for name, values in blocks.items():
        data[name] = {**data.get(name, {}), **values} if isinstance(values, dict) else values
    return Scenario.load(data)


def moved(base: Pose, shift_m: Vector, turn_rad: Vector | None = None) -> Pose:
    """`base` shifted by (3,) m and turned about itself by a rotation vector (3,) rad, world."""
    turn = np.zeros(3) if turn_rad is None else np.asarray(turn_rad, float)
    return Pose(base.position_m + shift_m, exp_map(turn) @ base.rotation)


def curved_pose(first: Pose, advance_m: float, sideways_m: float = 2e-3) -> Pose:
    """A base on an S-shaped way: the needle tilts and shifts sideways as it advances, and is bent by the tissue."""
    phase = advance_m / 0.04
    shift = np.array([sideways_m * np.sin(np.pi * phase), 0.7 * sideways_m * phase**2, advance_m])
    return moved(first, shift, np.array([0.02 * phase, 0.05 * np.sin(np.pi * phase), 0.03 * phase]))


def advanced(insertion: Insertion, state: InsertionState, base: Pose) -> InsertionState:
    """One step that must converge."""
    after = insertion.step(state, base)
    assert after.report.status is Status.COMPLETED, after.report.message
    return after


def travel(insertion: Insertion, state: InsertionState, poses: list[Pose]) -> list[InsertionState]:
    """The converged states after each pose, the first one included."""
    states = [state]
    for base in poses:
        states.append(advanced(insertion, states[-1], base))
    return states


def straight_poses(first: Pose, depths_m: Iterable[float]) -> list[Pose]:
    """`first` moved along its own axis to each depth."""
    return [moved(first, depth * first.rotation[:, 2]) for depth in depths_m]


@dataclass(frozen=True)
class Trip:
    """An insertion and its converged states; state i + 1 follows state i at poses[i]."""

    insertion: Insertion
    states: list[InsertionState]
    poses: list[Pose]


def curved_trip(depths_m: Iterable[float] = CURVED_M, **blocks: Any) -> Trip:
    insertion = insertion_of(block_scenario(**blocks))
    start = insertion.initial_state(AHEAD)
    poses = [curved_pose(start.base, depth) for depth in depths_m]
    return Trip(insertion, travel(insertion, start, poses), poses)


def straight_trip(depths_m: Iterable[float], **blocks: Any) -> Trip:
    insertion = insertion_of(block_scenario(**blocks))
    start = insertion.initial_state(AHEAD)
    poses = straight_poses(start.base, depths_m)
    return Trip(insertion, travel(insertion, start, poses), poses)


def bare_gaps(state: InsertionState) -> Vector:
    """(a, 3) m, world: ball minus the shaft point beside it, on which the force acts: the gap without C lambda."""
    at = state.solved.at
    local = np.einsum("aij,aj->ai", at.points.frames, at.force_n)
    gap = at.points.gap - np.einsum("aij,aj->ai", at.points.compliance, local)
    gap[:, 2] = 0.0
    return np.asarray(np.einsum("aij,ai->aj", at.points.frames, gap))


def line_energy(state: InsertionState) -> float:
    """J stored around the needle: 1/2 F C F of all points."""
    at = state.solved.at
    local = np.einsum("aij,aj->ai", at.points.frames, at.force_n)
    return float(0.5 * np.einsum("ai,aij,aj->", local, at.points.compliance, local))


def works(states: list[InsertionState]) -> Vector:
    """(s,) J of the robot up to each state: trapezoidal rule over the base's wrench."""
    done = [0.0]
    for a, b in pairwise(states):
        shift = b.base.position_m - a.base.position_m
        spin = 0.5 * np.cross(a.base.rotation.T, b.base.rotation.T).sum(axis=0)
        mean = 0.5 * (a.base_wrench + b.base_wrench)
        done.append(done[-1] + float(mean[:3] @ shift + mean[3:] @ spin))
    return np.array(done)


# the tissue on its own


def block(
    edge_mm: float = 10.0, size_mm: tuple[float, float, float] = (20.0, 30.0, 40.0), **fields: object
) -> TissueModel:
    return tissue_model(Tissue(size_mm=size_mm, element_size_mm=edge_mm, **fields))


def cold(model: TissueModel) -> Vector:
    return np.tile(np.eye(3).ravel(), (len(model.mesh.tets), 1))


def held(model: TissueModel, x: Vector, rotations: Vector | None = None) -> tuple[Vector, float, float]:
    """Holding forces (n, 3) N, min det F, energy J; the rotations start from the identity unless given."""
    forces = np.empty_like(x)
    rotations = cold(model) if rotations is None else rotations
    material = (model.gradients, model.volumes_m3, model.mu_pa, model.lambda_pa)
    least, energy = elastic_forces(np.ascontiguousarray(x), model.mesh.tets, *material, rotations, forces)
    return forces, least, energy


def stiffness_times(model: TissueModel, v: Vector, rotations: Vector) -> Vector:
    out = np.empty_like(v)
    material = (model.gradients, model.volumes_m3, model.mu_pa, model.lambda_pa)
    rotated_stiffness_times(np.ascontiguousarray(v), model.mesh.tets, *material, rotations, out)
    return out


def surface_areas(model: TissueModel, face: str) -> Vector:
    """(n,) m2: a third of each surface triangle in the face to each of its nodes."""
    mesh = model.mesh
    triangles = mesh.surface_triangles[np.isin(mesh.surface_triangles, mesh.faces[face]).all(axis=1)]
    a, b, c = np.swapaxes(mesh.nodes_m[triangles], 0, 1)
    areas = np.zeros(len(mesh.nodes_m))
    np.add.at(areas, triangles, (np.linalg.norm(np.cross(b - a, c - a), axis=1) / 6.0)[:, None])
    return areas


def relaxed(model: TissueModel, load: Vector, x: Vector) -> Vector:
    """Equilibrium under nodal loads (n, 3) N: the true residual, corrected with the factor at rest."""
    compliance, free = Compliance(model, 1.0, 1), model.unknown >= 0
    x, right = x.copy(), np.zeros((model.unknowns // 3, 3))
    for _ in range(200):
        rest = (load - held(model, x)[0])[free]
        right[model.unknown[free]] = rest
        if np.abs(rest).max() < 1e-14:
            return x
        x[free] += compliance.solve(right.ravel()).reshape(-1, 3)[model.unknown[free]]
    raise AssertionError(f"no equilibrium: residual {np.abs(rest).max()} N")
