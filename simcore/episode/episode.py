"""Episode: an insertion that is stepped from outside. `simcore.rollout` steps one with the scenario's controller."""

from __future__ import annotations

import time
from collections import deque
from functools import cache
from typing import TYPE_CHECKING, Any

from threadpoolctl import ThreadpoolController

from simcore.episode.command import checked_command
from simcore.episode.endings import after_failure, after_step
from simcore.episode.observation import Observation
from simcore.episode.sensing import Camera, View
from simcore.episode.snapshot import Snapshot, check_same_insertion
from simcore.episode.targets import Targets
from simcore.errors import NeedlebenchError, Problem, ScenarioError, Status
from simcore.insertion.state import Pose
from simcore.linear_algebra.products import norm
from simcore.robot import DelayedCommands, limited_pose
from simcore.scenario.build import insertion_of, robot_limits
from simcore.scenario.controller_rules import needs_tissue
from simcore.scenario.scenario import LARGEST_SEED, Scenario

if TYPE_CHECKING:
    from collections.abc import Callable
    from contextlib import AbstractContextManager

    from simcore.arrays import Floats
    from simcore.insertion.insertion import Insertion

    Clock = Callable[[], float]


class EpisodeOverError(NeedlebenchError, RuntimeError):
    """A step after the end of an episode; the message says how it ended."""


class Episode:
    """An insertion, a step at a time: whatever steers the base is outside of it.

    scenario: also as JSON data or text, or by the name of a built-in one; its `controller` steers nothing here, but its
    `delay_s` holds. Raises ScenarioError. clock: of `plant_s`, the wall time of the last step.

    `done` says that the last step has been made, or that the run ended before: by `status` and `message`. Two episodes
    of one scenario that are given the same commands are the same to the bit; so are those that go on from a snapshot.

    >>> import numpy as np
    >>> episode = Episode({"tissue": {"element_size_mm": 10}, "trajectory": {"target_mm": [18, 31, 5]}})
    >>> seen, done = episode.reset(), False
    >>> while not done:
    ...     advance = seen.target_m - seen.tip_m
    ...     seen, done = episode.step(Pose(seen.base.position_m + advance, seen.base.rotation))
    >>> print(episode.status, seen.step, 1e3 * np.linalg.norm(seen.tip_m - seen.target_m) < 0.2)
    completed 50 True
    """

    def __init__(
        self,
        scenario: Scenario | dict[str, Any] | str,
        *,
        clock: Clock = time.perf_counter,
        insertion: Insertion | None = None,
    ) -> None:
        """insertion: of this scenario, used by nobody else; None = it is made."""
        self.scenario = scenario if isinstance(scenario, Scenario) else Scenario.load(scenario)
        self.clock, self.steps = clock, self.scenario.steps
        with _one_thread():
            keeps = needs_tissue(self.scenario.controller)
            self.insertion = insertion or insertion_of(self.scenario, keeps_tissue=keeps)
            self.state = self.insertion.initial_state(self.scenario.path().first_tangent())
        self.limits = robot_limits(self.scenario.robot)
        self.targets = Targets(self.scenario, self.insertion)
        self.view = View(Camera.of(self.scenario, self.insertion.model), self.state)
        self.commands = DelayedCommands(self.state.base, self.scenario.delay_steps)
        self.before, self.step_number = self.state, 0
        self.status, self.message = self.state.report.status, self.state.report.message
        self.authority: list[Floats] = []  # (2, 2) of each state, from the first on, where a controller computed it
        self.limited, self.plant_s = False, 0.0
        self._first = self.snapshot()

    @property
    def done(self) -> bool:
        """Whether there is no further step."""
        return self.status is not Status.COMPLETED or self.step_number >= self.steps

    @property
    def observation(self) -> Observation:
        """What is seen at this moment."""
        step, base, image = self.step_number, self.state.base, self.view.seen
        noise = self.targets.noise_m[step]
        target = self.targets.clean(step, image.tissue_m) + noise
        coming = self.targets.coming(step, image.tissue_m) + noise
        coming[0] = target
        return Observation(
            step=step,
            base=Pose(base.position_m.copy(), base.rotation.copy()),
            tip_m=image.tip_m.copy(),
            target_m=target,
            t_s=step * self.scenario.dt_s,
            dt_s=self.scenario.dt_s,
            base_wrench=self.state.base_wrench.copy(),
            entry_m=self.insertion.entry_m.copy(),
            targets_m=coming,
            tip_direction=image.tip_direction.copy(),
            entry_offset_m=image.entry_offset_m.copy(),
            depth_m=image.depth_m,
        )

    def reset(self, *, seed: int | None = None) -> Observation:
        """Back to the beginning. seed: of all noise from now on, 0 to 2^53 - 1; None = as it was. Raises ScenarioError
        for another seed."""
        if seed is not None:
            self._reseed(seed)
        self._go_to(self._first)
        self.view.seen = self.view.camera.take(0, self.state)
        return self.observation

    def step(self, command: Pose, *, limited: bool = True) -> tuple[Observation, bool]:
        """The robot moves towards `command`, tissue and needle follow; what is seen then, and whether that is the end.

        limited: whether the robot's speed limits act. Raises CommandError for a command that is no finite pose within
        reach, and EpisodeOverError after the end; both leave the episode as it was. A step that fails numerically is an
        end: the episode stays at its last good state.
        """
        if self.done:
            how = f"{self.status}: {self.message}" if self.message else str(self.status)
            raise EpisodeOverError(f"the episode is over after {self.step_number} steps ({how}); reset it first")
        pose = checked_command(command, self.state.base, self.step_number)
        self._advance(pose, limited)
        return self.observation, self.done

    def _advance(self, command: Pose, limited: bool) -> None:
        """Wait for the delay, limit, step; then judge."""
        target_m = self.targets.clean(self.step_number, self.state.bodies.x)
        base, self.limited = self.commands.due(command), False
        if limited:
            base, self.limited = limited_pose(self.state.base, base, self.limits, self.scenario.dt_s)
        started = self.clock()
        state = self.insertion.step(self.state, base)
        self.plant_s = self.clock() - started
        if state.report.status is not Status.COMPLETED:
            error_m = norm(self.state.tip_m - target_m)
            ending = after_failure(self.insertion, self.state, state, error_m, self.authority)
            self._end(*ending)
            return
        where = self.where
        self.before, self.state, self.step_number = self.state, state, self.step_number + 1
        self.view.look(self.step_number, state)
        error_m = norm(state.tip_m - target_m)
        status, message = after_step(self.scenario, self.insertion, state, error_m, self.authority)
        self.status, self.message = status, f"{where}: {message}" if message else ""

    @property
    def where(self) -> str:
        """The step that comes and how deep the needle is, for messages."""
        return f"step {self.step_number + 1} of {self.steps}, depth {self.state.inserted_m * 1e3:.1f} mm"

    def _end(self, status: Status, message: str) -> None:
        self.status, self.message = status, f"{self.where}: {message}"

    def end(self, status: Status, message: str) -> None:
        """End it by name, as a step that is not made: what commands it has failed."""
        self._end(status, message)

    def snapshot(self) -> Snapshot:
        """This moment, to go back to: see `restore`."""
        return Snapshot(
            scenario=self.scenario,
            step=self.step_number,
            status=self.status,
            message=self.message,
            before=self.before,
            state=self.state,
            kept=self.insertion.workspace.kept(),
            waiting=tuple(self.commands.waiting),
            seen=self.view.seen,
            coming=tuple(self.view.coming),
            authority=tuple(self.authority),
        )

    def restore(self, snapshot: Snapshot) -> Observation:
        """Go to a moment of this episode or of another one of the same scenario, of another process too: the steps
        after it are the same to the bit. The seed is that of the snapshot. Raises SnapshotError for another scenario.
        """
        check_same_insertion(snapshot, self.scenario)
        self._reseed(snapshot.scenario.seed)
        self._go_to(snapshot)
        return self.observation

    @classmethod
    def from_snapshot(cls, snapshot: Snapshot) -> Episode:
        """A new episode at that moment."""
        episode = cls(snapshot.scenario)
        episode.restore(snapshot)
        return episode

    def copy(self) -> Episode:
        """An independent episode at this moment, which shares all that never changes: to look ahead with."""
        insertion = self.insertion.with_tolerances(self.insertion.model.tolerances)
        twin = Episode(self.scenario, clock=self.clock, insertion=insertion)
        twin.restore(self.snapshot())
        return twin

    def __reduce__(self) -> tuple[Callable[[Snapshot], Episode], tuple[Snapshot]]:
        """Pickled and deep-copied as its moment."""
        return Episode.from_snapshot, (self.snapshot(),)

    def _reseed(self, seed: int) -> None:
        if seed == self.scenario.seed:
            return
        if not 0 <= seed <= LARGEST_SEED:
            raise ScenarioError([Problem("seed", seed, "must be 0 to 2^53 - 1")])
        self.scenario = self.scenario.model_copy(update={"seed": int(seed)})
        self.targets.draw(self.scenario)
        self.view.camera = Camera.of(self.scenario, self.insertion.model)

    def _go_to(self, moment: Snapshot) -> None:
        self.insertion.workspace.restore(moment.kept)
        self.before, self.state, self.step_number = moment.before, moment.state, moment.step
        self.status, self.message = moment.status, moment.message
        self.commands.waiting = deque(moment.waiting)
        self.view.seen, self.view.coming = moment.seen, deque(moment.coming)
        self.authority = list(moment.authority)
        self.limited, self.plant_s = False, 0.0


@cache
def _controller() -> ThreadpoolController:
    return ThreadpoolController()


def _one_thread() -> AbstractContextManager[Any]:
    """One BLAS thread, whatever was imported first: the same bits whatever else the machine does."""
    limit: AbstractContextManager[Any] = _controller().limit(limits=1)
    return limit
