"""Speed limits of the base: one factor for the whole twist, direction kept."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from simcore.insertion.insertion import rotation_towards
from simcore.insertion.state import Pose
from simcore.robot import DelayedCommands, RobotLimits, limited_pose
from simcore.rotations import exp_map, log_map
from tests.budget import examples

Vector = np.ndarray

LIMITS = RobotLimits(max_speed_m_s=0.05, max_turn_rad_s=math.radians(30.0))
DT = 0.01
STEP_M, STEP_RAD = 50e-3 * DT, math.radians(30.0) * DT

components = st.floats(-1.0, 1.0)
vectors = st.tuples(components, components, components).map(np.array)
sizes = st.floats(-9.0, 0.5).map(lambda e: 10.0**e)
turns = st.floats(0.1, 3600.0).map(math.radians)
limits = st.builds(RobotLimits, max_speed_m_s=st.floats(1e-4, 1.0), max_turn_rad_s=turns)
steps = st.floats(1e-4, 0.1)
quick = settings(max_examples=examples(200), deadline=None)


@st.composite
def motions(draw: st.DrawFn) -> tuple[Pose, Vector, Vector]:
    """A base, a shift (3,) m and a turn (3,) rad below half a turn."""
    base = Pose(draw(vectors), exp_map(3.0 * draw(vectors)))
    turn = draw(vectors) * min(1.7, draw(sizes))
    return base, draw(vectors) * draw(sizes), turn


def commanded(base: Pose, shift: Vector, turn: Vector) -> Pose:
    return Pose(base.position_m + shift, exp_map(turn) @ base.rotation)


def moved(base: Pose, after: Pose) -> tuple[Vector, Vector]:
    return after.position_m - base.position_m, log_map(after.rotation @ base.rotation.T)


@pytest.mark.slow
@quick
@given(motions(), limits, steps)
def test_both_limits_are_respected(motion: tuple[Pose, Vector, Vector], robot: RobotLimits, dt: float) -> None:
    base, shift, turn = motion
    after, _ = limited_pose(base, commanded(base, shift, turn), robot, dt)
    done, turned = moved(base, after)
    assert np.linalg.norm(done) <= robot.max_speed_m_s * dt * (1 + 1e-9) + 1e-15
    assert np.linalg.norm(turned) <= robot.max_turn_rad_s * dt * (1 + 1e-9) + 1e-14


@pytest.mark.slow
@quick
@given(motions(), limits, steps)
def test_one_factor_scales_the_whole_twist(motion: tuple[Pose, Vector, Vector], robot: RobotLimits, dt: float) -> None:
    """The direction of shift and turn and their ratio are kept: done = share * commanded, for one share of both."""
    base, shift, turn = motion
    after, limited = limited_pose(base, commanded(base, shift, turn), robot, dt)
    done, turned = moved(base, after)
    longest = robot.max_speed_m_s * dt, robot.max_turn_rad_s * dt
    needed = max(float(np.linalg.norm(shift)) / longest[0], float(np.linalg.norm(turn)) / longest[1])
    share = min(1.0, 1.0 / needed) if needed else 1.0
    np.testing.assert_allclose(done, share * shift, atol=1e-15 + 1e-9 * share * float(np.linalg.norm(shift)))
    np.testing.assert_allclose(turned, share * turn, atol=1e-13 + 1e-9 * share * float(np.linalg.norm(turn)))
    if abs(needed - 1.0) > 1e-6:
        assert limited is (needed > 1.0)


@pytest.mark.slow
@quick
@given(motions(), limits, steps)
def test_a_limited_motion_uses_a_limit_fully(
    motion: tuple[Pose, Vector, Vector], robot: RobotLimits, dt: float
) -> None:
    base, shift, turn = motion
    after, limited = limited_pose(base, commanded(base, shift, turn), robot, dt)
    if limited:
        done, turned = moved(base, after)
        used = np.linalg.norm(done) / (robot.max_speed_m_s * dt)
        used_turn = np.linalg.norm(turned) / (robot.max_turn_rad_s * dt)
        assert max(used, used_turn) == pytest.approx(1.0, rel=1e-6)


@pytest.mark.slow
@quick
@given(motions())
def test_the_rotation_stays_a_rotation(motion: tuple[Pose, Vector, Vector]) -> None:
    base, shift, turn = motion
    after, _ = limited_pose(base, commanded(base, shift, turn), LIMITS, DT)
    np.testing.assert_allclose(after.rotation @ after.rotation.T, np.eye(3), atol=1e-14)
    assert np.linalg.det(after.rotation) == pytest.approx(1.0)


def test_a_reachable_command_is_taken_as_it_is() -> None:
    base = Pose(np.zeros(3), np.eye(3))
    command = commanded(base, np.array([0.0, 0.0, 0.99 * STEP_M]), np.array([0.99 * STEP_RAD, 0.0, 0.0]))
    after, limited = limited_pose(base, command, LIMITS, DT)
    assert after is command
    assert limited is False


def test_the_slower_limit_rules() -> None:
    """Twice too fast, four times too sharp: a quarter of both."""
    base = Pose(np.array([0.1, 0.2, -0.3]), exp_map(np.array([0.3, 0.1, -0.2])))
    shift, turn = np.array([0.0, 2 * STEP_M, 0.0]), np.array([0.0, 0.0, 4 * STEP_RAD])
    after, limited = limited_pose(base, commanded(base, shift, turn), LIMITS, DT)
    done, turned = moved(base, after)
    assert limited is True
    np.testing.assert_allclose(done, shift / 4, atol=1e-16)
    np.testing.assert_allclose(turned, turn / 4, atol=1e-15)


def test_no_motion_is_not_limited() -> None:
    base = Pose(np.array([0.1, 0.2, -0.3]), exp_map(np.array([0.3, 0.1, -0.2])))
    after, limited = limited_pose(base, base, LIMITS, DT)
    assert after is base
    assert not limited


def test_half_the_step_reaches_half_as_far() -> None:
    base = Pose(np.zeros(3), np.eye(3))
    command = commanded(base, np.array([1.0, 0.0, 0.0]), np.zeros(3))
    far, near = (limited_pose(base, command, LIMITS, dt)[0].position_m[0] for dt in (0.01, 0.005))
    assert far == pytest.approx(2 * near)
    assert far == pytest.approx(STEP_M)


def test_repeated_steps_arrive_and_stay() -> None:
    """A command 10 mm and 9 degrees away is reached after 30 steps of 0.3 degrees, exactly."""
    base = Pose(np.zeros(3), np.eye(3))
    command = commanded(base, np.array([0.0, 0.0, 0.01]), np.array([math.radians(9.0) * (1 - 1e-9), 0.0, 0.0]))
    for _ in range(30):
        base, limited = limited_pose(base, command, LIMITS, DT)
    assert not limited
    assert base is command


def test_a_command_that_is_not_finite_stays_visible() -> None:
    base = Pose(np.zeros(3), np.eye(3))
    after, _ = limited_pose(base, Pose(np.array([math.nan, 0.0, 0.0]), np.eye(3)), LIMITS, DT)
    assert not np.isfinite(after.position_m).all()


@pytest.mark.slow
@quick
@given(vectors.filter(lambda v: np.linalg.norm(v) > 1e-3))
def test_the_rotation_towards_a_direction(direction: Vector) -> None:
    unit = direction / np.linalg.norm(direction)
    rotation = rotation_towards(unit)
    np.testing.assert_allclose(rotation[:, 2], unit, atol=1e-14)
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-14)
    assert np.linalg.det(rotation) == pytest.approx(1.0)
    assert np.linalg.norm(log_map(rotation)) == pytest.approx(math.acos(np.clip(unit[2], -1, 1)), abs=1e-7)


@pytest.mark.parametrize("direction", [[0.0, 0.0, 1.0], [0.0, 0.0, -1.0], [1e-16, 0.0, 1.0], [1e-16, 0.0, -1.0]])
def test_the_rotation_towards_the_axis_itself(direction: list[float]) -> None:
    rotation = rotation_towards(np.array(direction))
    np.testing.assert_allclose(rotation[:, 2], direction, atol=1e-15)
    assert np.linalg.det(rotation) == pytest.approx(1.0)


# ---- late commands


def test_a_delayed_command_comes_back_after_its_steps() -> None:
    first, *poses = (Pose(np.full(3, float(i)), np.eye(3)) for i in range(8))
    for steps in (0, 1, 3):
        commands = DelayedCommands(first, steps)
        assert [commands.due(pose) for pose in poses] == [*[first] * steps, *poses][: len(poses)]
