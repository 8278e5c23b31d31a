"""Episode: an insertion that is stepped from outside, and what `run` makes of the same commands."""

from __future__ import annotations

import math
import pickle
import re
import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from simcore import plugins
from simcore.episode import CommandError, Episode, EpisodeOverError, Observation, SnapshotError
from simcore.errors import ScenarioError, Status
from simcore.insertion.state import Pose
from simcore.rollout.rollout import run
from simcore.rotations import matrix_from_quaternion
from tests.simcore.short_run import STEPS, short

if TYPE_CHECKING:
    from collections.abc import Sequence

    from simcore.rollout.result import Rollout
    from simcore.scenario.scenario import Scenario

ROOT = Path(__file__).parents[3]
KINDS: dict[str, dict[str, Any]] = {
    "quasi-static": {},
    "exact": {"controller": {"kind": "ifem", "derivative": "exact"}},
    "late": {"controller": {"kind": "ifem", "delay_s": 0.3}},
    "dynamic": {"tissue": {"density_kg_m3": 1000, "rayleigh_mass_per_s": 5, "rayleigh_stiffness_s": 0.01}},
    "punctured": {"interaction": {"puncture_n": 0.05}},
    "carried": {
        "trajectory": {"frame": "tissue", "target_mm": [12, 21, 30]},
        "motion": {"kind": "breathing", "amplitude_mm": 1},
    },
    "linearised": {"solver": {"mode": "linearised"}},
}


@pytest.fixture(scope="module", params=KINDS)
def scenario(request: pytest.FixtureRequest) -> Scenario:
    return short(**KINDS[request.param])


@pytest.fixture(scope="module")
def rollout(scenario: Scenario) -> Rollout:
    return run(scenario)


def commands(rollout: Rollout) -> list[Pose]:
    """What the controller of a run commanded, one a step."""
    series = rollout.series
    rows = zip(series["command_position_m"][1:], series["command_rotation"][1:], strict=True)
    return [Pose(position, matrix_from_quaternion(rotation)) for position, rotation in rows]


def shifted(base: Pose, x_m: float, y_m: float, z_m: float) -> Pose:
    return Pose(base.position_m + np.array([x_m, y_m, z_m]), base.rotation)


def stepped(episode: Episode, poses: Sequence[Pose]) -> list[Observation]:
    """Every observation that the steps lead to."""
    return [episode.step(pose)[0] for pose in poses]


def assert_same(ours: Sequence[Observation], theirs: Sequence[Observation]) -> None:
    """To the bit."""
    assert [bits(seen) for seen in ours] == [bits(seen) for seen in theirs]


def bits(seen: Observation) -> list[Any]:
    arrays = (seen.base.position_m, seen.base.rotation, seen.tip_m, seen.target_m, seen.base_wrench, seen.entry_m)
    return [seen.step, seen.t_s, seen.dt_s, *(array.tobytes() for array in (*arrays, seen.targets_m))]


def test_the_commands_of_a_run_lead_to_its_states(scenario: Scenario, rollout: Rollout) -> None:
    """The quaternions of the series are rounded, and with them the path by as much as a tolerance."""
    episode = Episode(scenario)
    seen = [episode.reset(), *stepped(episode, commands(rollout))]
    assert (episode.done, episode.status, len(seen)) == (True, rollout.status, len(rollout.series["t_s"]))
    for name, found in (
        ("tip_m", [s.tip_m for s in seen]),
        ("base_position_m", [s.base.position_m for s in seen]),
        ("base_force_n", [s.base_wrench[:3] for s in seen]),
        ("target_noisy_m", [s.target_m for s in seen]),
    ):
        np.testing.assert_allclose(found, rollout.series[name], atol=2e-4 if "force" in name else 1e-6, err_msg=name)
    assert [s.step for s in seen] == list(range(STEPS + 1))[: len(seen)]
    np.testing.assert_array_equal([s.t_s for s in seen], rollout.series["t_s"])


@pytest.mark.slow
def test_a_snapshot_leads_on_to_the_same_bits(scenario: Scenario, rollout: Rollout) -> None:
    """In the episode itself after it went on, in a copy, in a new episode and in an unpickled one."""
    poses, half = commands(rollout), len(commands(rollout)) // 2
    episode = Episode(scenario)
    stepped(episode, poses[:half])
    moment, twin = episode.snapshot(), episode.copy()
    later = stepped(episode, poses[half:])
    last = episode.state
    again = [episode, twin, Episode.from_snapshot(moment), pickle.loads(pickle.dumps(twin))]
    for one in again:
        one.restore(moment)
        assert_same(stepped(one, poses[half:]), later)
        np.testing.assert_array_equal(one.state.bodies.x, last.bodies.x)
        assert one.state.report == last.report


@pytest.mark.slow
def test_a_reset_is_a_new_episode(scenario: Scenario, rollout: Rollout) -> None:
    poses = commands(rollout)
    episode = Episode(scenario)
    first = [episode.observation, *stepped(episode, poses)]
    assert_same([episode.reset(), *stepped(episode, poses)], first)


_ELSEWHERE = """
import pickle, sys
from tests.simcore.episode.test_episode import stepped
episode, poses = pickle.load(sys.stdin.buffer)
pickle.dump((stepped(episode, poses), episode.state.bodies.x), sys.stdout.buffer)
"""


@pytest.mark.slow
def test_a_snapshot_goes_on_in_another_process() -> None:
    scenario = short()
    poses = commands(run(scenario))
    episode = Episode(scenario)
    stepped(episode, poses[:20])
    command = [sys.executable, "-c", _ELSEWHERE]
    done = subprocess.run(command, input=pickle.dumps((episode, poses[20:])), cwd=ROOT, capture_output=True, check=True)
    seen, x = pickle.loads(done.stdout)
    assert_same(seen, stepped(episode, poses[20:]))
    np.testing.assert_array_equal(x, episode.state.bodies.x)


def test_a_snapshot_stays_as_it_was_however_often_it_is_used() -> None:
    episode = Episode(short())
    ahead = shifted(episode.observation.base, 0.0, 0.0, 1e-3)
    moment = episode.snapshot()
    before = pickle.dumps(moment)
    for _ in range(3):
        episode.restore(moment)
        stepped(episode, [ahead, ahead])
    assert pickle.dumps(moment) == before
    assert len(before) < 20e6


def test_copies_are_independent() -> None:
    """As a sampling controller uses them: each copy goes its own way, the original stays."""
    episode = Episode(short())
    start = episode.observation
    sideways = [shifted(start.base, dx, 0.0, 1e-3) for dx in (-1e-4, 0.0, 1e-4)]
    ends = [episode.copy().step(pose)[0].tip_m for pose in sideways]
    assert ends[0][0] < ends[1][0] < ends[2][0]
    assert episode.step_number == 0
    assert_same([episode.observation], [start])


def test_a_snapshot_of_another_insertion_is_refused_by_field() -> None:
    moment = Episode(short()).snapshot()
    other = Episode(short(tissue={"young_kpa": 3.0}))
    with pytest.raises(SnapshotError, match=r"another insertion: tissue\.young_kpa = 6\.3 there, 3\.0 here"):
        other.restore(moment)
    assert other.step_number == 0


def test_the_seed_of_a_reset_draws_the_noise() -> None:
    episode = Episode(short())
    first, other = episode.reset(), episode.reset(seed=5)
    assert not np.array_equal(first.target_m, other.target_m)
    assert_same([Episode(short(seed=5)).observation], [other])
    moment = episode.snapshot()
    assert_same([episode.reset(seed=11)], [first])
    assert_same([episode.restore(moment)], [other])


@pytest.mark.parametrize("seed", [-1, 2**53])
def test_a_seed_out_of_range_is_refused(seed: int) -> None:
    with pytest.raises(ScenarioError, match=rf"seed = {seed}: must be 0 to 2\^53 - 1"):
        Episode(short()).reset(seed=seed)


# ---- what is seen


def test_an_observation_owns_its_arrays() -> None:
    """Whoever steers cannot change the insertion by writing into what it was shown."""
    episode = Episode(short())
    seen = episode.observation
    for array in (seen.base.position_m, seen.base.rotation, seen.tip_m, seen.target_m, seen.targets_m, seen.entry_m):
        array[:] = math.nan
    seen.base_wrench[:] = math.nan
    assert all(np.isfinite(state).all() for state in (episode.state.bodies.needle_x, episode.targets.rest_m))
    assert np.isfinite(episode.observation.target_m).all()
    assert np.isfinite(episode.insertion.entry_m).all()


@pytest.mark.parametrize("frame", ["world", "tissue"])
def test_the_coming_targets_are_those_of_the_steps_to_come(frame: str) -> None:
    """Without noise, where the tissue is at rest; with the noise of the moment on all of them."""
    episode = Episode(short(noise_mm=0.0, trajectory={"frame": frame}))
    seen = episode.observation
    assert seen.targets_m.shape == (STEPS + 1, 3)
    np.testing.assert_allclose(seen.targets_m, episode.targets.rest_m, atol=1e-15)
    np.testing.assert_array_equal(seen.targets_m[0], seen.target_m)
    noisy = Episode(short(trajectory={"frame": frame})).observation
    np.testing.assert_allclose(noisy.targets_m - seen.targets_m, [noisy.target_m - seen.target_m] * (STEPS + 1))
    assert np.abs(noisy.target_m - seen.target_m).max() > 1e-5


def test_a_carried_target_is_where_the_tissue_has_it_now() -> None:
    episode = Episode(short(**{**KINDS["carried"], "noise_mm": 0.0}))
    for _ in range(8):
        seen = episode.observation
        episode.step(shifted(seen.base, 0.0, 2e-4, 1e-3))
    seen = episode.observation
    for ahead in (0, 3, 10):
        rest = episode.targets.rest_m[8 + ahead]
        carried = episode.insertion.material_point_position(episode.state.bodies.x, rest)
        np.testing.assert_allclose(seen.targets_m[ahead], carried, atol=1e-15)
        assert np.linalg.norm(carried - rest) > 1e-4


# ---- what is commanded


HERE = Pose(np.array([0.012, 0.02, -0.08]), np.eye(3))
WRONG: dict[str, tuple[Any, str]] = {
    "nothing": (None, "a NoneType, not a Pose"),
    "array": (np.zeros(3), "a ndarray, not a Pose"),
    "short": (Pose(np.zeros(2), np.eye(3)), r"position_m \(2,\) and rotation \(3, 3\), not \(3,\) and \(3, 3\)"),
    "words": (Pose(["a", "b", "c"], np.eye(3)), "no array of numbers"),  # type: ignore[arg-type]
    "nan": (Pose(np.array([0.0, math.nan, 0.0]), np.eye(3)), r"position_m = \[0\.0, nan, 0\.0\], .*not finite"),
    "infinite": (Pose(np.zeros(3), np.full((3, 3), math.inf)), r"rotation = \[\[inf, .*not finite"),
    "mirror": (Pose(np.zeros(3), np.diag([1.0, 1.0, -1.0])), "no rotation matrix"),
    "stretch": (Pose(np.zeros(3), 1.1 * np.eye(3)), "no rotation matrix"),
    "millimetres": (Pose(1e3 * HERE.position_m, np.eye(3)), r"\[12\.0, 20\.0, -80\.0\].*looks like millimetres"),
    "far": (shifted(HERE, 0.0, 0.0, 5000.0), "at most 10 m are allowed"),
}


@pytest.fixture(scope="module")
def waiting() -> Episode:
    episode = Episode(short())
    stepped(episode, [HERE])
    return episode


@pytest.mark.parametrize("wrong", WRONG)
def test_a_wrong_command_is_named_and_changes_nothing(wrong: str, waiting: Episode) -> None:
    command, message = WRONG[wrong]
    before = waiting.observation
    with pytest.raises(CommandError, match=rf"step 1: the command is .*{message}"):
        waiting.step(command)
    assert not waiting.done
    assert_same([waiting.observation], [before])


def test_a_command_of_integers_is_a_pose(waiting: Episode) -> None:
    waiting.copy().step(Pose(np.array([0, 0, 0]), np.eye(3, dtype=int)))


def test_a_step_after_the_end_is_refused() -> None:
    episode = Episode(short(trajectory={"target_mm": [12, 20, 1], "amplitude_mm": 0}))
    while not episode.done:
        seen = episode.observation
        episode.step(shifted(seen.base, 0.0, 0.0, 1e-3))
    with pytest.raises(EpisodeOverError, match=r"over after 1 steps \(completed\)"):
        episode.step(HERE)
    assert not np.any(episode.reset().step)


def test_a_failed_step_ends_it_at_the_last_good_state() -> None:
    episode = Episode(short(solver={"max_iterations": 2}))
    while not episode.done:
        before = episode.observation
        episode.step(shifted(before.base, 3e-4, 0.0, 1e-3))
    assert episode.status is Status.NOT_CONVERGED
    assert episode.message.startswith(f"step {before.step + 1} of {STEPS}, depth ")
    assert_same([episode.observation], [before])
    with pytest.raises(EpisodeOverError, match="not_converged: step"):
        episode.step(before.base)


# ---- controllers that fail, in a run


class _Fails:
    def __init__(self, scenario: Scenario, entry_m: Any, needle_length_m: float, settings: dict[str, Any]) -> None:
        self.does = settings["does"]

    def command(self, observation: Observation) -> Any:
        if observation.step < 3:
            return shifted(observation.base, 0.0, 0.0, 1e-3)
        if self.does == "raises":
            raise KeyError("gain")
        return WRONG[self.does][0]


@pytest.mark.parametrize("does", ["raises", *WRONG])
def test_a_run_ends_by_name_where_its_controller_fails(does: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(plugins._registered, "mine", _Fails)
    found = run(short(controller={"kind": "plugin", "name": "mine", "settings": {"does": does}}))
    assert found.status is Status.CONTROLLER_FAILED
    assert re.match(rf"step 4 of {STEPS}, depth \d\.\d mm: controller 'mine'", found.message)
    assert len(found.series["t_s"]) == 4
    assert found.metrics["steps_completed"] == 3
    assert found.metrics["stable"] is False
    if does == "raises":
        assert "KeyError: 'gain' (test_episode.py, line " in found.message
    else:
        assert re.search(f"answered with .*{WRONG[does][1]}", found.message)
