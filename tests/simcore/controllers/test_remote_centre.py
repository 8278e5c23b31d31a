"""The remote centre: weighted rows, the axis through the entry, and the authority that is left once it is kept."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from simcore.controllers.ifem import AxisThroughEntryController, InverseFemController, objectives
from simcore.controllers.remote_centre import following_response, pose_through, rcm_authority
from simcore.insertion.jacobian_fast import Linearisation
from simcore.insertion.state import Pose
from simcore.rollout.rollout import run
from simcore.rotations import exp_map, log_map, matrix_from_quaternion
from simcore.scenario.scenario import InverseFem
from tests.simcore.controllers.test_controllers import BESIDE, DT_S, LENGTH_M, START, RigidNeedle
from tests.simcore.short_run import short

if TYPE_CHECKING:
    from simcore.controllers import Observation

Vector = np.ndarray
LEVER_ONE = 1000.0  # mm: rotations count as they are, in rad
THROUGH = Pose(np.array([0.01, -0.02, -0.14]), np.eye(3))  # before it is turned to the entry
ENTRY = np.zeros(3)


def random_response(seed: int) -> Linearisation:
    rng = np.random.default_rng(seed)
    return Linearisation(rng.normal(size=(3, 6)), rng.normal(size=(2, 6)), 1e-3 * rng.normal(size=2))


class Fixed:
    """A model whose answer is always the same."""

    def __init__(self, response: Linearisation) -> None:
        self.response = response

    def __call__(self, _: Observation) -> Linearisation:
        return self.response


def turned(base: Pose) -> Pose:
    """The same base with its axis through the entry."""
    return pose_through(ENTRY, base.position_m, base.rotation)


# ---- the weight of the rows


@pytest.mark.parametrize("weight", [0.03, 0.5, 1.0, 10.0])
def test_a_command_solves_the_weighted_least_squares_problem(weight: float) -> None:
    """min |k e_tip - tip x|^2 + w^2 |k_rcm e_rcm + rcm x|^2, the smallest such x, where no direction is slowed."""
    for seed in range(5):
        response = random_response(seed)
        assert response.rcm is not None
        settings = InverseFem(
            gain=0.7, rcm_gain=0.4, rcm_weight=weight, direction_speed_mm_s=1e5, lever_arm_mm=LEVER_ONE
        )
        plant = RigidNeedle(START)
        target = plant.tip_m + np.array([1e-3, -2e-3, 3e-3])
        command = InverseFemController(settings, Fixed(response), 1e3).command(plant.observe(target))
        rows = np.vstack([response.tip, -weight * response.rcm])
        right = np.concatenate([0.7 * (target - plant.tip_m), weight * 0.4 * response.rcm_error_m])
        expected = np.linalg.lstsq(rows, right, rcond=None)[0]
        found = np.concatenate([command.position_m - START.position_m, log_map(command.rotation @ START.rotation.T)])
        np.testing.assert_allclose(found, expected, atol=1e-12)


def test_the_weight_is_on_both_sides_and_the_gain_on_one() -> None:
    response = random_response(7)
    assert response.rcm is not None
    jacobian, wanted = objectives(response, np.ones(3), InverseFem(rcm_gain=0.5, rcm_weight=0.25))
    np.testing.assert_array_equal(jacobian, np.vstack([-response.tip, 0.25 * response.rcm]))
    np.testing.assert_array_equal(wanted[3:], 0.25 * 0.5 * response.rcm_error_m)


@pytest.mark.slow
def test_without_weight_a_run_is_the_one_without_rows() -> None:
    without, rate = (run(short(controller={"kind": "ifem", field: 0.0})) for field in ("rcm_weight", "rcm_gain"))
    assert without.digest == rate.digest
    assert without.digest != run(short()).digest


@pytest.mark.slow
def test_a_small_weight_gives_the_entry_away_for_the_tip() -> None:
    """Where slow directions limit both: RMSE falls, remote-centre error rises from a weight of 1 to 0.1 and to none."""
    found = [
        run(
            short(noise_mm=0.0, controller={"kind": "ifem", "direction_speed_mm_s": 20.0, "rcm_weight": weight})
        ).metrics
        for weight in (1.0, 0.1, 0.0)
    ]
    assert found[0]["rmse_commanded_mm"] > 1.05 * found[1]["rmse_commanded_mm"]
    assert found[0]["rcm_mean_mm"] < 0.8 * found[1]["rcm_mean_mm"] < 0.8 * found[2]["rcm_mean_mm"]


# ---- the axis through the entry


def test_the_following_response_is_the_derivative_along_the_rule() -> None:
    base, h = turned(THROUGH), 1e-6
    reach_m = float(np.linalg.norm(base.position_m))
    found = following_response(RigidNeedle(base)().tip, base.rotation[:, 2], reach_m)
    for column, direction in enumerate(h * np.eye(3)):
        ends = [RigidNeedle(turned(Pose(base.position_m + s * direction, base.rotation))).tip_m for s in (1, -1)]
        np.testing.assert_allclose(found[:, column], (ends[0] - ends[1]) / (2 * h), atol=1e-8)


def test_the_tip_reaches_a_target_and_every_axis_passes_the_entry() -> None:
    plant, target = RigidNeedle(turned(THROUGH), entry_m=ENTRY), np.array([1e-3, -2e-3, 0.035])
    controller = AxisThroughEntryController(
        InverseFem(direction_speed_mm_s=1e5, orientation="axis"), plant, ENTRY, DT_S
    )
    for _ in range(6):
        plant.base = controller.command(plant.observe(target))
        across = np.cross(ENTRY - plant.base.position_m, plant.base.rotation[:, 2])
        np.testing.assert_allclose(across, 0.0, atol=1e-15)
    assert np.linalg.norm(plant.tip_m - target) < 1e-9


def test_the_axis_command_knows_neither_rows_nor_their_gains() -> None:
    plant = RigidNeedle(BESIDE)
    seen = plant.observe(np.array([1e-3, 0.0, 0.03]))

    def without(observation: Observation) -> Linearisation:
        return Linearisation(plant(observation).tip, None, np.full(2, math.nan))

    plain = AxisThroughEntryController(InverseFem(orientation="axis"), plant, ENTRY, DT_S).command(seen)
    other = InverseFem(orientation="axis", rcm_gain=0.3, rcm_weight=5.0)
    for model in (plant, without):
        found = AxisThroughEntryController(other, model, ENTRY, DT_S).command(seen)
        np.testing.assert_array_equal(found.position_m, plain.position_m)
        np.testing.assert_array_equal(found.rotation, plain.rotation)


def test_a_base_at_the_entry_keeps_its_orientation() -> None:
    plant = RigidNeedle(Pose(np.array([0.0, 0.0, -1e-4]), np.eye(3)), inserted=False)
    command = AxisThroughEntryController(InverseFem(gain=1e-3), plant, ENTRY, DT_S).command(
        plant.observe(plant.tip_m + 1e-3)
    )
    np.testing.assert_array_equal(command.rotation, np.eye(3))
    assert np.isfinite(command.position_m).all()


@pytest.mark.slow
def test_in_a_run_every_commanded_axis_passes_the_entry() -> None:
    done = run(short(controller={"kind": "ifem", "orientation": "axis"}))
    for position, quaternion in zip(
        done.series["command_position_m"][1:], done.series["command_rotation"][1:], strict=True
    ):
        across = np.cross(np.array([0.012, 0.02, 0.0]) - position, matrix_from_quaternion(quaternion)[:, 2])
        np.testing.assert_allclose(across, 0.0, atol=1e-15)
    assert (
        done.metrics["rmse_commanded_mm"]
        < 0.7 * run(short(controller={"kind": "open_loop"})).metrics["rmse_commanded_mm"]
    )


# ---- the authority


@pytest.mark.parametrize("depth_m", [1e-3, 0.03, 0.12])
def test_the_authority_of_a_rigid_needle_is_that_of_a_lever(depth_m: float) -> None:
    """A rod pinned at the entry: the tip moves the other way, by depth over what is outside."""
    position = np.array([0.0, 0.0, depth_m - LENGTH_M])
    spin = exp_map(np.array([0.0, 0.0, 0.7]))
    tilt = exp_map(np.array([0.3, -0.2, 0.0]))
    for base in (Pose(position, np.eye(3)), Pose(position, spin), Pose(tilt @ position, tilt @ spin)):
        found = rcm_authority(RigidNeedle(base)(), base.rotation)
        np.testing.assert_allclose(found, -depth_m / (LENGTH_M - depth_m) * np.eye(2), atol=1e-14)


@pytest.mark.parametrize("seed", range(4))
def test_the_authority_keeps_both_remote_centre_rows_at_zero(seed: int) -> None:
    """Against a least squares problem for twists across the base's axis that meet rows and sideways move."""
    response = random_response(seed)
    assert response.rcm is not None
    rotation = exp_map(np.array([0.2, -0.4, 0.9]))
    across = np.kron(np.eye(2), rotation[:, :2])  # (6, 4): move x y, turn x y of the base's frame
    rows = np.vstack([response.rcm @ across, np.eye(2, 4)])
    twists = across @ np.linalg.lstsq(rows, np.vstack([np.zeros((2, 2)), np.eye(2)]), rcond=None)[0]
    np.testing.assert_allclose(response.rcm @ twists, 0.0, atol=1e-12)
    expected = rotation[:, :2].T @ response.tip @ twists
    np.testing.assert_allclose(rcm_authority(response, rotation), expected, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize(
    "response",
    [
        None,
        Linearisation(np.ones((3, 6)), None, np.zeros(2)),
        Linearisation(np.ones((3, 6)), np.hstack([np.ones((2, 3)), np.zeros((2, 3))]), np.zeros(2)),
    ],
)
def test_the_authority_is_unknown_where_nothing_is_guided_or_no_turn_helps(response: Linearisation | None) -> None:
    np.testing.assert_array_equal(rcm_authority(response, np.eye(3)), np.full((2, 2), np.nan), strict=True)


# ---- one run


def late(block: dict[str, Any], steps: int) -> dict[str, Any]:
    return {**block, "delay_s": 0.1 * steps}


@pytest.mark.slow
@pytest.mark.parametrize("steps", [1, 3])
@pytest.mark.parametrize(
    "block",
    [
        {"kind": "ifem"},
        {"kind": "ifem", "orientation": "axis"},
        {"kind": "ifem", "model": {"kind": "separate", "element_size_mm": 10}},
        {"kind": "rigid"},
        {"kind": "frozen"},
        {"kind": "open_loop"},
        {"kind": "linear"},
    ],
    ids=lambda block: "-".join(str(value) for value in block.values() if isinstance(value, str)),
)
def test_the_robot_executes_what_was_commanded_steps_ago(block: dict[str, Any], steps: int) -> None:
    """Unless its limits act; until the first command is due it holds its first pose."""
    robot = {"max_speed_mm_s": 1000.0, "max_turn_deg_s": 3600.0}
    s = run(short(controller=late(block, steps), noise_mm=0.0, robot=robot)).series
    assert len(s["t_s"]) > steps + 5
    for base, command in (("base_position_m", "command_position_m"), ("base_rotation", "command_rotation")):
        held = np.array([s[base][0]] * steps)
        executed = np.concatenate([held, s[command][1:-steps]])
        free = ~s["limited"][1:]
        assert free.mean() > 0.8
        np.testing.assert_allclose(s[base][1:][free], executed[free], atol=1e-15)
