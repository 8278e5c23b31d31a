"""The insertion as a plant: a constant model, a changing state, and `step`, which reads as the algorithm."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from simcore.contact.channel import Channel, Phase
from simcore.contact.cutting import advance_end, puncture, refresh_elements, slide_contact
from simcore.elementary import arc_tangent
from simcore.errors import Status
from simcore.insertion.solver import solve_step, tissue_response
from simcore.insertion.state import Bodies, Goal, Guess, Pose, SolvedStep, StepReport, Workspace
from simcore.linear_algebra.products import norm, times
from simcore.needle.model import NeedleModel, increments, straight
from simcore.rotations import exp_map

if TYPE_CHECKING:
    from simcore.arrays import Floats
    from simcore.insertion.model import CoupledModel, Tolerances
    from simcore.tissue.breathing import BreathingMotion
    from simcore.tissue.model import TissueModel

OUTSIDE_M = 1e-3  # a contact point or channel end farther than this outside the rest shape has left the tissue
RE_ENTRY_MISS_M = 2e-3  # a re-entering tip farther than this from its channel has left it


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
    solved: SolvedStep  # what a linearisation of the last step needs
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
    """Needle, tissue and their interaction. `step` leaves its argument as it was."""

    def __init__(
        self, model: CoupledModel, *, motion: BreathingMotion | None = None, keeps_tissue: bool = True
    ) -> None:
        """motion: of the held nodes; None = they stay. keeps_tissue: whether each step keeps the tissue's side of it,
        which the exact Jacobian needs: a copy of some megabytes."""
        self.model, self.motion, self.keeps_tissue = model, motion, keeps_tissue
        self.workspace = Workspace(model)

    @property
    def tissue(self) -> TissueModel:
        """The tissue's constants."""
        return self.model.tissue

    @property
    def needle(self) -> NeedleModel:
        """The needle's constants."""
        return self.model.needle

    @property
    def entry_m(self) -> Floats:
        """(3,) m, world: where the needle enters, also the remote centre of motion."""
        return self.model.entry_m

    def initial_base(self, tangent: Floats) -> Pose:
        """Base pose of the straight needle that waits along `tangent` (3,), unit, with its tip at the entry."""
        rotation = rotation_towards(tangent)
        return Pose(self.entry_m - self.needle.length_m * rotation[:, 2], rotation)

    def initial_state(self, tangent: Floats) -> InsertionState:
        """Tissue at rest, needle straight along `tangent` (3,), unit, its tip at the entry: it touches the surface, or
        is in it where the puncture takes no force."""
        base = self.initial_base(tangent)
        x, R = straight(self.needle, base.position_m, base.rotation)
        rest = self.tissue.mesh.nodes_m
        bodies = Bodies(rest.copy(), np.zeros_like(rest), x, R, np.zeros((len(x), 6)))
        channel = Channel.at_surface(self.model.channel, self.entry_m, self.needle.length_m)
        if self.model.law.puncture_n == 0.0:
            puncture(channel, self.model.channel)
        solved = self._kept(solve_step(self.model, self.workspace, bodies, channel, Goal(base)))
        nothing = np.zeros((0, 3))
        return InsertionState(bodies, channel, np.zeros(6), 0.0, nothing, nothing, solved.report, solved)

    def step(self, state: InsertionState, base: Pose) -> InsertionState:
        """The state after the base has moved to `base`; `report.status` says whether it may be used.

        A contact that reaches the puncture force is opened and the same step is solved again, inside.
        """
        solved = self._kept(self.solve(state, base))
        channel, report = solved.active.channel, solved.report
        if report.status is Status.COMPLETED:
            channel = channel.copy()  # the solved step keeps the channel that it was solved with
            report = self._settle(channel, solved)
        return InsertionState(
            solved.bodies,
            channel,
            solved.base_wrench,
            solved.at.inserted_m,
            solved.at.points.places,
            solved.at.force_n,
            report,
            solved,
            state.steps + 1,
        )

    def solve(self, state: InsertionState, base: Pose, guess: Guess | None = None) -> SolvedStep:
        """The first half of `step`: the new equilibrium, its channel not yet cut further; opened if it was punctured.

        guess: where the solver begins, for a channel that is open already; None = where the last step leads to.
        """
        solved = self._solve(state, state.channel, base, guess)
        if solved.report.status is Status.COMPLETED and _punctures(solved):
            channel = state.channel.copy()
            puncture(channel, self.model.channel)
            solved = self._solve(state, channel, base)
        return solved

    def with_tolerances(self, tolerances: Tolerances) -> Insertion:
        """The same bodies with work arrays of their own and other tolerances: steps of it leave this one alone."""
        model = replace(self.model, tolerances=tolerances)
        return Insertion(model, motion=self.motion, keeps_tissue=self.keeps_tissue)

    def material_point_position(self, x: Floats, rest_m: Floats) -> Floats:
        """(3,) m, world: where the tissue point at `rest_m` is when the nodes are at x (n, 3) m, by the shape functions
        of its tetrahedron."""
        nodes, weights = self.tissue.mesh.locate(rest_m)
        moved: Floats = rest_m + times((x[nodes] - self.tissue.mesh.nodes_m[nodes]).T, weights)
        return moved

    def held_shift_m(self, state: InsertionState) -> Floats:
        """(3,) m, world: how far the held nodes have moved by this state."""
        return self.motion.shift_m(state.steps * self.model.dt_s) if self.motion else np.zeros(3)

    def _solve(self, state: InsertionState, channel: Channel, base: Pose, guess: Guess | None = None) -> SolvedStep:
        shift = self.motion.shift_m((state.steps + 1) * self.model.dt_s) if self.motion else None
        old = state.bodies
        solved = solve_step(self.model, self.workspace, old, channel, Goal(base, shift), guess)
        bodies = solved.bodies
        bodies.v = (bodies.x - old.x) / self.model.dt_s
        bodies.needle_move = increments(old.needle_x, old.needle_R, bodies.needle_x, bodies.needle_R)
        return solved

    def _kept(self, solved: SolvedStep) -> SolvedStep:
        return replace(solved, tissue=tissue_response(self.workspace, solved)) if self.keeps_tissue else solved

    def _settle(self, channel: Channel, solved: SolvedStep) -> StepReport:
        """After convergence: store forces and arc lengths, cut, create, drop and take up elements."""
        at, bodies, elements, report = solved.at, solved.bodies, solved.active.elements, solved.report
        model, tip = self.model.channel, bodies.needle_x[-1]
        channel.force_change_n[:] = 0.0
        channel.force_change_n[elements] = at.force_n - channel.force_n[elements]
        channel.force_n[elements] = at.force_n
        channel.mode[elements] = at.mode
        if channel.phase is Phase.CONTACT:
            slide_contact(channel, model, bodies.x, tip)
            return self._inside(channel, report)
        channel.arc_m[:] = at.all_arcs_m
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


def _punctures(solved: SolvedStep) -> bool:
    return solved.active.contact and bool(solved.at.mode[0] == 2)


def rotation_towards(direction: Floats) -> Floats:
    """(3, 3) smallest rotation that takes +z to `direction` (3,), unit."""
    z = np.array([0.0, 0.0, 1.0])
    axis = np.cross(z, direction)
    sine, cosine = norm(axis), float(direction[2])
    if sine < 1e-15:
        return np.eye(3) if cosine > 0 else np.diag([1.0, -1.0, -1.0])
    return exp_map(axis / sine * arc_tangent(sine, cosine))
