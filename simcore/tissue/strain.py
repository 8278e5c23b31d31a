"""How far the tissue is strained: its largest principal strain, and where it is compressed most."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from simcore.compiled import kernel
from simcore.elementary_kernels import arc_tangent, sine_cosine
from simcore.tissue.force_blocks import LANES, gradients_of_block

if TYPE_CHECKING:
    from simcore.arrays import Floats
    from simcore.tissue.force_blocks import Corners


class StrainExtremes(NamedTuple):
    """Over all tetrahedra: the largest |principal stretch - 1|, the smallest det F and the tetrahedron that has it."""

    largest_strain: float
    least_det_f: float
    least_det_tet: int


@kernel
def strain_extremes(x: Floats, corners: Corners, gradients: Floats) -> StrainExtremes:
    """Of a tissue whose nodes are at x (n, 3) m; corners, gradients: its tetrahedra in blocks, see `in_blocks`.

    A stretch is computed only where the Frobenius norm of C - I, C = F^T F, allows it to exceed the largest one so far.
    """
    edges, f, c = np.empty((9, LANES)), np.empty((9, LANES)), np.empty((6, LANES))
    det, apart = np.empty(LANES), np.empty(LANES)
    largest, least, least_tet, screen = 0.0, np.inf, 0, 0.0
    for b in range(len(corners)):
        gradients_of_block(x, corners[b], gradients[b], edges, f)
        stretch_of_block(f, c, det, apart)
        for lane in range(LANES):
            if det[lane] < least:
                least, least_tet = det[lane], LANES * b + lane
            if apart[lane] > screen:
                low, high = outer_eigenvalues(c[0, lane], c[1, lane], c[2, lane], c[3, lane], c[4, lane], c[5, lane])
                largest = max(largest, np.sqrt(high) - 1.0, 1.0 - np.sqrt(max(low, 0.0)))
                # |stretch - 1| > largest needs |stretch^2 - 1| > 1 - (1 - largest)^2, and so ||C - I||
                screen = (1.0 - max(1.0 - largest, 0.0) ** 2) ** 2
    return StrainExtremes(largest, least, least_tet)


@kernel
def stretch_of_block(f: Floats, c: Floats, det: Floats, apart: Floats) -> None:
    """Of each deformation gradient in f (9, LANES): C = F^T F as its entries 00, 11, 22, 01, 02, 12, to c (6, LANES),
    det F and the squared Frobenius norm of C - I, (LANES,) each."""
    for lane in range(LANES):
        f00, f01, f02 = f[0, lane], f[1, lane], f[2, lane]
        f10, f11, f12 = f[3, lane], f[4, lane], f[5, lane]
        f20, f21, f22 = f[6, lane], f[7, lane], f[8, lane]
        det[lane] = f00 * (f11 * f22 - f12 * f21) - f01 * (f10 * f22 - f12 * f20) + f02 * (f10 * f21 - f11 * f20)
        c00 = f00 * f00 + f10 * f10 + f20 * f20
        c11 = f01 * f01 + f11 * f11 + f21 * f21
        c22 = f02 * f02 + f12 * f12 + f22 * f22
        c01 = f00 * f01 + f10 * f11 + f20 * f21
        c02 = f00 * f02 + f10 * f12 + f20 * f22
        c12 = f01 * f02 + f11 * f12 + f21 * f22
        c[0, lane], c[1, lane], c[2, lane], c[3, lane], c[4, lane], c[5, lane] = c00, c11, c22, c01, c02, c12
        on = (c00 - 1.0) * (c00 - 1.0) + (c11 - 1.0) * (c11 - 1.0) + (c22 - 1.0) * (c22 - 1.0)
        apart[lane] = on + 2.0 * (c01 * c01 + c02 * c02 + c12 * c12)


@kernel
def outer_eigenvalues(c00: float, c11: float, c22: float, c01: float, c02: float, c12: float) -> tuple[float, float]:
    """Smallest and largest eigenvalue of a symmetric matrix (3, 3) of these entries, by its invariants.

    O. K. Smith, "Eigenvalues of a symmetric 3 x 3 matrix", Commun. ACM 4 (1961) 168.
    """
    mean = (c00 + c11 + c22) / 3.0
    off = c01**2 + c02**2 + c12**2
    spread = np.sqrt(((c00 - mean) ** 2 + (c11 - mean) ** 2 + (c22 - mean) ** 2 + 2.0 * off) / 6.0)
    if spread == 0.0:
        return mean, mean
    a, b, d = (c00 - mean) / spread, (c11 - mean) / spread, (c22 - mean) / spread
    e, g, h = c01 / spread, c02 / spread, c12 / spread
    half_det = 0.5 * (a * (b * d - h * h) - e * (e * d - h * g) + g * (e * h - b * g))
    angle = arc_tangent(np.sqrt(max(0.0, (1.0 - half_det) * (1.0 + half_det))), half_det) / 3.0
    sine, cosine = sine_cosine(angle)
    least = -0.5 * cosine - 0.5 * np.sqrt(3.0) * sine  # the cosine a third of a turn on
    return mean + 2.0 * spread * least, mean + 2.0 * spread * cosine
