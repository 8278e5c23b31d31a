"""Volumes and inverse edge matrices of tetrahedra, by cross products."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from simcore.arrays import Floats, Ints


def determinants(edges: Floats) -> Floats:
    """(t,) of matrices (t, 3, 3): six times the volumes of tetrahedra whose edges from one corner are the rows."""
    found: Floats = (edges[:, 0] * np.cross(edges[:, 1], edges[:, 2])).sum(axis=1)
    return found


def edge_inverses(nodes_m: Floats, tets: Ints) -> tuple[Floats, Floats]:
    """Six times the volumes (t,) m3, and (t, 3, 3) 1/m: row a takes a vector from the first corner to the shape
    function of corner a + 1 there, and is its gradient.

    nodes_m: (n, 3) m; tets: (t, 4), none flat.
    """
    edges = nodes_m[tets[:, 1:]] - nodes_m[tets[:, :1]]
    sixfold = determinants(edges)
    across = np.cross(edges[:, [1, 2, 0]], edges[:, [2, 0, 1]])
    return sixfold, across / sixfold[:, None, None]
