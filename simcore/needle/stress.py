"""How hard the needle is strained: bending and axial strain at both ends of every beam."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from simcore.compiled import kernel
from simcore.needle.beam import Section, deform, stiffness
from simcore.rotations import compose

if TYPE_CHECKING:
    from simcore.arrays import Floats


@kernel
def largest_strain(x: Floats, R: Floats, section: Section, outer_radius_m: float) -> float:
    """Largest r kappa + |N| / EA of the chain x (n+1, 3) m, R (n+1, 3, 3), world; times E it is the largest stress.

    kappa = |M| / EI of the bending moment at either end of a beam, between which it is linear; N is its tension.
    """
    k = stiffness(section)
    scratch = np.empty((2, 3, 3))
    largest = 0.0
    for i in range(len(x) - 1):
        R1, R2 = R[i], R[i + 1]
        if len(section.rest_frames) > 0:
            R1, R2 = compose(R1, section.rest_frames[i, 0]), compose(R2, section.rest_frames[i, 1])
        beam = deform(x[i], x[i + 1], R1, R2, section.element_length_m, k, scratch)
        moment = math.sqrt(max(beam.m1[0] ** 2 + beam.m1[1] ** 2, beam.m2[0] ** 2 + beam.m2[1] ** 2))
        strain = outer_radius_m * moment / section.bending_nm2 + abs(beam.tension) / section.axial_n
        largest = max(largest, strain)
    return largest
