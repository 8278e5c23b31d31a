"""The tip as it is seen: now and then, late, noisy, in a frame that is not quite the robot's; for every controller."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from simcore import plugins
from simcore.controllers.base import seed_of_controller
from simcore.episode import Episode, Observation
from simcore.errors import ScenarioError
from simcore.insertion.state import Pose
from simcore.rollout.rollout import run
from simcore.scenario.sensing import without_idle_sensing
from tests.simcore.episode.test_episode import assert_same, shifted, stepped
from tests.simcore.short_run import STEPS, short

if TYPE_CHECKING:
    from simcore.scenario.scenario import Scenario

CLEAN: dict[str, Any] = {"noise_mm": 0.0, "controller": {"kind": "open_loop"}}


def tips(**sensing: Any) -> tuple[np.ndarray, np.ndarray]:
    """Seen and true, (rows, 3) m."""
    series = run(short(**CLEAN, sensing=sensing)).series
    return series["tip_seen_m"], series["tip_m"]


def test_by_default_the_tip_is_seen_as_it_is() -> None:
    seen, true = tips()
    np.testing.assert_array_equal(seen, true)


def test_between_images_the_last_one_stays() -> None:
    seen, true = tips(rate_hz=2.5)
    np.testing.assert_array_equal(seen, true[4 * (np.arange(STEPS + 1) // 4)])


def test_an_image_is_seen_later() -> None:
    seen, true = tips(latency_s=0.3)
    np.testing.assert_array_equal(seen, true[np.maximum(np.arange(STEPS + 1) - 3, 0)])


def test_a_late_image_of_now_and_then() -> None:
    """Taken at 0, 5, 10, ..., seen two steps later."""
    seen, true = tips(rate_hz=2.0, latency_s=0.2)
    np.testing.assert_array_equal(seen, true[5 * (np.maximum(np.arange(STEPS + 1) - 2, 0) // 5)])


@pytest.mark.slow
def test_noise_is_normal_drawn_for_each_image_and_follows_the_seed() -> None:
    seen, true = tips(noise_mm=0.5, rate_hz=5.0)
    noise = 1e3 * (seen[::2] - true[::2])
    np.testing.assert_array_equal(seen[1::2], seen[: 2 * len(seen[1::2]) : 2])
    expected = np.random.default_rng([11, 1]).normal(0.0, 0.5, (STEPS + 1, 3))
    np.testing.assert_allclose(noise, expected[::2], atol=1e-9)
    other = run(short(**CLEAN, sensing={"noise_mm": 0.5, "rate_hz": 5.0}, seed=3)).series["tip_seen_m"]
    assert not np.array_equal(other, seen)


@pytest.mark.slow
def test_a_registration_error_is_one_offset_for_the_whole_run() -> None:
    seen, true = tips(tip="registered", registration_mm=2.0)
    offsets = 1e3 * (seen - true)
    np.testing.assert_allclose(offsets, [offsets[0]] * (STEPS + 1), atol=1e-9)
    drawn = [
        1e3 * (e.observation.tip_m - e.state.tip_m)
        for e in (Episode(short(seed=s, sensing={"tip": "registered", "registration_mm": 2.0})) for s in range(40))
    ]
    assert np.std(drawn) == pytest.approx(2.0, rel=0.2)
    assert np.abs(np.mean(drawn, axis=0)).max() < 1.2


def test_nothing_of_the_plant_changes_where_nothing_is_fed_back() -> None:
    assert run(short(**CLEAN)).digest == run(short(**CLEAN, sensing={"rate_hz": 1.0, "noise_mm": 1.0})).digest


BAD = {"rate_hz": 2.5, "latency_s": 0.2, "noise_mm": 0.2, "tip": "registered"}
CONTROLLERS: dict[str, dict[str, Any]] = {
    "ifem": {"kind": "ifem"},
    "separate": {"kind": "ifem", "model": {"kind": "separate"}},
    "elm": {"kind": "elm"},
    "plugin": {"kind": "plugin", "name": "follows"},
}


class _Follows:
    """Remembers what it was shown."""

    shown: list[Observation]
    seeds: list[int]

    def __init__(self, scenario: Scenario, *_: Any) -> None:
        type(self).shown, type(self).seeds = [], [scenario.seed]

    def reset(self, seed: int) -> None:
        self.seeds.append(seed)

    def command(self, observation: Observation) -> Pose:
        self.shown.append(observation)
        return Pose(observation.base.position_m + observation.target_m - observation.tip_m, observation.base.rotation)


@pytest.mark.parametrize("kind", CONTROLLERS)
def test_every_controller_steers_by_what_is_seen(kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(plugins._registered, "follows", _Follows)
    target = {"target_mm": [12, 21, 15]}
    sound, degraded = (run(short(trajectory=target, controller=CONTROLLERS[kind], sensing=s)) for s in ({}, BAD))
    assert degraded.metrics["rmse_commanded_mm"] > 1.2 * sound.metrics["rmse_commanded_mm"]
    assert not np.array_equal(degraded.series["tip_seen_m"], degraded.series["tip_m"])


def test_no_clean_value_is_shown(monkeypatch: pytest.MonkeyPatch) -> None:
    """Neither the true tip, nor the clean target, nor the seed that the noise follows from."""
    monkeypatch.setitem(plugins._registered, "follows", _Follows)
    scenario = short(trajectory={"target_mm": [12, 21, 15]}, controller=CONTROLLERS["plugin"], sensing=BAD)
    series = run(scenario).series
    shown = _Follows.shown
    np.testing.assert_array_equal([seen.tip_m for seen in shown], series["tip_seen_m"][: len(shown)])
    np.testing.assert_array_equal([seen.target_m for seen in shown], series["target_noisy_m"][: len(shown)])
    for seen, tip, target in zip(shown, series["tip_m"], series["target_m"], strict=False):
        assert np.abs(seen.tip_m - tip).max() > 1e-6
        assert np.abs(seen.targets_m - target).max(axis=1).min() > 1e-6
    assert _Follows.seeds == [seed_of_controller(11)] * 2
    assert seed_of_controller(11) != 11


@pytest.mark.slow
def test_a_carried_path_is_seen_as_late_as_the_tip() -> None:
    moving = {"motion": {"kind": "breathing", "amplitude_mm": 4, "period_s": 2}, "trajectory": {"frame": "tissue"}}
    late = run(short(**CLEAN, **moving, sensing={"latency_s": 0.4}))
    now = run(short(**CLEAN, **moving))
    np.testing.assert_array_equal(late.series["target_m"], now.series["target_m"])
    np.testing.assert_array_equal(now.series["target_noisy_m"], now.series["target_m"])
    apart = np.linalg.norm(late.series["target_noisy_m"] - late.series["target_m"], axis=1)
    assert apart[10:].max() > 2e-3


def test_snapshots_and_resets_hold_the_images_on_their_way() -> None:
    episode = Episode(short(sensing=BAD))
    poses = [shifted(episode.observation.base, 0.0, 0.0, 1e-3 * i) for i in range(1, 13)]
    first = [episode.observation, *stepped(episode, poses[:6])]
    moment, later = episode.snapshot(), stepped(episode, poses[6:])
    episode.restore(moment)
    assert_same(stepped(episode, poses[6:]), later)
    assert_same(stepped(Episode.from_snapshot(moment), poses[6:]), later)
    assert_same([episode.reset(seed=4), *stepped(episode, poses)], [*_anew(4), *stepped(Episode(_bad(4)), poses)])
    assert_same([episode.reset(seed=11), *stepped(episode, poses[:6])], first)


def _bad(seed: int) -> Scenario:
    return short(sensing=BAD, seed=seed)


def _anew(seed: int) -> list[Observation]:
    return [Episode(_bad(seed)).observation]


@pytest.mark.parametrize(
    ("sensing", "message"),
    [
        ({"rate_hz": 3.0}, r"sensing\.rate_hz = 3\.0: must divide 1 / dt_s = 10 Hz; 2\.5 and 3\.33333 do"),
        ({"rate_hz": 20.0}, r"sensing\.rate_hz = 20\.0: must divide 1 / dt_s = 10 Hz; 5 and 10 do"),
        ({"latency_s": 0.25}, r"sensing\.latency_s = 0\.25: must be a multiple of dt_s = 0\.1 s, from 0 to 1 s"),
        ({"latency_s": 1.5}, r"sensing\.latency_s = 1\.5: .*0 to 1"),
        ({"tip": "guessed"}, r"sensing\.tip = 'guessed'"),
        ({"noise": 0.1}, r"sensing\.noise = 0\.1: unknown field.*noise_mm"),
    ],
)
def test_what_does_not_fit_is_refused(sensing: dict[str, Any], message: str) -> None:
    with pytest.raises(ScenarioError, match=message):
        short(sensing=sensing)


def test_a_shared_model_under_degraded_sensing_is_warned_of() -> None:
    assert any("kind = shared" in line for line in short(sensing=BAD).warnings())
    assert not any("kind = shared" in line for line in short().warnings())
    assert not any("kind = shared" in line for line in short(sensing=BAD, **CLEAN).warnings())


def test_a_scenario_without_sensing_is_what_it_was() -> None:
    resolved = short().resolved()
    assert "sensing" not in without_idle_sensing(resolved)
    assert without_idle_sensing(short(sensing=BAD).resolved())["sensing"] == short(sensing=BAD).resolved()["sensing"]
    assert without_idle_sensing({"a": 1}) == {"a": 1}
