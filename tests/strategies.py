"""Hypothesis strategies for valid scenarios, as JSON data: any that `Scenario.load` takes, and small ones to run."""

from __future__ import annotations

import math
from typing import Any

from hypothesis import strategies as st

from simcore.contact.line_radius import smallest_ball_radius
from simcore.scenario.blocks import HARD_SPACING_MM, LEAST_SPACING_MM
from simcore.scenario.scenario import MAXIMUM_CELLS, MAXIMUM_STEPS, MINIMUM_DEPTH_MM, STAND_OFF_MM

Json = dict[str, Any]

FACES = ["x_min", "x_max", "y_min", "y_max", "z_max"]
MARGIN_MM = 0.5  # of the path from the block's side faces
NAMES = st.text("abcXYZ019äß .,:+()/-_", min_size=1, max_size=100)


def between(low: float, high: float) -> st.SearchStrategy[float]:
    """Floats of an inclusive range, its ends among the likely ones."""
    return st.floats(low, high, allow_subnormal=False)


def faces() -> st.SearchStrategy[list[str]]:
    return st.lists(st.sampled_from(FACES), min_size=1, unique=True)


@st.composite
def tissues(draw: st.DrawFn) -> Json:
    size = [draw(between(10.0, 250.0)) for _ in range(3)]
    finest = max(1.0, 1.2 * (math.prod(size) / MAXIMUM_CELLS) ** (1 / 3))
    element = draw(between(finest, 50.0))
    return {
        "size_mm": size,
        "element_size_mm": element,
        "young_kpa": draw(between(0.1, 1000.0)),
        "poisson": draw(between(0.0, 0.49)),
        "density_kg_m3": draw(between(0.0, 20_000.0)),
        "rayleigh_mass_per_s": draw(between(0.0, 1000.0)),
        "rayleigh_stiffness_s": draw(between(0.0, 10.0)),
        "fixed_faces": draw(faces()),
    }


@st.composite
def trajectories(draw: st.DrawFn, size: list[float]) -> tuple[Json, float]:
    """A trajectory inside the block and an upper bound of its length in mm."""
    sides = [(MARGIN_MM, edge - MARGIN_MM) for edge in size[:2]]
    entry = [*(draw(between(low, high)) for low, high in sides), 0.0]
    end = [*(draw(between(low, high)) for low, high in sides), draw(between(MINIMUM_DEPTH_MM, size[2]))]
    chord = math.dist(entry, end)
    frame = draw(st.sampled_from(["world", "tissue"]))
    if draw(st.booleans()):
        return {"kind": "line", "entry_mm": entry, "target_mm": end, "frame": frame}, chord
    dx, dy = end[0] - entry[0], end[1] - entry[1]
    level = [-dy, dx, 0.0] if math.hypot(dx, dy) > 1e-3 * chord else [draw(st.sampled_from([1.0, -1.0])), 0.0, 0.0]
    longest = math.hypot(*level)
    periods = draw(between(0.1, 10.0))
    margin = min(min(p[i], size[i] - p[i]) for p in (entry, end) for i in (0, 1))
    amplitude = draw(between(0.0, min(20.0, 0.999 * margin - 1e-3 * chord, 100.0 / periods)))
    sine = {"amplitude_mm": amplitude, "periods": periods, "direction": [c / longest for c in level]}
    moved = {"kind": "sine", "entry_mm": entry, "target_mm": end, "frame": frame, **sine}
    return moved, chord + 4 * amplitude * (periods + 0.5)


@st.composite
def controllers(draw: st.DrawFn) -> Json:
    kind = draw(st.sampled_from(["ifem", "open_loop", "replay", "rigid", "frozen"]))
    if kind == "open_loop":
        return {"kind": kind}
    if kind == "rigid":
        return {"kind": kind, "straight_mm": draw(between(0.1, 1000.0))}
    if kind == "frozen":
        return {
            "kind": kind,
            "depth_mm": draw(between(1.0, 1000.0)),
            "gain": draw(between(0.0, 2.0)),
            "direction_speed_mm_s": draw(between(1.0, 1e5)),
            "model": draw(separate_models()),
        }
    if kind == "replay":
        return {"kind": kind, "poses": draw(st.lists(poses(), min_size=1, max_size=5))}
    return {
        "kind": kind,
        "gain": draw(between(0.0, 2.0)),
        "rcm_gain": draw(between(0.0, 2.0)),
        "rcm_weight": draw(between(0.0, 10.0)),
        "orientation": draw(st.sampled_from(["rcm", "axis"])),
        "direction_speed_mm_s": draw(between(1.0, 1e5)),
        "lever_arm_mm": draw(between(1.0, 1000.0)),
        "jacobian": draw(st.sampled_from(["constraint", "perturbation"])),
        "derivative": draw(st.sampled_from(["fast", "exact"])),
        "perturbation_mm": draw(between(0.05, 1.0)),
        "model": draw(ifem_models()),
    }


@st.composite
def ifem_models(draw: st.DrawFn) -> Json:
    return {"kind": "shared"} if draw(st.booleans()) else draw(separate_models())


@st.composite
def separate_models(draw: st.DrawFn) -> Json:
    return {
        "kind": "separate",
        "young_kpa": draw(between(0.1, 1000.0)),
        "poisson": draw(between(0.0, 0.49)),
        "element_size_mm": draw(between(10.0, 40.0)),
        "friction": draw(between(0.0, 1.0)),
        "spacing_mm": draw(between(40.0, 50.0)),
    }


@st.composite
def poses(draw: st.DrawFn) -> list[float]:
    position = [draw(between(-10_000.0, 10_000.0)) for _ in range(3)]
    quaternion = draw(st.lists(between(-1.0, 1.0), min_size=4, max_size=4).filter(lambda q: math.hypot(*q) > 0.1))
    return [*position, *(c / math.hypot(*quaternion) for c in quaternion)]


@st.composite
def points(draw: st.DrawFn, element: float, outer: float) -> Json:
    """How constraint points couple needle and tissue."""
    if compliant := draw(st.booleans()):
        spacing, spread = between(LEAST_SPACING_MM, 50.0), between(1.01 * smallest_ball_radius(0.5 * outer), 20.0)
    else:
        spacing, spread = between(max(HARD_SPACING_MM, element), 50.0), st.just(0.0) | between(0.1, 20.0)
    return {
        "line_compliance": compliant,
        "tip": draw(st.sampled_from(["free", "held"])),
        "spacing_mm": draw(st.none() | spacing),
        "spread_mm": draw(spread),
    }


def in_range(rate_hz: float) -> bool:
    return 0.1 <= rate_hz <= 10_000.0


@st.composite
def scenarios(draw: st.DrawFn) -> Json:
    """Any valid scenario, every field given."""
    tissue = draw(tissues())
    element = tissue["element_size_mm"]
    trajectory, length = draw(trajectories(tissue["size_mm"]))
    dt = draw(between(1e-4, 0.1))
    trajectory["speed_mm_s"] = draw(between(max(0.1, 1.01 * length / (MAXIMUM_STEPS * dt)), 1000.0))
    outer = draw(between(0.1, 5.0))
    controller = {**draw(controllers()), "delay_s": draw(st.integers(0, 5)) * dt}
    exact = (controller.get("jacobian"), controller.get("derivative")) == ("constraint", "exact")
    return {
        "schema": "needlebench/scenario/1",
        "name": draw(NAMES),
        "seed": draw(st.integers(0, 2**53 - 1)),
        "dt_s": dt,
        "noise_mm": draw(between(0.0, 5.0)),
        "noise_hold_s": draw(st.none() | st.integers(1, 100).map(lambda count: count * dt)),
        "tissue": tissue,
        "needle": {
            "length_mm": draw(between(max(20.0, length + STAND_OFF_MM), 1000.0)),
            "outer_diameter_mm": outer,
            "inner_diameter_mm": draw(between(0.0, 0.99 * outer)),
            "young_gpa": draw(between(0.1, 500.0)),
            "poisson": draw(between(0.0, 0.49)),
            "elements": draw(st.integers(2, 200)),
        },
        "interaction": {
            **draw(points(element, outer)),
            "friction": draw(between(0.0, 1.0)),
            "adhesion_n_per_mm": draw(between(0.0, 1.0)),
            "cutting_n": draw(between(0.0, 10.0)),
            "puncture_n": draw(between(0.0, 10.0)),
        },
        "trajectory": trajectory,
        "robot": {"max_speed_mm_s": draw(between(0.1, 1000.0)), "max_turn_deg_s": draw(between(0.1, 3600.0))},
        "controller": controller,
        "sensing": {
            "rate_hz": draw(st.none() | st.integers(1, 20).map(lambda count: 1.0 / (count * dt)).filter(in_range)),
            "latency_s": draw(st.integers(0, 5)) * dt,
            "noise_mm": draw(between(0.0, 5.0)),
            "tip": draw(st.sampled_from(["true", "registered"])),
            "registration_mm": draw(between(0.0, 20.0)),
        },
        "solver": {
            "mode": draw(st.sampled_from(["converged"] if exact else ["converged", "linearised"])),
            "force_tolerance_n": draw(between(1e-12, 1e-2)),
            "violation_tolerance_mm": draw(between(1e-10, 1e-1)),
            "max_iterations": draw(st.integers(1, 10_000)),
        },
        "recording": {"enabled": draw(st.booleans()), "every_steps": draw(st.integers(1, 10_000))},
    }


steered = st.sampled_from(
    [
        {"kind": "ifem"},
        {"kind": "open_loop"},
        {"kind": "ifem", "direction_speed_mm_s": 1e5, "gain": 2.0},
        {"kind": "ifem", "rcm_weight": 0.1, "delay_s": 0.1},
        {"kind": "ifem", "orientation": "axis"},
        {"kind": "rigid"},
        {"kind": "frozen", "depth_mm": 5.0},
    ]
)

coupled = st.fixed_dictionaries(
    {"line_compliance": st.just(True), "spread_mm": st.sampled_from([1.3, 6.0, 20.0])},
    optional={"tip": st.sampled_from(["free", "held"]), "spacing_mm": st.sampled_from([0.5, 3.0, 12.0])},
) | st.fixed_dictionaries(
    {"line_compliance": st.just(False), "spread_mm": st.sampled_from([0.0, 4.0, 20.0])},
    optional={"tip": st.sampled_from(["free", "held"])},
)


@st.composite
def small_runs(draw: st.DrawFn) -> Json:
    """A block of some 40 to 100 nodes and at most about a dozen steps: milliseconds to run, harsh values included."""
    size = [draw(between(20.0, 30.0)), draw(between(30.0, 45.0)), draw(between(25.0, 45.0))]
    trajectory, length = draw(trajectories(size).filter(lambda found: found[1] < 80.0))
    steps = draw(st.integers(1, 12))
    dt = draw(st.sampled_from([0.01, 0.02, 0.1]))
    trajectory["speed_mm_s"] = min(1000.0, max(0.1, length / (steps * dt)))
    return {
        "seed": draw(st.integers(0, 2**53 - 1)),
        "dt_s": dt,
        "noise_mm": draw(st.sampled_from([0.0, 0.25, 5.0])),
        "tissue": {
            "size_mm": size,
            "element_size_mm": 10.0,
            "young_kpa": draw(between(0.1, 100.0)),
            "poisson": draw(between(0.0, 0.49)),
            "density_kg_m3": draw(st.sampled_from([0.0, 1000.0, 20_000.0])),
            "rayleigh_stiffness_s": draw(st.sampled_from([0.0, 0.01])),
            "fixed_faces": draw(faces()),
        },
        "needle": {"length_mm": length + STAND_OFF_MM, "elements": draw(st.integers(2, 8))},
        "interaction": {
            **draw(coupled),
            "friction": draw(st.sampled_from([0.0, 0.1, 1.0])),
            "adhesion_n_per_mm": draw(st.sampled_from([0.0, 0.01, 1.0])),
            "cutting_n": draw(between(0.0, 2.0)),
            "puncture_n": draw(st.just(0.0) | between(0.0, 2.0)),
        },
        "trajectory": trajectory,
        "controller": draw(st.one_of(steered, steered, replays_near(trajectory["entry_mm"], length + STAND_OFF_MM))),
        "solver": {
            "max_iterations": draw(st.sampled_from([1, 10, 60])),
            "mode": draw(st.sampled_from(["converged", "converged", "linearised"])),
        },
        "recording": {"enabled": draw(st.booleans()), "every_steps": draw(st.integers(1, 3))},
    }


@st.composite
def replays_near(draw: st.DrawFn, entry: list[float], needle_length: float) -> Json:
    """A replay that pushes, pulls and shakes the needle by small steps, beginning with its tip at the entry."""
    x, y, z = entry[0], entry[1], -needle_length
    rows = []
    for _ in range(draw(st.integers(1, 12))):
        x, y, z = x + draw(between(-0.5, 0.5)), y + draw(between(-0.5, 0.5)), z + draw(between(-1.0, 3.0))
        rows.append([x, y, z, 1.0, 0.0, 0.0, 0.0])
    return {"kind": "replay", "poses": rows}
