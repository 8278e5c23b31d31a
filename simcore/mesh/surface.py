"""The surface of tetrahedra, for whoever draws them too: it needs nothing of the simulation."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from simcore.arrays import Ints


def surface_of(tets: Ints) -> Ints:
    """(triangles, 3): faces that belong to one tetrahedron only, seen counter-clockwise from outside."""
    triangles = np.concatenate([tets[:, [1, 2, 3]], tets[:, [0, 3, 2]], tets[:, [0, 1, 3]], tets[:, [0, 2, 1]]])
    _, first, count = np.unique(np.sort(triangles, axis=1), axis=0, return_index=True, return_counts=True)
    outer: Ints = triangles[np.sort(first[count == 1])]
    return outer
