"""The result of a run."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from simcore.provenance import provenance
from simcore.rollout.cautions import run_warnings
from simcore.rollout.digest import digest
from simcore.rollout.table import columns_of, rows_of

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from simcore.errors import Status
    from simcore.scenario.scenario import Scenario

TIMES = ("plant_s", "jacobian_s", "command_s", "recording_s")  # clock readings of a step, s
FRAMES = (  # of the kept states, and their steps
    "tissue_m",
    "tissue_frame_step",
    "shaft_m",
    "contact_points_m",
    "contact_forces_n",
    "strain_energy_j",
    "max_von_mises_pa",
)
DERIVED = ("min_det_f_at_m", "max_strain", "entry_drag_m", "needle_stress_pa")  # from the states of both bodies


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
        """Followed the path to its end, with a needle below its yield stress (see `metrics`)."""
        return bool(self.metrics["success"])

    @property
    def digest(self) -> str:
        """SHA-256 over the states, see `simcore.rollout.digest`."""
        return digest(self.series)

    @property
    def held(self) -> dict[str, Any]:
        """What of the tissue was held: faces, sets, regions, and the number of nodes in them."""
        tissue = self.scenario.tissue
        return {
            "faces": list(tissue.held_faces),
            "sets": list(tissue.fixed_sets),
            "regions": [region.model_dump(mode="json") for region in tissue.fixed_regions],
            "nodes": self.solver["held_nodes"],
        }

    @property
    def warnings(self) -> list[str]:
        """What the run showed that calls for a second look, beside what the scenario warns of."""
        return run_warnings(self.series, self.scenario)

    def to_dataframe(self) -> Any:
        """The series as a pandas DataFrame, one row a step, one column a component (tip_m_x ...), the time t_s as its
        index; what has another number of rows, such as the frames of the tissue, stays in `series`. Raises
        ModuleNotFoundError without pandas, which needlebench does not need."""
        import pandas

        return pandas.DataFrame(columns_of(rows_of(self.series))).set_index("t_s")

    def result(self) -> dict[str, Any]:
        """The content of result.json."""
        return {
            "status": str(self.status),
            "message": self.message,
            "metrics": self.metrics,
            "timing": self.timing,
            "solver": self.solver,
            "held": self.held,
            "digest": self.digest,
            "warnings": [*self.scenario.warnings(), *self.warnings],
            "provenance": provenance(self.scenario.resolved()),
        }
