"""What a strained tissue stores and bears: its elastic energy and its largest von Mises stress."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from simcore.compiled import kernel
from simcore.tissue.strain import outer_eigenvalues

if TYPE_CHECKING:
    from simcore.arrays import Floats, Ints


class Stored(NamedTuple):
    """Of the whole tissue: elastic energy, J, and the largest von Mises stress of any tetrahedron, Pa."""

    energy_j: float
    von_mises_pa: float


@kernel
def stored(x: Floats, tets: Ints, gradients: Floats, volumes: Floats, mu: float, lam: float) -> Stored:
    """Of co-rotational linear elasticity, nodes at x (n, 3) m; tets (t, 4), gradients (t, 4, 3) 1/m, volumes (t,) m3;
    Lame's constants in Pa.

    The strain is U - I, F = R U, so it has the principal values e_i = s_i - 1 of the stretches, and the stress
    2 mu e_i + lambda tr e. Damping is left out.
    """
    c, e = np.empty((3, 3)), np.empty(3)
    energy, most = 0.0, 0.0
    for t in range(len(tets)):
        for i in range(3):
            for j in range(3):
                c[i, j] = 0.0
        for k in range(3):
            f0, f1, f2 = 0.0, 0.0, 0.0
            for a in range(4):
                place = x[tets[t, a], k]
                f0 += place * gradients[t, a, 0]
                f1 += place * gradients[t, a, 1]
                f2 += place * gradients[t, a, 2]
            c[0, 0] += f0 * f0
            c[0, 1] += f0 * f1
            c[0, 2] += f0 * f2
            c[1, 1] += f1 * f1
            c[1, 2] += f1 * f2
            c[2, 2] += f2 * f2
        low, high = outer_eigenvalues(c[0, 0], c[1, 1], c[2, 2], c[0, 1], c[0, 2], c[1, 2])
        middle = c[0, 0] + c[1, 1] + c[2, 2] - low - high
        e[0], e[1], e[2] = np.sqrt(max(low, 0.0)) - 1.0, np.sqrt(max(middle, 0.0)) - 1.0, np.sqrt(max(high, 0.0)) - 1.0
        trace = e[0] + e[1] + e[2]
        energy += volumes[t] * (mu * (e[0] ** 2 + e[1] ** 2 + e[2] ** 2) + 0.5 * lam * trace**2)
        apart = (e[0] - e[1]) ** 2 + (e[1] - e[2]) ** 2 + (e[2] - e[0]) ** 2
        most = max(most, apart)
    return Stored(energy, 2.0 * mu * np.sqrt(0.5 * most))
