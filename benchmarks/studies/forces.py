"""The force curve: push straight in, hold, pull out.

The table compares the result with what the contact laws predict and with forces measured in bovine liver
(`bovine_liver`: Okamura et al. 2004, needle of 1.27 mm, ex vivo).
"""

from __future__ import annotations

import csv
import io
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from benchmarks.builtin_scenarios import benchmark_scenario, with_blocks
from benchmarks.measurements import Figure, Part, Table, figure
from benchmarks.observed_run import ObservedRun, observe
from benchmarks.performance.step_clock import MeasurementError
from benchmarks.studies.bovine_liver import (
    CITATION,
    CUTTING_N,
    DEEPEST_MM,
    PUNCTURE_DEPTH_MM,
    PUNCTURE_N,
    MeanAndDeviation,
    friction_n_per_mm,
)
from benchmarks.svg_plot import Band, Line, Panel, svg

if TYPE_CHECKING:
    from benchmarks.ports import BenchPorts
    from simcore.scenario.scenario import Scenario

Vector = NDArray[np.float64]

SPEED_MM_S = 10.0
DEPTH_MM, QUICK_DEPTH_MM = 100.0, 20.0
HOLD_S = 1.0
BEYOND_MM = 5.0  # pulled back so far out of the entry
CLOSED_SKIN_N = 0.1  # puncture force of this study; by default the skin is nicked and there is no puncture to see
LIVER_NOTE = """
Bovine liver: mean and standard deviation after Okamura, Simone and O'Leary 2004 (IEEE Trans. Biomed. Eng. 51(10),
1707-1716), ex vivo, bevel-tip needle of 1.27 mm; puncture and cutting at 3 mm/s, friction from their kinetic
coefficients at the speed above. The numbers come from public reading notes of the paper, not from the paper itself (see
`benchmarks/studies/bovine_liver.py`). Nothing is fitted: friction agrees within a standard deviation; puncture and
cutting are lower by choice, because linear elasticity folds at the entry at about 1 N.
"""
FITTED = (0.3, 0.95)  # share of the depth in which the slopes are fitted


@dataclass(frozen=True)
class Curve:
    """travel_mm: of the base from first touch; depth_mm: inserted rest length; force_n: on the base, > 0 pushes.

    held, pulled: index of the first row after the push and after the hold.
    """

    t_s: Vector
    travel_mm: Vector
    depth_mm: Vector
    force_n: Vector
    held: int
    pulled: int


@dataclass(frozen=True)
class Shape:
    """What is read off a curve: N, N/mm, mm and J."""

    puncture_n: float
    puncture_travel_mm: float
    cutting_n: float
    push_slope: float
    after_hold_n: float
    pull_slope: float
    reversal_mm: float
    work_j: float


def forces(ports: BenchPorts) -> Part:
    """One straight insertion, held and withdrawn."""
    depth = QUICK_DEPTH_MM if ports.quick else DEPTH_MM
    scenario = push_hold_pull(benchmark_scenario("replay", quick=False), depth, edge_mm=10.0 if ports.quick else 6.0)
    ports.say(f"forces: {scenario.steps} steps, push to {depth:g} mm, hold, pull out")
    run = observe(scenario)
    if run.status != "completed":
        raise MeasurementError(f"the insertion ended as {run.status}: {run.message}")
    curve = _curve(run, depth, scenario.dt_s)
    shape = read_off(curve)
    table = _table(shape, scenario)
    files = {"forces.svg": _picture(curve), "forces.csv": _csv(curve), "forces.md": _markdown(scenario, table)}
    return Part(tuple(_figures(shape)), (table,), files)


def push_hold_pull(base: Scenario, depth_mm: float, *, edge_mm: float) -> Scenario:
    """Straight along z in the middle of the block at 10 mm/s, through a closed skin: in, a second's rest, out and
    beyond."""
    step = SPEED_MM_S * base.dt_s
    travel = [
        *np.arange(step, depth_mm + 1e-9, step),
        *np.full(round(HOLD_S / base.dt_s), depth_mm),
        *np.arange(depth_mm - step, -BEYOND_MM - 1e-9, -step),
    ]
    x, y, z = base.trajectory.entry_mm
    height = z - base.needle.length_mm
    poses = [[x, y, round(float(height + s), 9), 1.0, 0.0, 0.0, 0.0] for s in travel]
    return with_blocks(
        base,
        name="push, hold, pull",
        tissue={"element_size_mm": edge_mm},
        interaction={"puncture_n": CLOSED_SKIN_N},
        trajectory={"target_mm": [x, y, depth_mm], "speed_mm_s": SPEED_MM_S},
        controller={"kind": "replay", "poses": poses},
        recording={"enabled": False},
    )


def _curve(run: ObservedRun, depth_mm: float, dt_s: float) -> Curve:
    series = run.series
    travel = 1e3 * (series["base_position_m"][:, 2] - series["base_position_m"][0, 2])
    held = int(np.argmax(travel >= depth_mm - 1e-6)) + 1
    return Curve(
        t_s=series["t_s"],
        travel_mm=travel,
        depth_mm=1e3 * series["depth_m"],
        force_n=series["insertion_force_n"],
        held=held,
        pulled=held + round(HOLD_S / dt_s),
    )


def read_off(curve: Curve) -> Shape:
    """Peak at puncture, then straight lines through push and pull: cutting force and friction per length."""
    force, depth, travel = curve.force_n, curve.depth_mm, curve.travel_mm
    inside = int(np.argmax(depth > 0.0))
    peak = int(np.argmax(force[:inside]))
    push_slope, cutting = _fit(depth[: curve.held], force[: curve.held], depth.max())
    pull_slope, _ = _fit(depth[curve.pulled :], force[curve.pulled :], depth.max())
    out = force[curve.pulled :]
    turned = curve.pulled + int(np.argmax(out <= 0.0))
    work = float(((force[1:] + force[:-1]) / 2 * np.diff(travel)).sum() * 1e-3)
    return Shape(
        puncture_n=float(force[peak]),
        puncture_travel_mm=float(travel[peak]),
        cutting_n=cutting,
        push_slope=push_slope,
        after_hold_n=float(force[curve.pulled - 1]),
        pull_slope=pull_slope,
        reversal_mm=float(travel[curve.pulled - 1] - travel[turned]),
        work_j=work,
    )


def _fit(depth: Vector, force: Vector, deepest: float) -> tuple[float, float]:
    """Slope N/mm and value at depth 0, N, within the fitted part."""
    part = (depth >= FITTED[0] * deepest) & (depth <= FITTED[1] * deepest)
    slope, offset = np.polyfit(depth[part], force[part], 1)
    return float(slope), float(offset)


def _figures(shape: Shape) -> list[Figure]:
    units = {"push_slope": "N/mm", "pull_slope": "N/mm", "work_j": "J"}
    names = ("puncture_n", "cutting_n", "push_slope", "pull_slope", "reversal_mm", "work_j")
    return [
        figure(f"forces.{name}", units.get(name, "mm" if name.endswith("mm") else "N"), [getattr(shape, name)])
        for name in names
    ]


def _table(shape: Shape, scenario: Scenario) -> Table:
    laws = scenario.interaction
    way_in, out = (friction_n_per_mm(way, SPEED_MM_S) for way in ("in", "out"))
    way_out = MeanAndDeviation(-out.mean, out.deviation)
    rows = (
        ("largest force before puncture, N", shape.puncture_n, laws.puncture_n, str(PUNCTURE_N)),
        ("base travel at puncture, mm", shape.puncture_travel_mm, None, str(PUNCTURE_DEPTH_MM)),
        ("cutting plateau: push line at depth 0, N", shape.cutting_n, laws.cutting_n, str(CUTTING_N)),
        ("friction on the way in, N/mm", shape.push_slope, laws.adhesion_n_per_mm, str(way_in)),
        ("force at the end of the hold, N", shape.after_hold_n, None, None),
        ("base travel until the force reverses, mm", shape.reversal_mm, None, None),
        ("friction on the way out, N/mm", shape.pull_slope, -laws.adhesion_n_per_mm, str(way_out)),
        ("work of the whole cycle (hysteresis), J", shape.work_j, None, None),
    )
    return Table("Force curve", ("quantity", "simulated", "contact law", f"bovine liver ({CITATION})"), rows)


def _picture(curve: Curve) -> str:
    parts = (
        ("push", slice(0, curve.held)),
        ("hold", slice(curve.held - 1, curve.pulled)),
        ("pull out", slice(curve.pulled - 1, None)),
    )
    over_depth = [
        Line(name, curve.travel_mm[part].tolist(), curve.force_n[part].tolist(), markers=False) for name, part in parts
    ]
    over_time = [
        Line(name, curve.t_s[part].tolist(), curve.force_n[part].tolist(), markers=False) for name, part in parts
    ]
    hold = Band("", float(curve.t_s[curve.held - 1]), float(curve.t_s[curve.pulled - 1]))
    panels = [
        Panel("Over the travel of the base", "base travel from first touch, mm", "axial force, N", tuple(over_depth)),
        Panel("Over time", "time, s", "axial force, N", tuple(over_time), (hold,)),
    ]
    rows = [panels, [_beside_liver(curve)]]
    return svg(rows, title="Force on the needle's base: push, hold, pull out", width=1100, height=400)


def _beside_liver(curve: Curve) -> Panel:
    """The push, and in the same axes what liver asked for: at puncture, and after it cutting and friction."""
    friction = friction_n_per_mm("in", SPEED_MM_S)
    depth, spread = PUNCTURE_DEPTH_MM.mean, PUNCTURE_DEPTH_MM.deviation
    ends = [depth, DEEPEST_MM]
    mean, high, low = (
        [CUTTING_N.mean + side * CUTTING_N.deviation + (friction.mean + side * friction.deviation) * x for x in ends]
        for side in (0, 1, -1)
    )
    gap, peak, around = math.nan, PUNCTURE_N.mean, PUNCTURE_N.deviation
    cross_x = [depth - spread, depth, depth + spread, gap, depth, depth]
    cross_y = [peak, peak, peak, gap, peak - around, peak + around]
    push = slice(0, curve.held)
    lines = (
        Line("simulated", curve.travel_mm[push].tolist(), curve.force_n[push].tolist(), markers=False),
        Line("liver, puncture, 3 mm/s", cross_x, cross_y),
        Line(f"liver, cutting at 3 mm/s + friction at {SPEED_MM_S:g} mm/s", ends, mean, dashed=True, markers=False),
        Line("the same, one standard deviation", [*ends, gap, *ends], [*high, gap, *low], dashed=True, markers=False),
    )
    title = f"The push compared with bovine liver ex vivo, needle of 1.27 mm ({CITATION})"
    return Panel(title, "base travel from first touch, mm", "axial force, N", lines, y_zero=True)


def _markdown(scenario: Scenario, table: Table) -> str:
    head = (
        f"# Force curve\n\nStraight insertion at {SPEED_MM_S:g} mm/s, {HOLD_S:g} s of rest, withdrawal; "
        f"h = {scenario.tissue.element_size_mm:g} mm, dt = {1e3 * scenario.dt_s:g} ms, a skin that is punctured"
        f" at {CLOSED_SKIN_N:g} N, all else the default. The model is quasi-static: nothing relaxes during the hold."
        " The push is a saw: a point that was just cut is sheared before it slips.\n\n![force curve](forces.svg)\n\n"
    )
    return head + table.markdown() + LIVER_NOTE


def _csv(curve: Curve) -> str:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["t_s", "base_travel_mm", "inserted_mm", "force_n"])
    for row in zip(curve.t_s, curve.travel_mm, curve.depth_mm, curve.force_n, strict=True):
        writer.writerow([f"{value:.9g}" for value in row])
    return text.getvalue()
