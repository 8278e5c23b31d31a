"""The remote centre of motion for controllers that give a position: the base's axis passes through the entry."""

from __future__ import annotations

import numpy as np

from simcore.arrays import Floats
from simcore.insertion.state import Pose
from simcore.rotations import exp_map

TOO_NEAR_M = 1e-3  # a base so near to the entry says nothing on its axis


def pose_through(entry_m: Floats, position_m: Floats, rotation: Floats) -> Pose:
    """The base at position_m (3,) m, its axis through entry_m (3,) m; turned from `rotation` (3, 3) without a twist
    about the axis, which an axisymmetric needle would carry as torsion for nothing."""
    towards = entry_m - position_m
    distance = float(np.linalg.norm(towards))
    if distance < TOO_NEAR_M:
        return Pose(position_m, rotation)
    axis, wanted = rotation[:, 2], towards / distance
    across = np.cross(axis, wanted)
    sine, cosine = float(np.linalg.norm(across)), float(axis @ wanted)
    if sine < 1e-15:
        return Pose(position_m, rotation)
    return Pose(position_m, exp_map(across / sine * np.arctan2(sine, cosine)) @ rotation)
