"""Wrappers and vectors of environments: poses in space, refusals, a seed each."""

from __future__ import annotations

import math
from itertools import pairwise

import gymnasium
import numpy as np
import pytest

from needlebench.gym import AbsolutePose, NeedleEnv, ThroughEntry
from simcore.insertion.state import Pose
from simcore.rotations import exp_map, quaternion_from_matrix
from tests.gym.coarse import COARSE, straight
from tests.simcore.short_run import short

# ---- wrappers and vectors


def test_moves_in_space_keep_the_axis_through_the_entry(env: NeedleEnv) -> None:
    wrapped = ThroughEntry(env)
    assert wrapped.action_space.shape == (3,)
    wrapped.reset(options={"scenario": short()})
    for i in range(8):
        wrapped.step(np.array([0.05 * math.sin(i), 0.05, 0.2]))
    base, entry = env.episode.state.base, env.episode.insertion.entry_m
    towards = entry - base.position_m
    assert np.linalg.norm(np.cross(base.rotation[:, 2], towards)) < 1e-5
    assert np.linalg.norm(base.position_m - [0.012, 0.02, -0.08]) > 1e-3


def test_poses_are_reached_as_fast_as_the_robot_may(env: NeedleEnv) -> None:
    wrapped = AbsolutePose(env)
    goal_mm = {"kind": "reach", "entry_mm": [12, 20, 0], "target_mm": [12, 20, 20]}
    wrapped.reset(options={"scenario": short(noise_mm=0.0, trajectory=goal_mm)})
    base = env.episode.state.base
    goal = Pose(base.position_m + np.array([1e-3, 0.0, 12e-3]), exp_map(np.array([0.01, 0.0, 0.0])) @ base.rotation)
    action = np.concatenate([goal.position_m, quaternion_from_matrix(goal.rotation)])
    places = [base.position_m]
    for _ in range(4):
        wrapped.step(action)
        places.append(env.episode.state.base.position_m)
    moved = [math.dist(a, b) for a, b in pairwise(places)]
    np.testing.assert_allclose(moved[:2], 5e-3, rtol=1e-5)
    np.testing.assert_allclose(places[-1], goal.position_m, atol=1e-7)
    np.testing.assert_allclose(env.episode.state.base.rotation, goal.rotation, atol=1e-6)
    _, _, terminated, _, info = wrapped.step(np.full(7, math.nan))
    assert (terminated, info["status"]) == (True, "controller_failed")


@pytest.mark.parametrize(
    ("wrapper", "action", "told"),
    [
        (AbsolutePose, [18.0, 31.0, -180.0, 1, 0, 0, 0], "position_m = [18.0, 31.0, -180.0]"),
        (AbsolutePose, [18.0, 31.0, -180.0, 1, 0, 0, 0], "looks like millimetres"),
        (AbsolutePose, [0, 0, -1200, 1, 0, 0, 0], "at most 10 m are allowed"),
        (AbsolutePose, [0, 0, math.inf, 1, 0, 0, 0], "[0.0, 0.0, inf, 1.0, 0.0, 0.0, 0.0], values that are not finite"),
        (ThroughEntry, [0, math.nan, 0.1], "[0.0, nan, 0.1], values that are not finite"),
    ],
)
def test_what_no_robot_can_do_ends_an_episode_by_name(
    env: NeedleEnv, wrapper: type[AbsolutePose], action: list[float], told: str
) -> None:
    """With step and value, through whatever wraps the wrapper; what was before is kept."""
    wrapped = gymnasium.wrappers.RecordEpisodeStatistics(wrapper(env))
    wrapped.reset(options={"scenario": short()})
    env.step(straight(env))
    _, _, terminated, _, info = wrapped.step(np.array(action))
    assert (terminated, info["status"]) == (True, "controller_failed")
    assert info["message"].startswith("step 2 of 41, depth")
    assert told in info["message"]
    assert env.rollout is not None
    assert len(env.rollout.series["t_s"]) == 2
    with pytest.raises(RuntimeError, match="the episode is over after 1 steps"):
        wrapped.step(np.array(action))
    wrapped.reset(options={"scenario": short()})
    env.step(straight(env))
    assert env.episode.status == "completed"


@pytest.mark.parametrize(("wrapper", "size"), [(AbsolutePose, 7), (ThroughEntry, 3)])
def test_an_action_of_another_shape_is_refused_with_the_step(
    env: NeedleEnv, wrapper: type[AbsolutePose], size: int
) -> None:
    wrapped = wrapper(env)
    wrapped.reset(options={"scenario": short()})
    with pytest.raises(ValueError, match=rf"step 0: the action has the shape \(6,\), not \({size},\)"):
        wrapped.step(np.zeros(6))
    with pytest.raises(ValueError, match="step 0: the action is 'left', no array of numbers"):
        wrapped.step("left")
    assert env.episode.step_number == 0


def test_a_wrapper_refuses_another_environment() -> None:
    with pytest.raises(TypeError, match="ThroughEntry wraps environments of needlebench, not CartPoleEnv"):
        ThroughEntry(gymnasium.make("CartPole-v1"))


def test_a_vector_of_environments_has_a_seed_each() -> None:
    envs = gymnasium.make_vec("needlebench/Line-v0", num_envs=2, vectorization_mode="sync", changes=COARSE)
    seen, _ = envs.reset(seed=7)
    assert seen["tip"].shape == (2, 3)
    assert not np.array_equal(seen["next_targets"][0], seen["next_targets"][1])
    seen, reward, terminated, truncated, _ = envs.step(np.zeros((2, 6), np.float32))
    assert reward.shape == terminated.shape == truncated.shape == (2,)
    alone = NeedleEnv("Line", changes=COARSE)
    for i in range(2):
        alone.reset(seed=7 + i)
        np.testing.assert_array_equal(alone.step(np.zeros(6))[0]["next_targets"], seen["next_targets"][i])
    envs.close()
