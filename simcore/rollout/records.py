"""What a run shows to whoever watches it: the scene once, a record after each step, the rollout at the end."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol, TypeVar

import numpy as np

if TYPE_CHECKING:
    from simcore.arrays import Floats, Ints
    from simcore.rollout.result import Rollout
    from simcore.scenario.scenario import Scenario

Shown = TypeVar("Shown", "Scene", "StepRecord")


@dataclass(frozen=True)
class Scene:
    """What stays the same during a run. Lengths in metres, world frame."""

    scenario: Scenario
    steps: int
    tissue_rest_m: Floats  # (nodes, 3)
    tissue_tets: Ints  # (tets, 4)
    surface_triangles: Ints  # (triangles, 3) into the nodes, outward
    held_nodes: Ints  # (held,) into the nodes
    path_m: Floats  # (p, 3) polyline of the nominal path
    entry_m: Floats  # (3,) world-fixed remote centre of motion
    needle_radius_m: float


@dataclass(frozen=True)
class StepTiming:
    """Wall time of the parts of one step, seconds; the initial record has zeros."""

    plant_s: float
    jacobian_s: float
    command_s: float


@dataclass(frozen=True)
class StepRecord:
    """The converged state after one step; step 0 is the initial state. SI units, world frame."""

    step: int
    t_s: float
    base_position_m: Floats  # (3,)
    base_rotation: Floats  # (4,) wxyz; identity = needle along +z
    tip_m: Floats  # (3,)
    tip_seen_m: Floats  # (3,) as the controller sees it from this state on
    target_m: Floats  # (3,) n_traj(t), clean
    target_noisy_m: Floats  # (3,) what the controller saw
    command_position_m: Floats  # (3,) T of this step, before delay and the robot's limits
    command_rotation: Floats  # (4,) wxyz
    limited: bool  # whether the robot's limits scaled what was executed
    depth_m: float  # inserted rest length
    base_force_n: Floats  # (3,) force of the robot on the needle
    base_torque_nm: Floats  # (3,) about the base
    insertion_force_n: float  # base force along the base's axis, > 0 pushes
    rcm_error_m: float  # lateral distance of the shaft from the entry
    iterations: int
    residual_n: float
    violation_m: float
    min_det_f: float
    min_det_f_at_m: Floats  # (3,) centre at rest of the tetrahedron that has it
    max_displacement_m: float
    max_strain: float  # largest |principal stretch - 1| of the tissue
    entry_drag_m: float  # lateral displacement of the tissue at the entry, without that of the held nodes
    needle_stress_pa: float  # largest bending plus axial stress
    shaft_m: Floats  # (k, 3) polyline of the needle's axis, base to tip
    points_m: Floats  # (m, 3) active constraint points
    point_forces_n: Floats  # (m, 3) force of the needle on the tissue at each
    tissue_m: Floats | None  # (nodes, 3) on recorded frames, else None
    timing: StepTiming
    strain_energy_j: float = math.nan  # of the tissue, on recorded frames
    max_von_mises_pa: float = math.nan  # of the tissue, on recorded frames


def sealed(shown: Shown) -> Shown:
    """The same scene or record with read-only arrays: whoever watches cannot change the run."""
    for value in vars(shown).values():
        if isinstance(value, np.ndarray):
            value.flags.writeable = False
    return shown


class Observer(Protocol):
    """Watches a run. It may raise to stop it (cancellation); it cannot change it, its arrays are read-only."""

    def begin(self, scene: Scene, first: StepRecord) -> None:
        """Called once, with the initial state."""

    def step(self, record: StepRecord) -> None:
        """Called after each step."""

    def end(self, rollout: Rollout) -> None:
        """Called once, with everything, also when the run ended in a named failure."""


class Silent:
    """The observer that looks away."""

    def begin(self, scene: Scene, first: StepRecord) -> None:
        """Does nothing."""

    def step(self, record: StepRecord) -> None:
        """Does nothing."""

    def end(self, rollout: Rollout) -> None:
        """Does nothing."""
