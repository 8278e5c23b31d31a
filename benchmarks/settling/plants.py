"""The two plants: the needle in quasi-static equilibrium, and one linearised dynamic solve a step."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

Json = dict[str, Any]

DENSITY_KG_M3 = 1000.0  # of soft tissue [cited]


@dataclass(frozen=True)
class Plant:
    """What is steered. changes: blocks of the scenario that differ from the defaults."""

    name: str
    title: str
    density_kg_m3: float
    mode: str

    def blocks(self) -> Json:
        """Fields of a scenario's tissue and solver."""
        return {"tissue": {"density_kg_m3": self.density_kg_m3}, "solver": {"mode": self.mode}}


CONVERGED = Plant("converged", "quasi-static, converged", 0.0, "converged")
LINEARISED = Plant("linearised", "1000 kg/m³, one linearised solve a step", DENSITY_KG_M3, "linearised")
PLANTS = (CONVERGED, LINEARISED)
