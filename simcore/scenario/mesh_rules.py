"""What a scenario takes from its mesh file, and what must fit to it: held nodes, entry, path."""

from __future__ import annotations

from typing import Any

import numpy as np

from simcore.arrays import Floats, Ints
from simcore.errors import Problem, ScenarioError
from simcore.linear_algebra.products import dot, norm
from simcore.mesh.numbering import free_node_order, half_bandwidth
from simcore.mesh.reader import digest_of, load_mesh
from simcore.mesh.tet_mesh import TetMesh
from simcore.scenario.blocks import Tissue
from simcore.scenario.held_parts import held_of, held_problems, nothing_held, region_problems
from simcore.scenario.suggestions import point_in_another_unit
from simcore.scenario.trajectory_blocks import Guide
from simcore.trajectory import Path

ON_SURFACE_MM = 0.05  # how far the entry may be from the surface, and the path outside it
ROUNDING_MM = 2e-6  # an entry so near to the surface is on it: it was put there before
PATH_STEP_MM = 0.5  # between the points of the path that are looked at
MAXIMUM_FACTOR_MB = 2000


def fields_of_mesh(tissue: Tissue) -> dict[str, Any]:
    """The fields of a tissue that its mesh file settles. Raises ScenarioError for a file that cannot be used."""
    path = tissue.mesh_file
    assert path is not None
    if wrong := region_problems(tissue):
        raise ScenarioError(wrong)
    sha256 = tissue.mesh_sha256 or digest_of(path)
    mesh = load_mesh(path, unit_mm=tissue.mesh_unit_mm, names=tissue.fixed_sets, sha256=sha256)
    problems = _fixed_problems(mesh, tissue)
    if problems:
        raise ScenarioError(problems)
    size = tuple(float(edge) for edge in np.round(1e3 * mesh.size_m, 6))
    element = round(1e3 * mesh.element_size_m, 6)
    return {"mesh_sha256": sha256, "size_mm": size, "element_size_mm": element}


def _fixed_problems(mesh: TetMesh, tissue: Tissue) -> list[Problem]:
    absent = [face for face in tissue.held_faces if face not in mesh.faces]
    if absent:
        flat = ", ".join(face for face in mesh.faces if face != "z_min") or "none"
        allowed = (
            f"is no flat side of the mesh's bounding box (flat: {flat}); "
            "hold parts with tissue.fixed_sets or tissue.fixed_regions"
        )
        return [Problem("tissue.fixed_faces", face, allowed) for face in absent]
    if problems := nothing_held(tissue):
        return problems
    held = held_of(tissue, mesh)
    if problems := held_problems(tissue, mesh.nodes_m, held):
        return problems
    return _factor_problems(mesh, tissue, held)


def _factor_problems(mesh: TetMesh, tissue: Tissue, held: Ints) -> list[Problem]:
    unknown = free_node_order(mesh, held)
    megabytes = 4e-6 * 3 * np.count_nonzero(unknown >= 0) * (half_bandwidth(mesh.tets, unknown) + 1)
    if megabytes <= MAXIMUM_FACTOR_MB:
        return []
    allowed = f"needs a factor of {megabytes:.0f} MB, at most {MAXIMUM_FACTOR_MB} are allowed: use a coarser mesh"
    return [Problem("tissue.mesh_file", tissue.mesh_file, allowed)]


def snapped_entry_mm(tissue: Tissue, path: Guide) -> tuple[float, float, float]:
    """The point of the surface nearest to the entry, if it is no farther than entry_snap_mm; else the entry."""
    assert tissue.mesh_file is not None
    mesh = load_mesh(tissue.mesh_file, unit_mm=tissue.mesh_unit_mm, names=tissue.fixed_sets, sha256=tissue.mesh_sha256)
    entry_m = np.array(path.entry_mm) * 1e-3
    _, nearest = mesh.nearest_on_surface(entry_m)
    apart_mm = 1e3 * norm(nearest - entry_m)
    if not ROUNDING_MM < apart_mm <= path.entry_snap_mm:
        return path.entry_mm
    x, y, z = (round(1e3 * float(value), 6) + 0.0 for value in nearest)
    return x, y, z


def mesh_path_problems(tissue: Tissue, path: Path, end_field: str) -> list[Problem]:
    """The entry lies on the free surface, the path leads inwards and stays inside; lengths of the messages in mm.

    end_field: what messages call the end of the path."""
    assert tissue.mesh_file is not None
    mesh = load_mesh(tissue.mesh_file, unit_mm=tissue.mesh_unit_mm, names=tissue.fixed_sets, sha256=tissue.mesh_sha256)
    entry, end = (1e3 * path.entry_m).tolist(), (1e3 * path.end_m).tolist()
    triangle, nearest = mesh.nearest_on_surface(path.entry_m)
    apart = 1e3 * norm(nearest - path.entry_m)
    if apart > ON_SURFACE_MM:
        allowed = (
            f"must lie on the mesh's surface within {ON_SURFACE_MM:g} mm; {_mm(nearest)} does, {apart:.3g} mm away; "
            "trajectory.entry_snap_mm moves it there"
        )
        meant = point_in_another_unit(entry, lambda point: _is_on_surface(mesh, point))
        return [Problem("trajectory.entry_mm", entry, allowed + meant)]
    if np.isin(mesh.surface_triangles[triangle], held_of(tissue, mesh)).all():
        return [Problem("trajectory.entry_mm", entry, "must not lie on a held part of the surface")]
    inward = mesh.inward_normal(path.entry_m)
    if dot(path.first_tangent(), inward) <= 0.0:
        allowed = (
            f"must be reached into the tissue; at the entry the path leads out of it (inward: {_mm(1e-3 * inward)})"
        )
        return [Problem(end_field, end, allowed)]
    points = path.point(np.linspace(0.0, path.length_m, int(np.ceil(1e3 * path.length_m / PATH_STEP_MM)) + 1))
    outside = np.flatnonzero(1e3 * mesh.outside_by(points) > ON_SURFACE_MM)
    if not len(outside):
        return []
    allowed = f"must be reached inside the mesh; the path leaves it at {_mm(points[outside[0]])}"
    return [Problem(end_field, end, allowed)]


def _is_on_surface(mesh: TetMesh, point_mm: tuple[float, float, float]) -> bool:
    point_m = 1e-3 * np.array(point_mm)
    return 1e3 * norm(mesh.nearest_on_surface(point_m)[1] - point_m) <= ON_SURFACE_MM


def _mm(point_m: Floats) -> str:
    return "[" + ", ".join(f"{1e3 * value:.4f}" for value in point_m) + "]"
