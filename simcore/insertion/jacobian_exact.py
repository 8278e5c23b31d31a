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

from typing import Any

import numpy as np
from scipy.linalg import lu_factor, lu_solve
from scipy.sparse import csr_matrix

from simcore.arrays import Floats, Ints
from simcore.contact.channel import project
from simcore.errors import ModelFailure, Status
from simcore.insertion.constraint_tangent import ConstraintTangent, constraint_tangent, shaft_changes, shaft_points
from simcore.insertion.insertion import Insertion, InsertionState
from simcore.insertion.jacobian_fast import Linearisation, lateral_offset
from simcore.insertion.solver import Coupled
from simcore.krylov import gmres
from simcore.tissue.tangent import tangent_times

TOLERANCE = 1e-8  # of the tissue's residual, relative to the change of its load
MAX_ITERATIONS = 80


class TissueResponse:
    """How the tissue of a solved step answers: rows (dx, dF, ds) (k, unknowns + 4a), one for each motion."""

    def __init__(self, c: Coupled, tangent: ConstraintTangent) -> None:
        self.c, self.tangent = c, tangent
        a = len(c.elements)
        self.balls = ball_matrix(c, tangent.elements)
        self.loaded = self.balls[: 3 * a]
        self.columns = c.compliance.columns[c.elements].reshape(3 * a, -1).astype(float)
        matrix = tangent.matrix.copy()
        matrix[:, : 3 * a] += tangent.per_ball @ (self.balls @ self.columns.T)
        self.factor = lu_factor(matrix)

    def respond(self, load: Floats, base: Floats) -> Floats:
        """(k, unknowns + 4a) under loads (k, unknowns) N on the tissue and moves (6, k) of the base."""
        dx = self.c.compliance.solve(load.T).astype(float)
        right = self.tangent.per_ball @ (self.balls @ dx) + self.tangent.per_base @ base
        y = -lu_solve(self.factor, right).T
        return np.hstack([dx.T + y[:, : len(self.columns)] @ self.columns, y])

    def residual(self, response: Floats) -> Floats:
        """(k, unknowns) N: K dx - B^T dF, with the exact tangent K of the tissue."""
        c, t = self.c, self.c.tissue
        dx, rotations = np.ascontiguousarray(response[:, : t.unknowns]), c.blocks.rotations()
        held = tangent_times(
            dx, c.bodies.x, c.start.x, t.mesh.tets, t.gradients, t.volumes_m3, t.mu_pa, t.lambda_pa, rotations,
            t.unknown, c.compliance.diagonal, t.stiffness_damping_s, c.dt_s,
        )  # fmt: skip
        return held - self.load(response)

    def load(self, response: Floats) -> Floats:
        """(k, unknowns) N: B^T dF."""
        start = self.c.tissue.unknowns
        return np.asarray((self.loaded.T @ response[:, start : start + len(self.columns)].T).T)


def ball_matrix(c: Coupled, elements: Ints) -> Any:
    """B (3p, unknowns), sparse: places of material balls per displacement of the free nodes."""
    channel, unknown = c.channel, c.tissue.unknown
    rows, columns, values = [], [], []
    for i, e in enumerate(elements):
        ranks = unknown[channel.nodes[e, : channel.touched[e]]]
        weights = channel.weights[e, : channel.touched[e]][ranks >= 0]
        for axis in range(3):
            columns.append(3 * ranks[ranks >= 0] + axis)
            rows.append(np.full(len(weights), 3 * i + axis))
            values.append(weights)
    shape = (3 * len(elements), c.tissue.unknowns)
    return csr_matrix((np.concatenate(values), (np.concatenate(rows), np.concatenate(columns))), shape)


def linearise_exactly(insertion: Insertion, state: InsertionState) -> Linearisation:
    """Differentiate the step that led to `state`, the one solved last. Raises ModelFailure without convergence."""
    c = insertion.solved(state)
    tangent = constraint_tangent(c)
    moves = needle_response(c, tangent)
    return Linearisation(moves[-1, :3], *passing_response(insertion, state, moves))


def needle_response(c: Coupled, tangent: ConstraintTangent) -> Floats:
    """(n, 6, 6): moves of the needle's free nodes per move of its base."""
    a, base = len(c.elements), np.eye(6)
    by_base: Floats = tangent.moves[:, :, 4 * a :]
    if a == 0:
        return by_base
    tissue = TissueResponse(c, tangent)
    first = tissue.respond(np.zeros((6, c.tissue.unknowns)), base)
    if not np.isfinite(first).all():
        raise ModelFailure(Status.NOT_FINITE, "the exact Jacobian has no finite response of the constraint forces")
    allowed = TOLERANCE * np.linalg.norm(tissue.load(first), axis=1)
    change, rest = gmres(
        tissue.residual,
        -tissue.residual(first),
        precondition=lambda load: tissue.respond(load, np.zeros((6, 6))),
        allowed=allowed,
        max_iterations=MAX_ITERATIONS,
    )
    if not (rest <= allowed).all():
        message = f"the exact Jacobian's residual is {rest.max():.3g} N per motion (allowed {allowed.max():.3g})"
        raise ModelFailure(Status.NOT_CONVERGED, f"{message} after at most {MAX_ITERATIONS} iterations")
    y = (first + change)[:, c.tissue.unknowns :]
    return by_base + tangent.moves[:, :, : 4 * a] @ y.T


def passing_response(insertion: Insertion, state: InsertionState, moves: Floats) -> tuple[Floats | None, Floats]:
    """Change (2, 6) of the shaft's lateral offsets at the entry, turn of its frame included, and the offsets (2,) m."""
    offset, frame, _, _ = lateral_offset(insertion, state, insertion.entry_m)
    if state.inserted_m == 0.0:
        return None, offset
    b, length = state.bodies, insertion.needle.element_length_m
    s = project(b.needle_x, b.needle_R, length, insertion.entry_m, insertion.needle.length_m - state.inserted_m)
    at = shaft_points(b, length, np.array([s]))
    shaft, turn = shaft_changes(at, moves, np.eye(6))
    apart, dc = insertion.entry_m - at.c[0], at.dc[0]
    ds = (apart @ turn[0] - dc @ shaft[0]) / (dc @ dc - apart @ at.ddc[0])
    dtau = (turn[0] + np.outer(at.ddc[0], ds)) / np.linalg.norm(dc)
    lead = int(abs(frame[2, 0]) >= 0.9)  # the axis that n1 leans towards: see frame_along
    spin = -frame[2, lead] / np.sqrt(1.0 - frame[2, lead] ** 2) * (frame[1] @ dtau)
    return frame[:2] @ shaft[0] + np.outer([offset[1], -offset[0]], spin), offset
