"""What the colours and lengths of a recorded scene mean, drawn beside the block in the scene itself."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import rerun as rr

from service.recording.colors import DISPLACEMENT_SCALE_M, MAGENTA, STRAIN_SCALE, WHITE, level_colors
from service.recording.section import path_plane

if TYPE_CHECKING:
    from simcore.arrays import Floats
    from simcore.rollout.records import Scene

FORCE_ARROW_M_PER_N = 0.05
BAR_M = 10e-3  # of the scale, and of the arrow of the force
STEPS = 5  # between the first and the last colour
_APART_M, _ROW_M, _COLOR_M = 10e-3, 15e-3, 12e-3  # from the block; between rows; between colours
_ARROW_AT_M = 40e-3  # along the first row, behind the scale bar


def legend(scene: Scene) -> dict[str, rr.AsComponents]:
    """Entity -> a scale bar, a force to scale, and the colours of the three layers, each with its labels."""
    rows = _rows(scene)
    force_n = BAR_M / FORCE_ARROW_M_PER_N
    along = path_plane(scene.path_m)[0]
    end = rows[0] + BAR_M * along
    young_kpa = scene.scenario.tissue.young_kpa
    return {
        "world/legend/length": rr.LineStrips3D(
            [[rows[0], end]], radii=0.5e-3, colors=[WHITE], labels=[f"{1e3 * BAR_M:g} mm"], show_labels=True
        ),
        "world/legend/force": rr.Arrows3D(
            origins=[rows[0] + _ARROW_AT_M * along],
            vectors=[BAR_M * along],
            radii=0.3e-3,
            colors=[MAGENTA],
            labels=[f"{force_n:g} N"],
            show_labels=True,
        ),
        "world/legend/displacement": _colors(rows[1], along, 1e3 * DISPLACEMENT_SCALE_M, "mm"),
        "world/legend/strain": _colors(rows[1], along, 100.0 * STRAIN_SCALE, "%"),
        "world/legend/stress": _colors(rows[1], along, young_kpa * STRAIN_SCALE, "kPa"),
    }


def legend_corners(scene: Scene) -> Floats:
    """(4, 3) m, world: what a view must show to show the legend."""
    rows, along = _rows(scene), path_plane(scene.path_m)[0]
    return np.array([*rows, *(row + STEPS * _COLOR_M * along for row in rows)])


def _rows(scene: Scene) -> Floats:
    """(2, 3) m: where each row begins, below the block as the eye sees it, on its near side."""
    along, across, normal = path_plane(scene.path_m)
    sides = scene.tissue_rest_m @ np.stack([along, across, normal], axis=1)
    low, high = sides.min(axis=0), sides.max(axis=0)
    first = low[0] * along + (low[1] - _APART_M) * across + high[2] * normal
    return np.array([first - row * _ROW_M * across for row in range(2)])


def _colors(first: Floats, along: Floats, last: float, unit: str) -> rr.Points3D:
    shares = np.linspace(0.0, 1.0, STEPS + 1)
    places = first + np.arange(STEPS + 1)[:, None] * _COLOR_M * along
    labels = [f"{last * share:.2g}" for share in shares[:-1]] + [f"{last:.2g} {unit}"]
    return rr.Points3D(places, radii=2e-3, colors=level_colors(shares), labels=labels, show_labels=True)
