"""How the result depends on the discretisation: the same base poses replayed with another mesh, needle, time step,
spacing, spread, coupling along the line, with other fixed faces and solver tolerances.

The tip alone hides locking and forces that depend on the mesh, so the force at the entry, the force on the base and
sum |lambda| are reported with it.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.builtin_scenarios import benchmark_scenario, with_blocks
from benchmarks.observed_run import ObservedRun, observe
from benchmarks.studies.replayed_poses import replay_block
from benchmarks.studies.sweeps_report import VariantRow, study_part
from simcore.scenario.scenario import StraightTrajectory

if TYPE_CHECKING:
    from benchmarks.measurements import Part
    from benchmarks.ports import BenchPorts
    from simcore.scenario.scenario import Scenario

Vector = NDArray[np.float64]

SAMPLES_MM = 1.0


@dataclass(frozen=True)
class Sweep:
    """One parameter. values: label, place on the axis, changes; the reference is what the others are compared with."""

    name: str
    x_label: str
    values: tuple[tuple[str, float, dict[str, Any]], ...]
    default: str
    reference: str
    log: bool = False
    named: bool = field(default=False)


def sweeps(*, quick: bool) -> list[Sweep]:
    """All sweeps; `quick` keeps three or four coarse values of each."""
    h = 10.0 if quick else 6.0
    edges = (15.0, 12.0, 10.0) if quick else (10.0, 8.0, 6.0, 5.0, 4.0)
    beams = (10, 20, 40) if quick else (10, 20, 40, 80)
    dts = (0.01, 0.005) if quick else (0.01, 0.005, 0.002, 0.0012)
    spacings = (6.0, 3.0) if quick else (12.0, 6.0, 4.0, 3.0, 2.0, 1.0)
    spreads = (4.0, 6.0, 8.0) if quick else (3.0, 4.0, 6.0, 8.0)
    tolerances = (1e-4, 1e-5, 1e-6) if quick else (1e-3, 1e-4, 1e-5, 1e-6, 1e-7)
    fine = f"{edges[-1]:g}"
    return [
        Sweep("mesh", "h, mm", _values(edges, _edge), f"{h:g}", fine),
        Sweep("beams", "beams", _values(beams, _beams), "20", f"{beams[-1]}", log=True),
        Sweep("dt", "dt, ms", tuple((f"{1e3 * v:g}", 1e3 * v, {"dt_s": v}) for v in dts), "10", f"{1e3 * dts[-1]:g}"),
        Sweep("spacing", "spacing, mm", _values(spacings, _spacing), "3", f"{spacings[-1]:g}"),
        Sweep("spread", "spread, mm", _values(spreads, _spread), "6", "6"),
        Sweep("coupling", "", _coupling_values(), "free tip", "free tip", named=True),
        Sweep("faces", "", _face_values(), "y", "y", named=True),
        Sweep(
            "tolerance",
            "tolerance, N and mm",
            _values(tolerances, _tolerance),
            "1e-05",
            f"{tolerances[-1]:g}",
            log=True,
        ),
    ]


def _values(numbers: tuple[float, ...], change: Any) -> tuple[tuple[str, float, dict[str, Any]], ...]:
    return tuple((f"{v:g}", float(v), change(v)) for v in numbers)


def _edge(h: float) -> dict[str, Any]:
    return {"tissue": {"element_size_mm": h}}


def _beams(count: int) -> dict[str, Any]:
    return {"needle": {"elements": count}}


def _spacing(spacing: float) -> dict[str, Any]:
    return {"interaction": {"spacing_mm": spacing}}


def _spread(radius: float) -> dict[str, Any]:
    return {"interaction": {"spread_mm": radius}}


def _tolerance(value: float) -> dict[str, Any]:
    return {"solver": {"force_tolerance_n": value, "violation_tolerance_mm": value}}


def _coupling_values() -> tuple[tuple[str, float, dict[str, Any]], ...]:
    """Compliant points with either tip, and hard ones, which have no limit as they and the mesh become finer."""
    ways: dict[str, dict[str, Any]] = {
        "free tip": {},
        "held tip": {"tip": "held"},
        "hard": {"line_compliance": False, "tip": "held", "spacing_mm": None},
    }
    return tuple((name, float(i), {"interaction": fields}) for i, (name, fields) in enumerate(ways.items()))


def _face_values() -> tuple[tuple[str, float, dict[str, Any]], ...]:
    sides = {
        "y": None,  # the default: y_min and y_max
        "y+z": ["y_min", "y_max", "z_max"],
        "y+x0": ["y_min", "y_max", "x_min"],
        "y+x": ["y_min", "y_max", "x_min", "x_max"],
        "z": ["z_max"],
    }
    return tuple((name, float(i), {"tissue": {"fixed_faces": faces}}) for i, (name, faces) in enumerate(sides.items()))


def sweeps_study(ports: BenchPorts) -> Part:
    """The I-FEM run at the default, then all variants under its base poses."""
    base = benchmark_scenario("sine", quick=ports.quick, changes=("recording.enabled=false",))
    ports.say("sweeps: the run whose base poses are replayed")
    source_run = observe(base)
    studies = sweeps(quick=ports.quick)
    scenarios = {
        (s.name, label): _replay(base, source_run, changes, f"{s.name} {label}")
        for s in studies
        for label, _, changes in s.values
    }
    distinct = {scenario.model_dump_json(exclude={"name"}): scenario for scenario in scenarios.values()}
    ports.say(f"sweeps: {len(distinct)} replays")
    with ports.crew(2) as crew:
        results = dict(zip(distinct, crew.run_many(list(distinct.values())), strict=True))
    runs = {key: results[scenario.model_dump_json(exclude={"name"})] for key, scenario in scenarios.items()}
    assert isinstance(base.trajectory, StraightTrajectory)
    speed_mm_s = base.trajectory.speed_mm_s
    rows = [row for sweep in studies for row in _rows(sweep, runs, speed_mm_s)]
    depth_runs = {label: runs["mesh", label] for label, _, _ in studies[0].values}
    return study_part(base, source_run, [(s.name, s.x_label, s.log, s.named) for s in studies], rows, depth_runs)


def _replay(base: Scenario, source_run: ObservedRun, changes: dict[str, Any], name: str) -> Scenario:
    dt_s = changes.get("dt_s", base.dt_s)
    poses = replay_block(source_run.series, dt_s=base.dt_s, new_dt_s=dt_s)
    return with_blocks(base, **changes, controller=poses, name=name)


def _rows(sweep: Sweep, runs: dict[tuple[str, str], ObservedRun], speed_mm_s: float) -> list[VariantRow]:
    reference = runs[sweep.name, sweep.reference]
    return [
        _row(sweep, label, place, runs[sweep.name, label], reference, speed_mm_s) for label, place, _ in sweep.values
    ]


def _row(
    sweep: Sweep, label: str, place: float, run: ObservedRun, reference: ObservedRun, speed_mm_s: float
) -> VariantRow:
    end_s = min(run.series["t_s"][-1], reference.series["t_s"][-1])
    samples = np.arange(SAMPLES_MM, end_s * speed_mm_s + 1e-9, SAMPLES_MM) / speed_mm_s
    times = np.append(samples, end_s)
    apart = 1e3 * np.linalg.norm(at_times(run, "tip_m", times) - at_times(reference, "tip_m", times), axis=1)
    entry, pushed, lateral = (
        at_times(run, name, times) for name in ("entry_force_n", "insertion_force_n", "lateral_sum_n")
    )
    pushed_reference = at_times(reference, "insertion_force_n", times)
    return VariantRow(
        sweep=sweep.name,
        variant=label,
        place=place,
        default=label == sweep.default,
        reference=label == sweep.reference,
        status=run.status,
        steps=int(run.metrics["steps_completed"]),
        tip_end_mm=float(apart[-1]),
        tip_max_mm=float(apart.max()),
        rmse_commanded_mm=run.metrics["rmse_commanded_mm"],
        entry_mean_n=float(entry.mean()),
        entry_max_n=float(entry.max()),
        push_mean_n=float(pushed.mean()),
        push_apart_n=float(np.abs(pushed - pushed_reference).max()),
        lateral_mean_n=float(lateral.mean()),
        lateral_max_n=float(lateral.max()),
        lambda_ratio=run.metrics["lambda_ratio"],
        min_det_f=run.metrics["min_det_f"],
        iterations=run.solver["iterations_mean"],
    )


def at_times(run: ObservedRun, name: str, times_s: Vector) -> Vector:
    """A series, scalar or vector, at the given times, linear between steps."""
    known, values = run.series["t_s"], run.series[name]
    if values.ndim == 1:
        return np.asarray(np.interp(times_s, known, values))
    return np.column_stack([np.interp(times_s, known, column) for column in values.T])
