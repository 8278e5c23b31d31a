"""A tree of axis-aligned boxes over triangles or tetrahedra: what is near a point, without looking at all of them.

The tree is complete and stored without pointers: node 1 is the root, node i has the children 2 i and 2 i + 1, the last
half of the nodes are leaves of LEAF items each. Items are split at the median along the longest side of their group.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from simcore.arrays import Floats, Ints
from simcore.compiled import kernel

LEAF = 8


@dataclass(frozen=True)
class BoundingTree:
    """low, high: (2 leaves, 3) m, corners of each node's box; items: (leaves, LEAF) item numbers, -1 = none."""

    low: Floats
    high: Floats
    items: Ints

    @classmethod
    def of(cls, corners: Floats) -> BoundingTree:
        """The tree over items with corners (n, k, 3) m; n at least 1."""
        low, high = corners.min(axis=1), corners.max(axis=1)
        items = _grouped(0.5 * (low + high))
        nowhere = np.full((1, 3), np.inf)
        levels = [
            (np.concatenate([low, nowhere])[items].min(axis=1), np.concatenate([high, -nowhere])[items].max(axis=1))
        ]
        while len(levels[0][0]) > 1:
            below = [side.reshape(-1, 2, 3) for side in levels[0]]
            levels.insert(0, (below[0].min(axis=1), below[1].max(axis=1)))
        lows, highs = ([nowhere, *side] for side in zip(*levels, strict=True))
        return cls(np.concatenate(lows), np.concatenate(highs), items)


def _grouped(middles: Floats) -> Ints:
    """(leaves, LEAF) numbers of the items with middles (n, 3), -1 where there are none left."""
    leaves = 1
    while leaves * LEAF < len(middles):
        leaves *= 2
    groups = np.full((1, leaves * LEAF), -1)
    groups[0, : len(middles)] = np.arange(len(middles))
    padded = np.concatenate([middles, np.full((1, 3), np.inf)])
    while len(groups) < leaves:
        places = padded[groups]
        highest = np.where(np.isinf(places), -np.inf, places).max(axis=1)
        axis = np.argmax(highest - places.min(axis=1), axis=1)
        along = np.take_along_axis(places, axis[:, None, None], axis=2)[:, :, 0]
        groups = np.take_along_axis(groups, np.argsort(along, axis=1, kind="stable"), axis=1)
        groups = groups.reshape(2 * len(groups), -1)
    return groups


@kernel
def squared_distance(point: Floats, low: Floats, high: Floats) -> float:
    """Squared distance of a point (3,) from the box [low, high]; 0 inside, infinite for the box of nothing."""
    total = 0.0
    for a in range(3):
        apart = max(low[a] - point[a], point[a] - high[a], 0.0)
        total += apart * apart
    return total
