"""A picture of an insertion as an array, without any library: from the side and from above."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from simcore.arrays import Floats
    from simcore.rollout.records import Scene, StepRecord

Image = NDArray[np.uint8]

HEIGHT, WIDTH, MARGIN = 240, 480, 10
NEEDLE_SHOWN_M = 40e-3  # in front of the surface
PAPER, BLOCK, OUTLINE = (255, 255, 255), (244, 226, 214), (150, 120, 105)
PATH, NEEDLE, TARGET, SEEN = (60, 130, 200), (40, 40, 45), (214, 60, 50), (30, 150, 80)


def picture(scene: Scene, record: StepRecord) -> Image:
    """(480, 480, 3) of bytes: y down above, x down below, z to the right in both; path blue, target red, tip green."""
    return np.concatenate([_view(scene, record, axis) for axis in (1, 0)])


def _view(scene: Scene, record: StepRecord, axis: int) -> Image:
    canvas = np.full((HEIGHT, WIDTH, 3), PAPER, np.uint8)
    nodes = scene.tissue_rest_m
    low, high = nodes.min(axis=0), nodes.max(axis=0)
    left, right = min(low[2], scene.entry_m[2]) - NEEDLE_SHOWN_M, high[2]
    scale = min((WIDTH - 2 * MARGIN) / (right - left), (HEIGHT - 2 * MARGIN) / (high[axis] - low[axis]))

    def flat(points: Floats) -> Floats:
        """(n, 2) columns and rows of points (n, 3) m."""
        across = 0.5 * (low[axis] + high[axis])
        return np.column_stack(
            [MARGIN + scale * (points[:, 2] - left), 0.5 * HEIGHT + scale * (points[:, axis] - across)]
        )

    corners = flat(np.array([low, high]))
    (c0, r0), (c1, r1) = np.clip(np.rint(corners).astype(int), 0, [WIDTH, HEIGHT])
    canvas[r0:r1, c0:c1] = OUTLINE
    canvas[r0 + 1 : r1 - 1, c0 + 1 : c1 - 1] = BLOCK
    _line(canvas, flat(scene.path_m), PATH, 0)
    _line(canvas, flat(record.shaft_m), NEEDLE, 1)
    _line(canvas, flat(record.target_m[None]), TARGET, 3)
    _line(canvas, flat(record.tip_m[None]), SEEN, 2)
    return canvas


def _line(canvas: Image, points: Floats, colour: tuple[int, int, int], thick: int) -> None:
    """A polyline of squares of 2 thick + 1 pixels, cut off at the edges."""
    ends = np.concatenate([points, points[-1:]])
    for start, end in pairwise(ends):
        count = int(np.ceil(np.abs(end - start).max())) + 1
        for column, row in np.rint(np.linspace(start, end, count)).astype(int):
            top, first = max(row - thick, 0), max(column - thick, 0)
            canvas[top : max(row + thick + 1, 0), first : max(column + thick + 1, 0)] = colour
