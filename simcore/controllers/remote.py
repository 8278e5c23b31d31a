"""A controller in another process: asked in lock step over a connection, see `simcore.remote.messages`."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

import numpy as np

from simcore.controllers.base import seed_of_controller
from simcore.episode.observation import Observation
from simcore.errors import ControllerError
from simcore.insertion.state import Pose
from simcore.linear_algebra.products import norm
from simcore.remote.link import Address, Link, LinkError
from simcore.remote.messages import (
    PROTOCOL,
    CommandMessage,
    End,
    NonsenseError,
    ObservationMessage,
    Start,
    Stop,
    read_answer,
    read_ready,
)
from simcore.rotations import matrix_from_quaternion, quaternion_from_matrix

if TYPE_CHECKING:
    from collections.abc import Callable

    from simcore.arrays import Floats
    from simcore.episode.observation import Observation
    from simcore.remote.messages import Vector3
    from simcore.scenario.scenario import Remote, Scenario


class RemoteController:
    """Asks the controller at the other end; an error names it and the step.

    settings.clock = simulated: the run waits, and the answer counts as given at once. real: the plant goes on with the
    last command for as many whole steps as the answer took, and the controller sees nothing of them.
    """

    limited = True

    def __init__(
        self,
        settings: Remote,
        scenario: Scenario,
        entry_m: Floats,
        needle_length_m: float,
        clock: Callable[[], float] = time.perf_counter,
    ) -> None:
        """Begins to listen; the controller may connect from now on. Raises ControllerError."""
        self.settings, self.scenario, self.clock = settings, scenario, clock
        self.entry_m, self.needle_length_m = entry_m, needle_length_m
        self._greeted, self._due = False, 0
        self._next: Pose | None = None
        self._held: Pose | None = None
        try:
            self._link = Link(Address.parse(settings.address))
        except OSError as error:
            raise self._fault(f"cannot be waited for at {settings.address}: {error.strerror or error}", None) from None

    def command(self, observation: Observation) -> Pose:
        """What it wants; in real time, what it wanted last until its answer is due. Raises ControllerError."""
        if not self._greeted:
            self._greet()
        if self._held is None:
            self._held = observation.base
        if observation.step >= self._due:
            self._held = self._next or self._held
            started = self.clock()
            answer = self._asked(observation)
            late = int((self.clock() - started) / observation.dt_s) if self.settings.clock == "real" else 0
            if late == 0:
                self._held = answer
            self._next, self._due = answer, observation.step + max(late, 1)
        return self._held

    def close(self, status: str, message: str) -> None:
        """Tell the controller how the run ended, if it is still there, and let it go. status: of the run, or
        `interrupted`."""
        try:
            if self._greeted:
                self._link.send(End(status=status, message=message).line(), self.settings.step_timeout_s)
        except LinkError:
            pass
        finally:
            self._link.close()

    def _greet(self) -> None:
        """Wait for the connection, say what stays the same, hear that it is ready."""
        settings = self.settings
        start = Start(
            dt_s=self.scenario.dt_s,
            steps=self.scenario.steps,
            entry_m=_triple(self.entry_m),
            needle_length_m=self.needle_length_m,
            seed=seed_of_controller(self.scenario.seed),
            settings=dict(settings.settings),
            scenario={**self.scenario.resolved(), "seed": seed_of_controller(self.scenario.seed)},
        )
        try:
            self._link.accept(settings.connect_timeout_s)
            self._link.send(start.line(), settings.step_timeout_s)
            ready = read_ready(self._link.receive(settings.connect_timeout_s))
        except (LinkError, NonsenseError) as error:
            raise self._fault(str(error), None) from None
        if isinstance(ready, Stop):
            raise self._fault(f"does not begin: {ready.reason or 'it gives no reason'}", None)
        if ready.protocol != PROTOCOL:
            raise self._fault(f"speaks {ready.protocol!r}, this is {PROTOCOL}", None)
        self._greeted = True

    def _asked(self, observation: Observation) -> Pose:
        step, limit_s = observation.step, self.settings.step_timeout_s
        try:
            self._link.send(self._message(observation).line(), limit_s)
            answer = read_answer(self._link.receive(limit_s))
        except (LinkError, NonsenseError) as error:
            raise self._fault(str(error), step) from None
        if isinstance(answer, Stop):
            raise self._fault(f"stops: {answer.reason or 'it gives no reason'}", step)
        if answer.step != step:
            raise self._fault(f"answered step {answer.step}", step)
        return self._pose(answer, observation)

    def _message(self, seen: Observation) -> ObservationMessage:
        quaternion = quaternion_from_matrix(seen.base.rotation)
        w, x, y, z = (float(value) for value in quaternion)
        return ObservationMessage(
            step=seen.step,
            t_s=seen.t_s,
            base_position_m=_triple(seen.base.position_m),
            base_quaternion=(w, x, y, z),
            base_force_n=_triple(seen.base_wrench[:3]),
            base_torque_nm=_triple(seen.base_wrench[3:]),
            tip_m=_triple(seen.tip_m),
            tip_direction=_triple(seen.tip_direction),
            depth_m=seen.depth_m,
            entry_offset_m=_pair(seen.entry_offset_m),
            target_m=_triple(seen.target_m),
            coming_m=[_triple(point) for point in seen.targets_m[1 : 1 + self.settings.look_ahead]],
        )

    def _pose(self, answer: CommandMessage, observation: Observation) -> Pose:
        if answer.quaternion is None:
            return Pose(np.array(answer.position_m), observation.base.rotation)
        quaternion = np.array(answer.quaternion)
        length = norm(quaternion)
        if not 1e-6 < length < 1e6:
            raise self._fault(
                f"answered with the quaternion {answer.quaternion}, which is no rotation", observation.step
            )
        return Pose(np.array(answer.position_m), matrix_from_quaternion(quaternion / length))

    def _fault(self, what: str, step: int | None) -> ControllerError:
        where = "" if step is None else f", step {step}"
        return ControllerError(f"remote controller {self.settings.name!r}: {what}{where}")


def _triple(values: Floats) -> Vector3:
    x, y, z = (float(value) for value in values)
    return x, y, z


def _pair(values: Floats) -> tuple[float, float]:
    x, y = (float(value) for value in values)
    return x, y
