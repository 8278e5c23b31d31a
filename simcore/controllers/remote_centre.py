"""The remote centre of motion: the base's axis through the entry, for controllers that give a position, and what a
base that keeps the remote centre does to the tip."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from simcore.elementary import arc_tangent
from simcore.insertion.state import Pose
from simcore.linear_algebra.products import dot, norm, product
from simcore.rotations import compose, exp_map, skew

if TYPE_CHECKING:
    from simcore.arrays import Floats
    from simcore.insertion.jacobian_fast import Linearisation

TOO_NEAR_M = 1e-3  # a base so near to the entry says nothing on its axis


def pose_through(entry_m: Floats, position_m: Floats, rotation: Floats) -> Pose:
    """The base at position_m (3,) m, its axis through entry_m (3,) m; turned from `rotation` (3, 3) without a twist
    about the axis, which an axisymmetric needle would carry as torsion for nothing."""
    towards = entry_m - position_m
    distance = norm(towards)
    if distance < TOO_NEAR_M:
        return Pose(position_m, rotation)
    axis, wanted = rotation[:, 2], towards / distance
    across = np.cross(axis, wanted)
    sine, cosine = norm(across), dot(axis, wanted)
    if sine < 1e-15:
        return Pose(position_m, rotation)
    return Pose(position_m, compose(exp_map(across / sine * arc_tangent(sine, cosine)), rotation))


def following_response(tip: Floats, axis: Floats, reach_m: float) -> Floats:
    """(3, 3) d tip / d base position when the base's axis (3,), a unit vector, turns to stay on a point reach_m away.

    tip: (3, 6) m per (m, m, m, rad, rad, rad), spatial spin about the base.
    """
    following: Floats = tip[:, :3] - product(tip[:, 3:], skew(axis)) / reach_m
    return following


def rcm_authority(response: Linearisation | None, rotation: Floats) -> Floats:
    """(2, 2) d tip / d base, both along x and y of the base's frame `rotation` (3, 3), with both remote-centre rows
    zero: the base turns about the entry as it moves sideways. NaN without a linearisation, where nothing guides the
    shaft, and where no turn helps."""
    if response is None or response.rcm is None:
        return np.full((2, 2), np.nan)
    across = rotation[:, :2]
    passing = product(response.rcm.reshape(4, 3), across).reshape(2, 2, 2)  # of each row: by moves, by turns
    (a, b), (c, d) = passing[:, 1].tolist()
    determinant = a * d - b * c
    if determinant == 0.0:
        return np.full((2, 2), np.nan)
    turn = product(np.array([[-d, b], [c, -a]]), passing[:, 0]) / determinant
    tip = product(product(across.T, response.tip).reshape(4, 3), across).reshape(2, 2, 2)
    authority: Floats = tip[:, 0] + product(tip[:, 1], turn)
    return authority
