"""The digest that says whether two runs did the same to the bit."""

from __future__ import annotations

import hashlib
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

LAST_TISSUE = "tissue_last_m"  # the last frame of `tissue_m`: frames between are kept or not, as the recording says
DIGESTED = (  # the whole list: an array that is derived from these, or a clock reading, is in no digest
    "t_s",
    "base_position_m",
    "base_rotation",
    "tip_m",
    "target_m",
    "target_noisy_m",
    "command_position_m",
    "command_rotation",
    "depth_m",
    "base_force_n",
    "base_torque_nm",
    "iterations",  # with residual and violation: how the step was solved, which every bit of both bodies goes into
    "residual_n",
    "violation_m",
    "tissue_rest_m",
    "tissue_tets",
    LAST_TISSUE,
)


def digest(series: Mapping[str, NDArray[Any]]) -> str:
    """SHA-256 over the arrays of DIGESTED, in the order of their names, with name, type and shape of each.

    Raises KeyError for a series without one of them."""
    hashed = hashlib.sha256()
    for name in sorted(DIGESTED):
        array = np.ascontiguousarray(series["tissue_m"][-1] if name == LAST_TISSUE else series[name])
        hashed.update(f"{name}{array.dtype.str}{array.shape}".encode())
        hashed.update(array.tobytes())
    return hashed.hexdigest()
