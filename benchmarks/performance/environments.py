"""Steps a second of an insertion that is stepped from outside: the plain episode, one environment of Gymnasium around
it, and two of these at once in processes of their own."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from benchmarks.builtin_scenarios import benchmark_scenario
from benchmarks.measurements import Figure, Part, figure, missing_figure
from benchmarks.performance.step_clock import MeasurementError
from simcore.episode import Episode
from simcore.insertion.state import Pose
from simcore.rollout.rollout import compile_kernels

if TYPE_CHECKING:
    from benchmarks.ports import BenchPorts, Clock
    from simcore.scenario.scenario import Scenario

ROUNDS = 5
AT_ONCE = 2  # environments of the vector, a process each
ID = "needlebench.gym:needlebench/Line-v0"  # imported by Gymnasium, which stands above this
WITHOUT = 'needs gymnasium: pip install "needlebench[gym]"'


def environments(ports: BenchPorts) -> Part:
    """Rounds of one insertion along `line` each, the base pushed along its own axis with the speed of the path: from
    the reset to the end, without the reset. Two environments take twice as many steps."""
    scenario = benchmark_scenario("line", quick=ports.quick, changes=("recording.enabled=false",))
    compile_kernels()
    episode = Episode(scenario)
    try:
        import gymnasium
    except ModuleNotFoundError:
        plain = [_episode_rate(episode, ports.clock) for _ in range(ports.rounds(ROUNDS))]
        names = ("envs.one_steps_s", "envs.two_steps_s", "envs.one_over_episode", "envs.two_over_one")
        return Part((_rate("envs.episode_steps_s", plain), *(missing_figure(name, "", WITHOUT) for name in names)))
    one = gymnasium.make(ID)
    two = gymnasium.make_vec(ID, num_envs=AT_ONCE, vectorization_mode="async", vector_kwargs={"context": "spawn"})
    rates: list[tuple[float, float, float]] = []
    try:
        _env_rate(one, scenario, ports.clock)
        _vector_rate(two, scenario, ports.clock)  # both processes are warm now
        for number in range(ports.rounds(ROUNDS)):
            ports.say(f"envs: round {number + 1} of {ports.rounds(ROUNDS)}")
            measured = (
                _episode_rate(episode, ports.clock),
                _env_rate(one, scenario, ports.clock),
                _vector_rate(two, scenario, ports.clock),
            )
            rates.append(measured)
    finally:
        one.close()
        two.close()
    plain, alone, together = (list(values) for values in zip(*rates, strict=True))
    return Part(
        (
            _rate("envs.episode_steps_s", plain),
            _rate("envs.one_steps_s", alone),
            _rate("envs.two_steps_s", together, note="of both, two processes"),
            _ratio("envs.one_over_episode", alone, plain),
            _ratio("envs.two_over_one", together, alone),
        )
    )


def _rate(key: str, values: list[float], note: str = "") -> Figure:
    return figure(key, "1/s", values, better="higher", note=note)


def _ratio(key: str, above: list[float], below: list[float]) -> Figure:
    return figure(key, "x", [a / b for a, b in zip(above, below, strict=True)], better="higher")


def _episode_rate(episode: Episode, clock: Clock) -> float:
    """Steps a second of the plain loop."""
    seen, done = episode.reset(), False
    ahead_m = episode.limits.max_speed_m_s * episode.scenario.dt_s * _push(episode.scenario)
    started = clock()
    while not done:
        base = seen.base
        seen, done = episode.step(Pose(base.position_m + ahead_m * base.rotation[:, 2], base.rotation))
    elapsed = clock() - started
    _check(str(episode.status), episode.message)
    return seen.step / elapsed


def _env_rate(env: Any, scenario: Scenario, clock: Clock) -> float:
    """Steps a second of one environment."""
    env.reset(options={"scenario": scenario})
    action, steps, done, info = _action(scenario), 0, False, dict[str, Any]()
    started = clock()
    while not done:
        _, _, terminated, truncated, info = env.step(action)
        done, steps = terminated or truncated, steps + 1
    elapsed = clock() - started
    _check(info["status"], info["message"])
    return steps / elapsed


def _vector_rate(envs: Any, scenario: Scenario, clock: Clock) -> float:
    """Steps a second of all environments of a vector together; they end in the same step."""
    envs.reset(options={"scenario": scenario.resolved()})
    actions, steps, done, info = np.tile(_action(scenario), (AT_ONCE, 1)), 0, False, dict[str, Any]()
    started = clock()
    while not done:
        _, _, terminated, truncated, info = envs.step(actions)
        done, steps = bool((terminated | truncated).all()), steps + 1
    elapsed = clock() - started
    for status, message in zip(info["status"], info["message"], strict=True):
        _check(status, message)
    return AT_ONCE * steps / elapsed


def _push(scenario: Scenario) -> float:
    """The speed of the path as a share of the robot's limit, in single precision as actions are."""
    speed_mm_s: float = scenario.resolved()["trajectory"]["speed_mm_s"]
    return float(np.float32(speed_mm_s / scenario.robot.max_speed_mm_s))


def _action(scenario: Scenario) -> np.ndarray[Any, np.dtype[np.float32]]:
    return np.array([0.0, 0.0, _push(scenario), 0.0, 0.0, 0.0], np.float32)


def _check(status: str, message: str) -> None:
    """Raises MeasurementError for an insertion that did not reach its end."""
    if status != "completed":
        raise MeasurementError(f"the insertion that is stepped ended as {status}: {message}")
