"""What a command must be: a finite pose within reach of the base, in metres."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from simcore.errors import NeedlebenchError
from simcore.insertion.state import Pose
from simcore.linear_algebra.products import norm
from simcore.rotations import is_rotation

if TYPE_CHECKING:
    from simcore.arrays import Floats

MAXIMUM_SKEW = 1e-6  # of R^T R from the identity
FARTHEST_M = 10.0  # a command from the base; no robot reaches as far
FAR_M = 1.0  # beyond, a thousandth of the command that is near the base tells that it was in millimetres


class CommandError(NeedlebenchError, ValueError):
    """A command that no robot can execute. step: the step it was meant for, from 0. problem: what it is instead."""

    def __init__(self, step: int, problem: str) -> None:
        self.step, self.problem = step, problem
        super().__init__(f"step {step}: the command is {problem}")


def checked_command(command: Any, base: Pose, step: int) -> Pose:
    """The command as a pose of floats. Raises CommandError for anything but a finite pose within reach of the base."""
    if not isinstance(command, Pose):
        raise CommandError(step, f"a {type(command).__name__}, not a Pose")
    try:
        position, rotation = np.asarray(command.position_m, float), np.asarray(command.rotation, float)
    except (TypeError, ValueError):
        raise CommandError(step, "a Pose whose position_m or rotation is no array of numbers") from None
    if position.shape != (3,) or rotation.shape != (3, 3):
        shapes = f"position_m {position.shape} and rotation {rotation.shape}"
        raise CommandError(step, f"a Pose with {shapes}, not (3,) and (3, 3)")
    if not (np.isfinite(position).all() and np.isfinite(rotation).all()):
        name, value = ("rotation", rotation) if np.isfinite(position).all() else ("position_m", position)
        raise CommandError(step, f"a Pose with {name} = {_shown(value)}, values that are not finite")
    if not is_rotation(np.ascontiguousarray(rotation), MAXIMUM_SKEW):
        raise CommandError(step, f"a Pose with rotation = {_shown(rotation)}, which is no rotation matrix")
    if (problem := _reach_problem(position, base.position_m)) is not None:
        raise CommandError(step, f"a Pose with position_m = {problem}")
    return Pose(position, rotation)


def _reach_problem(position_m: Floats, base_m: Floats) -> str | None:
    """Why a command (3,) is too far from the base (3,) to be meant, both m, world; None if it is not."""
    away_m = norm(position_m - base_m)
    if away_m <= FAR_M:
        return None
    where = f"{_shown(position_m)}, {away_m:.4g} m from the base"
    if norm(position_m * 1e-3 - base_m) < FAR_M / 2:
        return f"{where}: that looks like millimetres, position_m is in metres"
    if away_m > FARTHEST_M:
        return f"{where}: at most {FARTHEST_M:g} m are allowed"
    return None


def _shown(array: Floats) -> str:
    return str(np.round(array, 4).tolist())
