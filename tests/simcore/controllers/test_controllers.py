"""The controllers on toy plants whose answers are known: no tissue, no solver."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from simcore.controllers import Observation, make_controller
from simcore.controllers.ifem import InverseFemController, objectives
from simcore.controllers.open_loop import OpenLoopController
from simcore.controllers.replay import ReplayController
from simcore.insertion.insertion import rotation_towards
from simcore.insertion.jacobian_fast import Linearisation
from simcore.insertion.state import Pose
from simcore.rotations import exp_map, log_map, skew
from simcore.scenario.scenario import InverseFem, Scenario
from simcore.trajectory import targets

if TYPE_CHECKING:
    from collections.abc import Callable

Vector = np.ndarray
LENGTH_M = 0.18


# ---- inverse FEM on a linear plant


class RigidNeedle:
    """tip = base + length R e_z: the response of a needle that does not bend, in the form of a linearisation."""

    def __init__(self, base: Pose, *, inserted: bool = True, entry_m: Vector | None = None) -> None:
        self.base = base
        self.inserted = inserted
        self.entry_m = np.zeros(3) if entry_m is None else entry_m

    @property
    def tip_m(self) -> Vector:
        return self.base.position_m + LENGTH_M * self.base.rotation[:, 2]

    def __call__(self, _: Observation | None = None) -> Linearisation:
        arm = self.tip_m - self.base.position_m
        tip = np.hstack([np.eye(3), -skew(arm)])
        across = self.base.rotation[:, :2].T
        reach = self.base.rotation[:, 2] @ (self.entry_m - self.base.position_m)
        passing = np.hstack([np.eye(3), -skew(reach * self.base.rotation[:, 2])])
        at_entry = self.base.position_m + reach * self.base.rotation[:, 2]
        offset = across @ (at_entry - self.entry_m)
        return Linearisation(tip, across @ passing if self.inserted else None, offset)

    def observe(self, target_m: Vector) -> Observation:
        return Observation(0, self.base, self.tip_m, target_m)


DT_S = 0.01
START = Pose(np.array([0.0, 0.0, -0.15]), np.eye(3))
BESIDE = Pose(np.array([2e-3, -1e-3, -0.15]), exp_map(np.array([0.01, 0.03, 0.0])))


def follow(plant: RigidNeedle, settings_: InverseFem, target_m: Vector, steps: int) -> list[float]:
    """Distances of the tip from a fixed target, step by step, without robot limits."""
    controller = InverseFemController(settings_, plant, DT_S)
    gaps = []
    for _ in range(steps):
        plant.base = controller.command(plant.observe(target_m))
        gaps.append(float(np.linalg.norm(plant.tip_m - target_m)))
    return gaps


def test_the_tip_reaches_a_target_on_the_axis_in_one_step() -> None:
    target = np.array([0.0, 0.0, 0.031])
    (gap,) = follow(RigidNeedle(START), InverseFem(direction_speed_mm_s=1e5), target, 1)
    assert gap < 1e-10


def test_the_tip_reaches_a_target_beside_and_the_needle_passes_the_entry() -> None:
    plant, target = RigidNeedle(START), np.array([1e-3, -2e-3, 0.032])
    gaps = follow(plant, InverseFem(direction_speed_mm_s=1e5), target, 8)
    assert gaps[-1] < 1e-9
    assert np.linalg.norm(plant().rcm_error_m) < 1e-9


def test_a_slow_direction_takes_longer_and_ends_at_the_same_goal() -> None:
    target = np.array([1e-3, -2e-3, 0.032])
    gaps = follow(RigidNeedle(START), InverseFem(), target, 150)
    assert all(after <= before for before, after in pairwise(gaps[:20]))
    assert gaps[-1] < 1e-8


@pytest.mark.parametrize("gain", [0.25, 0.5, 1.0])
def test_the_gain_is_the_share_of_the_error_taken_away(gain: float) -> None:
    target = np.array([0.0, 0.0, 0.031])
    (gap,) = follow(RigidNeedle(START), InverseFem(direction_speed_mm_s=1e5, gain=gain), target, 1)
    assert gap == pytest.approx((1 - gain) * 1e-3, abs=1e-10)


def test_the_remote_centre_pulls_the_shaft_back() -> None:
    plant = RigidNeedle(BESIDE)
    before = np.linalg.norm(plant().rcm_error_m)
    follow(plant, InverseFem(direction_speed_mm_s=1e5), plant.tip_m, 5)
    assert np.linalg.norm(plant().rcm_error_m) < 1e-6 * before


@pytest.mark.parametrize(
    ("plant", "gains"),
    [
        (RigidNeedle(BESIDE, inserted=False), {}),
        (RigidNeedle(BESIDE), {"rcm_gain": 0.0}),
        (RigidNeedle(BESIDE), {"rcm_weight": 0.0}),
    ],
)
def test_rows_of_the_remote_centre_are_off_before_puncture_and_without_gain(
    plant: RigidNeedle, gains: dict[str, float]
) -> None:
    response = plant()
    error = np.array([1e-3, 2e-3, 3e-3])
    jacobian, wanted = objectives(response, error, InverseFem(gain=0.5, **gains))
    np.testing.assert_array_equal(jacobian, -response.tip)
    np.testing.assert_array_equal(wanted, 0.5 * error)
    tip = plant.tip_m.copy()
    stay = InverseFemController(InverseFem(**gains), plant, DT_S).command(plant.observe(tip))
    np.testing.assert_allclose(stay.position_m, plant.base.position_m, atol=1e-16)
    np.testing.assert_allclose(stay.rotation, plant.base.rotation, atol=1e-16)


def test_objectives_are_stacked_tip_first_with_their_gains() -> None:
    response = RigidNeedle(BESIDE)()
    assert response.rcm is not None
    error = np.array([1e-3, 2e-3, 3e-3])
    jacobian, wanted = objectives(response, error, InverseFem(gain=0.5, rcm_gain=0.25, rcm_weight=1.0))
    np.testing.assert_array_equal(jacobian, np.vstack([-response.tip, response.rcm]))
    np.testing.assert_allclose(wanted, [*(0.5 * error), *(0.25 * response.rcm_error_m)])


def test_the_jacobian_is_the_derivative_of_the_objectives() -> None:
    """J = de/dX with e = (n_traj - n_tip, offsets): the signs that make X - J^+ e a step towards zero."""
    target = np.array([1e-3, -2e-3, 0.032])
    through = Pose(
        -0.15 * rotation_towards(np.array([0.6, 0.0, 0.8]))[:, 2], rotation_towards(np.array([0.6, 0.0, 0.8]))
    )
    jacobian, _ = objectives(RigidNeedle(through)(), target - RigidNeedle(through).tip_m, InverseFem(rcm_weight=1.0))
    h = 1e-6
    for column, direction in enumerate(np.eye(6)):
        ends = []
        for sign in (1, -1):
            shift, turn = sign * h * direction[:3], sign * h * direction[3:]
            plant = RigidNeedle(Pose(through.position_m + shift, exp_map(turn) @ through.rotation))
            ends.append(np.concatenate([target - plant.tip_m, plant().rcm_error_m]))
        np.testing.assert_allclose(jacobian[:, column], (ends[0] - ends[1]) / (2 * h), atol=1e-8)


def test_the_lever_arm_weighs_turning_against_moving() -> None:
    """One lateral target, two ways to it: a long lever arm makes turning dear, a short one cheap."""
    target = np.array([1e-3, 0.0, 0.03])
    turns = []
    for lever in (10.0, 100.0, 1000.0):
        plant = RigidNeedle(START, inserted=False)
        command = InverseFemController(InverseFem(lever_arm_mm=lever, direction_speed_mm_s=1e5), plant, DT_S).command(
            plant.observe(target)
        )
        turns.append(float(np.linalg.norm(log_map(command.rotation))))
        shift = command.position_m[0] + LENGTH_M * log_map(command.rotation)[1]
        assert shift == pytest.approx(1e-3, rel=1e-6)  # to first order the tip goes to the target either way
        a = LENGTH_M / (lever * 1e-3)
        assert log_map(command.rotation)[1] == pytest.approx(1e-3 / LENGTH_M * a**2 / (1 + a**2), rel=1e-6)
    assert turns[0] > turns[1] > turns[2]


def test_a_command_is_a_rigid_pose_and_leaves_the_observation_alone() -> None:
    plant = RigidNeedle(BESIDE)
    seen = plant.observe(np.array([5e-3, 5e-3, 0.03]))
    kept = replace(seen, base=Pose(seen.base.position_m.copy(), seen.base.rotation.copy()), tip_m=seen.tip_m.copy())
    command = InverseFemController(InverseFem(), plant, DT_S).command(seen)
    np.testing.assert_allclose(command.rotation @ command.rotation.T, np.eye(3), atol=1e-14)
    np.testing.assert_array_equal(seen.base.position_m, kept.base.position_m)
    np.testing.assert_array_equal(seen.tip_m, kept.tip_m)


# ---- open loop


def scenario(**blocks: Any) -> Scenario:
    base: dict[str, Any] = {
        "trajectory": {"entry_mm": [18, 31, 0], "target_mm": [24, 41, 122]},
        "controller": {"kind": "open_loop"},
    }
    return Scenario.load({**base, **blocks})


def nothing(_: Observation) -> Linearisation:
    raise AssertionError("this controller must not ask the plant")


def made(described: Scenario) -> Any:
    entry = np.array(described.trajectory.entry_mm) * 1e-3
    return make_controller(described, entry_m=entry, needle_length_m=described.needle.length_mm * 1e-3, model=nothing)


def blind(step: int) -> Observation:
    nowhere = np.full(3, math.nan)
    return Observation(step, Pose(nowhere, np.full((3, 3), math.nan)), nowhere, nowhere)


def test_open_loop_puts_a_rigid_tip_on_the_targets() -> None:
    described = scenario()
    controller = made(described)
    wanted = targets(described.path(), speed_m_s=0.01, dt_s=0.01, steps=described.steps)
    for step in (0, 1, 500, described.steps - 1, described.steps):
        pose = controller.command(blind(step))
        np.testing.assert_allclose(pose.position_m + LENGTH_M * pose.rotation[:, 2], wanted[step], atol=1e-12)
        assert pose.rotation[:, 2] @ (wanted[-1] - wanted[0]) == pytest.approx(np.linalg.norm(wanted[-1] - wanted[0]))


def test_open_loop_stays_at_the_end() -> None:
    controller = made(scenario())
    last, after = controller.command(blind(1_000_000)), controller.command(blind(2_000_000))
    np.testing.assert_array_equal(last.position_m, after.position_m)
    np.testing.assert_allclose(last.position_m + LENGTH_M * last.rotation[:, 2], [0.024, 0.041, 0.122], atol=1e-15)


def test_open_loop_ignores_the_overlay_but_keeps_its_time() -> None:
    described = scenario(trajectory={"kind": "sine", "amplitude_mm": 5.0, "periods": 3.0}, needle={"length_mm": 200.0})
    controller = made(described)
    half = controller.command(blind(round(described.steps / 2)))
    np.testing.assert_allclose(half.rotation, np.eye(3), atol=1e-15)
    np.testing.assert_allclose(half.position_m * 1e3, [18.0, 31.0, 61.0 - 200.0], atol=0.06)
    assert described.steps > 1220


# ---- replay


def test_replay_gives_its_poses_in_order_in_metres() -> None:
    turn = [math.cos(0.3), math.sin(0.3), 0.0, 0.0]
    poses = [[18.0, 31.0, -180.0, 1.0, 0.0, 0.0, 0.0], [1.0, -2.0, 3.0, *turn]]
    controller = made(scenario(controller={"kind": "replay", "poses": poses}))
    first, second = (controller.command(blind(i)) for i in (0, 1))
    np.testing.assert_allclose(first.position_m, [0.018, 0.031, -0.18])
    np.testing.assert_array_equal(first.rotation, np.eye(3))
    np.testing.assert_allclose(second.position_m, [1e-3, -2e-3, 3e-3])
    np.testing.assert_allclose(second.rotation, exp_map(np.array([0.6, 0.0, 0.0])), atol=1e-15)
    with pytest.raises(IndexError):
        controller.command(blind(2))


@pytest.mark.parametrize("scale", [0.9991, 1.0009, -1.0])
def test_replay_normalises_quaternions_of_either_sign(scale: float) -> None:
    exact = np.array([math.cos(0.4), 0.0, math.sin(0.4), 0.0])
    poses = [[0.0, 0.0, 0.0, *(scale * exact)]]
    rotation = made(scenario(controller={"kind": "replay", "poses": poses})).command(blind(0)).rotation
    np.testing.assert_allclose(rotation, exp_map(np.array([0.0, 0.8, 0.0])), atol=1e-15)
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-15)


# ---- the registry


@pytest.mark.parametrize(
    ("block", "kind", "limited"),
    [
        ({"kind": "ifem"}, InverseFemController, True),
        ({"kind": "open_loop"}, OpenLoopController, True),
        ({"kind": "replay", "poses": [[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]]}, ReplayController, False),
    ],
)
def test_a_block_becomes_its_controller(block: dict[str, Any], kind: Callable[..., object], limited: bool) -> None:
    controller = made(scenario(controller=block))
    assert type(controller) is kind
    assert controller.limited is limited
