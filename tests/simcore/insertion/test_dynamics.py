"""The coupled step against plain full Newton, with and without inertia; then what inertia and damping must obey."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from scipy.linalg import eigh

from simcore.contact.channel import Phase
from simcore.scenario.build import insertion_of
from tests.simcore.block import (
    AHEAD,
    Trip,
    advanced,
    block_scenario,
    cold,
    curved_trip,
    held,
    moved,
    stiffness_times,
    travel,
)
from tests.simcore.reference import FullNewton, Iterate
from tests.verification import verify

if TYPE_CHECKING:
    from simcore.insertion.insertion import Insertion, InsertionState

Vector = np.ndarray
check = partial(verify, "coupled")
CUTTING_N, ADHESION_N_PER_M, FRICTION = 0.1, 10.0, 0.1  # the defaults of the scenario
HEAVY = {"density_kg_m3": 1000.0, "rayleigh_mass_per_s": 5.0, "rayleigh_stiffness_s": 0.01}


@pytest.fixture(scope="module")
def heavy() -> Trip:
    """The curved trip with mass and both kinds of damping."""
    return curved_trip(tissue=HEAVY)


# the same step by plain full Newton


def reference_of(trip: Trip, i: int) -> FullNewton:
    return FullNewton(trip.insertion, trip.states[i], trip.poses[i], trip.states[i + 1].channel.mode)


def iterate_of(newton: FullNewton, after: InsertionState) -> Iterate:
    """A converged state of the fast solver in the unknowns of full Newton."""
    b, arcs = after.bodies, np.empty(len(newton.elements))
    at = Iterate(b.x, b.needle_x, b.needle_R, after.point_forces_n, arcs)
    for i, e in enumerate(newton.elements):
        point = newton.channel.rest_m[e] + newton.balls[e] @ (b.x - newton.tissue.mesh.nodes_m)
        arcs[i] = newton.projected(at, point, newton.channel.arc_m[e])
        if newton.modes[i] % 2 == 1 and (e == 0 or newton.insertion.model.line.hard):
            arcs[i] = newton.breakpoint(i)
    return at


def check_full_newton(text: str, pairs: list[tuple[InsertionState, Iterate]]) -> None:
    """Positions of all nodes to 1e-9 m, forces of all points to 1e-6 N, of the same steps by both ways."""
    tissue = [after.bodies.x - found.x for after, found in pairs]
    needle = [after.bodies.needle_x - found.needle_x for after, found in pairs]
    forces = [after.point_forces_n - found.force for after, found in pairs]
    case, source = f"fast step = full Newton, {text}", "plain full Newton, dense, differences as tangents"
    for name, misses, tolerance, unit in (("positions", tissue + needle, 1e-9, "m"), ("forces", forces, 1e-6, "N")):
        worst = max(np.abs(miss).max() for miss in misses)
        check(f"{case}: {name}", expected=0, measured=worst, tolerance=tolerance, source=source, unit=unit)


@pytest.mark.slow
@pytest.mark.parametrize("step", [5, 15, 50, 60, 61, 75, 89, 90, 100, 125])
def test_fast_step_is_full_newton(curved: Trip, step: int) -> None:
    """Cutting and slip (5, 15, 50), sticking reversals (60, 61, 90), withdrawal (75, 89), re-advance and cutting again
    (100, 125)."""
    check_full_newton(f"curved, step {step}", [(curved.states[step + 1], reference_of(curved, step).solve())])


@pytest.mark.slow
@pytest.mark.parametrize("step", [1, 30, 62, 125])
def test_fast_dynamic_step_is_full_newton(heavy: Trip, step: int) -> None:
    """The same with mass and damping, contact (1) included."""
    check_full_newton(f"dynamic, step {step}", [(heavy.states[step + 1], reference_of(heavy, step).solve())])


@pytest.mark.slow
@pytest.mark.parametrize(("friction", "slips"), [(1.0, False), (0.1, True)])
def test_fast_contact_step_is_full_newton(friction: float, slips: bool) -> None:
    """Indentation before puncture, pushed obliquely: sticking, and slipping with Coulomb's force along the slip."""
    insertion = insertion_of(block_scenario(interaction={"puncture_n": 1.0, "friction": friction}))
    start = insertion.initial_state(AHEAD)
    poses = [moved(start.base, np.array([2e-4, 1e-4, 3e-4]) * k, 1e-3 * k * np.array([1, 2, 3])) for k in range(1, 6)]
    pairs = []
    for before, after in pairwise(travel(insertion, start, poses)):
        found = FullNewton(insertion, before, after.base, after.channel.mode, slips_on_surface=slips).solve()
        assert (np.hypot(*found.force[0, :2]) > 0.999 * friction * found.force[0, 2]) == slips
        assert found.force[0, 2] > 0.01
        pairs.append((after, found))
    check_full_newton(f"contact that {'slips' if slips else 'sticks'}, five steps", pairs)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["curved", "heavy"])
def test_every_step_satisfies_the_independent_equations(name: str, request: pytest.FixtureRequest) -> None:
    """Balance of both bodies, zero gaps, breakpoints and levels of full Newton's residual (N; mm), at each step."""
    trip, worst = request.getfixturevalue(name), 0.0
    for i, after in enumerate(trip.states[1:]):
        if trip.states[i].channel.phase is Phase.INSERTED:
            newton = reference_of(trip, i)
            worst = max(worst, np.abs(newton.residual(iterate_of(newton, after))).max())
    text = f"residual of the independent equations over all steps, {name} (N; gaps and breakpoints in mm)"
    check(text, expected=0, measured=worst, tolerance=1e-7, source="full Newton's residual")


def test_friction_cone_and_complementarity_at_every_step(curved: Trip) -> None:
    """|lambda_t| <= tau0 l + mu |lambda_n| (+ f_cut at the tip); inside it the point keeps its arc length: slip only
    at the bound. Stick, both directions of slip, cutting and withdrawal all occur."""
    met, cone, gain, slack, spare = set(), [0.0], [0.0], [0.0], []
    for i, after in enumerate(curved.states[1:]):
        if curved.states[i].channel.phase is not Phase.INSERTED:
            continue
        newton = reference_of(curved, i)
        at = iterate_of(newton, after)
        points = newton.channel.rest_m[: newton.channel.count] + newton.balls @ (at.x - newton.tissue.mesh.nodes_m)
        bases = ADHESION_N_PER_M * newton.tributaries(at, points)
        for j, e in enumerate(newton.elements):
            axial, lateral = resolved(curved, after, newton, j, at.arc[j])
            bound = bases[j] + FRICTION * lateral
            cone += [-bound - axial, axial - bound - (CUTTING_N if e == 0 else 0.0)]
            # a tip that was taken up again beyond the channel end, by a step at most, counts from there
            start = max(newton.channel.arc_m[e], newton.needle.length_m) if e == 0 else newton.channel.arc_m[e]
            slip = after.solved.at.all_arcs_m[e] - start  # of the place of contact
            gain.append(axial * slip)  # dissipation: a falling arc length is a needle that moves forward
            if e != 0 and abs(slip) > 1e-9:
                slack.append(abs(abs(axial) - bound))
            if e == 0 and slip < -1e-9 and not newton.withdrawn(j):
                spare.append(bound + CUTTING_N - axial)
            met.add(("tip" if e == 0 else "shaft", int(newton.modes[j])))
    assert met >= {(kind, mode) for kind in ("tip", "shaft") for mode in (0, 1, 2)}
    source = "Coulomb with adhesion, specification of the interaction; stick, both slips, cutting and withdrawal occur"
    numbers: dict[str, Any] = {"expected": 0, "source": source}
    check("friction cone, every point and step: excess", measured=max(cone), tolerance=1e-8, unit="N", **numbers)
    for name, measured in (("slipping", max(slack)), ("cutting", spare)):
        text = f"complementarity: force short of its level while {name}"
        check(text, measured=measured, tolerance=1e-8, unit="N", **numbers)
    check("friction work gained, every point and step", measured=max(gain), tolerance=1e-11, unit="J", **numbers)


def resolved(trip: Trip, after: InsertionState, newton: FullNewton, j: int, arc: float) -> tuple[float, float]:
    """Axial and lateral force of a point, N."""
    b = after.bodies
    dc = newton.shaft(b.needle_x, b.needle_R, arc)[1]
    axial = after.point_forces_n[j] @ dc / np.linalg.norm(dc)
    return float(axial), float(np.sqrt(max(after.point_forces_n[j] @ after.point_forces_n[j] - axial**2, 0.0)))


# inertia and damping


def free_tissue(dt_s: float, alpha: float = 0.0, beta: float = 0.0) -> tuple[Insertion, InsertionState]:
    """The block with mass, the needle lifted 10 mm off: nothing touches it."""
    tissue = {"density_kg_m3": 1000.0, "rayleigh_mass_per_s": alpha, "rayleigh_stiffness_s": beta}
    insertion = insertion_of(block_scenario(tissue=tissue, dt_s=dt_s))
    start = insertion.initial_state(AHEAD)
    return insertion, advanced(insertion, start, moved(start.base, np.array([0.0, 0.0, -0.01])))


def first_mode(insertion: Insertion) -> tuple[float, Vector]:
    """Angular frequency rad/s and shape (n, 3), largest component 1, of the linear problem K phi = w^2 M phi."""
    tissue = insertion.tissue
    free, size = np.repeat(tissue.unknown >= 0, 3), tissue.mesh.nodes_m.size
    stiff = np.array([stiffness_times(tissue, u.reshape(-1, 3), cold(tissue)).ravel() for u in np.eye(size)])
    square, vector = eigh(stiff[free][:, free], np.diag(np.repeat(tissue.masses_kg, 3)[free]), subset_by_index=[0, 0])
    shape = np.zeros(size)
    shape[free] = vector[:, 0]
    return float(np.sqrt(square[0])), shape.reshape(-1, 3) / np.abs(shape).max()


def swing(
    amplitude_m: float, dt_s: float, time_s: float, alpha: float = 0.0, beta: float = 0.0
) -> tuple[Vector, Vector, float]:
    """Modal amplitude (share of the first) and mechanical energy (J) after each step of a release; frequency."""
    insertion, state = free_tissue(dt_s, alpha, beta)
    omega, shape = first_mode(insertion)
    tissue, rest = insertion.tissue, insertion.tissue.mesh.nodes_m
    released = replace(state.bodies, x=rest + amplitude_m * shape, v=np.zeros_like(rest))
    state = replace(state, bodies=released)
    states = travel(insertion, state, [state.base] * round(time_s / dt_s))
    weight = tissue.masses_kg[:, None] * shape
    shares = [np.sum(weight * (s.bodies.x - rest)) / np.sum(weight * shape) / amplitude_m for s in states]
    kinetic = [0.5 * np.sum(tissue.masses_kg[:, None] * s.bodies.v**2) for s in states]
    return np.array(shares), np.array([held(tissue, s.bodies.x)[2] for s in states]) + kinetic, omega


def decay(omega: float, time_s: float, alpha: float, beta: float) -> float:
    """Released damped oscillator: damping ratio (alpha / w + beta w) / 2 (Rayleigh)."""
    ratio = 0.5 * (alpha / omega + beta * omega)
    damped = omega * np.sqrt(1.0 - ratio**2)
    swinging = np.cos(damped * time_s) + ratio * omega / damped * np.sin(damped * time_s)
    return float(np.exp(-ratio * omega * time_s) * swinging)


def implicit_euler(omega: float, dt_s: float, steps: int, alpha: float, beta: float) -> Vector:
    """(steps + 1,) the same oscillator in steps: v+ = v - dt (w^2 u+ + (alpha + beta w^2) v+)."""
    u, v, out = 1.0, 0.0, [1.0]
    for _ in range(steps):
        v = (v - dt_s * omega**2 * u) / (1 + dt_s * (alpha + beta * omega**2) + (dt_s * omega) ** 2)
        u += dt_s * v
        out.append(u)
    return np.array(out)


@pytest.mark.slow
@pytest.mark.parametrize(("alpha", "beta"), [(0.0, 0.0), (20.0, 0.0), (0.0, 2e-3)])
def test_a_mode_swings_like_its_oscillator(alpha: float, beta: float) -> None:
    """Modal analysis (Rayleigh): step by step the scalar recursion of implicit Euler, at 0.1 mm (strains of 0.5 %)."""
    shares, _, omega = swing(1e-4, 2e-3, 0.1, alpha, beta)
    assert np.ptp(shares) > 1.0
    text = (
        f"released mode over 50 steps of 2 ms, alpha = {alpha:g} / s, beta = {beta:g} s: share of the first amplitude"
    )
    expected, source = implicit_euler(omega, 2e-3, 50, alpha, beta), "Rayleigh: modal oscillator, implicit Euler"
    check(text, expected=expected, measured=shares, tolerance=5e-5, source=source)


@pytest.mark.slow
@pytest.mark.parametrize(("alpha", "beta"), [(0.0, 0.0), (10.0, 1e-3)])
def test_implicit_euler_is_of_first_order(alpha: float, beta: float) -> None:
    """The error against the exact decay falls with dt: slope fitted over four time steps."""
    steps_s, time_s = np.array([1e-3, 5e-4, 2.5e-4, 1.25e-4]), 0.01
    errors = []
    for dt_s in steps_s:
        shares, _, omega = swing(1e-4, dt_s, time_s, alpha, beta)
        errors.append(abs(shares[-1] - decay(omega, time_s, alpha, beta)))
    order, text = (
        np.polyfit(np.log(steps_s), np.log(errors), 1)[0],
        f"order in dt, alpha = {alpha:g} / s, beta = {beta:g} s",
    )
    check(text, expected=1, measured=order, tolerance=0.1, source="implicit Euler against the exact decay")


@pytest.mark.slow
def test_free_oscillation_never_gains_energy_and_damping_takes_more() -> None:
    """Implicit Euler dissipates, Rayleigh damping adds to it: v^T C v >= 0; at 3 mm (strains of 15 %) too."""
    energies = {damping: swing(3e-3, 1e-3, 0.1, *damping)[1] for damping in ((0.0, 0.0), (10.0, 0.0), (0.0, 2e-3))}
    for (alpha, beta), energy in energies.items():
        text = f"free oscillation at strains of 15 %: energy gained in a step, alpha = {alpha:g} / s, beta = {beta:g} s"
        gained = max(np.diff(energy).max(), 0.0)
        check(text, expected=0, measured=gained, tolerance=1e-12, source="v^T C v >= 0 (Rayleigh)", unit="J")
    plain = energies.pop((0.0, 0.0))
    assert plain[-1] > 0.1 * plain[0]
    for energy in energies.values():
        assert energy[-1] < 0.6 * plain[-1]


@pytest.mark.slow
def test_momentum_balance(heavy: Trip) -> None:
    """Newton: force of the robot + reaction of the held faces = M dv / dt + alpha M v, summed over all nodes."""
    tissue, dt = heavy.insertion.tissue, heavy.insertion.model.dt_s
    fixed, mass, largest, misses = tissue.unknown < 0, tissue.masses_kg[:, None], 0.0, []
    for before, after in pairwise(heavy.states):
        if before.channel.phase is not Phase.INSERTED:
            continue
        newton = FullNewton(heavy.insertion, before, after.base, after.channel.mode)
        inner = np.zeros_like(after.bodies.x)
        np.add.at(inner, tissue.mesh.tets, newton.element_forces(after.bodies.x))
        load = newton.balls[newton.elements].T @ after.point_forces_n
        change = (after.bodies.v - before.bodies.v) / dt + HEAVY["rayleigh_mass_per_s"] * after.bodies.v
        reaction = (inner - load + mass * change)[fixed].sum(axis=0)
        inertia = (mass * change).sum(axis=0)
        misses.append(after.base_wrench[:3] + reaction - inertia)
        largest = max(largest, np.abs(inertia).max())
    assert largest > 1e-3
    text, source = "momentum balance with mass and damping, every step", "Newton's second law over all nodes"
    check(text, expected=0, measured=misses, tolerance=1e-6, source=source, unit="N")


@pytest.mark.slow
def test_static_limit_is_the_quasi_static_solution() -> None:
    """Held still, the damped block comes to rest where the quasi-static one is: indented obliquely, sticking."""
    ends = []
    for tissue, holds in (({}, 1), ({**HEAVY, "rayleigh_mass_per_s": 60.0}, 150)):
        insertion = insertion_of(block_scenario(tissue=tissue, interaction={"puncture_n": 1.0, "friction": 1.0}))
        start = insertion.initial_state(AHEAD)
        poses = [moved(start.base, np.array([1e-4, -5e-5, 3e-4]) * k) for k in range(1, 6)]
        ends.append(travel(insertion, start, [*poses, *[poses[-1]] * holds])[-1])
    assert np.abs(ends[1].bodies.v).max() < 1e-8
    miss, text = (
        ends[1].bodies.x - ends[0].bodies.x,
        "damped block at rest against the quasi-static solution: positions",
    )
    check(text, expected=0, measured=miss, tolerance=1e-9, source="static limit of the equation of motion", unit="m")
    np.testing.assert_allclose(ends[1].base_wrench, ends[0].base_wrench, atol=1e-7)
