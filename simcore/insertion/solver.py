"""One coupled step: tissue, needle and constraints in equilibrium at the new base pose, to a stated tolerance.

Find x, q, lambda with

    M (v+ - v) / dt + C v+ + f_tissue(x+) = H_t^T lambda,      f_needle(q+) = -H_n^T lambda,      and the contact laws.

Each iteration evaluates the TRUE residuals, then corrects with a kept tissue factor, the needle's exact tangent and the
exact solution of the condensed contact laws (Duriez et al. 2009 do one such linearised solve a step and stop).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from simcore.arrays import Floats, Ints, Singles
from simcore.contact.channel import Channel, Phase, inserted_rest_length, tributary_lengths
from simcore.contact.kernels import (
    constraint_geometry,
    local_compliance,
    move_nodes,
    moved_shaft,
    needle_residual,
    needle_right_sides,
    project_inactive,
    tissue_moves,
    tissue_residual,
    to_local,
    to_world,
)
from simcore.contact.laws import law_residual, solve_laws, staircases
from simcore.errors import Status
from simcore.insertion.compliance import Compliance, NotPositiveDefinite
from simcore.insertion.model import CoupledModel
from simcore.needle.beam import internal
from simcore.needle.model import advance, factor_blocks, solve_blocks
from simcore.rotations import log_map
from simcore.tissue.force_blocks import ForceBlocks
from simcore.tissue.model import rotated_stiffness_times

LEAST_DET_F = 0.1  # below it a tetrahedron counts as inverted
FIRST_TRY = 12  # iterations with the kept factor before it is renewed


@dataclass(frozen=True)
class StepReport:
    """How a step was solved."""

    status: Status
    message: str
    iterations: int
    residual_n: float
    violation_m: float
    min_det_f: float
    refactored: int


@dataclass
class Bodies:
    """Positions of both bodies: tissue x, v (n, 3); needle x (m, 3), R (m, 3, 3) and its last increments (m, 6)."""

    x: Floats
    v: Floats
    needle_x: Floats
    needle_R: Floats
    needle_move: Floats

    def copy(self) -> Bodies:
        """An independent copy."""
        return Bodies(self.x.copy(), self.v.copy(), self.needle_x.copy(), self.needle_R.copy(), self.needle_move.copy())


@dataclass
class Guess:
    """Where a try begins: bodies, which it moves; forces (a, 3) N, world, and modes (a,) of the active elements."""

    bodies: Bodies
    force_n: Floats
    mode: Ints

    def copy(self) -> Guess:
        """An independent copy."""
        return Guess(self.bodies.copy(), self.force_n.copy(), self.mode.copy())


class Coupled:
    """The coupled problem of one step, with its work arrays: residuals, geometry, condensed solve."""

    def __init__(self, model: CoupledModel) -> None:
        self.model = model
        self.tissue, self.needle, self.channel_model = tissue, needle, channel_model = (
            model.tissue,
            model.needle,
            model.channel,
        )
        self.law, self.tolerances, self.dt_s = model.law, model.tolerances, model.dt_s
        n, m = len(tissue.mesh.nodes_m), needle.elements
        self.blocks = ForceBlocks(tissue)
        self.compliance = Compliance(tissue, model.dt_s, channel_model.capacity)
        self.held, self.damping = np.zeros((n, 3)), np.zeros((n, 3))
        self.right = np.zeros(tissue.unknowns)
        self.needle_forces, self.needle_rest = np.zeros((m + 1, 6)), np.zeros((m + 1, 6))
        self.diag, self.upper = np.zeros((m + 1, 6, 6)), np.zeros((m, 6, 6))
        self.lower = np.zeros((m, 6, 6))
        self.tributary = np.zeros(channel_model.capacity)
        self.surface_frame = model.surface_frame

    # -- one step -----------------------------------------------------------------------------------------------------

    def solve(
        self,
        start: Bodies,
        channel: Channel,
        position: Floats,
        rotation: Floats,
        held_shift_m: Floats | None = None,
        guess: Guess | None = None,
    ) -> tuple[Bodies, StepReport]:
        """Move the base to (position (3,) m, rotation (3, 3)) and find the new equilibrium; `channel` gets its forces.

        `start` is not changed. The first try continues the last step's motion and its change of forces, or begins at
        `guess`, with the kept factor; where it fails, a second one begins at `start` with a new factor. The base's
        difference from the first iterate is handed to the first correction as a prescribed displacement.
        held_shift_m: (3,) m, world, displacement of the held nodes from the reference shape at the end of the step;
        None = they stay.
        """
        self.start, self.channel = start, channel
        goal = (position, rotation, held_shift_m)
        first = self._extrapolated() if guess is None else guess
        bodies, report = self._attempt(first, goal, min(FIRST_TRY, self.tolerances.max_iterations))
        if report.status in (Status.COMPLETED, Status.INVERTED) or report.iterations >= self.tolerances.max_iterations:
            return bodies, report
        try:
            self._renew_factor()
        except NotPositiveDefinite as error:
            return bodies, replace(report, status=Status.NOT_POSITIVE_DEFINITE, message=str(error))
        left = self.tolerances.max_iterations - report.iterations
        elements = channel.active_elements()
        again_from = Guess(start.copy(), channel.force_n[elements], channel.mode[elements])
        bodies, again = self._attempt(again_from, goal, left)
        return bodies, replace(again, iterations=again.iterations + report.iterations, refactored=1)

    def _renew_factor(self) -> None:
        """Factor at the start of the step: an equilibrium, so that a failed step leaves nothing bad behind."""
        self.blocks.evaluate(self.start.x, self.held)
        self.compliance.refactor(self.blocks.rotations())

    def _attempt(
        self, first: Guess, goal: tuple[Floats, Floats, Floats | None], allowed: int
    ) -> tuple[Bodies, StepReport]:
        """Iterate from `first`, whose bodies are moved, until converged or `allowed` corrections were made."""
        position, rotation, held_shift_m = goal
        self.bodies = bodies = first.bodies
        if held_shift_m is not None:
            self._move_held(bodies.x, held_shift_m)
        self.base_gap = np.concatenate([position - bodies.needle_x[0], log_map(rotation @ bodies.needle_R[0].T)])
        self._begin(self.channel, first)
        for iteration in range(allowed + 1):
            residual, violation, law = self._evaluate()
            report = StepReport(Status.COMPLETED, "", iteration, residual, violation, self.min_det_f, 0)
            if not np.isfinite([residual, violation, law, *self.base_gap]).all():
                return bodies, replace(report, status=Status.NOT_FINITE, message=f"iteration {iteration} is not finite")
            if self._converged(residual, violation, law):
                return bodies, self._checked(report)
            if iteration < allowed and not self._correct():
                return bodies, replace(report, status=Status.NOT_CONVERGED, message="no consistent contact state")
        message = (
            f"residual {residual:.3g} N (allowed {self.tolerances.force_n:g}), "
            f"violation {violation * 1e3:.3g} mm (allowed {self.tolerances.violation_m * 1e3:g}), "
            f"law {law:.3g} N after {allowed} iterations"
        )
        return bodies, replace(report, status=Status.NOT_CONVERGED, message=message)

    def _extrapolated(self) -> Guess:
        """As much further as in the last step."""
        bodies, channel, elements = self.start.copy(), self.channel, self.channel.active_elements()
        bodies.x += self.dt_s * bodies.v
        advance(bodies.needle_x, bodies.needle_R, bodies.needle_move)
        return Guess(bodies, channel.force_n[elements] + channel.force_change_n[elements], channel.mode[elements])

    def _move_held(self, x: Floats, shift_m: Floats) -> None:
        """Put the held nodes exactly where they are prescribed; in the first iterate all others go along with them."""
        held = self.tissue.unknown < 0
        places = self.channel_model.rest_m[held] + shift_m
        x += places[0] - x[held][0]
        x[held] = places

    def _converged(self, residual: float, violation: float, law: float) -> bool:
        return (
            not self.base_gap.any()
            and max(residual, law) <= self.tolerances.force_n
            and violation <= self.tolerances.violation_m
        )

    def _checked(self, report: StepReport) -> StepReport:
        if self.min_det_f > LEAST_DET_F:
            return report
        message = f"min det F = {self.min_det_f:.3g}, must stay above {LEAST_DET_F}"
        return replace(report, status=Status.INVERTED, message=message)

    # -- the parts of an iteration ------------------------------------------------------------------------------------

    def _begin(self, channel: Channel, first: Guess) -> None:
        """Fix the active elements and their staircases for this step."""
        self.contact = channel.phase is Phase.CONTACT
        self.elements = elements = channel.active_elements()
        a = len(elements)
        self.mode, self.force = first.mode.copy(), first.force_n
        self.steps, self.breaks = np.zeros(a, np.int64), np.zeros((a, 2))
        self.sign, self.extra = np.zeros((a, 3)), np.zeros((a, 3))
        staircases(
            self.contact,
            elements,
            channel.arc_m[elements],
            self.needle.length_m,
            self.law.cutting_n,
            self.law.puncture_n,
            self.mode,
            self.breaks,
            self.steps,
            self.sign,
            self.extra,
        )
        self.arc, self.speed = channel.arc_m[elements], np.ones(a)
        self.all_arcs = channel.arc_m.copy()
        self.frames, self.gap = np.zeros((a, 3, 3)), np.zeros((a, 3))
        self.beams, self.columns, self.points = np.zeros(a, np.int64), np.zeros((a, 3, 12)), np.zeros((a, 3))
        self.slide = np.zeros(2)
        self.compliance.sync(channel)

    def _balls(self) -> tuple[Ints, Floats, Ints]:
        return self.channel.nodes, self.channel.weights, self.channel.touched

    def _evaluate(self) -> tuple[float, float, float]:
        """True residuals at the present iterate: force N, violation m, contact law N."""
        t, b = self.tissue, self.bodies
        self.min_det_f = self.blocks.evaluate(b.x, self.held)
        if t.stiffness_damping_s > 0.0:
            material = (t.mesh.tets, t.gradients, t.volumes_m3, t.mu_pa, t.lambda_pa)
            rotated_stiffness_times((b.x - self.start.x) / self.dt_s, *material, self.blocks.rotations(), self.damping)
        internal(
            b.needle_x,
            b.needle_R,
            *self.needle.constants,
            self.needle_forces,
            self.diag,
            self.upper,
            self.lower,
        )
        self._geometry()
        residual = tissue_residual(
            self.held,
            b.x,
            self.start.x,
            self.start.v,
            t.masses_kg,
            self.damping,
            self.dt_s,
            t.mass_damping_per_s,
            t.stiffness_damping_s,
            self.elements,
            *self._balls(),
            self.force,
            t.unknown,
            self.right,
        )
        needle_residual(self.needle_forces, b.needle_R, self.beams, self.columns, self.force, self.needle_rest)
        free = np.abs(self.needle_rest[1:])
        residual = max(residual, free[:, :3].max(), free[:, 3:].max() / self.needle.element_length_m)
        return residual, self._violation(), self._law_residual()

    def _geometry(self) -> None:
        b, c, rest = self.bodies, self.channel, self.channel_model.rest_m
        length = self.needle.element_length_m
        place = (self.channel.rest_m, *self._balls(), b.x, rest, b.needle_x, b.needle_R)
        constraint_geometry(
            self.contact,
            self.surface_frame,
            self.elements,
            *place,
            length,
            self.mode,
            self.breaks,
            self.arc,
            self.speed,
            self.frames,
            self.gap,
            self.beams,
            self.columns,
            self.points,
        )
        if self.contact:
            self.base_friction = np.zeros(len(self.elements))
            return
        self.all_arcs[self.elements] = self.arc
        project_inactive(c.count, c.active, *place, length, self.all_arcs)
        self.inserted_m = inserted_rest_length(c.depth_m, self.all_arcs, c.count, self.needle.length_m)
        tributary_lengths(c.depth_m, c.active, c.count, self.inserted_m, self.tributary)
        self.base_friction = self.law.adhesion_n_per_m * self.tributary[self.elements]

    def _violation(self) -> float:
        if not len(self.elements):
            return 0.0
        gap = self.gap[:, 2:] if self.contact and self.slide.any() else self.gap
        return float(np.abs(gap).max())

    def _law_residual(self) -> float:
        """Largest distance of an axial force from its level (sliding elements), N."""
        local = to_local(self.frames, self.force)
        friction = 0.0 if self.contact else self.law.friction
        return law_residual(local, self.mode, self.sign, self.extra, self.base_friction, friction)

    def linear_response(self) -> tuple[Floats, Floats]:
        """(3a, 3a) m/N compliance in local frames, and the needle's nodal moves (n, 6, 3a) per world force on it."""
        a, m = len(self.elements), self.needle.elements
        self.needle_factor = factor_blocks(self.diag[1:], self.upper[1:], self.lower[1:])
        moves = np.empty((m, 6, 3 * a))
        needle_right_sides(self.beams, self.columns, moves)
        solve_blocks(*self.needle_factor, self.upper[1:], moves)
        shaft, w = np.empty((a, 3, 3 * a)), np.empty((3 * a, 3 * a))
        moved_shaft(self.beams, self.columns, np.zeros((6, 3 * a)), moves, shaft)
        local_compliance(self.elements, self.compliance.between_points, shaft, self.frames, w)
        return w, moves

    def _correct(self) -> bool:
        """One correction of tissue, needle and forces; False if the contact laws found no consistent state."""
        a, m, b = len(self.elements), self.needle.elements, self.bodies
        w, per_force = self.linear_response()
        tissue_step = self.compliance.solve(self.right)
        needle_step = self.needle_rest[1:, :, None].copy()
        needle_step[0, :, 0] -= self.lower[0] @ self.base_gap
        solve_blocks(*self.needle_factor, self.upper[1:], needle_step)
        tissue_part, shaft_part = np.empty((a, 3)), np.empty((a, 3, 1))
        tissue_moves(self.elements, *self._balls(), self.tissue.unknown, tissue_step, tissue_part)
        moved_shaft(self.beams, self.columns, self.base_gap[:, None], needle_step, shaft_part)
        gap = self.gap + to_local(self.frames, tissue_part - shaft_part[:, :, 0])
        force, new_force, new_arc = to_local(self.frames, self.force), np.empty((a, 3)), np.empty(a)
        try:
            settled = a == 0 or self._laws(w, gap, force, new_force, new_arc)
        except np.linalg.LinAlgError:
            settled = False
        if not settled:
            return False
        change = to_world(self.frames, new_force - force)
        self.force = self.force + change
        self.arc = new_arc
        moves = np.zeros((m + 1, 6))
        moves[0] = self.base_gap
        moves[1:] = needle_step[:, :, 0] - per_force @ change.ravel()
        advance(b.needle_x, b.needle_R, moves)
        self.base_gap = np.zeros(6)
        self._move_tissue(tissue_step, change)
        return True

    def _laws(self, w: Floats, gap: Floats, force: Floats, new_force: Floats, new_arc: Floats) -> bool:
        return solve_laws(
            w,
            gap,
            self.arc,
            self.speed,
            force,
            self.mode,
            self.steps,
            self.breaks,
            self.sign,
            self.extra,
            self.base_friction,
            self.law.friction,
            self.contact,
            self.slide,
            new_force,
            new_arc,
        )

    def _move_tissue(self, step: Singles, change: Floats) -> None:
        full = np.zeros((self.channel.count, 3), np.float32)
        columns = self.compliance.columns[: self.channel.count].reshape(3 * self.channel.count, -1)
        with np.errstate(over="ignore", invalid="ignore"):  # a diverging step is named when it is evaluated
            full[self.elements] = change
            step += full.ravel() @ columns
        move_nodes(self.tissue.unknown, step, self.bodies.x)

    def base_wrench(self) -> Floats:
        """(6,) N, N m of the robot on the needle's base, at the last evaluated state."""
        return np.asarray(-self.needle_rest[0])
