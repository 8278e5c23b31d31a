"""The insertion as a plant: a constant model, a changing state, `step` a function that reads as the algorithm."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from simcore.arrays import Floats
from simcore.contact.channel import (
    Channel,
    Phase,
    advance_end,
    puncture,
    refresh_elements,
    slide_contact,
)
from simcore.errors import Status
from simcore.insertion.model import CoupledModel, Tolerances
from simcore.insertion.solver import Bodies, Coupled, Guess, StepReport
from simcore.needle.model import NeedleModel, increments, straight
from simcore.rotations import exp_map
from simcore.tissue.breathing import BreathingMotion
from simcore.tissue.model import TissueModel

OUTSIDE_M = 1e-3  # a contact point or channel end farther than this outside the rest shape has left the tissue
RE_ENTRY_MISS_M = 2e-3  # a re-entering tip farther than this from its channel has left it


@dataclass(frozen=True)
class Pose:
    """Of the needle's base: position (3,) m and rotation (3, 3), world; identity = needle along +z."""

    position_m: Floats
    rotation: Floats


@dataclass
class InsertionState:
    """A converged state: bodies, channel, forces on the base, and how the last step was solved."""

    bodies: Bodies
    channel: Channel
    base_wrench: Floats  # (6,) N, N m of the robot on the base
    inserted_m: float  # rest length of channel that the needle occupies
    points_m: Floats  # (a, 3) active constraint points
    point_forces_n: Floats  # (a, 3) of the needle on the tissue
    report: StepReport
    steps: int = 0  # since the start: the held nodes are where the motion has them at steps * dt

    @property
    def base(self) -> Pose:
        """Where the robot holds the needle."""
        return Pose(self.bodies.needle_x[0], self.bodies.needle_R[0])

    @property
    def tip_m(self) -> Floats:
        """(3,) m, world."""
        tip: Floats = self.bodies.needle_x[-1]
        return tip


class Insertion:
    """Needle, tissue and their interaction . `step` leaves its argument as it was."""

    def __init__(self, model: CoupledModel, *, entry_m: Floats, motion: BreathingMotion | None = None) -> None:
        """entry_m: (3,) m, on the surface. motion: of the held nodes; None = they stay."""
        self.model, self.entry_m, self.motion = model, entry_m, motion
        self.coupled = Coupled(model)

    @property
    def tissue(self) -> TissueModel:
        """The tissue's constants."""
        return self.model.tissue

    @property
    def needle(self) -> NeedleModel:
        """The needle's constants."""
        return self.model.needle

    def initial_base(self, tangent: Floats) -> Pose:
        """Base pose of the straight needle that waits along `tangent` (3,), unit, with its tip at the entry."""
        rotation = rotation_towards(tangent)
        return Pose(self.entry_m - self.needle.length_m * rotation[:, 2], rotation)

    def initial_state(self, tangent: Floats) -> InsertionState:
        """Tissue at rest, needle straight along `tangent`, tip at the entry, touching."""
        base = self.initial_base(tangent)
        x, R = straight(self.needle, base.position_m, base.rotation)
        rest = self.tissue.mesh.nodes_m
        bodies = Bodies(rest.copy(), np.zeros_like(rest), x, R, np.zeros((len(x), 6)))
        channel = Channel.at_surface(self.model.channel, self.entry_m, self.needle.length_m)
        _, report = self.coupled.solve(bodies, channel, base.position_m, base.rotation)
        nothing = np.zeros((0, 3))
        self._last = InsertionState(bodies, channel, np.zeros(6), 0.0, nothing, nothing, report)
        return self._last

    def step(self, state: InsertionState, base: Pose) -> InsertionState:
        """The state after the base has moved to `base`; `report.status` says whether it may be used.

        A contact that reaches the puncture force is opened and the same step is solved again, inside.
        """
        channel, bodies, report = self.solve(state, base)
        if report.status is Status.COMPLETED:
            channel = channel.copy()  # the solved problem keeps the channel that it was solved with
            report = self._settle(channel, bodies, report)
        self._last = InsertionState(
            bodies,
            channel,
            self.coupled.base_wrench(),
            self.coupled.inserted_m if channel.phase is Phase.INSERTED else 0.0,
            self.coupled.points,
            self.coupled.force,
            report,
            state.steps + 1,
        )
        return self._last

    def solve(
        self, state: InsertionState, base: Pose, guess: Guess | None = None
    ) -> tuple[Channel, Bodies, StepReport]:
        """The first half of `step`: the new equilibrium, its channel not yet cut further; opened if it was punctured.

        guess: where the solver begins, for a channel that is open already; None = where the last step leads to.
        """
        channel = state.channel.copy()
        bodies, report = self._solve(state, channel, base, guess)
        if report.status is Status.COMPLETED and self._punctures():
            channel = state.channel.copy()
            puncture(channel, self.model.channel)
            bodies, report = self._solve(state, channel, base)
        return channel, bodies, report

    def with_tolerances(self, tolerances: Tolerances) -> Insertion:
        """The same bodies with work arrays of their own and other tolerances: steps of it leave this one alone."""
        return Insertion(replace(self.model, tolerances=tolerances), entry_m=self.entry_m, motion=self.motion)

    def solved(self, state: InsertionState) -> Coupled:
        """The coupled problem as it was solved for `state`, to linearise it. Only the last step is at hand."""
        if self._last is not state:
            raise ValueError("only the step that was solved last can be linearised")
        return self.coupled

    def material_point_position(self, state: InsertionState, rest_m: Floats) -> Floats:
        """(3,) m, world: where the tissue point at `rest_m` is now, by the shape functions of its tetrahedron."""
        nodes, weights = self.tissue.mesh.locate(rest_m)
        moved: Floats = rest_m + weights @ (state.bodies.x[nodes] - self.tissue.mesh.nodes_m[nodes])
        return moved

    def _solve(
        self, state: InsertionState, channel: Channel, base: Pose, guess: Guess | None = None
    ) -> tuple[Bodies, StepReport]:
        shift = self.motion.shift_m((state.steps + 1) * self.model.dt_s) if self.motion else None
        bodies, report = self.coupled.solve(state.bodies, channel, base.position_m, base.rotation, shift, guess)
        bodies.v = (bodies.x - state.bodies.x) / self.model.dt_s
        old = state.bodies
        bodies.needle_move = increments(old.needle_x, old.needle_R, bodies.needle_x, bodies.needle_R)
        return bodies, report

    def _punctures(self) -> bool:
        return self.coupled.contact and bool(self.coupled.mode[0] == 2)

    def _settle(self, channel: Channel, bodies: Bodies, report: StepReport) -> StepReport:
        """After convergence: store forces and arc lengths, cut, create, drop and take up elements."""
        c, model, tip = self.coupled, self.model.channel, bodies.needle_x[-1]
        channel.force_change_n[:] = 0.0
        channel.force_change_n[c.elements] = c.force - channel.force_n[c.elements]
        channel.force_n[c.elements] = c.force
        channel.mode[c.elements] = c.mode
        if channel.phase is Phase.CONTACT:
            slide_contact(channel, model, bodies.x, tip)
            return self._inside(channel, report)
        channel.arc_m[:] = c.all_arcs
        if channel.active[0] and channel.arc_m[0] < self.needle.length_m:
            advance_end(channel, model, bodies.x, tip)
            channel.arc_m[0] = self.needle.length_m
        missed = refresh_elements(
            channel, model, bodies.x, bodies.needle_x, bodies.needle_R, self.needle.element_length_m
        )
        if missed > RE_ENTRY_MISS_M:
            message = (
                f"the tip re-enters {missed * 1e3:.2f} mm beside its channel, at most {RE_ENTRY_MISS_M * 1e3:g} mm"
            )
            return replace(report, status=Status.CHANNEL_LEFT, message=message)
        return self._inside(channel, report)

    def _inside(self, channel: Channel, report: StepReport) -> StepReport:
        """The report, or a failure if the contact point or the channel's end lies outside the tissue."""
        outside = float(self.tissue.mesh.outside_by(channel.rest_m[:1])[0])
        if outside <= OUTSIDE_M:
            return report
        message = f"the tip is {outside * 1e3:.2f} mm outside the tissue's rest shape, at most {OUTSIDE_M * 1e3:g} mm"
        return replace(report, status=Status.TISSUE_LEFT, message=message)


def rotation_towards(direction: Floats) -> Floats:
    """(3, 3) smallest rotation that takes +z to `direction` (3,), unit."""
    z = np.array([0.0, 0.0, 1.0])
    axis = np.cross(z, direction)
    sine, cosine = float(np.linalg.norm(axis)), float(direction[2])
    if sine < 1e-15:
        return np.eye(3) if cosine > 0 else np.diag([1.0, -1.0, -1.0])
    return exp_map(axis / sine * np.arctan2(sine, cosine))
