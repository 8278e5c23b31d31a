"""Breathing: the held nodes are where they are prescribed, and the tissue follows by the equations of motion."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from scipy.linalg import cho_factor, cho_solve

from simcore.errors import ScenarioError
from simcore.rollout.rollout import run
from simcore.scenario.build import breathing_motion, insertion_of
from simcore.scenario.scenario import Breathing, Scenario, Still
from simcore.tissue.model import rotated_stiffness_times
from tests.simcore.block import Vector, advanced, block_scenario, moved, straight_poses

if TYPE_CHECKING:
    from simcore.insertion.insertion import Insertion, InsertionState

BREATH = {"kind": "breathing", "amplitude_mm": 6.0, "period_s": 0.5, "direction": [0.0, 3.0, 4.0]}


def lone_tissue(steps: int, **blocks: Any) -> tuple[Insertion, list[InsertionState]]:
    """Steps without a needle: its base has been pulled back by 40 mm."""
    insertion = insertion_of(block_scenario(interaction={"puncture_n": 0.1}, **blocks))
    state = insertion.initial_state(np.array([0.0, 0.0, 1.0]))
    base, states = moved(state.base, np.array([0.0, 0.0, -0.04])), [state]
    for _ in range(steps):
        states.append(advanced(insertion, states[-1], base))
    return insertion, states


def test_the_curve() -> None:
    """u = A (1 - cos(2 pi t / T)) d: from rest to twice the amplitude and back, with the slope of its derivative."""
    motion = breathing_motion(Breathing(amplitude_mm=6.0, period_s=4.0, direction=(0.0, 3.0, 4.0)))
    assert motion is not None
    along = np.array([0.0, 0.6, 0.8])
    for t in (0.0, 0.3, 1.0, 2.0, 3.7, 4.0, 9.1):
        expected = 6e-3 * (1.0 - np.cos(2 * np.pi * t / 4.0)) * along
        np.testing.assert_allclose(motion.shift_m(t), expected, atol=1e-16)
        slope = (motion.shift_m(t + 1e-6) - motion.shift_m(t - 1e-6)) / 2e-6
        rate = 6e-3 * 2 * np.pi / 4.0 * np.sin(2 * np.pi * t / 4.0)
        np.testing.assert_allclose(slope, rate * along, atol=1e-8)
    assert not motion.shift_m(0.0).any()
    assert not motion.shift_m(4.0).any()
    assert np.linalg.norm(motion.shift_m(2.0)) == pytest.approx(12e-3, rel=1e-15)


def test_the_default_is_the_cited_breath() -> None:
    """specification of the tissue: 12 mm peak to peak at 0.25 Hz; off unless asked for."""
    assert isinstance(Scenario().motion, Still)
    assert breathing_motion(Scenario().motion) is None
    breath = Scenario.load({"motion": {"kind": "breathing"}}).motion
    assert isinstance(breath, Breathing)
    assert (2 * breath.amplitude_mm, 1 / breath.period_s, breath.direction) == (12.0, 0.25, (0.0, 0.0, 1.0))


@pytest.mark.parametrize(
    ("motion", "field"),
    [
        ({"amplitude_mm": 3.0}, "motion.amplitude_mm"),
        ({"kind": "coughing"}, "motion.kind"),
        ({"kind": "breathing", "amplitude_mm": -1.0}, "motion.amplitude_mm"),
        ({"kind": "breathing", "period_s": 0.1}, "motion.period_s"),
        ({"kind": "breathing", "direction": [0.0, 0.0, 0.0]}, "motion.direction"),
        ({"kind": "breathing", "direction": [0.0, 0.0, 1e-300]}, "motion.direction"),
    ],
)
def test_a_wrong_motion_is_refused_by_name(motion: dict[str, Any], field: str) -> None:
    with pytest.raises(ScenarioError) as refused:
        Scenario.load({"motion": motion})
    assert [problem.field for problem in refused.value.problems] == [field]


@pytest.mark.parametrize("faces", [["y_min", "y_max"], ["x_min", "x_max", "y_min", "y_max", "z_max"]])
def test_an_unloaded_tissue_moves_as_one_piece(faces: list[str]) -> None:
    """Quasi-static, held faces translated: rigid translation of every node, no force anywhere, whatever is held."""
    insertion, states = lone_tissue(30, tissue={"fixed_faces": faces}, motion=BREATH)
    rest, motion = insertion.tissue.mesh.nodes_m, insertion.motion
    assert motion is not None
    for i, state in enumerate(states):
        np.testing.assert_allclose(state.bodies.x, rest + motion.shift_m(0.01 * i), atol=1e-15)
        assert state.report.min_det_f == pytest.approx(1.0, abs=1e-12)
    assert np.abs(insertion.workspace.held_n).max() < 1e-12
    assert np.abs(states[25].bodies.x - rest).max() > 9e-3


def test_after_one_breath_the_tissue_is_where_it_was() -> None:
    """Quasi-static, without a needle: the state has the period of the motion."""
    insertion, states = lone_tissue(60, motion=BREATH)
    np.testing.assert_allclose(states[50].bodies.x, insertion.tissue.mesh.nodes_m, atol=1e-15)
    np.testing.assert_allclose(states[60].bodies.x, states[10].bodies.x, atol=1e-15)
    np.testing.assert_allclose(states[60].bodies.v, states[10].bodies.v, atol=1e-12)


def test_held_nodes_are_exactly_where_they_are_prescribed() -> None:
    """To the last bit, also while a needle is pushed in; the rest of the tissue is deformed by it."""
    insertion = insertion_of(block_scenario(motion=BREATH))
    state = insertion.initial_state(np.array([0.0, 0.0, 1.0]))
    held, rest = insertion.tissue.unknown < 0, insertion.tissue.mesh.nodes_m
    assert insertion.motion is not None
    for i, base in enumerate(straight_poses(state.base, np.linspace(5e-4, 0.02, 40))):
        state = advanced(insertion, state, base)
        shift = insertion.motion.shift_m((i + 1) * 0.01)
        np.testing.assert_array_equal(state.bodies.x[held], rest[held] + shift)
    assert state.inserted_m > 5e-3
    assert np.abs(state.bodies.x - rest - shift).max() > 5e-4


def test_a_step_depends_on_its_state_alone() -> None:
    """The time of the motion is part of the state: the same step twice, and in another order, is the same."""
    insertion = insertion_of(block_scenario(motion=BREATH))
    first = insertion.initial_state(np.array([0.0, 0.0, 1.0]))
    poses = straight_poses(first.base, np.array([0.002, 0.004]))
    second = insertion.step(first, poses[0])
    third = insertion.step(second, poses[1])
    again = insertion.step(insertion.step(first, poses[0]), poses[1])
    assert (first.steps, second.steps, third.steps) == (0, 1, 2)
    np.testing.assert_allclose(again.bodies.x, third.bodies.x, atol=1e-11)


@pytest.mark.slow
def test_a_breath_of_no_depth_is_no_breath() -> None:
    """Amplitude 0 and no motion at all give the same digest."""
    path = {"target_mm": [12.0, 20.0, 5.0]}
    still = run(block_scenario(trajectory=path))
    shallow = run(block_scenario(trajectory=path, motion={**BREATH, "amplitude_mm": 0.0}))
    assert still.digest == shallow.digest


def linear_response(insertion: Insertion, steps: int) -> list[Vector]:
    """Displacements (n, 3) of the small-strain tissue under the same motion: dense implicit Euler,
    M (v+ - v) / dt + (alpha M + beta K) v+ + K u+ = 0 on the free nodes."""
    t, dt = insertion.tissue, insertion.model.dt_s
    n, motion = len(t.mesh.nodes_m), insertion.motion
    assert motion is not None
    stiff, column = np.empty((3 * n, 3 * n)), np.empty((n, 3))
    material = (t.mesh.tets, t.gradients, t.volumes_m3, t.mu_pa, t.lambda_pa)
    cold = np.tile(np.eye(3).ravel(), (len(t.mesh.tets), 1))
    for i, unit in enumerate(np.eye(3 * n)):
        rotated_stiffness_times(unit.reshape(n, 3), *material, cold, column)
        stiff[:, i] = column.ravel()
    mass = np.diag(np.repeat(t.masses_kg, 3))
    damping = t.mass_damping_per_s * mass + t.stiffness_damping_s * stiff
    free, matrix = np.repeat(t.unknown >= 0, 3), mass / dt**2 + damping / dt + stiff
    factor, from_held = cho_factor(matrix[free][:, free]), matrix[free][:, ~free]
    u, v, states = np.zeros(3 * n), np.zeros(3 * n), []
    for step in range(1, steps + 1):
        new = np.tile(motion.shift_m(step * dt), n)
        right = mass @ (u / dt**2 + v / dt) + damping @ u / dt
        new[free] = cho_solve(factor, right[free] - from_held @ new[~free])
        u, v = new, (new - u) / dt
        states.append(u.reshape(n, 3))
    return states


def test_inertia_and_damping_feel_the_motion() -> None:
    """A soft, heavy, damped block shaken by 0.02 mm: the small-strain solution, integrated independently."""
    tissue = {"young_kpa": 0.3, "density_kg_m3": 20e3, "rayleigh_mass_per_s": 2.0, "rayleigh_stiffness_s": 0.01}
    shake = {"kind": "breathing", "amplitude_mm": 0.01, "period_s": 0.5, "direction": [1.0, 0.5, 0.3]}
    insertion, states = lone_tissue(40, tissue=tissue, motion=shake)
    rest = insertion.tissue.mesh.nodes_m
    lag = 0.0
    for i, expected in enumerate(linear_response(insertion, 40)):
        np.testing.assert_allclose(states[i + 1].bodies.x - rest, expected, atol=2e-8)
        lag = max(lag, float(np.abs(expected - expected[insertion.tissue.unknown < 0][0]).max()))
    assert lag > 1e-5  # the free nodes do not just go along
