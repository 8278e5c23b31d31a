"""Sine, cosine, arc tangent, exponential and logarithm, by additions, multiplications and divisions alone.

The system's mathematical library and NumPy choose among several versions of these by the processor, and the versions
differ in the last bit. What is written here is rounded the same way everywhere, as IEEE 754 demands. Cody and Waite's
reductions, and the polynomials of Sun's fdlibm and of Moshier's Cephes: each result is within two units of the last
place of the exact one. `elementary_kernels` has them for kernels.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from simcore.arrays import Floats

QUARTER_TURN = (1.57079632673412561417, 6.07710050630396597660e-11, 2.02226624879595063154e-21)  # three parts of pi / 2
LN2 = (6.93147180369123816490e-01, 1.90821492927058770002e-10)  # two parts


def sine_cosine_near_zero(x: Any) -> tuple[Any, Any]:
    """Of an angle of at most pi / 4, rad: a number, also inside kernels, or an array."""
    z = x * x
    s = 8.33333333332248946124e-03 + z * (
        -1.98412698298579493134e-04
        + z * (2.75573137070700676789e-06 + z * (-2.50507602534068634195e-08 + z * 1.58969099521155010221e-10))
    )
    c = 4.16666666666666019037e-02 + z * (
        -1.38888888888741095749e-03
        + z
        * (
            2.48015872894767294178e-05
            + z * (-2.75573143513906633035e-07 + z * (2.08757232129817482790e-09 + z * -1.13596475577881948265e-11))
        )
    )
    half = 0.5 * z
    near = 1.0 - half
    return x + x * z * (-1.66666666666666324348e-01 + z * s), near + (((1.0 - near) - half) + z * z * c)


def sines_cosines(angles: Floats) -> tuple[Floats, Floats]:
    """Sine and cosine of every angle, rad, of at most a million turns."""
    quarters = np.rint(angles * (2.0 / math.pi))
    x = ((angles - quarters * QUARTER_TURN[0]) - quarters * QUARTER_TURN[1]) - quarters * QUARTER_TURN[2]
    sines, cosines = sine_cosine_near_zero(x)
    odd, turned = quarters % 2.0 == 1.0, quarters % 4.0
    return (
        np.where(turned >= 2.0, -1.0, 1.0) * np.where(odd, cosines, sines),
        np.where((turned == 1.0) | (turned == 2.0), -1.0, 1.0) * np.where(odd, sines, cosines),
    )


def arc_tangent(y: float, x: float) -> float:
    """Angle of the point (x, y), rad, above -pi to pi; 0 at the origin."""
    if x == 0.0 and y == 0.0:
        return 0.0
    rest = 6.123233995736765886130e-17  # pi / 2 minus its double
    start, low, t = 0.5 * math.pi, rest, 0.0
    if x != 0.0:
        ratio = abs(y) / abs(x)
        if ratio > 2.41421356237309504880:
            t = -1.0 / ratio
        elif ratio > 0.66:
            start, low, t = 0.25 * math.pi, 0.5 * rest, (ratio - 1.0) / (ratio + 1.0)
        else:
            start, low, t = 0.0, 0.0, ratio
    z = t * t
    above = (-8.750608600031904122785e-1 * z - 1.615753718733365076637e1) * z - 7.500855792314704667340e1
    above = (above * z - 1.228866684490136173410e2) * z - 6.485021904942025371773e1
    below = ((z + 2.485846490142306297962e1) * z + 1.650270098316988542046e2) * z + 4.328810604912902668951e2
    below = (below * z + 4.853903996359136964868e2) * z + 1.945506571482613964425e2
    angle = start + ((t * (z * above / below) + t) + low)
    if x < 0.0:
        angle = math.pi - (angle - 2.0 * rest)
    return -angle if y < 0.0 else angle


def exponential(x: Floats) -> Floats:
    """e^x of every number; as large as it can be above 709.78, 0 far below."""
    x = np.clip(x, -746.0, 709.78)
    power = np.rint(x * 1.44269504088896338700)
    high, low = x - power * LN2[0], power * LN2[1]
    r = high - low
    z = r * r
    c = r - z * (
        1.66666666666666019037e-01
        + z
        * (
            -2.77777777770155933842e-03
            + z * (6.61375632143793436117e-05 + z * (-1.65339022054652515390e-06 + z * 4.13813679705723846039e-08))
        )
    )
    near: Floats = 1.0 - ((low - (r * c) / (2.0 - c)) - high)
    found: Floats = np.ldexp(near, np.where(np.isnan(power), 0.0, power).astype(np.int64))
    return found


def sigmoid(x: Floats) -> Floats:
    """1 / (1 + e^-x) of every number."""
    found: Floats = 1.0 / (1.0 + exponential(-x))
    return found


def logarithm(x: float) -> float:
    """The natural logarithm of a number above 0."""
    fraction, power = math.frexp(x)
    if fraction < math.sqrt(0.5):
        fraction, power = 2.0 * fraction, power - 1
    f = fraction - 1.0
    s = f / (2.0 + f)
    z = s * s
    w = z * z
    even = w * (3.999999999940941908e-01 + w * (2.222219843214978396e-01 + w * 1.531383769920937332e-01))
    odd = z * (
        6.666666666666735130e-01
        + w * (2.857142874366239149e-01 + w * (1.818357216161805012e-01 + w * 1.479819860511658591e-01))
    )
    half = 0.5 * f * f
    return power * LN2[0] - ((half - (s * (half + (even + odd)) + power * LN2[1])) - f)
