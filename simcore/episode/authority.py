"""Where the RCM authority vanishes: how far the tip follows a base that keeps the needle passing the entry."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from simcore.linear_algebra.singular_values import smallest_of_pairs

if TYPE_CHECKING:
    from simcore.arrays import Floats

AUTHORITY_FLOOR = 0.02  # a base that moves fifty times as far as the tip steers nothing


def lost_authority(authority: list[Floats]) -> str | None:
    """That the authority has vanished, if it has: once above its floor, the smallest singular value fell to it or
    below, or passed zero between two steps, where the determinant changes sign.

    authority: (2, 2) of every state so far, NaN where it is unknown.
    """
    known = [one for one in authority if np.isfinite(one).all()]
    if not known:
        return None
    sigma = smallest_of_pairs(np.array(known))
    if not (steered := np.flatnonzero(sigma > AUTHORITY_FLOOR)).size:
        return None
    first = int(steered[0])
    turned = np.diff(np.sign(np.array([a * d - b * c for (a, b), (c, d) in known[first:]]))) != 0.0
    if sigma[first:].min() > AUTHORITY_FLOOR and not turned.any():
        return None
    passed = "0" if turned.any() else f"{sigma[first:].min():.2g}"
    return f"the RCM authority was lost: its smallest singular value passed {passed} and is {sigma[-1]:.2g} now"
