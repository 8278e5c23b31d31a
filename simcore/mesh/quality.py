"""Whether tetrahedra make one body that can be computed with: finite, of sensible size, none flat, face to face."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from simcore.mesh.edges import determinants

if TYPE_CHECKING:
    from simcore.arrays import Flags, Floats, Ints

SIZE_MM = (10.0, 500.0)  # edges of the bounding box, as of the built-in block
ELEMENT_MM = (1.0, 50.0)  # mean element, as of the built-in block
FARTHEST_MM = 10_000.0
FLATTEST = 1e-3  # least 6 sqrt(2) V / l^3, l the root mean square edge: 1 for a regular tetrahedron


def fault_of_mesh(nodes_m: Floats, tets: Ints) -> str | None:
    """What is wrong with the mesh of nodes (n, 3) m, all used, and tetrahedra (t, 4) of any orientation."""
    if not np.isfinite(nodes_m).all():
        return f"has a point that is not finite: {_listed(nodes_m[~np.isfinite(nodes_m).all(axis=1)][0])} m"
    return _fault_of_size(nodes_m) or _fault_of_tets(nodes_m, tets) or _fault_of_joints(nodes_m, tets)


def _fault_of_size(nodes_m: Floats) -> str | None:
    low, high = 1e3 * nodes_m.min(axis=0), 1e3 * nodes_m.max(axis=0)
    size = np.round(high - low, 6)
    if size.min() < SIZE_MM[0] or size.max() > SIZE_MM[1]:
        return (
            f"has a bounding box of {_listed(size)} mm; each edge must be {SIZE_MM[0]:g} to {SIZE_MM[1]:g}: "
            "is tissue.mesh_unit_mm right?"
        )
    if max(abs(low).max(), abs(high).max()) > FARTHEST_MM:
        return f"has points from {_listed(low)} to {_listed(high)} mm; they must lie within +-{FARTHEST_MM:g}"
    return None


def shapes_of(nodes_m: Floats, tets: Ints) -> Floats:
    """(t,) 6 sqrt(2) V / l^3 of each tetrahedron, l the root mean square edge: 1 if it is regular, 0 if it is flat."""
    return _volumes_and_shapes(nodes_m[tets])[1]


def _volumes_and_shapes(corners: Floats) -> tuple[Floats, Floats]:
    """Of tetrahedra (t, 4, 3) in any orientation."""
    volumes = np.abs(determinants(corners[:, 1:] - corners[:, :1])) / 6.0
    pairs = [(a, b) for a in range(4) for b in range(a)]
    edges = np.array([np.sum((corners[:, a] - corners[:, b]) ** 2, axis=1) for a, b in pairs])
    shape = 6.0 * np.sqrt(2.0) * volumes / np.maximum(edges.mean(axis=0), np.finfo(float).tiny) ** 1.5
    return volumes, shape


def _fault_of_tets(nodes_m: Floats, tets: Ints) -> str | None:
    corners = nodes_m[tets]
    volumes, shape = _volumes_and_shapes(corners)
    flat = np.flatnonzero(shape < FLATTEST)
    if len(flat):
        around = _listed(1e3 * corners[flat[0]].mean(axis=0))
        return f"has {len(flat)} flat tetrahedra, such as number {flat[0]} (from 0) around {around} mm"
    mean_mm = round(1e3 * float(np.cbrt(6.0 * volumes.mean())), 6)
    if not ELEMENT_MM[0] <= mean_mm <= ELEMENT_MM[1]:
        return f"has elements of {mean_mm:.3g} mm on average; {ELEMENT_MM[0]:g} to {ELEMENT_MM[1]:g} are allowed"
    return None


def _fault_of_joints(nodes_m: Floats, tets: Ints) -> str | None:
    """Two tetrahedra share whole faces and lie on its two sides, and every one is reached from every other through
    faces."""
    triangles = np.sort(np.concatenate([tets[:, others] for others in _OTHERS]))
    order = np.lexsort(triangles.T)
    same = (triangles[order][1:] == triangles[order][:-1]).all(axis=1)
    if (same[1:] & same[:-1]).any() or len(np.unique(np.sort(tets), axis=0)) < len(tets):
        return "has overlapping tetrahedra: a face belongs to more than two of them, or two have the same nodes"
    first, second = order[:-1][same], order[1:][same]  # places among the triangles: corner * t + tetrahedron
    count = len(tets)
    graph = coo_array((np.ones(len(first), bool), (first % count, second % count)), shape=(count, count))
    parts, _ = connected_components(graph, directed=False)
    if parts > 1:
        return f"falls into {parts} parts that share no face; the tissue must be one body (are its nodes merged?)"
    return _fault_of_sides(nodes_m, tets, triangles, first, second)


_OTHERS = ([1, 2, 3], [0, 2, 3], [0, 1, 3], [0, 1, 2])  # the corners of the face opposite to corner 0, 1, 2, 3


def _fault_of_sides(nodes_m: Floats, tets: Ints, triangles: Ints, first: Ints, second: Ints) -> str | None:
    """Tetrahedra on the same side of their shared face: one of the two is turned inside out, a node stands elsewhere
    than its neighbours need it. The order in which a file lists corners does not matter."""
    count = len(tets)
    a, b, c = (nodes_m[triangles[first][:, corner]] for corner in range(3))
    normal = np.cross(b - a, c - a)
    sides = [np.einsum("fi,fi->f", normal, nodes_m[tets.T.ravel()[of]] - a) > 0.0 for of in (first, second)]
    wrong = sides[0] == sides[1]
    if not wrong.any():
        return None
    inverted = _turned_inside_out(first % count, second % count, wrong, count)
    around = _listed(1e3 * nodes_m[tets[inverted[0]]].mean(axis=0))
    return (
        f"is tangled: {len(inverted)} of its tetrahedra are turned inside out through their neighbours, "
        f"such as number {inverted[0]} (from 0) around {around} mm"
    )


def _turned_inside_out(first: Ints, second: Ints, wrong: Flags, count: int) -> Ints:
    """The smaller of the two groups into which the faces with both tetrahedra on one side divide the mesh; where they
    do not divide it, all tetrahedra at such faces."""
    sound = coo_array((np.ones((~wrong).sum(), bool), (first[~wrong], second[~wrong])), shape=(count, count))
    parts, part = connected_components(sound, directed=False)
    sizes = np.bincount(part, minlength=parts)
    at_fault = np.union1d(first[wrong], second[wrong])
    inverted: Ints = np.flatnonzero(part != np.argmax(sizes)) if parts > 1 else at_fault
    return inverted if len(inverted) else at_fault


def _listed(values: Floats) -> str:
    return "[" + ", ".join(f"{value:.6g}" for value in values) + "]"
