"""How far the tissue is strained: its largest principal strain, and where it is compressed most."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from simcore.compiled import kernel
from simcore.elementary_kernels import arc_tangent, sine_cosine

if TYPE_CHECKING:
    from simcore.arrays import Floats, Ints


class StrainExtremes(NamedTuple):
    """Over all tetrahedra: the largest |principal stretch - 1|, the smallest det F and the tetrahedron that has it."""

    largest_strain: float
    least_det_f: float
    least_det_tet: int


@kernel
def strain_extremes(x: Floats, tets: Ints, gradients: Floats) -> StrainExtremes:
    """Of a tissue whose nodes are at x (n, 3) m; tets (t, 4); gradients (t, 4, 3) 1/m of the shape functions at rest.

    A stretch is computed only where the Frobenius norm of C - I, C = F^T F, allows it to exceed the largest one so far.
    """
    f, c = np.empty((3, 3)), np.empty((3, 3))
    largest, least, least_tet, screen = 0.0, np.inf, 0, 0.0
    for t in range(len(tets)):
        n0, n1, n2, n3 = tets[t, 0], tets[t, 1], tets[t, 2], tets[t, 3]
        for i in range(3):
            x0, x1, x2, x3 = x[n0, i], x[n1, i], x[n2, i], x[n3, i]
            for j in range(3):
                g0, g1, g2, g3 = gradients[t, 0, j], gradients[t, 1, j], gradients[t, 2, j], gradients[t, 3, j]
                f[i, j] = x0 * g0 + x1 * g1 + x2 * g2 + x3 * g3
        det = (
            f[0, 0] * (f[1, 1] * f[2, 2] - f[1, 2] * f[2, 1])
            - f[0, 1] * (f[1, 0] * f[2, 2] - f[1, 2] * f[2, 0])
            + f[0, 2] * (f[1, 0] * f[2, 1] - f[1, 1] * f[2, 0])
        )
        if det < least:
            least, least_tet = det, t
        for i in range(3):
            for j in range(i, 3):
                c[i, j] = f[0, i] * f[0, j] + f[1, i] * f[1, j] + f[2, i] * f[2, j]
        on = (c[0, 0] - 1.0) ** 2 + (c[1, 1] - 1.0) ** 2 + (c[2, 2] - 1.0) ** 2
        if on + 2.0 * (c[0, 1] ** 2 + c[0, 2] ** 2 + c[1, 2] ** 2) > screen:
            low, high = outer_eigenvalues(c)
            largest = max(largest, np.sqrt(high) - 1.0, 1.0 - np.sqrt(max(low, 0.0)))
            # |stretch - 1| > largest needs |stretch^2 - 1| > 1 - (1 - largest)^2, and so ||C - I||
            screen = (1.0 - max(1.0 - largest, 0.0) ** 2) ** 2
    return StrainExtremes(largest, least, least_tet)


@kernel
def outer_eigenvalues(c: Floats) -> tuple[float, float]:
    """Smallest and largest eigenvalue of a symmetric matrix (3, 3), of its upper half, by its invariants.

    O. K. Smith, "Eigenvalues of a symmetric 3 x 3 matrix", Commun. ACM 4 (1961) 168.
    """
    mean = (c[0, 0] + c[1, 1] + c[2, 2]) / 3.0
    off = c[0, 1] ** 2 + c[0, 2] ** 2 + c[1, 2] ** 2
    spread = np.sqrt(((c[0, 0] - mean) ** 2 + (c[1, 1] - mean) ** 2 + (c[2, 2] - mean) ** 2 + 2.0 * off) / 6.0)
    if spread == 0.0:
        return mean, mean
    a, b, d = (c[0, 0] - mean) / spread, (c[1, 1] - mean) / spread, (c[2, 2] - mean) / spread
    e, g, h = c[0, 1] / spread, c[0, 2] / spread, c[1, 2] / spread
    half_det = 0.5 * (a * (b * d - h * h) - e * (e * d - h * g) + g * (e * h - b * g))
    angle = arc_tangent(np.sqrt(max(0.0, (1.0 - half_det) * (1.0 + half_det))), half_det) / 3.0
    sine, cosine = sine_cosine(angle)
    least = -0.5 * cosine - 0.5 * np.sqrt(3.0) * sine  # the cosine a third of a turn on
    return mean + 2.0 * spread * least, mean + 2.0 * spread * cosine
