"""Runs that end by a name, and what a run warns of."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from simcore.episode.authority import lost_authority
from simcore.episode.endings import after_failure, after_step, place_of_inversion, shaft_beside
from simcore.errors import Status
from simcore.insertion.stability import is_stable
from simcore.rollout.cautions import run_warnings
from simcore.rollout.rollout import run
from simcore.scenario.build import insertion_of
from simcore.scenario.scenario import Scenario
from tests.simcore.short_run import LINE, replay, short

if TYPE_CHECKING:
    from simcore.insertion.insertion import Insertion, InsertionState
    from simcore.rollout.result import Rollout

THIN = {"outer_diameter_mm": 0.514, "inner_diameter_mm": 0.26, "length_mm": 300}  # 25G
DOWN = np.array([0.0, 0.0, 1.0])


# ---- the target


@pytest.mark.slow
@pytest.mark.parametrize(("success_mm", "allowed_mm"), [(2.0, 10.0), (0.5, 10.0), (4.0, 20.0)])
def test_a_tip_that_is_left_behind_has_lost_its_target(success_mm: float, allowed_mm: float) -> None:
    """120 mm/s for a robot that goes 50: this was a completed run, 35 mm from its target."""
    found = run(short(trajectory={**LINE, "speed_mm_s": 120}, dt_s=0.01, noise_mm=0.0, success_mm=success_mm))
    assert found.status is Status.TARGET_LOST
    assert f"mm from its target, at most {allowed_mm:g} mm" in found.message
    assert found.metrics["final_commanded_mm"] > allowed_mm  # the step that lost it is in the series
    assert (
        np.linalg.norm(found.series["tip_m"][1:-1] - found.series["target_m"][:-2], axis=1) <= 1e-3 * allowed_mm
    ).all()
    assert found.metrics["stable"] is False


def test_a_leap_to_the_end_is_no_success() -> None:
    """1000 mm/s in steps of 0.1 s: RMSE 0, and the end of the path never commanded."""
    found = run(short(trajectory={**LINE, "speed_mm_s": 1000}, dt_s=0.1, noise_mm=0.0))
    assert found.metrics["rmse_commanded_mm"] < 1.0
    assert found.metrics["final_same_time_mm"] > 30.0
    assert found.success is False


def test_prescribed_poses_have_no_target_to_lose() -> None:
    still = [[12.0, 20.0, -79.0, 1.0, 0.0, 0.0, 0.0]] * 30
    found = run(short(controller=replay(still), trajectory={**LINE, "speed_mm_s": 100}, noise_mm=0.0))
    assert found.metrics["max_commanded_mm"] > 30.0
    assert found.status is Status.COMPLETED


# ---- the needle's limit point


def buckling(**changes: Any) -> Rollout:
    block = {"size_mm": [36, 62, 122], "element_size_mm": 10}
    target = {"kind": "line", "entry_mm": [18, 31, 0], "target_mm": [18, 31, 60]}
    return run(Scenario.load({"tissue": block, "needle": THIN, "trajectory": target, "dt_s": 0.02, **changes}))


@pytest.mark.slow
def test_a_thin_needle_buckles_at_the_load_of_euler() -> None:
    """A strut held at its base and led at the entry: 2.0457 pi^2 EI / l^2; its end in the tissue is not quite still."""
    found = buckling()
    assert found.status is Status.BUCKLED
    assert "the needle buckles" in found.message
    free_m = 0.3 - found.series["depth_m"][-1]
    bending = 200e9 * math.pi / 64.0 * ((0.514e-3) ** 4 - (0.26e-3) ** 4)
    euler_n = 2.0457 * math.pi**2 * bending / free_m**2
    assert 0.9 * euler_n < found.metrics["max_push_n"] < 1.03 * euler_n


@pytest.mark.slow
def test_a_step_that_fails_just_below_the_limit_is_named_after_it() -> None:
    insertion, state = inserted(THIN)
    failed = replace(state, report=replace(state.report, status=Status.NOT_CONVERGED, message="residual 1 N"))
    push = float(state.base_wrench[:3] @ state.base.rotation[:, 2])
    assert is_stable(insertion.model, state.solved)
    limit = max(load for load in np.arange(1.0, 4.0, 0.01) if is_stable(insertion.model, state.solved, load=load))
    status, message = after_failure(insertion, state, failed, 0.0, [])
    assert (status is Status.BUCKLED) == (limit < 1.1)
    assert ("buckles" in message) == (limit < 1.1)
    free_m = 0.3 - state.inserted_m
    euler_n = 2.0457 * math.pi**2 * insertion.needle.bending_nm2 / free_m**2
    assert push * limit == pytest.approx(euler_n, rel=0.05)
    stiff, calm = inserted({"length_mm": 80})
    worse = replace(calm, report=replace(calm.report, status=Status.NOT_CONVERGED, message="residual 1 N"))
    assert after_failure(stiff, calm, worse, 0.0, []) == (Status.NOT_CONVERGED, "residual 1 N")


def inserted(needle: dict[str, Any], steps: int = 20) -> tuple[Insertion, InsertionState]:
    """A needle pushed straight in by 2 mm, on the coarse block of `short`."""
    scenario = short(needle={"elements": 20, **needle}, trajectory=LINE, noise_mm=0.0)
    insertion = insertion_of(scenario)
    state = insertion.initial_state(DOWN)
    for _ in range(steps):
        base = replace(state.base, position_m=state.base.position_m + 1e-4 * DOWN)
        state = insertion.step(state, base)
        assert state.report.status is Status.COMPLETED
    return insertion, state


# ---- base and free shaft


@pytest.mark.parametrize(("nodes", "part"), [(slice(0, 1), "base"), (slice(0, 3), "base"), (slice(2, 3), "free shaft")])
def test_a_shaft_beside_the_tissue_is_outside_the_model(nodes: slice, part: str) -> None:
    insertion, state = inserted({"length_mm": 80})
    assert shaft_beside(insertion, state) is None
    state.bodies.needle_x[nodes] = [0.05, 0.05, 3e-3]
    message = shaft_beside(insertion, state)
    assert message is not None
    assert message.startswith(f"the needle's {part} is 3.0 mm below the surface")
    scenario = short(needle={"length_mm": 80}, trajectory=LINE)
    assert after_step(scenario, insertion, state, 0.0, [])[0] is Status.SHAFT_BESIDE


def test_a_tip_that_dents_the_surface_is_not_beside_it() -> None:
    scenario = short(interaction={"puncture_n": 5.0}, trajectory=LINE, noise_mm=0.0)
    insertion = insertion_of(scenario)
    state = insertion.initial_state(DOWN)
    for _ in range(25):
        state = insertion.step(state, replace(state.base, position_m=state.base.position_m + 2e-4 * DOWN))
    assert state.inserted_m == 0.0
    assert state.tip_m[2] > 2e-3
    assert shaft_beside(insertion, state) is None


# ---- authority


def steered(*diagonals: tuple[float, float]) -> list[np.ndarray]:
    return [np.full((2, 2), np.nan), *(np.diag(pair) for pair in diagonals)]


@pytest.mark.parametrize(
    ("authority", "lost"),
    [
        ([], False),
        (steered((-0.01, -0.01), (-0.1, -0.1), (-0.1, -0.05)), False),
        (steered((-0.01, -0.01), (-0.01, -0.005)), False),  # never steered: nothing to lose
        (steered((-0.1, -0.1), (-0.1, -0.02)), True),
        (steered((-0.1, -0.1), (-0.1, -0.04), (-0.1, 0.04)), True),  # through zero between two steps
    ],
)
def test_authority_is_lost_at_its_floor_or_through_zero(authority: list[np.ndarray], lost: bool) -> None:
    assert (lost_authority(authority) is not None) == lost


def test_only_a_run_that_fails_is_named_after_its_authority() -> None:
    insertion, state = inserted({"length_mm": 80})
    gone = steered((-0.1, -0.1), (-0.1, 0.01))
    scenario = short(trajectory=LINE)
    assert after_step(scenario, insertion, state, 9e-3, gone) == (Status.COMPLETED, "")
    status, message = after_step(scenario, insertion, state, 11e-3, gone)
    assert status is Status.AUTHORITY_LOST
    assert "RCM authority was lost" in message
    assert "11.0 mm from its target" in message
    failed = replace(state, report=replace(state.report, status=Status.NOT_CONVERGED, message="residual 1 N"))
    assert after_failure(insertion, state, failed, 1.9e-3, gone) == (Status.NOT_CONVERGED, "residual 1 N")
    status, message = after_failure(insertion, state, failed, 2.1e-3, gone)
    assert status is Status.AUTHORITY_LOST
    assert message.endswith("; residual 1 N")


# ---- where


def test_an_inversion_says_where() -> None:
    insertion, state = inserted({"length_mm": 80})
    rest, tets = insertion.tissue.mesh.nodes_m, insertion.tissue.mesh.tets
    corner = tets[np.linalg.norm(rest[tets].mean(axis=1) - [0.0, 0.02, 0.04], axis=1).argmin()]
    centre = rest[corner].mean(axis=0)
    free = next(node for node in corner if not np.isin(rest[node], [0.0]).all())
    state.bodies.x[free] += 2.5 * (rest[corner].mean(axis=0) - rest[free])
    message = place_of_inversion(insertion, state)
    x, y, z = 1e3 * rest[tets[worst_of(insertion, state)]].mean(axis=0)
    assert f"the tetrahedron at ({x:.1f}, {y:.1f}, {z:.1f}) mm" in message
    assert f"{np.linalg.norm([x - 12, y - 20, z]):.1f} mm from the entry" in message
    assert np.linalg.norm(1e-3 * np.array([x, y, z]) - centre) < 0.02
    failed = replace(state, report=replace(state.report, status=Status.INVERTED, message="min det F = 0.05"))
    assert after_failure(insertion, state, failed, 0.0, []) == (Status.INVERTED, f"min det F = 0.05; {message}")


def worst_of(insertion: Insertion, state: InsertionState) -> int:
    tissue = insertion.tissue
    gradients = np.einsum("tai,taj->tij", state.bodies.x[tissue.mesh.tets], tissue.gradients)
    return int(np.linalg.det(gradients).argmin())


# ---- warnings


def series(**columns: Any) -> dict[str, np.ndarray]:
    rows = 4
    plain = {
        "t_s": np.arange(rows),
        "depth_m": 1e-3 * np.arange(rows),
        "needle_stress_pa": np.zeros(rows),
        "min_det_f": np.ones(rows),
        "min_det_f_at_m": np.tile([0.012, 0.02, 0.005], (rows, 1)),
        "limited": np.zeros(rows, bool),
        "rcm_sigma_min": np.full(rows, np.nan),
        "rcm_authority": np.full((rows, 2, 2), np.nan),
    }
    return {**plain, **{name: np.array(values) for name, values in columns.items()}}


def test_a_calm_run_warns_of_nothing() -> None:
    assert run_warnings(series(), short()) == []


def test_a_needle_that_would_yield_is_told_with_its_depth() -> None:
    (line,) = run_warnings(series(needle_stress_pa=[0.0, 5e8, 1.2e9, 1.5e9]), short())
    assert "reaches 1500 MPa and passes needle.yield_mpa = 1030 at a depth of 2.0 mm" in line
    assert run_warnings(series(needle_stress_pa=[1.2e9] * 4), short(needle={"yield_mpa": 1300})) == []


def test_an_entry_fold_is_told_with_its_det_f() -> None:
    (line,) = run_warnings(series(min_det_f=[1.0, 0.8, 0.31, 0.6]), short())
    assert "folds at the entry: det F falls to 0.31, 5.0 mm from it, at a depth of 2.0 mm" in line
    far = np.tile([0.012, 0.02, 0.03], (4, 1))
    assert run_warnings(series(min_det_f=[1.0, 0.8, 0.31, 0.6], min_det_f_at_m=far), short()) == []


def test_limits_that_act_in_most_steps_are_told() -> None:
    (line,) = run_warnings(series(limited=[False, True, True, False]), short())
    assert "acted in 67 % of the steps" in line
    assert run_warnings(series(limited=[False, True, False, False]), short()) == []


@pytest.mark.slow
def test_a_run_past_its_yield_stress_is_no_success_and_says_so() -> None:
    lax, strict = (run(short(noise_mm=0.0, needle={"yield_mpa": limit})) for limit in (10_000, 1))
    assert (lax.success, strict.success) == (True, False)
    assert lax.digest == strict.digest
    assert any("needle.yield_mpa = 1 " in line for line in strict.result()["warnings"])
