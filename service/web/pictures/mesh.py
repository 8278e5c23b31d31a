"""A still of the surface of a mesh, as an SVG of bounded size: flat shaded, seen from the front, above and aside."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from simcore.mesh.surface import surface_of

if TYPE_CHECKING:
    from simcore.arrays import Floats, Ints

MOST_TETRAHEDRA = 400_000  # of a mesh that is drawn at all
MOST_TRIANGLES = 5_000  # of a picture; a finer surface is coarsened
SIZE, MARGIN = 320, 12  # px
_BACKWARD = np.array([0.55, 0.45, -0.70])  # from the mesh to the eye: entries are usually on the side of small z
_LIGHT = np.array([0.25, 0.80, -0.55])
_DARK, _BRIGHT = np.array([112, 62, 50]), np.array([240, 206, 196])
_SHADES = 12
_COARSEST, _FINEST = 8, 96  # cells along the longest side when a surface is coarsened


def mesh_svg(points: Floats, tets: Ints) -> str:
    """The picture. points: (n, 3) in any unit; tets: (m, 4) of positive volume."""
    corners, triangles = _bounded(np.asarray(points, float), surface_of(tets))
    backward = _unit(_BACKWARD)
    right = _unit(np.cross([0.0, 1.0, 0.0], backward))
    up = np.cross(backward, right)
    placed = corners @ np.stack([right, -up, backward], axis=1)  # pixels grow downwards
    normals = _normals(corners, triangles)
    seen = normals @ backward > 0.0
    triangles, normals = triangles[seen], normals[seen]
    order = np.argsort(placed[triangles, 2].mean(axis=1))  # the farthest first
    flat = _fitted(placed[:, :2], triangles)
    shades = np.clip(0.35 + 0.65 * normals @ _unit(_LIGHT), 0.0, 1.0)
    levels = np.rint(shades * (_SHADES - 1)).astype(int)
    parts = [f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {SIZE} {SIZE}" width="{SIZE}" height="{SIZE}">']
    parts.append('<g stroke="#5a4038" stroke-opacity=".35" stroke-width=".5" stroke-linejoin="round">')
    for number in order:
        (ax, ay), (bx, by), (cx, cy) = flat[triangles[number]]
        path = f"M{ax:.1f} {ay:.1f}L{bx:.1f} {by:.1f}L{cx:.1f} {cy:.1f}Z"
        parts.append(f'<path fill="{_color(levels[number])}" d="{path}"/>')
    return "\n".join([*parts, "</g></svg>"])


def _bounded(points: Floats, triangles: Ints) -> tuple[Floats, Ints]:
    """The surface, its nodes merged on a grid that is as fine as the bound of triangles allows."""
    cells = _FINEST
    found = points, triangles
    while len(found[1]) > MOST_TRIANGLES and cells >= _COARSEST:
        found = _merged(points, triangles, cells)
        cells = int(0.8 * cells)
    return found[0], found[1][:MOST_TRIANGLES]


def _merged(points: Floats, triangles: Ints, cells: int) -> tuple[Floats, Ints]:
    """Nodes within one cell of a grid become their mean; triangles without an area go."""
    low, high = points.min(axis=0), points.max(axis=0)
    at = np.floor((points - low) / max(float((high - low).max()), 1e-300) * cells).astype(np.int64)
    _, number = np.unique(at, axis=0, return_inverse=True)
    number = number.reshape(-1)
    count = np.bincount(number)
    middle = np.stack([np.bincount(number, points[:, axis]) / count for axis in range(3)], axis=1)
    merged = number[triangles]
    proper = (merged[:, 0] != merged[:, 1]) & (merged[:, 1] != merged[:, 2]) & (merged[:, 0] != merged[:, 2])
    merged = merged[proper]
    _, first = np.unique(np.sort(merged, axis=1), axis=0, return_index=True)
    return middle, merged[np.sort(first)]


def _fitted(flat: Floats, triangles: Ints) -> Floats:
    """(n, 2) px, the drawn ones within the picture."""
    used = flat[np.unique(triangles)] if len(triangles) else flat
    low, high = used.min(axis=0), used.max(axis=0)
    scale = (SIZE - 2 * MARGIN) / max(float((high - low).max()), 1e-300)
    fitted: Floats = (flat - 0.5 * (low + high)) * scale + 0.5 * SIZE
    return fitted


def _normals(corners: Floats, triangles: Ints) -> Floats:
    a, b, c = (corners[triangles[:, i]] for i in range(3))
    across = np.cross(b - a, c - a)
    normals: Floats = across / np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-300)
    return normals


def _color(level: int) -> str:
    red, green, blue = np.rint(_DARK + (_BRIGHT - _DARK) * (level / (_SHADES - 1))).astype(int)
    return f"#{red:02x}{green:02x}{blue:02x}"


def _unit(vector: Floats) -> Floats:
    return np.asarray(vector / np.linalg.norm(vector))
