"""Numbers of nodes: which are held, and the order of the free ones that makes the factor's band narrow."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from simcore.arrays import Ints
    from simcore.mesh.mesh import Mesh
    from simcore.mesh.regions import Region


def held_nodes(mesh: Mesh, faces: Sequence[str], sets: Sequence[str] = (), regions: Sequence[Region] = ()) -> Ints:
    """The nodes of the flat sides `faces`, of the named `sets` and in the `regions` of a mesh, in ascending order.

    Raises KeyError for a side or a set that the mesh has not.
    """
    inside = [np.flatnonzero(region.contains(mesh.nodes_m)) for region in regions]
    parts = [*(mesh.faces[face] for face in faces), *(mesh.sets[name] for name in sets), *inside]
    return np.unique(np.concatenate([np.zeros(0, np.int64), *parts]))


def free_node_order(mesh: Mesh, held: Ints) -> Ints:
    """(n,) rank of each free node in the order of the factor, the one of narrowest band; -1 if held."""
    ranks = []
    for free in mesh.node_orders(held):
        unknown = np.full(len(mesh.nodes_m), -1)
        unknown[free] = np.arange(len(free))
        ranks.append(unknown)
    return min(ranks, key=lambda unknown: half_bandwidth(mesh.tets, unknown))


def half_bandwidth(tets: Ints, unknown: Ints) -> int:
    """Largest distance of two coupled degrees of freedom."""
    ranks = unknown[tets]
    largest = np.where(ranks < 0, -1, ranks).max(axis=1)
    smallest = np.where(ranks < 0, np.iinfo(np.int64).max, ranks).min(axis=1)
    return int(3 * (largest - smallest)[largest >= 0].max() + 2)
