"""How far the default discretisation is from its limit: three meshes and three spacings, the same base poses in all.

The poses are those of I-FEM on the default discretisation, made once for each path and replayed open loop: a closed
loop would steer the error of the discretisation away and hide it; what it leaves is in `closed_loop`. What is
compared: where the tip is, at the end and along the path; the mean lateral force at the entry over the first 12 mm;
the mean push on the base.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.builtin_scenarios import with_blocks
from benchmarks.observed_run import ObservedRun, observe
from benchmarks.studies.closed_loop import closed_loops
from benchmarks.studies.convergence_report import PathBands, QuantityBand, band_part
from benchmarks.studies.discretisation import FULL, QUICK, QUICK_SHARE
from benchmarks.studies.grid_convergence import GridBand, grid_band, size_of
from benchmarks.studies.replayed_poses import replay_block
from benchmarks.studies.sweeps import at_times
from simcore.scenario.scenario import Scenario, StraightTrajectory

if TYPE_CHECKING:
    from collections.abc import Sequence

    from benchmarks.measurements import Part
    from benchmarks.ports import BenchPorts
    from benchmarks.studies.discretisation import Discretisation, Series

Values = NDArray[np.float64]

ENTRY_DEPTH_MM = 12.0  # the entry force is compared over so much of the path
SAMPLES_MM = 1.0
QUANTITIES = ("tip_end_mm", "tip_path_mm", "entry_force_n", "push_n")


SINE = {"kind": "sine", "amplitude_mm": 1.0}
PATHS: dict[str, dict[str, Any]] = {
    "line": {"kind": "line", "target_mm": [18.0, 31.0, 122.0]},
    "sine-x": {**SINE, "target_mm": [24.0, 38.0, 110.0], "direction": [1.0, 0.0, 0.0]},
    "sine-y": {**SINE, "target_mm": [24.0, 38.0, 110.0], "direction": [0.0, 1.0, 0.0]},
    "steep-73+y": {**SINE, "target_mm": [24.357, 59.23, 122.0], "direction": [0.0, 1.0, 0.0]},
}
SUITES = {"LIN": ("line",), "CUR": ("sine-x", "sine-y", "steep-73+y")}  # whose worst band a suite carries


def convergence(ports: BenchPorts) -> Part:
    """Bands of the default: under the same base poses, and of closed loops."""
    chosen = QUICK if ports.quick else FULL
    return band_part(chosen.dt_s, replayed_bands(ports, chosen), SUITES, closed_loops(ports), chosen)


def replayed_bands(ports: BenchPorts, chosen: Discretisation) -> list[PathBands]:
    """I-FEM once a path, then every discretisation under its base poses."""
    sources: dict[str, tuple[Scenario, ObservedRun]] = {}
    for name in PATHS:
        ports.say(f"convergence: I-FEM along {name}, whose base poses are replayed")
        scenario = path_scenario(name, chosen, quick=ports.quick)
        sources[name] = scenario, observe(scenario)
    replays = {
        (name, series.name, i): _replay(*sources[name], changes, f"{name} {series.name} {series.sizes_mm[i]:g}")
        for name in PATHS
        for series in chosen.series()
        for i, changes in enumerate(series.changes)
    }
    distinct = {scenario.model_dump_json(exclude={"name"}): scenario for scenario in replays.values()}
    ports.say(f"convergence: {len(distinct)} replays")
    with ports.crew(2) as crew:
        found = dict(zip(distinct, crew.run_many(list(distinct.values())), strict=True))
    runs = {key: found[scenario.model_dump_json(exclude={"name"})] for key, scenario in replays.items()}
    return [
        path_bands(name, chosen.series(), {key[1:]: run for key, run in runs.items() if key[0] == name}, scenario)
        for name, (scenario, _) in sources.items()
    ]


def path_scenario(name: str, chosen: Discretisation, *, quick: bool) -> Scenario:
    """The run whose poses are replayed. quick: the first part of the path."""
    path = {"entry_mm": [18.0, 31.0, 0.0], **PATHS[name]}
    if quick:
        entry, target = np.array(path["entry_mm"]), np.array(path["target_mm"])
        path["target_mm"] = (entry + QUICK_SHARE * (target - entry)).tolist()
    return Scenario.load(
        {
            "name": name,
            "dt_s": chosen.dt_s,
            "tissue": {"element_size_mm": chosen.element_size_mm},
            "interaction": {"spacing_mm": chosen.spacing_mm},
            "trajectory": path,
            "controller": {"kind": "ifem"},
            "recording": {"enabled": False},
        }
    )


def _replay(base: Scenario, source: ObservedRun, changes: dict[str, Any], name: str) -> Scenario:
    poses = replay_block(source.series, dt_s=base.dt_s, new_dt_s=base.dt_s)
    return with_blocks(base, **changes, controller=poses, name=name)


def path_bands(
    name: str, series: Sequence[Series], runs: dict[tuple[str, int], ObservedRun], scenario: Scenario
) -> PathBands:
    """Bands of every quantity along one path; the path ends where the shortest run does."""
    end_s = min(float(run.series["t_s"][-1]) for run in runs.values())
    assert isinstance(scenario.trajectory, StraightTrajectory)
    speed = scenario.trajectory.speed_mm_s
    results = {key: quantities(run, end_s, speed) for key, run in runs.items()}
    bands = {}
    for quantity in QUANTITIES:
        parts: dict[str, GridBand] = {
            s.name: grid_band([results[s.name, i][quantity] for i in range(3)], s.sizes_mm) for s in series
        }
        values = {(s.name, size): results[s.name, i][quantity] for s in series for i, size in enumerate(s.sizes_mm)}
        default = results[series[0].name, 1][quantity]
        apart = {key: size_of(value - default) for key, value in values.items()}
        size = None if quantity.startswith("tip") else size_of(default)
        bands[quantity] = QuantityBand(parts, apart, size)
    statuses = {f"{key[0]} {series_of(series, key[0]).sizes_mm[key[1]]:g}": run.status for key, run in runs.items()}
    return PathBands(name, end_s * speed, statuses, bands)


def series_of(series: Sequence[Series], name: str) -> Series:
    """The one of that name."""
    return next(one for one in series if one.name == name)


def quantities(run: ObservedRun, end_s: float, speed_mm_s: float) -> dict[str, Values]:
    """Of a run up to end_s: tip at the end (1, 3) and each millimetre (k, 3), mm; mean forces (1,), N."""
    times = np.append(np.arange(SAMPLES_MM / speed_mm_s, end_s, SAMPLES_MM / speed_mm_s), end_s)
    tip = 1e3 * at_times(run, "tip_m", times)
    early = times <= ENTRY_DEPTH_MM / speed_mm_s + 1e-9
    entry, push = at_times(run, "entry_force_n", times[early]), at_times(run, "insertion_force_n", times)
    return dict(zip(QUANTITIES, (tip[-1:], tip, entry.mean(keepdims=True), push.mean(keepdims=True)), strict=True))
