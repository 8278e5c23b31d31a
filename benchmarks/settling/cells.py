"""What is varied: plant, delay, and how I-FEM treats the remote centre. Each combination is a cell."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from benchmarks.settling.plants import PLANTS, Plant

if TYPE_CHECKING:
    from benchmarks.settling.scale import SettlingScale

Json = dict[str, Any]

ROW_WEIGHTS = (1.0, 0.1, 0.0)  # of the two remote-centre rows; 0 = left out
AXIS = "axis"


@dataclass(frozen=True)
class Cell:
    """One controller on one plant. rows: weight of the remote-centre rows, "axis" for I-FEM's axis through the entry,
    None for the ELM, whose axis always passes through it."""

    arm: str
    plant: Plant
    delay_s: float
    rows: float | str | None = None

    @property
    def name(self) -> str:
        """Good in a file name."""
        rows = "" if self.rows is None else "-axis" if self.rows == AXIS else f"-rows-{self.rows:g}"
        return f"{self.arm}-{self.plant.name}-{1e3 * self.delay_s:g}ms{rows}"

    @property
    def rows_title(self) -> str:
        """How the remote centre is treated, in words."""
        if self.rows is None or self.rows == AXIS:
            return "axis through the entry"
        return f"rows with weight {self.rows:g}" if self.rows else "rows left out"

    def controller(self, scale: SettlingScale) -> Json:
        """The scenario's block."""
        block: Json = {"kind": self.arm, "delay_s": self.delay_s}
        if self.arm == "elm":
            return {**block, "model": scale.model_of(self.plant)}
        return {**block, **({"orientation": AXIS} if self.rows == AXIS else {"rcm_weight": self.rows})}


def ifem_cells(scale: SettlingScale) -> list[Cell]:
    """12 with the remote-centre rows, then 4 with the axis through the entry."""
    delays = (0.0, scale.ifem_delay_s)
    rows = [Cell("ifem", plant, delay, weight) for plant in PLANTS for delay in delays for weight in ROW_WEIGHTS]
    return rows + [Cell("ifem", plant, delay, AXIS) for plant in PLANTS for delay in delays]


def elm_cells(scale: SettlingScale) -> list[Cell]:
    """Each ELM on the plant that it was trained on, undelayed and, as a control, delayed."""
    return [Cell("elm", plant, delay) for plant in PLANTS for delay in (0.0, scale.elm_delay_s)]


def cells(scale: SettlingScale) -> list[Cell]:
    """All 20."""
    return [*ifem_cells(scale), *elm_cells(scale)]


def planned_pairs(scale: SettlingScale) -> list[tuple[Cell, Cell]]:
    """The comparisons that are tested: the undelayed ELM against each of I-FEM's cells on the same plant, 16."""
    undelayed = {cell.plant: cell for cell in elm_cells(scale) if not cell.delay_s}
    return [(undelayed[cell.plant], cell) for cell in ifem_cells(scale)]
