"""Which mesh is worth its time: error of the tip over milliseconds a step, uniform and graded blocks.

Base poses of I-FEM on the default are replayed open loop in every mesh, along a line, a sine along x, one along y and a
steep path. The error is the root of the mean square distance of the tip, along the path, from that in the finest
uniform mesh; how far the finest graded one is from it is printed beside, since no one knows the limit better than that.
Quadratic tetrahedra are no mesh of the plant: what linear ones owe to them is part of the line's compliance already.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from benchmarks.builtin_scenarios import with_blocks
from benchmarks.measurements import Part, Table, figure
from benchmarks.observed_run import ObservedRun, observe
from benchmarks.studies.convergence import PATHS, path_scenario, quantities
from benchmarks.studies.discretisation import FULL, QUICK, Discretisation
from benchmarks.studies.graded_block import graded_block, write_medit
from benchmarks.studies.grid_convergence import size_of
from benchmarks.studies.replayed_poses import replay_block
from benchmarks.svg_plot import Line, Panel, svg
from simcore.errors import Status
from simcore.scenario.scenario import StraightTrajectory

if TYPE_CHECKING:
    from pathlib import Path

    from benchmarks.ports import BenchPorts
    from simcore.scenario.scenario import Scenario, Tissue


@dataclass(frozen=True)
class Candidate:
    """Even cells of about size_mm; grading: see `graded_block`, 0 = uniform."""

    size_mm: float
    grading: float = 0.0

    @property
    def family(self) -> str:
        """Meshes that differ in the size of their cells alone."""
        return f"graded {self.grading:g}" if self.grading else "uniform"

    @property
    def name(self) -> str:
        """For tables."""
        return f"{self.family}, {self.size_mm:g} mm"

    def tissue(self, scenario: Scenario) -> Tissue:
        """The scenario's, in cells of this size."""
        return scenario.tissue.model_copy(update={"element_size_mm": self.size_mm})

    def changes(self, scenario: Scenario, folder: Path) -> dict[str, Any]:
        """Blocks of the scenario with this mesh; a graded one is written to a file in the folder."""
        if not self.grading:
            return {"tissue": {"element_size_mm": self.size_mm}}
        path, tissue = scenario.trajectory, self.tissue(scenario)
        assert isinstance(path, StraightTrajectory)
        ends = np.array(path.entry_mm), np.array(path.target_mm)
        box, nodes = graded_block(np.array(tissue.size_mm), tissue.cells, *ends, self.grading)
        file = folder / f"{scenario.name}-{self.size_mm:g}-{self.grading:g}.mesh"
        write_medit(file, nodes, box.tets)
        return {"tissue": {"mesh_file": str(file), "fixed_faces": ["y_min", "y_max"]}}


@dataclass(frozen=True)
class Measured:
    """A mesh along a path. error_mm: of the tip along it, NaN if the run failed; plant_ms: median of its steps."""

    candidate: Candidate
    path: str
    nodes: int
    error_mm: float
    plant_ms: float


CANDIDATES = (
    *(Candidate(size) for size in (10.0, 8.0, 6.0, 5.0, 4.0)),
    *(Candidate(size, grading) for grading in (1.5, 3.0) for size in (10.0, 8.0, 6.0)),
)
REFERENCE = Candidate(3.5)
QUICK_CANDIDATES, QUICK_REFERENCE = (Candidate(15.0), Candidate(15.0, 1.5)), Candidate(12.0)


def work_precision(ports: BenchPorts) -> Part:
    """Every mesh along every path, one after the other in this process, so that the times can be compared."""
    chosen, candidates, reference = (
        (QUICK, QUICK_CANDIDATES, QUICK_REFERENCE) if ports.quick else (FULL, CANDIDATES, REFERENCE)
    )
    found = [
        one
        for number, path in enumerate(PATHS, 1)
        for one in along_path(ports, path, chosen, (*candidates, reference), f"{number} of {len(PATHS)}")
    ]
    table = _table(found)
    figures = tuple(
        figure(f"work-precision.{candidate.name}.error", "mm", [_worst(found, candidate)])
        for candidate in dict.fromkeys(one.candidate for one in found)
    )
    return Part(figures, (table,), {"work_precision.md": _markdown(table), "work_precision.svg": _picture(found)})


def along_path(
    ports: BenchPorts, path: str, chosen: Discretisation, candidates: tuple[Candidate, ...], count: str
) -> list[Measured]:
    """One path; the last candidate is the reference."""
    ports.say(f"work-precision: path {count}, {path}: I-FEM, whose base poses are replayed")
    base = path_scenario(path, chosen, quick=ports.quick)
    source = observe(base)
    poses = replay_block(source.series, dt_s=base.dt_s, new_dt_s=base.dt_s)
    runs: dict[Candidate, ObservedRun] = {}
    for candidate in candidates:
        ports.say(f"work-precision: path {count}, {path}: {candidate.name}")
        changes = candidate.changes(base, ports.folder)
        runs[candidate] = observe(with_blocks(base, **changes, controller=poses, name=f"{path} {candidate.name}"))
    end_s = min(float(run.series["t_s"][-1]) for run in runs.values() if run.status == Status.COMPLETED)
    assert isinstance(base.trajectory, StraightTrajectory)
    speed = base.trajectory.speed_mm_s
    exact = quantities(runs[candidates[-1]], end_s, speed)["tip_path_mm"]
    return [
        Measured(candidate, path, _nodes(candidate, base), _error(run, exact, end_s, speed), _plant_ms(run))
        for candidate, run in runs.items()
    ]


def _nodes(candidate: Candidate, scenario: Scenario) -> int:
    return int(np.prod([cells + 1 for cells in candidate.tissue(scenario).cells]))


def _error(run: ObservedRun, exact: Any, end_s: float, speed_mm_s: float) -> float:
    if run.status != Status.COMPLETED:
        return float("nan")
    return size_of(quantities(run, end_s, speed_mm_s)["tip_path_mm"] - exact)


def _plant_ms(run: ObservedRun) -> float:
    return 1e3 * float(np.median(run.series["plant_s"][1:]))


def _worst(found: list[Measured], candidate: Candidate) -> float:
    return float(np.max([one.error_mm for one in found if one.candidate == candidate]))


def _table(found: list[Measured]) -> Table:
    paths = list(dict.fromkeys(one.path for one in found))
    rows = []
    for candidate in dict.fromkeys(one.candidate for one in found):
        mine = {one.path: one for one in found if one.candidate == candidate}
        errors = [mine[path].error_mm for path in paths]
        time = float(np.median([one.plant_ms for one in mine.values()]))
        rows.append((candidate.name, next(iter(mine.values())).nodes, time, *errors, max(errors)))
    columns = ("mesh", "nodes", "ms a step", *(f"{path}, mm" for path in paths), "worst, mm")
    return Table("Error of the tip along the path", columns, tuple(rows))


def _markdown(table: Table) -> str:
    text = (
        "Base poses of I-FEM on the default mesh, replayed open loop, steps of 40 ms. Error: root of the mean square "
        f"distance of the tip from that in the uniform mesh of {REFERENCE.size_mm:g} mm, along the path. Graded g: the "
        "small cells follow the straight line from the entry to the target, at it g / sinh g of uniform ones. Time: "
        "median of the plant's step."
    )
    picture = "![error over time](work_precision.svg)"
    return f"# Work and precision\n\n{text}\n\n{picture}\n\n## {table.title}\n\n{table.markdown()}"


def _picture(found: list[Measured]) -> str:
    panels = []
    for path in dict.fromkeys(one.path for one in found):
        mine = [one for one in found if one.path == path and one.error_mm > 0.0]
        families = dict.fromkeys(one.candidate.family for one in mine)
        lines = []
        for family in families:
            ones = [one for one in mine if one.candidate.family == family]
            lines.append(Line(family, [one.plant_ms for one in ones], [one.error_mm for one in ones], markers=True))
        panels.append(Panel(path, "ms a step", "error of the tip, mm", tuple(lines), x_log=True, y_log=True))
    return svg([panels[:2], panels[2:]], title="Error of the tip over the time of a step", width=1000, height=320)
