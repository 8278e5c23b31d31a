"""The exact Jacobian equals central differences of the solved step: every phase, sticking and slipping, at depth.

Rows: tip (3) and, after puncture, the shaft's lateral offsets at the entry (2); columns scaled by a lever arm of 0.1 m.
Allowed: 1e-4 of each row (spec of the controllers); the fast form is many times that away, so the test can fail.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from numpy.typing import NDArray

import simcore.insertion.jacobian_exact
from simcore.contact.kernels import frame_along
from simcore.controllers import Observation, make_controller
from simcore.controllers.plant_model import make_model
from simcore.errors import ModelFailureError, Status
from simcore.insertion.jacobian_exact import linearise_exactly
from simcore.insertion.jacobian_fast import Linearisation, lateral_offset, linearise
from simcore.robot import limited_pose
from simcore.scenario.build import insertion_of, robot_limits
from simcore.scenario.scenario import Scenario
from simcore.trajectory import targets
from tests.simcore.block import AHEAD, TIGHT, advanced, block_scenario, curved_pose, moved
from tests.verification import verify

if TYPE_CHECKING:
    from collections.abc import Callable

    from simcore.insertion.insertion import Insertion, InsertionState
    from simcore.insertion.state import Pose

Vector = NDArray[np.float64]

LEVER = np.array([1.0, 1.0, 1.0, 0.1, 0.1, 0.1])
FAST_BOUND = {"quasi-static": 0.13, "dynamic": 0.2, "line": 0.16, "sine": 0.43}
DAMPED = {"density_kg_m3": 1000.0, "rayleigh_mass_per_s": 2.0, "rayleigh_stiffness_s": 0.02}


@dataclass(frozen=True)
class Case:
    """A step to be differentiated: from a state to a base pose."""

    insertion: Insertion
    before: InsertionState
    base: Pose


def rows(response: Linearisation) -> Vector:
    """(3 or 5, 6), columns in metres at the lever arm."""
    parts = [response.tip] if response.rcm is None else [response.tip, response.rcm]
    return np.vstack(parts) / LEVER


def differences(case: Case, step_m: float) -> tuple[Vector, list[NDArray[np.int64]]]:
    """(5, 6) by central differences of the step, and the active set of each solve."""
    columns, modes = [], []
    for dof in range(6):
        ends = []
        for side in (step_m, -step_m):
            twist = side * np.eye(6)[dof] / LEVER
            after = advanced(case.insertion, case.before, moved(case.base, twist[:3], twist[3:]))
            modes.append(after.solved.at.mode)
            offset = lateral_offset(case.insertion.model, after.bodies, after.inserted_m)[0]
            ends.append(np.concatenate([after.tip_m, offset]))
        columns.append((ends[0] - ends[1]) / (2.0 * step_m))
    return np.array(columns).T, modes


def errors(case: Case, step_m: float = 1e-7) -> tuple[Vector, Vector, NDArray[np.int64]]:
    """Errors of the exact and of the fast form, relative by row, and the active set, the same at every difference."""
    after = advanced(case.insertion, case.before, case.base)
    exact, fast = (
        rows(linearise_exactly(case.insertion.model, after.solved)),
        rows(linearise(case.insertion.model, after.solved)),
    )
    mode = after.solved.at.mode
    expected, modes = differences(case, step_m)
    assert all((other == mode).all() for other in modes), "the case is too near a change of the active set"
    expected = expected[: len(exact)]
    size = np.linalg.norm(expected, axis=1)
    return np.linalg.norm(exact - expected, axis=1) / size, np.linalg.norm(fast - expected, axis=1) / size, mode


def check(text: str, exact: Vector, fast: Vector, *, fast_bound: float) -> None:
    """Record both errors, the worst row; that of the fast form is shown, and bounded a fifth above what it is."""
    source = "central differences of the solved step (after Baksic et al. 2020)"
    shown = (("exact", exact, 1e-4), ("fast", fast, fast_bound))
    for name, found, tolerance in shown:
        case = f"{name} Jacobian, {text}: error of any row"
        verify("coupled", case, expected=0, measured=found, tolerance=tolerance, source=source)


def pushed(insertion: Insertion, advance_m: float, steps: int) -> tuple[InsertionState, InsertionState, Pose]:
    """States before and after the last of `steps` steps along the curved way, and its base pose."""
    state = insertion.initial_state(AHEAD)
    first = before = state
    for i in range(steps):
        base = curved_pose(first.base, advance_m * (i + 1) / steps)
        before, state = state, advanced(insertion, state, base)
    return before, state, base


@pytest.fixture(scope="module", params=["quasi-static", "dynamic"])
def kind(request: pytest.FixtureRequest) -> str:
    return str(request.param)


@pytest.fixture(scope="module")
def walk(kind: str) -> dict[str, Case]:
    """Push 48 mm on a curved way, reverse by a little, pull back past the first point, push again."""
    insertion = insertion_of(block_scenario(tissue=DAMPED if kind == "dynamic" else {}))
    before, state, base = pushed(insertion, 0.048, 96)
    cases = {"pushing": Case(insertion, before, base)}
    cases["reversed by 0.02 mm"] = Case(insertion, state, moved(base, np.array([1e-5, 2e-5, -2e-5])))
    for i in range(20):
        base = moved(base, np.array([0.0, 0.0, -5e-4]))
        before, state = state, advanced(insertion, state, base)
        if i in (7, 19):
            cases["pulled back a little" if i == 7 else "pulled back"] = Case(insertion, before, base)
    cases["turned round"] = Case(insertion, state, moved(base, np.array([1e-5, 0.0, 1e-4])))
    for _ in range(16):
        base = moved(base, np.array([0.0, 0.0, 5e-4]))
        before, state = state, advanced(insertion, state, base)
    return {**cases, "pushing again": Case(insertion, before, base)}


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", ["pushing", "reversed by 0.02 mm", "pulled back a little", "pulled back", "turned round", "pushing again"]
)
def test_sticking_and_slipping(walk: dict[str, Case], kind: str, name: str) -> None:
    exact, fast, mode = errors(walk[name])
    slipping = np.count_nonzero(mode % 2 == 0)
    expected = {"pushing": len(mode), "pulled back": len(mode), "pushing again": len(mode), "turned round": 0}
    assert slipping == expected.get(name, slipping)
    check(f"{kind}, {name}, {slipping} of {len(mode)} points slip", exact, fast, fast_bound=FAST_BOUND[kind])
    assert fast.max() > 1e-2


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["line", "sine"])
def test_paper_block_at_four_depths(kind: str) -> None:
    """I-FEM on a line and on a sine, at 3, 30, 70 and 110 mm of a block of the paper's size, coarsely meshed."""
    scenario = controlled_scenario(kind)
    worst = 0.0
    places = (3.0, 30.0, 70.0, 110.0)
    for depth, case in zip(places, depths(scenario, places), strict=True):
        exact, fast, _ = errors(case)
        check(f"I-FEM on a {kind}, {depth:g} mm deep", exact, fast, fast_bound=FAST_BOUND[kind])
        worst = max(worst, float(fast.max()))
    assert worst > 1e-2


def controlled_scenario(kind: str, **controller: Any) -> Scenario:
    """12 mm elements, 0.5 mm a step."""
    overlay = {"amplitude_mm": 1.0} if kind == "sine" else {}
    return Scenario.load(
        {
            "dt_s": 0.05,
            "tissue": {"element_size_mm": 12.0},
            "needle": {"elements": 12},
            "trajectory": {"kind": kind, "target_mm": [24.0, 41.0, 122.0], **overlay},
            "controller": {"kind": "ifem", **controller},
            "solver": TIGHT,
        }
    )


def depths(scenario: Scenario, depths_mm: tuple[float, ...]) -> list[Case]:
    """The steps of a controlled insertion that first reach each depth."""
    insertion = insertion_of(scenario)
    path = scenario.path()
    goals = targets(path, speed_m_s=0.01, dt_s=scenario.dt_s, steps=scenario.steps)
    before = state = insertion.initial_state(path.first_tangent())
    model = make_model(scenario, insertion, lambda: (before, state))
    controller = make_controller(scenario, entry_m=insertion.entry_m, needle_length_m=0.18, model=model)
    cases: list[Case] = []
    for step, goal in enumerate(goals[:-1]):
        command = controller.command(Observation(step, state.base, state.tip_m.copy(), goal))
        base, _ = limited_pose(state.base, command, robot_limits(scenario.robot), scenario.dt_s)
        before, state = state, advanced(insertion, state, base)
        if len(cases) < len(depths_mm) and state.inserted_m * 1e3 >= depths_mm[len(cases)]:
            cases.append(Case(insertion, before, base))
    assert len(cases) == len(depths_mm)
    return cases


def surface_contact(sideways_m: float, tilt_rad: float = 0.0) -> Case:
    """The tip presses 0.4 mm straight into the surface, then moves sideways; the contact's normal may be tilted."""
    insertion = insertion_of(block_scenario(interaction={"puncture_n": 0.3}))
    frame_along(np.array([0.0, np.sin(tilt_rad), np.cos(tilt_rad)]), insertion.model.surface_frame)
    first = insertion.initial_state(AHEAD)
    base = moved(first.base, np.array([0.0, 0.0, 4e-4]))
    state = advanced(insertion, first, base)
    for _ in range(3):
        before, base = state, moved(base, np.array([sideways_m, 0.4 * sideways_m, 0.0]))
        state = advanced(insertion, before, base)
    return Case(insertion, before, base)


@pytest.mark.parametrize(
    ("sideways_m", "tilt_rad", "fast_bound"), [(2e-5, 0.0, 0.005), (5e-4, 0.0, 0.09), (5e-4, 0.4, 0.1)]
)
def test_surface_contact_before_puncture(sideways_m: float, tilt_rad: float, fast_bound: float) -> None:
    """Sticking, slipping, and slipping on a tilted surface."""
    case = surface_contact(sideways_m, tilt_rad)
    exact, fast, _ = errors(case, step_m=1e-6)
    solved = advanced(case.insertion, case.before, case.base).solved
    assert solved.active.contact
    assert bool(solved.at.slide.any()) is (sideways_m > 1e-4)
    assert len(exact) == 3
    text = f"contact before puncture, {1e3 * sideways_m:g} mm sideways a step, surface tilted by {tilt_rad:g} rad"
    check(text, exact, fast, fast_bound=fast_bound)
    assert fast.max() > 1e-3


@pytest.mark.slow
def test_breathing_tissue() -> None:
    """The prescribed motion of the held nodes is no unknown: the step is differentiated around it."""
    insertion = insertion_of(block_scenario(motion={"kind": "breathing", "amplitude_mm": 3.0, "period_s": 1.0}))
    before, _, base = pushed(insertion, 0.03, 60)
    exact, fast, _ = errors(Case(insertion, before, base))
    check("breathing tissue", exact, fast, fast_bound=0.042)
    assert fast.max() > 1e-2


def test_surface_friction_opposes_the_slip() -> None:
    """Coulomb: F_lateral = mu F_n along the needle's slip over the tissue, whatever the kept factor."""
    case = surface_contact(5e-4)
    at, law = advanced(case.insertion, case.before, case.base).solved.at, case.insertion.model.law
    force, slip = at.force_n[0], -at.points.gap[0, :2]
    assert np.linalg.norm(slip) > 1e-4
    along = slip / np.linalg.norm(slip)
    assert np.abs(force[:2] - law.friction * force[2] * along).max() < 1e-7 * force[2]


def test_needle_in_the_air_moves_rigidly() -> None:
    """Contact with a skin that is not nicked is lost: the tip follows the base rigidly, J = [I, -[tip - base]]."""
    insertion = insertion_of(block_scenario(interaction={"puncture_n": 0.1}))
    state = insertion.initial_state(AHEAD)
    state = advanced(insertion, state, moved(state.base, np.array([1e-4, 2e-4, -1e-3]), np.array([0.01, 0.02, 0.03])))
    arm = state.tip_m - state.base.position_m
    expected = np.hstack([np.eye(3), np.cross(np.eye(3), -arm)])
    found, text = linearise_exactly(insertion.model, state.solved).tip, "exact Jacobian of a free needle"
    verify("coupled", text, expected=expected, measured=found, tolerance=1e-9, source="rigid body, dX - (tip - X) x dw")


@pytest.mark.slow
@pytest.mark.parametrize("form", [linearise, linearise_exactly])
def test_an_earlier_step_is_linearised_as_when_it_was_the_last(form: Callable[..., Linearisation]) -> None:
    """A solved step is a value: what is solved after it, with a new factor even, changes nothing in it."""
    insertion = insertion_of(block_scenario())
    _, state, _ = pushed(insertion, 0.02, 40)
    fresh = form(insertion.model, state.solved)
    later = state
    for _ in range(20):
        later = advanced(insertion, later, moved(later.base, np.array([2e-4, 0.0, 5e-4])))
    insertion.workspace.compliance.refactor(insertion.workspace.blocks.rotations())
    again = form(insertion.model, state.solved)
    np.testing.assert_array_equal(again.tip, fresh.tip)
    np.testing.assert_array_equal(again.rcm, fresh.rcm)


def test_without_the_tissue_a_step_is_linearised_in_the_fast_form_only() -> None:
    insertion = insertion_of(block_scenario(), keeps_tissue=False)
    _, state, _ = pushed(insertion, 5e-3, 10)
    assert np.isfinite(linearise(insertion.model, state.solved).tip).all()
    with pytest.raises(ValueError, match="without keeping the tissue"):
        linearise_exactly(insertion.model, state.solved)


def test_unfinished_iteration_is_a_named_failure(monkeypatch: pytest.MonkeyPatch) -> None:
    insertion = insertion_of(block_scenario())
    _, state, _ = pushed(insertion, 5e-3, 10)
    monkeypatch.setattr(simcore.insertion.jacobian_exact, "MAX_ITERATIONS", 1)
    with pytest.raises(ModelFailureError, match="exact Jacobian's residual is") as failure:
        linearise_exactly(insertion.model, state.solved)
    assert failure.value.status is Status.NOT_CONVERGED
