"""The colours of a recording: of its entities and series, and of the displacement of the tissue."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from simcore.arrays import Floats

Colors = NDArray[np.uint32]

WHITE, STEEL, CYAN, ORANGE = (245, 247, 250), (205, 214, 226), (80, 220, 235), (255, 150, 50)
GREEN, MAGENTA, YELLOW, GREY = (90, 220, 120), (240, 90, 200), (250, 215, 80), (150, 160, 175)
RED = (240, 70, 60)
DISPLACEMENT_SCALE_M = 5e-3  # of the last colour
STRAIN_SCALE = 0.3  # the same for strains; stresses: this strain times Young's modulus
_LEVELS = np.linspace(0.0, 1.0, 5)
_COLOR_MAP = np.array([[58, 76, 110], [48, 132, 150], [120, 190, 110], [248, 208, 80], [240, 84, 60]], float)


def displacement_colors(moved_m: Floats) -> Colors:
    """(n,) colours 0xRRGGBBAA of displacements (n, 3) m, from none to DISPLACEMENT_SCALE_M and beyond."""
    x, y, z = moved_m.T
    return level_colors(np.sqrt(x * x + y * y + z * z) / DISPLACEMENT_SCALE_M)


def level_colors(level: Floats) -> Colors:
    """(n,) colours 0xRRGGBBAA of levels (n,), 0 for the first colour to 1 for the last and beyond."""
    packed = np.full(level.shape, 0xFF, np.uint32)
    for channel, shift in enumerate((24, 16, 8)):
        packed |= np.interp(level, _LEVELS, _COLOR_MAP[:, channel]).astype(np.uint32) << np.uint32(shift)
    return packed
