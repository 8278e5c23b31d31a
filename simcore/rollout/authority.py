"""The RCM authority in the series of a run, and where it is lost: how far the tip follows a base that moves sideways
and turns so that the needle keeps passing the entry."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from simcore.linear_algebra.singular_values import smallest_of_pairs
from simcore.scenario.scenario import InverseFem

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from simcore.arrays import Floats
    from simcore.scenario.controller_blocks import Controller

WEAK = 0.05  # [ours] below it the base moves sideways more than twenty times as far as the tip
AUTHORITY = ("rcm_authority", "rcm_sigma_min")  # of a series: derived from its states and therefore not digested


def authority_arrays(authority: list[Floats], rows: int) -> dict[str, Floats]:
    """AUTHORITY: (rows, 2, 2) and its smallest singular values (rows,), NaN where it is unknown.

    authority: (2, 2) of the first rows, at most as many as there are.
    """
    found = np.full((rows, 2, 2), np.nan)
    if authority:
        found[: len(authority)] = authority
    known = np.isfinite(found).all(axis=(1, 2))
    smallest = np.full(rows, np.nan)
    smallest[known] = smallest_of_pairs(found[known])
    return dict(zip(AUTHORITY, (found, smallest), strict=True))


def authority_warnings(series: Mapping[str, NDArray[Any]], controller: Controller) -> list[str]:
    """A line for each direction that changes sign, and one where the smallest singular value is below WEAK.

    The rise just behind the entry, where no needle has authority, is not told; a run that never leaves it is.
    """
    known = np.isfinite(series["rcm_sigma_min"])
    if not isinstance(controller, InverseFem) or not known.any():
        return []
    depth_mm, sigma = 1e3 * series["depth_m"][known], series["rcm_sigma_min"][known]
    told = []
    for i, axis in enumerate("xy"):
        negative = series["rcm_authority"][known, i, i] < 0.0
        if (turned := np.flatnonzero(negative[1:] != negative[:-1]) + 1).size:
            told.append(
                f"RCM authority: its {axis} component changes sign at a depth of {depth_mm[turned[0]]:.1f} mm: with "
                "the remote centre kept, the tip moves the other way from there"
            )
    reached = np.flatnonzero(sigma >= WEAK)
    if not reached.size:
        most = int(sigma.argmax())
        values = f"at most {sigma[most]:.2g}, at a depth of {depth_mm[most]:.1f} mm"
        return [*told, f"RCM authority: its smallest singular value never reaches {WEAK:g} ({values})"]
    first = int(reached[0])
    if (lost := np.flatnonzero(sigma[first:] < WEAK) + first).size:
        least = first + int(sigma[first:].argmin())
        values = f"at least {sigma[least]:.2g}, at {depth_mm[least]:.1f} mm"
        where = f"falls below {WEAK:g} at a depth of {depth_mm[lost[0]]:.1f} mm ({values})"
        told.append(f"RCM authority: its smallest singular value {where}: the tip is hardly steered sideways there")
    return told
