"""Forces measured on a needle in bovine liver, to compare with the simulated curve. Nothing is fitted to them.

Okamura, Simone and O'Leary 2004, Force modeling for needle insertion into soft tissue, IEEE Transactions on Biomedical
Engineering 51(10), 1707-1716: a bevel-tip needle of 1.27 mm (18 gauge), liver ex vivo at room temperature. Puncture:
19 insertions at 3 mm/s. Cutting: 5 insertions at 3 mm/s, measured force less friction. Friction per length of contact:
needle moved to and fro at 0.2 Hz with up to 20 mm/s in an existing channel.

The paper was not at hand. The numbers are those of public reading notes that say they were checked against it:
github.com/Yuming-007/Needle-Tissue-Simulation, docs/literature/05_Okamura2004_force_modeling.md, commit 3dde32c.
"""

from __future__ import annotations

from dataclasses import dataclass

CITATION = "Okamura et al. 2004"


@dataclass(frozen=True)
class MeanAndDeviation:
    """Mean and standard deviation, in the unit of the name."""

    mean: float
    deviation: float

    def __str__(self) -> str:
        return f"{self.mean:.4g} ± {self.deviation:.3g}"


PUNCTURE_N = MeanAndDeviation(2.304, 0.829)
PUNCTURE_DEPTH_MM = MeanAndDeviation(16.65, 3.55)
CUTTING_N = MeanAndDeviation(0.94, 0.36)
COULOMB_N_PER_M = {"in": MeanAndDeviation(10.57, 4.34), "out": MeanAndDeviation(11.96, 4.40)}
VISCOUS_N_S_PER_M2 = {"in": MeanAndDeviation(212.31, 45.70), "out": MeanAndDeviation(293.08, 30.73)}
FASTEST_MM_S = 20.0
DEEPEST_MM = 50.0  # of the insertions shown in the paper


def friction_n_per_mm(way: str, speed_mm_s: float) -> MeanAndDeviation:
    """Size of the kinetic friction per length of contact, N/mm, on the way "in" or "out".

    The two deviations are added, as if Coulomb and viscous part varied together. Raises ValueError for a speed beyond
    those measured.
    """
    if not 0.0 < speed_mm_s <= FASTEST_MM_S:
        raise ValueError(f"speed_mm_s = {speed_mm_s:g}: friction was measured above 0 and up to {FASTEST_MM_S:g} mm/s")
    coulomb, viscous, speed_m_s = COULOMB_N_PER_M[way], VISCOUS_N_S_PER_M2[way], 1e-3 * speed_mm_s
    return MeanAndDeviation(
        1e-3 * (coulomb.mean + viscous.mean * speed_m_s),
        1e-3 * (coulomb.deviation + viscous.deviation * speed_m_s),
    )
