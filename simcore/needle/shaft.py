"""The shaft between the nodes: a cubic Hermite curve in the rest arc length.

Nodal tangents are the third columns of the nodal rotations. These shapes ignore the shear parameter of the
beams (they are the Euler-Bernoulli ones): between nodes they differ from the beam's own curve by terms of
order phi.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from simcore.arrays import Floats
from simcore.compiled import kernel


class Shaft(NamedTuple):
    """What the curve is made of: nodes x (n+1, 3) m and R (n+1, 3, 3), world, and the rest length of a beam."""

    x: Floats
    R: Floats
    element_length_m: float


@kernel
def shaft_weights(elements: int, element_length: float, s: float) -> tuple[int, Floats]:
    """Element e and weights (3, 4) at the rest arc length s m: rows h, dh/ds, d2h/ds2.

    c = h[0] x_e + h[1] t_e + h[2] x_{e+1} + h[3] t_{e+1} with nodal positions x and unit tangents t; h[1] and
    h[3] carry the length. Beyond either end the curve goes on straight along the end tangent.
    """
    w = np.zeros((3, 4))
    if s < 0.0:
        w[0, 0], w[0, 1], w[1, 1] = 1.0, s, 1.0
        return 0, w
    if s > elements * element_length:
        w[0, 2], w[0, 3], w[1, 3] = 1.0, s - elements * element_length, 1.0
        return elements - 1, w
    length = element_length
    e = min(int(s / length), elements - 1)
    u = s / length - e
    w[0, 2] = u * u * (3.0 - 2.0 * u)
    w[0, 0] = 1.0 - w[0, 2]
    w[0, 1] = length * u * (1.0 - u) ** 2
    w[0, 3] = length * u * u * (u - 1.0)
    w[1, 2] = 6.0 * u * (1.0 - u) / length
    w[1, 0] = -w[1, 2]
    w[1, 1] = (1.0 - u) * (1.0 - 3.0 * u)
    w[1, 3] = u * (3.0 * u - 2.0)
    w[2, 2] = (6.0 - 12.0 * u) / length**2
    w[2, 0] = -w[2, 2]
    w[2, 1] = (6.0 * u - 4.0) / length
    w[2, 3] = (6.0 * u - 2.0) / length
    return e, w


@kernel
def shaft_frame(x: Floats, R: Floats, element_length: float, s: float) -> tuple[Floats, Floats, Floats, int, Floats]:
    """Point c (3,) m, dc/ds, d2c/ds2 (3,), element e and weights h (4,) at the rest arc length s m.

    x: (n+1, 3) m, R: (n+1, 3, 3), world. dc/ds is not of unit length where the needle is stretched or curved.
    """
    e, w = shaft_weights(len(x) - 1, element_length, s)
    out = np.empty((3, 3))
    for row in range(3):
        for i in range(3):
            positions = w[row, 0] * x[e, i] + w[row, 2] * x[e + 1, i]
            out[row, i] = positions + (w[row, 1] * R[e, i, 2] + w[row, 3] * R[e + 1, i, 2])
    return out[0], out[1], out[2], e, w[0]


@kernel
def shaft_columns(R: Floats, e: int, h: Floats, out: Floats) -> None:
    """Write to out (3, 12) the gradient of the shaft point, at fixed s, to dx, dw of nodes e and e+1.

    With a derivative row of `shaft_weights` in place of h (4,) it is the gradient of dc/ds or of d2c/ds2.
    """
    out[:] = 0.0
    for node in range(2):
        i, column, along = e + node, 6 * node, h[2 * node + 1]
        for a in range(3):
            out[a, column + a] = h[2 * node]
            b, c = (a + 1) % 3, (a + 2) % 3
            out[b, column + 3 + c] = along * R[i, a, 2]
            out[c, column + 3 + b] = -along * R[i, a, 2]


@kernel
def shaft_polyline(x: Floats, R: Floats, element_length: float, points: int) -> Floats:
    """(points, 3) m: the shaft from base to tip at equal rest arc lengths, for drawing."""
    out = np.empty((points, 3))
    for k in range(points):
        c, _, _, _, _ = shaft_frame(x, R, element_length, element_length * (len(x) - 1) * k / (points - 1))
        for i in range(3):
            out[k, i] = c[i]
    return out
