"""The rules of paths: inside the tissue, no tighter than the needle bends, no longer than the needle."""

from __future__ import annotations

import math

import numpy as np

from simcore.arrays import Floats
from simcore.errors import Problem
from simcore.linear_algebra.products import norm
from simcore.scenario.blocks import MINIMUM_DEPTH_MM, STAND_OFF_MM, Needle, Tissue
from simcore.scenario.held_parts import block_problems
from simcore.scenario.suggestions import point_in_another_unit
from simcore.scenario.trajectory_blocks import ArcTrajectory, Guide, SineTrajectory, WaypointTrajectory
from simcore.trajectory import Path

Point = tuple[float, float, float]  # mm
PLACES = 1001  # of a path that are looked at, evenly along it
OUTSIDE_M = 1e-12  # rounding


def path_problems(guide: Guide, tissue: Tissue, needle: Needle) -> list[Problem]:
    """All that is wrong with where a path leads; the first place on it where there are several."""
    if found := _shape_problems(guide):
        return found
    found = _block_path_problems(guide, tissue) if tissue.mesh_file is None else _mesh_path_problems(guide, tissue)
    return found or _bend_problems(guide, needle)


def length_problems(guide: Guide, needle: Needle) -> list[Problem]:
    """A needle that is too short for its path."""
    length = 1e3 * guide.path().length_m
    if needle.length_mm >= length + STAND_OFF_MM - 1e-9:
        return []
    allowed = f"must be at least {length + STAND_OFF_MM:.6g} mm (path {length:.6g} plus stand-off {STAND_OFF_MM:g})"
    return [Problem("needle.length_mm", needle.length_mm, allowed)]


def largest_curvature_per_m(needle: Needle) -> float:
    """At which the outermost fibre of a bent needle reaches its yield stress: yield / (E r)."""
    return needle.yield_mpa * 1e6 / (needle.young_gpa * 1e9 * 0.5e-3 * needle.outer_diameter_mm)


def _shape_problems(guide: Guide) -> list[Problem]:
    """Points that coincide: the curve through them has no direction there."""
    if not isinstance(guide, WaypointTrajectory):
        return []
    points = np.array([guide.entry_mm, *guide.points_mm])
    apart = np.linalg.norm(np.diff(points, axis=0), axis=1)
    if (near := np.flatnonzero(apart < MINIMUM_DEPTH_MM)).size:
        row = int(near[0])
        before = f"trajectory.points_mm[{row - 1}]" if row else "trajectory.entry_mm"
        allowed = f"must lie at least {MINIMUM_DEPTH_MM:g} mm from {before}, and is {apart[row]:.3g} mm away"
        return [Problem(f"trajectory.points_mm[{row}]", list(guide.points_mm[row]), allowed)]
    return []


def _block_path_problems(guide: Guide, tissue: Tissue) -> list[Problem]:
    size = tissue.size_mm
    if guide.entry_snap_mm != 0.0:
        allowed = "must be 0: it belongs to tissue.mesh_file, which is not given"
        return [Problem("trajectory.entry_snap_mm", guide.entry_snap_mm, allowed)]

    def on_face(point: Point) -> bool:
        return point[2] == 0.0 and 0.0 < point[0] < size[0] and 0.0 < point[1] < size[1]

    def inside(point: Point) -> bool:
        return on_face((*point[:2], 0.0)) and MINIMUM_DEPTH_MM <= point[2] <= size[2]

    if not on_face(entry := guide.entry_mm):
        allowed = f"must lie on the face z = 0, inside 0 < x < {size[0]:g}, 0 < y < {size[1]:g} mm"
        return [Problem("trajectory.entry_mm", list(entry), allowed + point_in_another_unit(entry, on_face))]
    for field, point in _inner_points(guide):
        if not inside(point):
            within = f"0 < x < {size[0]:g}, 0 < y < {size[1]:g}, {MINIMUM_DEPTH_MM:g} <= z <= {size[2]:g} mm"
            allowed = f"must lie below the entry, inside {within}{point_in_another_unit(point, inside)}"
            return [Problem(field, list(point), allowed)]
    return block_problems(tissue, guide.entry_mm) or direction_problems(guide) or _leaving_problems(guide, tissue)


def _inner_points(guide: Guide) -> list[tuple[str, Point]]:
    """The fields of points that a path goes through below the surface."""
    if isinstance(guide, WaypointTrajectory):
        return [(f"trajectory.points_mm[{i}]", point) for i, point in enumerate(guide.points_mm)]
    return [(guide.end_field, guide.end_mm)]


def _leaving_problems(guide: Guide, tissue: Tissue) -> list[Problem]:
    """A curved path that leaves the block on its way."""
    if isinstance(guide, SineTrajectory):
        points = guide.path().curve(np.linspace(0.0, 1.0, PLACES))
    elif isinstance(guide, ArcTrajectory | WaypointTrajectory):
        points = _places(guide.path())
    else:
        return []
    high = np.array(tissue.size_mm) * 1e-3 + OUTSIDE_M
    outside = np.flatnonzero((points < -OUTSIDE_M).any(axis=1) | (points > high).any(axis=1))
    if not outside.size:
        return []
    field, value = _blamed(guide, int(outside[0]))
    return [
        Problem(field, value, f"must keep the whole path inside the block; it leaves it at {shown(points[outside[0]])}")
    ]


def _mesh_path_problems(guide: Guide, tissue: Tissue) -> list[Problem]:
    length = math.dist(guide.entry_mm, guide.end_mm)
    if length < MINIMUM_DEPTH_MM:
        allowed = f"is {length:.3g} mm from trajectory.entry_mm; it must be at least {MINIMUM_DEPTH_MM:g} mm"
        allowed += "; are its points in metres?" if length * 1e3 >= 1.0 else ""
        return [Problem(guide.end_field, list(guide.end_mm), allowed)]
    from simcore.scenario.mesh_rules import mesh_path_problems

    return direction_problems(guide) or mesh_path_problems(tissue, guide.path(), guide.end_field)


def direction_problems(guide: Guide) -> list[Problem]:
    """A direction that is not across the chord, and a circle that is too small for it."""
    if not isinstance(guide, SineTrajectory | ArcTrajectory):
        return []
    chord = np.subtract(guide.target_mm, guide.entry_mm)
    across = norm(np.cross(guide.direction, chord))
    if across <= 1e-9 * norm(np.array(guide.direction)) * norm(chord):
        allowed = "must be a vector across the path, neither zero nor along it"
        return [Problem("trajectory.direction", list(guide.direction), allowed)]
    least = 0.5 * norm(chord)
    if isinstance(guide, ArcTrajectory) and guide.radius_mm < least:
        allowed = f"must be at least {least:.6g} mm, half of the distance from entry to target"
        return [Problem("trajectory.radius_mm", guide.radius_mm, allowed)]
    return []


def _bend_problems(guide: Guide, needle: Needle) -> list[Problem]:
    """An arc or a curve through points that is bent tighter than a needle can be that is to spring back."""
    if not isinstance(guide, ArcTrajectory | WaypointTrajectory):
        return []
    path, most = guide.path(), largest_curvature_per_m(needle)
    along = np.linspace(0.0, path.length_m, PLACES)
    curvature = path.curvature_per_m(path.parameter(along))
    tight = np.flatnonzero(curvature > most * (1.0 + 1e-9))
    if not tight.size:
        return []
    first = int(tight[0])
    field, value = _blamed(guide, first)
    allowed = (
        f"must not bend the path tighter than a radius of {1e3 / most:.4g} mm, below which the needle yields "
        f"(needle.yield_mpa, young_gpa, outer_diameter_mm); first at {shown(path.point(along[first : first + 1])[0])}, "
        f"{1e3 * along[first]:.1f} mm along, and to {1e3 / curvature.max():.4g} mm at the tightest"
    )
    return [Problem(field, value, allowed)]


def _blamed(guide: Guide, place: int) -> tuple[str, object]:
    """The field to change where a path is wrong at one of its PLACES: of several points the next one."""
    if isinstance(guide, WaypointTrajectory):
        points = np.array([guide.entry_mm, *guide.points_mm])
        reached = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
        share = place / (PLACES - 1) * reached[-1]
        row = min(int(np.searchsorted(reached[1:], share)), len(guide.points_mm) - 1)
        return f"trajectory.points_mm[{row}]", list(guide.points_mm[row])
    name = "radius_mm" if isinstance(guide, ArcTrajectory) else "amplitude_mm"
    return f"trajectory.{name}", getattr(guide, name)


def _places(path: Path) -> Floats:
    """(PLACES, 3) m, evenly along a path."""
    return path.point(np.linspace(0.0, path.length_m, PLACES))


def shown(point_m: Floats) -> str:
    """A point (3,) m as messages write it, in mm."""
    return "[" + ", ".join(f"{round(1e3 * value, 4) + 0.0:.4f}" for value in point_m) + "] mm"
