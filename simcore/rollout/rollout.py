"""run(scenario, observer) -> Rollout: the one loop that every way of using the simulator goes through."""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import cache
from typing import TYPE_CHECKING, Any

from threadpoolctl import threadpool_limits

from simcore.controllers import make_controller
from simcore.controllers.plant_model import make_model
from simcore.controllers.remote_centre import rcm_authority
from simcore.episode import CommandError, Episode
from simcore.errors import ControllerError, ModelFailureError, Status
from simcore.rollout.recorder import Recorder
from simcore.rollout.records import Observer, Silent, StepTiming
from simcore.scenario.controller_rules import needs_tissue
from simcore.scenario.scenario import Plugin, Remote, Scenario

if TYPE_CHECKING:
    from simcore.episode import Observation
    from simcore.insertion.jacobian_fast import Linearisation
    from simcore.insertion.state import Pose
    from simcore.rollout.result import Rollout

Clock = Callable[[], float]
INTERRUPTED = "interrupted"  # what a controller is told of a run that something else has ended


def compile_kernels(*, exact: bool = True, linearised: bool = True) -> None:
    """Run eight steps of a tiny insertion (contact, puncture, cutting, steering), once in a process: compiles every
    kernel, or loads it from the cache, so that compilation is in no measured time. exact: also with the exact
    Jacobian, linearised: also with linearised steps; no other run needs the kernels of these."""
    _run_tiny("fast", "converged")
    if exact:
        _run_tiny("exact", "converged")
    if linearised:
        _run_tiny("fast", "linearised")


@cache
def _run_tiny(derivative: str, mode: str) -> None:
    small = {
        "name": "warm-up",
        "tissue": {"size_mm": [24, 24, 30], "element_size_mm": 10, "rayleigh_stiffness_s": 0.001, "density_kg_m3": 1},
        "needle": {"length_mm": 60, "elements": 3},
        "trajectory": {"kind": "line", "entry_mm": [12, 12, 0], "target_mm": [12, 12, 4], "speed_mm_s": 50},
    }
    steering = {"controller": {"kind": "ifem", "derivative": derivative}, "solver": {"mode": mode}}
    _Loop(Scenario.load({**small, **steering}), Silent(), time.perf_counter).run()


def run(
    scenario: Scenario | dict[str, Any] | str, observer: Observer | None = None, *, clock: Clock = time.perf_counter
) -> Rollout:
    """Simulate one scenario; the observer sees every step and changes nothing.

    scenario: also as JSON data or text, or by the name of a built-in one. Raises ScenarioError.

    A step that fails ends the run with its named status; the last good state is the last row of the series. Exceptions
    of the observer pass through: that is how a run is cancelled.

    >>> rollout = run(Scenario.load({"tissue": {"element_size_mm": 10}, "trajectory": {"target_mm": [18, 31, 5]}}))
    >>> print(rollout.status, rollout.series["tip_m"].shape, rollout.metrics["rmse_commanded_mm"] < 0.1)
    completed (51, 3) True
    """
    chosen = scenario if isinstance(scenario, Scenario) else Scenario.load(scenario)
    with threadpool_limits(1):
        linearised = chosen.solver.mode == "linearised"
        compile_kernels(exact=needs_tissue(chosen.controller), linearised=linearised)
        return _Loop(chosen, observer or Silent(), clock).run()


class _Loop:
    """An episode and the controller of its scenario; targets, robot and plant are the episode's."""

    def __init__(self, scenario: Scenario, observer: Observer, clock: Clock) -> None:
        self.scenario, self.observer, self.clock = scenario, observer, clock
        self.episode = episode = Episode(scenario, clock=clock)
        self.model = make_model(scenario, episode.insertion, lambda: (episode.before, episode.state))
        self.response: Linearisation | None = None
        self.jacobian_s = 0.0
        self.controller = make_controller(
            scenario,
            entry_m=episode.insertion.entry_m,
            needle_length_m=episode.insertion.needle.length_m,
            model=self._timed_model if self.model else None,
        )

    def run(self) -> Rollout:
        """The loop itself; a controller that holds something lets go of it, whatever ends the loop."""
        try:
            return self._run()
        finally:
            if callable(close := getattr(self.controller, "close", None)):
                close(str(self.episode.status) if self.episode.done else INTERRUPTED, self.episode.message)

    def _run(self) -> Rollout:
        episode, recorder = self.episode, Recorder(self.episode, self.observer)
        seen = episode.observation
        while not episode.done:
            made = episode.step_number
            seen, command, command_s = self._advance(seen)
            if command is None or episode.step_number == made:
                break
            recorder.add(command, seen, StepTiming(episode.plant_s, self.jacobian_s, command_s))
        return recorder.finished()

    def _advance(self, seen: Observation) -> tuple[Observation, Pose | None, float]:
        """Ask the controller and step the episode: what is seen then, the command, and the time that it took, s. A
        controller that fails ends the episode."""
        episode = self.episode
        self.response, self.jacobian_s, started = None, 0.0, self.clock()
        try:
            command = self.controller.command(seen)
        except ModelFailureError as failure:
            episode.end(failure.status, f"the controller's model: {failure.message}")
            return seen, None, 0.0
        except ControllerError as error:
            episode.end(Status.CONTROLLER_FAILED, str(error))
            return seen, None, 0.0
        command_s = self.clock() - started - self.jacobian_s
        episode.authority.append(rcm_authority(self.response, seen.base.rotation))
        try:
            seen, _ = episode.step(command, limited=self.controller.limited)
        except CommandError as error:
            episode.end(Status.CONTROLLER_FAILED, f"controller {self._label} answered with {error.problem}")
            return seen, None, 0.0
        return seen, command, command_s

    @property
    def _label(self) -> str:
        """What messages call the controller."""
        settings = self.scenario.controller
        return repr(settings.name if isinstance(settings, Plugin | Remote) else settings.kind)

    def _timed_model(self, observation: Observation) -> Linearisation:
        assert self.model is not None
        started = self.clock()
        self.response = self.model(observation)
        self.jacobian_s = self.clock() - started
        return self.response
