"""The functions of `elementary` for kernels."""

from __future__ import annotations

import math

import numpy as np

from simcore import elementary
from simcore.compiled import kernel
from simcore.elementary import QUARTER_TURN

sine_cosine_near_zero = kernel(elementary.sine_cosine_near_zero)
arc_tangent = kernel(elementary.arc_tangent)


@kernel
def sine_cosine(angle: float) -> tuple[float, float]:
    """Of an angle, rad, of at most a million turns."""
    quarters = np.rint(angle * (2.0 / math.pi))
    x = ((angle - quarters * QUARTER_TURN[0]) - quarters * QUARTER_TURN[1]) - quarters * QUARTER_TURN[2]
    sine, cosine = sine_cosine_near_zero(x)
    turned = int(quarters) % 4
    if turned % 2 == 1:
        sine, cosine = cosine, sine
    return -sine if turned >= 2 else sine, -cosine if turned in (1, 2) else cosine
