"""The insertions of the settling experiment: data sets first, one for each plant, then every cell along every path."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

from benchmarks.cases import Case
from benchmarks.learning.training_insertions import training_insertions
from benchmarks.paper.plan import Stage, StagedPlan
from benchmarks.paper.suites import SIGNS, Path, case_labels, discretisation, scenario
from benchmarks.settling.cells import Cell, cells
from benchmarks.settling.plants import PLANTS, Plant
from benchmarks.settling.scale import END_POINTS, SettlingScale

CELL, PLANT = "cell", "plant"  # labels


@dataclass(frozen=True)
class SettlingPlan(StagedPlan):
    """20 cells along the same 80 paths."""

    schema: ClassVar[str] = "needlebench/settling-run/1"
    scale: SettlingScale

    @cached_property
    def stages(self) -> tuple[Stage, ...]:
        """Data sets of the ELMs that are trained here, then the cells, path by path: what is there after an
        interruption are whole paths."""
        trained = [plant for plant in PLANTS if self.scale.named_model(plant) is None]
        data = [Stage(data_title(plant), tuple(data_cases(self.scale, plant)), trains=True) for plant in trained]
        tests = [settling_case(self.scale, path, cell) for path in paths(self.scale) for cell in cells(self.scale)]
        return (*data, Stage("cells", tuple(tests)))


def data_title(plant: Plant) -> str:
    """The stage of a plant's data set."""
    return f"data, {plant.name}"


def data_cases(scale: SettlingScale, plant: Plant) -> list[Case]:
    """The paper's data set on this plant."""
    shared, changes = discretisation(scale), plant.blocks()
    changes["tissue"] |= shared.pop("tissue")
    insertions = training_insertions(insertions=scale.training, seed=0, changes={**shared, **changes})
    return [Case(f"{c.id}-{plant.name}", c.scenario, {**c.labels, PLANT: plant.name}) for c in insertions]


def paths(scale: SettlingScale) -> list[Path]:
    """Of CUR: the chosen end points, each along some directions."""
    chosen = END_POINTS[: scale.end_points]
    return [Path(point, SIGNS[(i + k) % 4]) for i, point in enumerate(chosen) for k in range(scale.directions)]


def settling_case(scale: SettlingScale, path: Path, cell: Cell) -> Case:
    """One insertion."""
    name = f"{path.name}-{cell.name}"
    blocks = {**cell.plant.blocks(), "controller": cell.controller(scale)}
    data = scenario(name, scale, seed=0, trajectory=path.trajectory(), **blocks)
    return Case(name, data, case_labels(path, cell.arm, "main", **{CELL: cell.name, PLANT: cell.plant.name}))
