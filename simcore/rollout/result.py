"""The result of a run."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from simcore.provenance import provenance
from simcore.rollout.authority import authority_warnings
from simcore.rollout.digest import digest

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from simcore.errors import Status
    from simcore.scenario.scenario import Scenario

TIMES = ("plant_s", "jacobian_s", "command_s", "recording_s")  # clock readings of a step, s
FRAMES = ("tissue_m", "tissue_frame_step")  # kept tissue states and their steps


@dataclass(frozen=True)
class Rollout:
    """One finished run: how it ended, what happened, what it is worth, how long it took."""

    scenario: Scenario
    status: Status
    message: str
    series: dict[str, NDArray[Any]]
    metrics: dict[str, Any]
    timing: dict[str, Any]
    solver: dict[str, Any]

    @property
    def success(self) -> bool:
        """Completed, reached the end, never lost the target (see `metrics`)."""
        return bool(self.metrics["success"])

    @property
    def digest(self) -> str:
        """SHA-256 over the states, see `simcore.rollout.digest`."""
        return digest(self.series)

    @property
    def warnings(self) -> list[str]:
        """What the run showed that calls for a second look, beside what the scenario warns of."""
        return authority_warnings(self.series, self.scenario.controller)

    def result(self) -> dict[str, Any]:
        """The content of result.json."""
        return {
            "status": str(self.status),
            "message": self.message,
            "metrics": self.metrics,
            "timing": self.timing,
            "solver": self.solver,
            "digest": self.digest,
            "warnings": [*self.scenario.warnings(), *self.warnings],
            "provenance": provenance(self.scenario.resolved()),
        }
