"""One coupled step: tissue, needle and constraints in equilibrium at the new base pose, to a stated tolerance.

Find x, q, lambda with

    M (v+ - v) / dt + C v+ + f_tissue(x+) = H_t^T lambda,      f_needle(q+) = -H_n^T lambda,      and the contact laws.

Each iteration evaluates the TRUE residuals, then corrects with a kept tissue factor, the needle's exact tangent and the
exact solution of the condensed contact laws. Duriez et al. 2009 do one such linearised solve a step and stop:
`linearised_step`.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from simcore.contact.kernels import Motion
from simcore.errors import Status
from simcore.insertion import step_kernel
from simcore.insertion.compliance import NotPositiveDefiniteError
from simcore.insertion.iteration import begin
from simcore.insertion.state import (
    ActiveSet,
    Bodies,
    Goal,
    Guess,
    Iterate,
    SolvedStep,
    StepReport,
    TissueResponse,
    Workspace,
)
from simcore.insertion.step_kernel import Allowed, Arrays, Factored, Missing
from simcore.needle.beam import BeamForces
from simcore.needle.model import advance

if TYPE_CHECKING:
    from simcore.contact.channel import Channel
    from simcore.insertion.model import CoupledModel
    from simcore.insertion.residuals import Constants, Constraints, Unknowns

LEAST_DET_F = 0.1  # below it a tetrahedron counts as inverted
FIRST_TRY = 12  # iterations with the kept factor before it is renewed
STALE_TURN = 0.1  # entries of a rotation may change so much before a linearised step factors the tissue anew
NO_CONTACT_STATE = "no consistent contact state"


def solve_step(
    model: CoupledModel, workspace: Workspace, start: Bodies, channel: Channel, goal: Goal, guess: Guess | None = None
) -> SolvedStep:
    """The new equilibrium at `goal`; `start` and `channel`, with the elements and forces of before, stay as they are.

    The first try continues the last step's motion and its change of forces, or begins at `guess`, with the kept factor;
    where it fails, a second one begins at `start` with a new factor. A linearised model takes one linearised step,
    which always begins at `start`.
    """
    if model.linearised:
        return linearised_step(model, workspace, start, channel, goal)
    first = _extrapolated(model, start, channel) if guess is None else guess
    allowed = model.tolerances.max_iterations
    solved = _attempt(model, workspace, start, channel, first, goal, min(FIRST_TRY, allowed))
    report = solved.report
    if report.status in (Status.COMPLETED, Status.INVERTED) or report.iterations >= allowed:
        return solved
    try:
        _renew_factor(workspace, start)
    except NotPositiveDefiniteError as error:
        return replace(solved, report=replace(report, status=Status.NOT_POSITIVE_DEFINITE, message=str(error)))
    first = _as_before(start, channel)
    solved = _attempt(model, workspace, start, channel, first, goal, allowed - report.iterations)
    iterations = solved.report.iterations + report.iterations
    return replace(solved, report=replace(solved.report, iterations=iterations, refactored=1))


def linearised_step(
    model: CoupledModel, workspace: Workspace, start: Bodies, channel: Channel, goal: Goal
) -> SolvedStep:
    """One linearised solve from `start`, then the step is taken as it is (Duriez et al. 2009, and SOFA).

    Implicit: both bodies' displacements, the tissue's velocity (backward Euler), and the constraint forces, which
    obey their laws against the linear response. Explicit, as they are at the start of the step: the needle's tangent,
    frames of the constraints, places of the points on the shaft, lengths on which adhesion acts, and the tissue's
    stiffness, factored at rotations that differ from those of the start by less than STALE_TURN. What the step leaves
    is the report's residual, and the next step's load: it grows with the square of the base's turn, which stretches
    the needle. The Jacobian of such a step is that of its end, where the next one is linearised.
    The status is a failure only for an inverted or infinite state, or laws without a solution.
    """
    active, at = begin(model, workspace, channel, _as_before(start, channel), goal)
    step_kernel.evaluate(*problem_of(model, workspace, start, active, at))
    rotations, compliance = workspace.blocks.rotations(), workspace.compliance
    stale = compliance.turned_by(rotations) >= STALE_TURN
    try:
        if stale:
            compliance.refactor(rotations)
            compliance.sync(channel)
        settled = step_kernel.correct(*problem_of(model, workspace, start, active, at))
        failure = None if settled else (Status.NOT_CONVERGED, NO_CONTACT_STATE)
    except NotPositiveDefiniteError as error:
        failure = Status.NOT_POSITIVE_DEFINITE, str(error)
    left = step_kernel.evaluate(*problem_of(model, workspace, start, active, at))
    at.min_det_f, at.inserted_m = left.min_det_f, left.inserted_m
    if not np.isfinite(left[:3]).all():
        failure = Status.NOT_FINITE, "the linearised step is not finite"
    status, message = failure or _checked(at.min_det_f)
    report = StepReport(status, message, 1, left.force_n, left.violation_m, at.min_det_f, int(stale))
    return _solved(workspace, start, active, at, report)


def _as_before(start: Bodies, channel: Channel) -> Guess:
    """Bodies, forces and modes as the last step left them."""
    elements = channel.active_elements()
    return Guess(start.copy(), channel.force_n[elements], channel.mode[elements])


def _attempt(
    model: CoupledModel,
    workspace: Workspace,
    start: Bodies,
    channel: Channel,
    first: Guess,
    goal: Goal,
    allowed: int,
) -> SolvedStep:
    """Iterate from `first`, whose bodies are moved, until converged or `allowed` corrections were made."""
    active, at = begin(model, workspace, channel, first, goal)
    limits = Allowed(model.tolerances.force_n, model.tolerances.violation_m, allowed)
    ended, iteration, missing = step_kernel.iterate(*problem_of(model, workspace, start, active, at), limits)
    at.min_det_f, at.inserted_m = missing.min_det_f, missing.inserted_m
    status, message = _ending(model, ended, iteration, missing)
    report = StepReport(status, message, iteration, missing.force_n, missing.violation_m, at.min_det_f, 0)
    return _solved(workspace, start, active, at, report)


def problem_of(
    model: CoupledModel, workspace: Workspace, start: Bodies, active: ActiveSet, at: Iterate
) -> tuple[Constants, Constraints, Motion, Unknowns, Arrays]:
    """What the kernels of an iteration take."""
    motion = Motion(at.bodies.x, start.x, start.v, model.dt_s)
    compliance = workspace.compliance
    tissue = Factored(compliance.factor, compliance.columns, compliance.between_points)
    arrays = Arrays(workspace.arrays, workspace.blocks.arrays, tissue)
    return model.constants, active.constraints, motion, at.unknowns, arrays


def _ending(model: CoupledModel, ended: int, iteration: int, missing: Missing) -> tuple[Status, str]:
    """Status and message of an iteration that ended so after this many corrections."""
    if ended == step_kernel.CONVERGED:
        return _checked(missing.min_det_f)
    if ended == step_kernel.INFINITE:
        return Status.NOT_FINITE, f"iteration {iteration} is not finite"
    if ended == step_kernel.NO_CONTACT_STATE:
        return Status.NOT_CONVERGED, NO_CONTACT_STATE
    return Status.NOT_CONVERGED, _missing(model, missing, iteration)


def _extrapolated(model: CoupledModel, start: Bodies, channel: Channel) -> Guess:
    """As much further as in the last step."""
    bodies, elements = start.copy(), channel.active_elements()
    bodies.x += model.dt_s * bodies.v
    advance(bodies.needle_x, bodies.needle_R, bodies.needle_move)
    return Guess(bodies, channel.force_n[elements] + channel.force_change_n[elements], channel.mode[elements])


def _renew_factor(workspace: Workspace, start: Bodies) -> None:
    """Factor at the start of the step: an equilibrium, so that a failed step leaves nothing bad behind."""
    workspace.blocks.evaluate(start.x, workspace.held_n)
    workspace.compliance.refactor(workspace.blocks.rotations())


def _checked(min_det_f: float) -> tuple[Status, str]:
    if min_det_f > LEAST_DET_F:
        return Status.COMPLETED, ""
    return Status.INVERTED, f"min det F = {min_det_f:.3g}, must stay above {LEAST_DET_F}"


def _missing(model: CoupledModel, residuals: Missing, allowed: int) -> str:
    tolerances = model.tolerances
    return (
        f"residual {residuals.force_n:.3g} N (allowed {tolerances.force_n:g}), "
        f"violation {residuals.violation_m * 1e3:.3g} mm (allowed {tolerances.violation_m * 1e3:g}), "
        f"law {residuals.law_n:.3g} N after {allowed} iterations"
    )


def _solved(workspace: Workspace, start: Bodies, active: ActiveSet, at: Iterate, report: StepReport) -> SolvedStep:
    """The step at its last evaluation, free of the workspace: the next step writes there."""
    beams = BeamForces(*(array.copy() for array in workspace.beams))
    between = workspace.compliance.between_points.copy()
    return SolvedStep(active, start, at, beams, between, -workspace.needle_rest[0], report)


def tissue_response(workspace: Workspace, solved: SolvedStep) -> TissueResponse:
    """The tissue's side of the step that was solved last in this workspace, copied out of it."""
    compliance, elements = workspace.compliance, solved.active.elements
    columns = compliance.columns[elements].reshape(3 * len(elements), compliance.columns.shape[2])
    return TissueResponse(workspace.blocks.rotations(), compliance.factor, columns)
