"""The EXACT Jacobian of the converged step (`constraint` of Baksic et al. 2020), every mode frozen.

Implicit differentiation of the whole coupled system: the tissue with its exact tangent K, the needle and the laws with
all of theirs (see `constraint_tangent`). With the kept factor A of the tissue, its columns W = A^-1 B^T and an extra
load u on the tissue,

    dx = A^-1 u + W dF,      the needle's side answers with dF,      K dx - B^T dF = 0

is a small correction equation in u alone, A being near K: GMRES solves it for the six motions of the base at once. A
comes in single precision; its very answers go into the last equation, so that their rounding costs nothing.
With u = 0 and the geometric terms dropped it is the fast form.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.sparse import csr_matrix

from simcore.contact.channel import project
from simcore.errors import ModelFailureError, Status
from simcore.insertion.compliance import inertia, solve_factored
from simcore.insertion.constraint_tangent import ConstraintTangent, constraint_tangent, shaft_changes, shaft_points
from simcore.insertion.jacobian_fast import Linearisation, lateral_offset
from simcore.krylov import gmres
from simcore.linear_algebra.dense import add_product, factor_lu, solve_lu
from simcore.linear_algebra.products import dot, norm, product, times
from simcore.tissue.tangent import Dynamics, tangent_times

if TYPE_CHECKING:
    from simcore.arrays import Floats, Ints
    from simcore.contact.ball import Balls
    from simcore.insertion.model import CoupledModel
    from simcore.insertion.state import SolvedStep, TissueResponse
    from simcore.tissue.model import TissueModel

TOLERANCE = 1e-8  # of the tissue's residual, relative to the change of its load
MAX_ITERATIONS = 80


class CoupledResponse:
    """How tissue and needle of a solved step answer together: rows (dx, dF, ds) (k, unknowns + 4a), one a motion."""

    def __init__(
        self, model: CoupledModel, solved: SolvedStep, tissue: TissueResponse, tangent: ConstraintTangent
    ) -> None:
        self.model, self.solved, self.tissue, self.tangent = model, solved, tissue, tangent
        a = len(solved.active.elements)
        self.balls = ball_matrix(model.tissue, solved.active.balls, tangent.elements)
        self.loaded = self.balls[: 3 * a]
        self.columns = tissue.columns.astype(float)
        self.dynamics = Dynamics(inertia(model.tissue, model.dt_s), model.tissue.stiffness_damping_s, model.dt_s)
        matrix = tangent.matrix.copy()
        by_forces = np.zeros((4 * a, 3 * a))
        add_product(tangent.per_ball, self.balls @ self.columns.T, by_forces)
        matrix[:, : 3 * a] += by_forces
        self.factor, self.pivots = matrix, np.empty(len(matrix), np.int64)
        self.regular = factor_lu(self.factor, self.pivots)

    def respond(self, load: Floats, base: Floats) -> Floats:
        """(k, unknowns + 4a) under loads (k, unknowns) N on the tissue and moves (6, k) of the base."""
        dx = solve_factored(self.tissue.factor, load).astype(float)
        y = product(self.tangent.per_ball, self.balls @ dx.T) + product(self.tangent.per_base, base)
        solve_lu(self.factor, self.pivots, y)
        y = np.ascontiguousarray(-y.T)
        add_product(y[:, : len(self.columns)].copy(), self.columns, dx)
        return np.hstack([dx, y])

    def residual(self, response: Floats) -> Floats:
        """(k, unknowns) N: K dx - B^T dF, with the exact tangent K of the tissue."""
        t, solved = self.model.tissue, self.solved
        dx = np.ascontiguousarray(response[:, : t.unknowns])
        places = (solved.bodies.x, solved.start.x)
        held = tangent_times(dx, *places, t.tetrahedra, self.tissue.rotations, t.unknown, self.dynamics)
        return held - self.load(response)

    def load(self, response: Floats) -> Floats:
        """(k, unknowns) N: B^T dF."""
        start = self.model.tissue.unknowns
        return np.asarray((self.loaded.T @ response[:, start : start + len(self.columns)].T).T)


def ball_matrix(tissue: TissueModel, balls: Balls, elements: Ints) -> Any:
    """B (3p, unknowns), sparse: places of the elements' balls per displacement of the free nodes."""
    rows, columns, values = [], [], []
    for i, e in enumerate(elements):
        ranks = tissue.unknown[balls.nodes[e, : balls.touched[e]]]
        weights = balls.weights[e, : balls.touched[e]][ranks >= 0]
        for axis in range(3):
            columns.append(3 * ranks[ranks >= 0] + axis)
            rows.append(np.full(len(weights), 3 * i + axis))
            values.append(weights)
    shape = (3 * len(elements), tissue.unknowns)
    return csr_matrix((np.concatenate(values), (np.concatenate(rows), np.concatenate(columns))), shape)


def linearise_exactly(model: CoupledModel, solved: SolvedStep) -> Linearisation:
    """Differentiate a solved step. Raises ModelFailureError without convergence, ValueError for a step whose insertion
    does not keep the tissue."""
    moves = needle_response(model, solved, constraint_tangent(model, solved))
    return Linearisation(moves[-1, :3], *passing_response(model, solved, moves))


def needle_response(model: CoupledModel, solved: SolvedStep, tangent: ConstraintTangent) -> Floats:
    """(n, 6, 6): moves of the needle's free nodes per move of its base."""
    a, base, unknowns = len(solved.active.elements), np.eye(6), model.tissue.unknowns
    by_base: Floats = tangent.moves[:, :, 4 * a :]
    if a == 0:
        return by_base
    if solved.tissue is None:
        raise ValueError("the step was solved without keeping the tissue: Insertion(..., keeps_tissue=True)")
    coupled = CoupledResponse(model, solved, solved.tissue, tangent)
    first = coupled.respond(np.zeros((6, unknowns)), base)
    if not (coupled.regular and np.isfinite(first).all()):
        raise ModelFailureError(Status.NOT_FINITE, "the exact Jacobian has no finite response of the constraint forces")
    allowed = TOLERANCE * np.linalg.norm(coupled.load(first), axis=1)
    change, rest = gmres(
        coupled.residual,
        -coupled.residual(first),
        precondition=lambda load: coupled.respond(load, np.zeros((6, 6))),
        allowed=allowed,
        max_iterations=MAX_ITERATIONS,
    )
    if not (rest <= allowed).all():
        message = f"the exact Jacobian's residual is {rest.max():.3g} N per motion (allowed {allowed.max():.3g})"
        raise ModelFailureError(Status.NOT_CONVERGED, f"{message} after at most {MAX_ITERATIONS} iterations")
    y = (first + change)[:, unknowns:]
    per_y = tangent.moves[:, :, : 4 * a]
    return by_base + product(per_y.reshape(-1, 4 * a), y.T).reshape(by_base.shape)


def passing_response(model: CoupledModel, solved: SolvedStep, moves: Floats) -> tuple[Floats | None, Floats]:
    """Change (2, 6) of the shaft's lateral offsets at the entry, turn of its frame included, and the offsets (2,) m."""
    b, inserted_m, entry_m = solved.bodies, solved.at.inserted_m, model.entry_m
    offset, frame, _, _ = lateral_offset(model, b, inserted_m)
    if inserted_m == 0.0:
        return None, offset
    length = model.needle.element_length_m
    s = project(b.needle_x, b.needle_R, length, entry_m, model.needle.length_m - inserted_m)
    at = shaft_points(b, length, np.array([s]))
    shaft, turn = shaft_changes(at, moves, np.eye(6))
    apart, dc = entry_m - at.c[0], at.dc[0]
    ds = (times(turn[0].T, apart) - times(shaft[0].T, dc)) / (dot(dc, dc) - dot(apart, at.ddc[0]))
    dtau = (turn[0] + np.outer(at.ddc[0], ds)) / norm(dc)
    lead = int(abs(frame[2, 0]) >= 0.9)  # the axis that n1 leans towards: see frame_along
    spin = -frame[2, lead] / np.sqrt(1.0 - frame[2, lead] ** 2) * times(dtau.T, frame[1])
    return product(frame[:2], shaft[0]) + np.outer([offset[1], -offset[0]], spin), offset
