"""A small coupled problem that every physics test can afford: 24 x 40 x 60 mm of tissue, a needle of eight beams."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from simcore.errors import Status
from simcore.insertion import Insertion, InsertionState, Pose
from simcore.rotations import exp_map
from simcore.scenario import Scenario

Vector = NDArray[np.float64]

AHEAD = np.array([0.0, 0.0, 1.0])
TIGHT = {"force_tolerance_n": 3e-9, "violation_tolerance_mm": 1e-9}
BLOCK_MM = (24.0, 40.0, 60.0)


def block_scenario(**blocks: dict[str, Any]) -> Scenario:
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


def straight_poses(first: Pose, depths_m: Vector) -> list[Pose]:
    """`first` moved along its own axis to each depth."""
    return [moved(first, depth * first.rotation[:, 2]) for depth in depths_m]
