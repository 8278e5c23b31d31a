"""How large the settling experiment is, and its discretisation."""

from __future__ import annotations

from pydantic import Field

from benchmarks.paper.scale import ExperimentScale
from benchmarks.settling.plants import CONVERGED, Plant

END_POINTS = (0, 1, 3, 4, 6, 7, 8, 9, 10, 15, 17, 19, 22, 23, 25, 27, 33, 42, 50, 57)
"""Of CUR's 100: the first in each of 4 x 5 equal parts of the face without its margin, without EXPLORED."""
EXPLORED = (2, 13, 66, 73, 81)  # along which row weights were tried before this plan was fixed
MODEL = (
    "ELM of the {} plant: a file, relative to the folder of the run; default = the packaged one, null = trained here"
)


class SettlingScale(ExperimentScale):
    """Which part of the plan is run. Only `full` is the experiment: budget, margin and tests are no fields."""

    end_points: int = Field(20, ge=1, le=len(END_POINTS), description="of the fixed list, the first ones")
    directions: int = Field(4, ge=1, le=4, description="of the sine at each; fewer than four are taken in turn")
    ifem_delay_steps: int = Field(2, ge=1, le=100, description="steps by which I-FEM's delayed cells are late")
    elm_delay_steps: int = Field(1, ge=1, le=100, description="steps by which the ELM's control cells are late")
    converged_model: str | None = Field(None, min_length=1, max_length=1000, description=MODEL.format("converged"))
    linearised_model: str | None = Field(None, min_length=1, max_length=1000, description=MODEL.format("linearised"))

    @property
    def ifem_delay_s(self) -> float:
        """Delay of I-FEM's delayed cells, s."""
        return round(self.ifem_delay_steps * self.dt_s, 9)

    @property
    def elm_delay_s(self) -> float:
        """Delay of the ELM's control cells, s."""
        return round(self.elm_delay_steps * self.dt_s, 9)

    def named_model(self, plant: Plant) -> str | None:
        """The model that is not trained here."""
        return self.converged_model if plant == CONVERGED else self.linearised_model

    def model_of(self, plant: Plant) -> str:
        """The file of the ELM that steers this plant."""
        return self.named_model(plant) or f"models/elm-{plant.name}.json"


SCALES = {
    "smoke": SettlingScale(
        name="smoke", element_size_mm=12.0, dt_s=0.05, training=8, samples=1000, end_points=1, directions=2
    ),
    "full": SettlingScale(name="full"),
}
