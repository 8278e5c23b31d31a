"""What a mesh file offers to a scenario: extents, quality, sets, the likely unit of length, places to enter."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from simcore.linear_algebra.products import norm, times
from simcore.mesh.quality import SIZE_MM, shapes_of
from simcore.mesh.reader import body_of, digest_of, load_mesh

if TYPE_CHECKING:
    from simcore.arrays import Floats, Ints
    from simcore.mesh.tet_mesh import TetMesh

UNITS = {"mm": 1.0, "m": 1000.0, "cm": 10.0, "inch": 25.4, "um": 1e-3}  # in the order in which they are tried

BELOW_M = 1e-6  # from where the other end of the tissue is looked for


@dataclass(frozen=True)
class Entry:
    """A place to enter: on the surface, in line with the middle of the mesh. inward: unit normal of the surface.
    depth_mm: how far the tissue goes on along it."""

    entry_mm: list[float]
    inward: list[float]
    depth_mm: float


@dataclass(frozen=True)
class MeshSummary:
    """A mesh file. Lengths in mm, at the unit that was given or guessed; sets: name -> number of nodes, or why it
    cannot be held; shape: 1 for a regular tetrahedron, 0 for a flat one."""

    sha256: str
    unit_mm: float
    unit_guessed: bool
    nodes: int
    tetrahedra: int
    low_mm: list[float]
    high_mm: list[float]
    element_mm: float
    shape_worst: float
    shape_mean: float
    flat_sides: list[str]
    sets: dict[str, int | str]
    other_names: list[str]
    left_out: list[str]
    entries: list[Entry]

    def as_json(self) -> dict[str, Any]:
        """JSON data."""
        return asdict(self)


def summary_of(path: str, unit_mm: float | None = None) -> MeshSummary:
    """The summary of a file; unit_mm: None to guess it. Raises ScenarioError for a file that cannot be used."""
    body = body_of(path)
    with np.errstate(over="ignore", invalid="ignore"):  # of any size, looked at below
        extents = np.ptp(body.points, axis=0)
    unit = guessed_unit_mm(extents) if unit_mm is None else unit_mm
    mesh = load_mesh(path, unit_mm=unit, names=(), sha256=None)
    shapes = shapes_of(mesh.nodes_m, mesh.tets)
    low, high = (1e3 * end(axis=0) for end in (mesh.nodes_m.min, mesh.nodes_m.max))
    return MeshSummary(
        sha256=digest_of(path),
        unit_mm=unit,
        unit_guessed=unit_mm is None,
        nodes=len(mesh.nodes_m),
        tetrahedra=len(mesh.tets),
        low_mm=_rounded(low),
        high_mm=_rounded(high),
        element_mm=round(1e3 * mesh.element_size_m, 3),
        shape_worst=round(float(shapes.min()), 4),
        shape_mean=round(float(shapes.mean()), 4),
        flat_sides=list(mesh.faces),
        sets={name: len(nodes) for name, nodes in body.sets.items()} | body.refused,
        other_names=[name for name in body.names if name.endswith("=NUMBER")],
        left_out=list(body.remarks),
        entries=entries_of(mesh),
    )


def guessed_unit_mm(size: Floats) -> float:
    """The first unit at which edges (3,) of a bounding box are those of a tissue; millimetres if none is."""
    fits = (unit for unit in UNITS.values() if SIZE_MM[0] <= size.min() * unit and size.max() * unit <= SIZE_MM[1])
    return next(fits, 1.0)


def entries_of(mesh: TetMesh) -> list[Entry]:
    """Where lines along the axes through the middle of the mesh meet its surface first, from either side."""
    middle = 0.5 * (mesh.nodes_m.min(axis=0) + mesh.nodes_m.max(axis=0))
    triangles = mesh.nodes_m[mesh.surface_triangles]
    found = []
    for axis in (2, 1, 0):
        for sign in (1.0, -1.0):
            direction = np.zeros(3)
            direction[axis] = sign
            start = middle - direction * mesh.size_m.max()
            hits, which = _hits(triangles, start, direction)
            if not len(hits):
                continue
            first = int(np.argmin(hits))
            entry, (a, b, c) = start + hits[first] * direction, triangles[which[first]]
            normal = -np.cross(b - a, c - a)
            normal /= norm(normal)
            onward, _ = _hits(triangles, entry + BELOW_M * normal, normal)
            depth = 1e3 * (BELOW_M + float(onward.min())) if len(onward) else 0.0
            found.append(Entry(_rounded(1e3 * entry), _rounded(normal), round(depth, 3)))
    return found


def _hits(triangles: Floats, start: Floats, direction: Floats) -> tuple[Floats, Ints]:
    """Distances along a ray from start (3,) at which it meets triangles (t, 3, 3), and their rows."""
    first, second = triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    across = np.cross(direction, second)
    scale = np.einsum("ti,ti->t", first, across)
    with np.errstate(divide="ignore", invalid="ignore"):
        offset = start - triangles[:, 0]
        u = np.einsum("ti,ti->t", offset, across) / scale
        turned = np.cross(offset, first)
        v = times(turned, direction) / scale
        distance = np.einsum("ti,ti->t", second, turned) / scale
        met = (u >= 0.0) & (v >= 0.0) & (u + v <= 1.0) & (distance > 0.0) & np.isfinite(distance)
    rows: Ints = np.flatnonzero(met)
    return distance[rows], rows


def _rounded(values: Floats) -> list[float]:
    return [round(float(value), 6) + 0.0 for value in values]
