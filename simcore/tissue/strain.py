"""How far the tissue is strained: its largest principal strain, and where it is compressed most."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from simcore.compiled import kernel

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

    A stretch is computed only where the Frobenius norm of Green's strain allows it to exceed the largest one so far.
    """
    f, c = np.empty((3, 3)), np.empty((3, 3))
    largest, least, least_tet = 0.0, np.inf, 0
    for t in range(len(tets)):
        for i in range(3):
            for j in range(3):
                f[i, j] = 0.0
                for a in range(4):
                    f[i, j] += x[tets[t, a], i] * gradients[t, a, j]
        det = (
            f[0, 0] * (f[1, 1] * f[2, 2] - f[1, 2] * f[2, 1])
            - f[0, 1] * (f[1, 0] * f[2, 2] - f[1, 2] * f[2, 0])
            + f[0, 2] * (f[1, 0] * f[2, 1] - f[1, 1] * f[2, 0])
        )
        if det < least:
            least, least_tet = det, t
        square = 0.0
        for i in range(3):
            for j in range(3):
                c[i, j] = f[0, i] * f[0, j] + f[1, i] * f[1, j] + f[2, i] * f[2, j]
                square += (0.5 * (c[i, j] - (1.0 if i == j else 0.0))) ** 2
        if 1.0 - np.sqrt(max(0.0, 1.0 - 2.0 * np.sqrt(square))) > largest:
            low, high = _outer_eigenvalues(c)
            largest = max(largest, np.sqrt(high) - 1.0, 1.0 - np.sqrt(max(low, 0.0)))
    return StrainExtremes(largest, least, least_tet)


@kernel
def _outer_eigenvalues(c: Floats) -> tuple[float, float]:
    """Smallest and largest eigenvalue of a symmetric matrix (3, 3), by its invariants.

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
    angle = np.arccos(min(1.0, max(-1.0, half_det))) / 3.0
    return mean + 2.0 * spread * np.cos(angle + 2.0 * np.pi / 3.0), mean + 2.0 * spread * np.cos(angle)
