"""The environments: Gymnasium's own check, seeds, spaces, rewards, ends, pictures, wrappers, vectors of them."""

from __future__ import annotations

import math
import subprocess
import sys
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from needlebench.gym import IDS, NeedleEnv, actions_of
from needlebench.gym.spaces import action_towards, pose_of
from needlebench.gym.tasks import TASKS
from simcore.errors import ScenarioError
from simcore.metrics import MEASURED
from simcore.rollout.rollout import run
from simcore.rotations import quaternion_from_matrix
from simcore.scenario.scenario import Scenario
from tests.gym.coarse import COARSE, straight
from tests.simcore.short_run import STEPS, short

ROOT = Path(__file__).parents[2]


@pytest.mark.slow
@pytest.mark.parametrize("name", IDS)
@pytest.mark.filterwarnings("ignore:.*render.*:UserWarning")
def test_gymnasium_finds_nothing_wrong(name: str, tmp_path: Path) -> None:
    made = gymnasium.make(name, changes=COARSE, folder=tmp_path)
    check_env(made.unwrapped)
    made.close()


@pytest.mark.parametrize("name", IDS)
@pytest.mark.filterwarnings("ignore:.*unconventional shape:UserWarning")
def test_stable_baselines_finds_nothing_wrong(name: str) -> None:
    """It advises to flatten what has two axes, and no more; its policies for dictionaries do."""
    checker = pytest.importorskip("stable_baselines3.common.env_checker", reason="stable-baselines3 is not installed")
    made = gymnasium.make(name, changes=COARSE, render_mode="rgb_array")
    checker.check_env(made, skip_render_check=False)
    made.close()


@pytest.mark.parametrize("name", IDS)
@pytest.mark.parametrize("privileged", [False, True])
def test_what_stable_baselines_asks_of_an_environment(name: str, privileged: bool) -> None:
    """Its documented rules, without it: a flat dictionary of finite boxes in single precision, actions in -1 ... 1, a
    reset that takes a seed, plain types, nothing that is not finite."""
    made = gymnasium.make(name, changes=COARSE, privileged=privileged)
    space, actions = made.observation_space, made.action_space
    assert isinstance(space, gymnasium.spaces.Dict)
    for box in (actions, *space.values()):
        assert isinstance(box, gymnasium.spaces.Box)
        assert box.dtype == np.float32
        assert np.isfinite([box.low, box.high]).all()
        np.testing.assert_array_equal(box.low, -box.high)
    assert isinstance(actions, gymnasium.spaces.Box)
    assert (actions.high == 1.0).all()
    seen, info = made.reset(seed=0)
    for _ in range(5):
        assert isinstance(info, dict)
        assert list(seen) == list(space)
        for key, box in space.items():
            assert (seen[key].dtype, seen[key].shape) == (np.float32, box.shape), key
            assert np.isfinite(seen[key]).all(), key
            assert box.contains(seen[key]), key
        seen, reward, terminated, truncated, info = made.step(
            0.1 * actions.sample()
        )  # gently: a loose needle loses its target
        assert (type(reward), type(terminated), type(truncated)) == (float, bool, bool)
        assert math.isfinite(reward)
    made.close()


@pytest.mark.slow
def test_the_ids_are_those_of_the_tasks_and_import_themselves() -> None:
    assert tuple(f"needlebench/{task}-v0" for task in ("Line", "Curve", "Breathing", "Mismatch", "Reach")) == IDS
    code = (
        "import gymnasium; env = gymnasium.make('needlebench.gym:needlebench/Reach-v0'); "
        "assert env.unwrapped.task == 'Reach'"
    )
    subprocess.run([sys.executable, "-W", "error", "-c", code], check=True, cwd=ROOT)


def test_without_gymnasium_the_message_says_what_to_install() -> None:
    code = "import sys; sys.modules['gymnasium'] = None; import needlebench.gym"
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=False)
    assert 'pip install "needlebench[gym]"' in done.stderr


@pytest.mark.parametrize("task", TASKS)
def test_a_seed_is_an_episode_to_the_bit(task: str) -> None:
    ends = []
    for env in (NeedleEnv(task, changes=COARSE), NeedleEnv(task, changes=COARSE)):
        for seed in (3, 4, 3):
            rows = [env.reset(seed=seed)[0]]
            for action in np.random.default_rng(1).uniform(-0.2, 0.2, (3, 6)):
                rows.append(env.step(action)[0])
            ends.append([row[name].tobytes() for row in rows for name in sorted(row)])
    assert ends[0] == ends[2] == ends[3] == ends[5] != ends[1] == ends[4]


def test_without_a_seed_every_reset_is_another_episode(env: NeedleEnv) -> None:
    env.reset(seed=0)
    ends = [env.reset()[1]["scenario"]["trajectory"]["target_mm"] for _ in range(4)]
    assert len({tuple(end) for end in ends}) == 4
    assert len({env.reset()[1]["scenario"]["seed"] for _ in range(3)}) == 3


@pytest.mark.slow
def test_an_episode_of_an_environment_is_a_run_of_its_commands(env: NeedleEnv) -> None:
    """The same series as of a replay of its commands, and the metrics of result.json."""
    scenario = short(robot={"max_speed_mm_s": 50})
    env.reset(options={"scenario": scenario})
    done = False
    while not done:
        _, _, terminated, done, info = env.step(straight(env))
        assert not terminated
    rollout = env.rollout
    assert rollout is not None
    assert (info["status"], info["digest"], info["message"]) == ("completed", rollout.digest, "")
    assert set(MEASURED) <= set(info["metrics"])
    assert info["is_success"] == info["metrics"]["success"]
    assert len(rollout.series["t_s"]) == STEPS + 1
    poses = [
        [*(1e3 * p), *q]
        for p, q in zip(rollout.series["base_position_m"][1:], rollout.series["base_rotation"][1:], strict=True)
    ]
    again = run(Scenario.load({**scenario.resolved(), "controller": {"kind": "replay", "poses": poses}}))
    np.testing.assert_allclose(again.series["tip_m"], rollout.series["tip_m"], atol=1e-7)


def test_the_actions_of_a_run_lead_the_environment_along_it(env: NeedleEnv) -> None:
    """What the robot did, limits included, as actions: the environment shows what the run's controller saw."""
    scenario = short(robot={"max_speed_mm_s": 20, "max_turn_deg_s": 5})
    done = run(scenario)
    assert done.series["limited"].any()
    actions = actions_of(done)
    assert actions.shape == (STEPS, 6)
    assert actions.dtype == np.float32
    assert np.abs(actions).max() <= 1.0
    env.reset(options={"scenario": scenario})
    for action in actions:
        _, _, _, ended, info = env.step(action)
    assert ended
    assert info["status"] == "completed"
    assert env.rollout is not None
    np.testing.assert_allclose(env.rollout.series["tip_m"], done.series["tip_m"], atol=2e-7)
    np.testing.assert_allclose(env.rollout.series["target_noisy_m"], done.series["target_noisy_m"], atol=1e-12)


def test_observations_are_what_a_controller_sees(env: NeedleEnv) -> None:
    seen, _ = env.reset(options={"scenario": short()})
    for _ in range(4):
        seen, *_ = env.step(straight(env))
    known = env.episode.observation
    assert env.observation_space.contains(seen)
    quaternion = quaternion_from_matrix(known.base.rotation)
    expected: dict[str, Any] = {
        "base": [*known.base.position_m, *quaternion],
        "tip": known.tip_m,
        "tip_direction": known.tip_direction,
        "target": known.target_m,
        "next_targets": known.targets_m[1:11],
        "entry_offset": known.entry_offset_m,
        "depth": [known.depth_m],
        "base_wrench": known.base_wrench,
        "time": [known.t_s],
    }
    for name, value in expected.items():
        np.testing.assert_allclose(seen[name], value, rtol=1e-6, atol=1e-7, err_msg=name)
    assert seen["depth"][0] > 1e-3


def test_the_last_targets_wait_at_the_end(env: NeedleEnv) -> None:
    env.reset(options={"scenario": short(noise_mm=0.0, trajectory={"target_mm": [12, 20, 3], "amplitude_mm": 0})})
    seen, *_ = env.step(straight(env))
    np.testing.assert_allclose(seen["next_targets"][1:], [[0.012, 0.02, 0.003]] * 9, atol=1e-6)


def test_privileged_arrays_are_those_of_the_plant() -> None:
    env = NeedleEnv(privileged=True)
    seen, _ = env.reset(options={"scenario": short()})
    for _ in range(6):
        seen, *_ = env.step(straight(env))
    state = env.episode.state
    count = len(state.points_m)
    assert count > 0
    np.testing.assert_allclose(seen["shaft"][[0, -1]], [state.base.position_m, state.tip_m], atol=1e-6)
    np.testing.assert_allclose(seen["contact_points"][:count], state.points_m, atol=1e-6)
    np.testing.assert_allclose(seen["contact_forces"][:count], state.point_forces_n, rtol=1e-5, atol=1e-6)
    assert not seen["contact_points"][count:].any()
    np.testing.assert_allclose(seen["material"], [6300.0, 0.4, 0.1], rtol=1e-6)
    assert env.observation_space.contains(seen)


def test_the_reward_is_the_sum_of_its_terms(env: NeedleEnv) -> None:
    env.reset(options={"scenario": short()})
    _, reward, _, _, info = env.step(straight(env))
    terms, record = info["reward_terms"], env.record
    assert reward == pytest.approx(sum(terms.values()))
    assert terms["tip"] == pytest.approx(-1e3 * math.dist(record.tip_m, record.target_m))
    assert terms["rcm"] == pytest.approx(-100.0 * record.rcm_error_m)
    assert (terms["failure"], terms["success"]) == (0.0, 0.0)
    assert info["is_success"] is False


def test_a_named_failure_terminates(env: NeedleEnv) -> None:
    """An action that is not finite, with step and value; what was before is kept."""
    env.reset(options={"scenario": short()})
    for _ in range(3):
        env.step(straight(env))
    _, reward, terminated, truncated, info = env.step(np.array([0.0, math.nan, 0.0, 0.0, 0.0, 0.0]))
    assert (terminated, truncated, info["is_success"]) == (True, False, False)
    assert info["status"] == "controller_failed"
    assert info["message"].startswith("step 4 of 41")
    assert "[0.0, nan, 0.0, 0.0, 0.0, 0.0]" in info["message"]
    assert info["reward_terms"]["failure"] == -100.0
    assert reward < -100.0
    assert env.rollout is not None
    assert len(env.rollout.series["t_s"]) == 4


def test_a_failure_of_the_plant_terminates_by_its_name(env: NeedleEnv) -> None:
    env.reset(options={"scenario": short(solver={"max_iterations": 2})})
    terminated = truncated = False
    while not (terminated or truncated):
        _, _, terminated, truncated, info = env.step(np.array([0.1, 0.0, 0.2, 0.0, 0.0, 0.0]))
    assert (terminated, info["status"]) == (True, "not_converged")


def test_bad_input_is_named(env: NeedleEnv) -> None:
    with pytest.raises(RuntimeError, match="reset the environment first"):
        env.step(np.zeros(6))
    env.reset(options={"scenario": short()})
    with pytest.raises(ValueError, match=r"step 0: the action has the shape \(3,\), not \(6,\)"):
        env.step(np.zeros(3))
    with pytest.raises(ValueError, match=r"options \['scenarios'\]: only `scenario` is known"):
        env.reset(options={"scenarios": 1})
    with pytest.raises(ValueError, match="task = 'Lines': must be one of Line"):
        NeedleEnv("Lines")
    with pytest.raises(ValueError, match="look_ahead = 101: must be 0 to 100"):
        NeedleEnv(look_ahead=101)
    with pytest.raises(ScenarioError, match=r"tissue\.young = 3: unknown field"):
        NeedleEnv(changes={"tissue.young": 3}).reset()


def test_an_action_is_the_twist_that_the_robot_can_make(env: NeedleEnv) -> None:
    env.reset(options={"scenario": short(trajectory={"target_mm": [13, 24, 30]})})
    episode, base = env.episode, env.episode.state.base
    ahead = pose_of(np.array([0.0, 0.0, 1.0, 0.0, 0.0, 0.0]), base, episode.limits, 0.1)
    np.testing.assert_allclose(ahead.position_m - base.position_m, 5e-3 * base.rotation[:, 2], atol=1e-15)
    rng = np.random.default_rng(0)
    for _ in range(20):
        twist = rng.uniform(-1, 1, 6) / np.sqrt(3)
        back = action_towards(pose_of(twist, base, episode.limits, 0.1), base, episode.limits, 0.1)
        np.testing.assert_allclose(back, twist, atol=1e-6)


# ---- pictures


@pytest.mark.slow
def test_a_picture_shows_block_path_and_needle(env: NeedleEnv) -> None:
    env.reset(options={"scenario": short()})
    first = env.render()
    for _ in range(20):
        env.step(straight(env))
    later = env.render()
    assert first.shape == later.shape == (480, 480, 3)
    assert first.dtype == np.uint8
    colours = {tuple(pixel) for pixel in later.reshape(-1, 3)}
    assert len(colours) == 7
    needle = [(np.array(image) == (40, 40, 45)).all(axis=2) for image in (first, later)]
    right = [np.flatnonzero(one.any(axis=0)).max() for one in needle]
    assert right[1] > right[0] + 50


def test_rerun_writes_a_recording_of_each_episode(tmp_path: Path) -> None:
    env = NeedleEnv(
        depth_mm=0.6, changes={**COARSE, "trajectory.speed_mm_s": 100}, render_mode="rerun", folder=tmp_path
    )
    files = []
    for seed in (1, 2):
        env.reset(seed=seed)
        assert env.render() is None
        while not any(env.step(straight(env))[2:4]):
            pass
        assert env.recording is not None
        files.append(env.recording)
    env.close()
    assert files[0] != files[1]
    assert all(file.read_bytes()[:4] == b"RRF2" for file in files)
