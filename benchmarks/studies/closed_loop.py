"""How far the errors of closed loops are from their limit: what a claim about a controller's RMSE is measured against.

Each controller, undelayed, steers the same paths in three meshes, at three spacings and with two balls; with the
insertions' time step, which is also the period of control and is not varied. The claims are about the RMSE of one
controller and about the paired difference of two, and a difference may depend less on the mesh than either: both have
a band. The paths are two straight ones and six sines in four directions, with end points all over the face, among them
the steepest that is known; none of them is one of the settling experiment.

The rule was fixed before the first run:

- Band of a quantity along a path: mesh, spacing and ball added up, `ranged_band` for three sizes and
  `two_grid_band` for the two balls. It says how far the default may be from the limit.
- A closed loop steers most of the discretisation's error away; what is left of it is small, and scattered rather than
  of an order, since the meshes are not similar to each other (even counts of cells that fit the block). So where no
  order between 0.5 and 2 is observed, the band is three times the data range, after Eca and Hoekstra: the results say
  how much they scatter, and no rate. `grid_band` is not used here for two reasons. It takes the range once where
  results swing, and three scattered results lie closer together than the 95 % that Roache's index stands for;
  where they do not swing it divides the last change by r - 1 = 0.36, along an order that was just refused. Which of the
  two it does, by a factor of nine, is chance when results scatter.
- A suite carries the widest band of its paths. A quantity that rests on a run that did not reach the end has no band
  along that path, and then the suite has none: unknown.
- rcm_max_mm is description and has no band.

The ELM is the packaged one, trained on the default discretisation, in all of them: its band also holds what it loses on
a plant other than its own.
"""

from __future__ import annotations

import hashlib
import json
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from benchmarks.builtin_scenarios import with_blocks
from benchmarks.paper.suites import Path
from benchmarks.studies.discretisation import FULL, LOOP_DT_S, QUICK, QUICK_SHARE
from benchmarks.studies.grid_convergence import GridBand, ranged_band, two_grid_band
from simcore.provenance import commit
from simcore.scenario.scenario import Scenario

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from benchmarks.observed_run import ObservedRun
    from benchmarks.ports import BenchPorts, Crew
    from benchmarks.studies.discretisation import Discretisation, Series

CONTROLLERS: dict[str, dict[str, Any]] = {
    "ifem": {"kind": "ifem"},
    "ifem-axis": {"kind": "ifem", "orientation": "axis"},
    "elm": {"kind": "elm", "model": "default"},
}
DIFFERENCES = {"elm minus ifem": ("elm", "ifem"), "elm minus ifem-axis": ("elm", "ifem-axis")}
LOOP_PATHS = (
    Path(13), Path(73),
    Path(2, "-y"), Path(13, "+x"), Path(70, "-y"), Path(73, "+y"), Path(81, "-x"), Path(93, "+y"),
)  # fmt: skip
QUICK_PATHS = (Path(13), Path(2, "-y"))
STORE = "closed_loop_runs.json"
COMPLETED = "completed"
Key = tuple[str, str, float]  # controller, name of a series, size in mm


@dataclass(frozen=True)
class LoopRun:
    """What is kept of one run, mm."""

    status: str
    rmse_commanded_mm: float | None
    rcm_max_mm: float | None


@dataclass(frozen=True)
class LoopBand:
    """Of one quantity along one path, mm. values: by (series, size), the default under each series. parts: by
    series; None where a run did not reach the end."""

    values: Mapping[tuple[str, float], float | None]
    parts: Mapping[str, GridBand] | None

    @property
    def band(self) -> float | None:
        """Of the default from the limit: mesh, spacing and ball added up; None = unknown."""
        return None if self.parts is None else sum(part.default for part in self.parts.values())


@dataclass(frozen=True)
class LoopPath:
    """All runs along one path."""

    name: str
    suite: str
    series: tuple[Series, ...]
    runs: Mapping[Key, LoopRun]

    def value(self, quantity: str, series: str, size_mm: float) -> float | None:
        """RMSE of a controller, or a paired difference of two, mm; None if a run did not reach the end."""
        names = DIFFERENCES.get(quantity, (quantity,))
        runs = [self.runs[name, series, size_mm] for name in names]
        errors = [
            run.rmse_commanded_mm for run in runs if run.status == COMPLETED and run.rmse_commanded_mm is not None
        ]
        if len(errors) < len(names):
            return None
        return errors[0] - sum(errors[1:])

    def band(self, quantity: str) -> LoopBand:
        """Of a controller, or of a difference."""
        values = {(s.name, h): self.value(quantity, s.name, h) for s in self.series for h in s.sizes_mm}
        if any(value is None for value in values.values()):
            return LoopBand(values, None)
        parts = {}
        for series in self.series:
            results = [np.array([values[series.name, h]], float) for h in series.sizes_mm]
            rule = two_grid_band if len(results) == 2 else ranged_band
            parts[series.name] = rule(results, series.sizes_mm)
        return LoopBand(values, parts)


def quantities() -> tuple[str, ...]:
    """Whatever has a band."""
    return (*CONTROLLERS, *DIFFERENCES)


def loop_suite_bands(paths: Sequence[LoopPath]) -> dict[str, dict[str, float | None]]:
    """By suite and quantity the widest band of its paths, mm; None if one of them has none."""
    suites: dict[str, dict[str, float | None]] = {}
    for suite in dict.fromkeys(path.suite for path in paths):
        mine = [path for path in paths if path.suite == suite]
        suites[suite] = {quantity: _widest([path.band(quantity).band for path in mine]) for quantity in quantities()}
    return suites


def _widest(bands: Sequence[float | None]) -> float | None:
    known = [band for band in bands if band is not None]
    return max(known) if len(known) == len(bands) else None


# ---- the runs


def closed_loops(ports: BenchPorts) -> list[LoopPath]:
    """Every controller along every path in every discretisation; each path is kept when it is done."""
    chosen, paths = (QUICK, QUICK_PATHS) if ports.quick else (FULL, LOOP_PATHS)
    kept = _kept_runs(ports.kept(STORE))
    done = []
    with ports.crew(2) as crew:
        for i, path in enumerate(paths):
            ports.say(f"closed loop: path {i + 1} of {len(paths)}, {path.name}")
            wanted = loop_scenarios(path, chosen, quick=ports.quick)
            kept |= _missing_runs(crew, wanted, kept)
            ports.keep(
                STORE, json.dumps({"commit": commit(), "runs": {k: asdict(r) for k, r in kept.items()}}, indent=1)
            )
            runs = {key: kept[identity(scenario)] for key, scenario in wanted.items()}
            done.append(LoopPath(path.name, path.group, chosen.loop_series(), runs))
    return done


def loop_scenarios(path: Path, chosen: Discretisation, *, quick: bool) -> dict[Key, Scenario]:
    """All of one path. quick: the first part of it."""
    trajectory = path.trajectory()
    if quick:
        entry, target = np.array(trajectory["entry_mm"]), np.array(trajectory["target_mm"])
        trajectory["target_mm"] = (entry + QUICK_SHARE * (target - entry)).tolist()
    found = {}
    for name, controller in CONTROLLERS.items():
        base = Scenario.load(
            {
                "name": f"{path.name}-{name}",
                "dt_s": LOOP_DT_S,
                "trajectory": trajectory,
                "controller": controller,
                "recording": {"enabled": False},
            }
        )
        for series in chosen.loop_series():
            for size, changes in zip(series.sizes_mm, series.changes, strict=True):
                title = f"{base.name} {series.name} {size:g}"
                found[name, series.name, size] = with_blocks(base, **changes, name=title)
    return found


def identity(scenario: Scenario) -> str:
    """Of everything but the name: the default stands in every series and is run once."""
    return hashlib.sha256(scenario.model_dump_json(exclude={"name"}).encode()).hexdigest()


def _missing_runs(crew: Crew, wanted: Mapping[Key, Scenario], kept: Mapping[str, LoopRun]) -> dict[str, LoopRun]:
    missing = {identity(scenario): scenario for scenario in wanted.values() if identity(scenario) not in kept}
    if not missing:
        return {}
    return dict(zip(missing, map(_loop_run, crew.run_many(list(missing.values()))), strict=True))


def _loop_run(run: ObservedRun) -> LoopRun:
    return LoopRun(run.status, run.metrics.get("rmse_commanded_mm"), run.metrics.get("rcm_max_mm"))


def _kept_runs(text: str | None) -> dict[str, LoopRun]:
    """Of an interrupted study by the same code; a changed checkout is not the same."""
    known = commit()
    document = json.loads(text) if text else {}
    if known is None or known.endswith("-dirty") or document.get("commit") != known:
        return {}
    return {key: LoopRun(**run) for key, run in document["runs"].items()}
