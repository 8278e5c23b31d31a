"""What an environment shows and takes: spaces, and the arrays in them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from gymnasium import spaces

from simcore.insertion.state import Pose
from simcore.needle.shaft import shaft_polyline
from simcore.rotations import exp_map, log_map, quaternion_from_matrix

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from simcore.arrays import Floats
    from simcore.episode import Episode, Observation
    from simcore.robot import RobotLimits

    Singles = NDArray[np.float32]

FARTHEST_M, MOST_N, LONGEST_S = 2.0, 1000.0, 1e6
SHAFT_POINTS, CONTACTS = 61, 64  # of what is privileged; contacts beyond are left out, rows without one are 0
SIZES: dict[str, tuple[int | tuple[int, ...], float]] = {  # shape and bound, SI units, world frame
    "base": (7, FARTHEST_M),
    "tip": (3, FARTHEST_M),
    "tip_direction": (3, 1.0),
    "target": (3, FARTHEST_M),
    "entry_offset": (2, FARTHEST_M),
    "depth": (1, FARTHEST_M),
    "base_wrench": (6, MOST_N),
    "time": (1, LONGEST_S),
}
PRIVILEGED: dict[str, tuple[int | tuple[int, ...], float]] = {
    "shaft": ((SHAFT_POINTS, 3), FARTHEST_M),
    "contact_points": ((CONTACTS, 3), FARTHEST_M),
    "contact_forces": ((CONTACTS, 3), MOST_N),
    "material": (3, 1e7),  # Young's modulus Pa, Poisson's ratio, friction
}


def action_space() -> spaces.Box:
    """(6,) in -1 ... 1: velocity of the base along its own axes in units of the robot's speed limit, then its spin."""
    return spaces.Box(-1.0, 1.0, (6,), np.float32)


def observation_space(look_ahead: int, *, privileged: bool) -> spaces.Dict:
    """Bounded boxes by name; look_ahead: number of coming targets."""
    sizes = {**SIZES, "next_targets": ((look_ahead, 3), FARTHEST_M), **(PRIVILEGED if privileged else {})}
    return spaces.Dict({name: _box(shape, bound) for name, (shape, bound) in sizes.items()})


def _box(shape: int | tuple[int, ...], bound: float) -> spaces.Box:
    return spaces.Box(-bound, bound, (shape,) if isinstance(shape, int) else shape, np.float32)


def arrays(seen: Observation, space: spaces.Dict, extra: dict[str, Floats]) -> dict[str, Singles]:
    """An observation as the space has it: single precision, clipped to its bounds."""
    ahead = seen.targets_m[1:]
    count = int(space["next_targets"].shape[0])  # type: ignore[index]
    rows = np.minimum(np.arange(count), len(ahead) - 1) if len(ahead) else np.zeros(0, int)
    values: dict[str, Any] = {
        "base": np.concatenate([seen.base.position_m, quaternion_from_matrix(seen.base.rotation)]),
        "tip": seen.tip_m,
        "tip_direction": seen.tip_direction,
        "target": seen.target_m,
        "next_targets": ahead[rows] if len(ahead) else np.tile(seen.target_m, (count, 1)),
        "entry_offset": seen.entry_offset_m,
        "depth": [seen.depth_m],
        "base_wrench": seen.base_wrench,
        "time": [seen.t_s],
        **extra,
    }
    return {name: _fitted(values[name], box) for name, box in space.items()}


def _fitted(values: Any, box: Any) -> Singles:
    found: Singles = np.clip(np.asarray(values, np.float32), box.low, box.high)
    return found


def privileged_arrays(episode: Episode) -> dict[str, Floats]:
    """What no controller may know: shape of the shaft, contact points and forces, material."""
    state, needle, scenario = episode.state, episode.insertion.needle, episode.scenario
    b, count = state.bodies, min(CONTACTS, len(state.points_m))
    points, forces = np.zeros((CONTACTS, 3)), np.zeros((CONTACTS, 3))
    points[:count], forces[:count] = state.points_m[:count], state.point_forces_n[:count]
    material = [1e3 * scenario.tissue.young_kpa, scenario.tissue.poisson, scenario.interaction.friction]
    shaft = shaft_polyline(b.needle_x, b.needle_R, needle.element_length_m, SHAFT_POINTS)
    return {"shaft": shaft, "contact_points": points, "contact_forces": forces, "material": np.array(material)}


def pose_of(action: Floats, base: Pose, limits: RobotLimits, dt_s: float) -> Pose:
    """Where the base is commanded to: its twist in its own axes over one step, as shares of the robot's limits."""
    shift = base.rotation @ action[:3] * (limits.max_speed_m_s * dt_s)
    turn = base.rotation @ action[3:] * (limits.max_turn_rad_s * dt_s)
    return Pose(base.position_m + shift, exp_map(turn) @ base.rotation)


def action_towards(pose: Pose, base: Pose, limits: RobotLimits, dt_s: float) -> Singles:
    """The action that moves the base to a pose, or towards it as fast as the robot may: the inverse of `pose_of`."""
    shift = base.rotation.T @ (pose.position_m - base.position_m) / (limits.max_speed_m_s * dt_s)
    turn = base.rotation.T @ log_map(pose.rotation @ base.rotation.T) / (limits.max_turn_rad_s * dt_s)
    most = max(1.0, float(np.linalg.norm(shift)), float(np.linalg.norm(turn)))
    action: Singles = np.clip(np.concatenate([shift, turn]) / most, -1.0, 1.0).astype(np.float32)
    return action
