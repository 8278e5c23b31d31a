"""The part of the exact linearisation that belongs to the coupling along the needle's line (see `contact.line`).

A shaft point obeys g + L F = 0 with L = P G P / l, P = I - tau tau^T, g = p - c(s) and F the force on the tissue,
world; it is in contact at s + C F_tau / |c'| with C = tau G tau / l. All of it changes with dF, ds, with the shaft's
turn and with the length l that it is coupled over. A free tip keeps P F = 0 in place of its lateral gap.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from simcore.linear_algebra.products import dot, norm, product, times

if TYPE_CHECKING:
    from simcore.arrays import Floats
    from simcore.insertion.model import CoupledModel
    from simcore.insertion.state import SolvedStep

LATERAL_M_PER_N = 0.01  # makes rows of force as large as rows of gap: only their scale


class Turning(NamedTuple):
    """Of the active elements (a,): c' (a, 3) and its change (a, 3, k) by all unknowns."""

    dc: Floats
    change: Floats

    def axis(self, i: int) -> tuple[Floats, Floats, float]:
        """Tau (3,), its change (3, k) and |c'| of element i."""
        size = norm(self.dc[i])
        tau = self.dc[i] / size
        return tau, (self.change[i] - np.outer(tau, times(self.change[i].T, tau))) / size, size


class Lengths(NamedTuple):
    """Lengths (a,) m of the active elements, and their changes (a, k) by all unknowns and (a, 3p) by the balls."""

    length_m: Floats
    change: Floats
    by_ball: Floats


def projected_arcs(solved: SolvedStep) -> Floats:
    """(P,) m: where the elements' balls project onto the shaft; they are in contact farther along by the creep."""
    at, arcs = solved.at, solved.at.all_arcs_m.copy()
    along = np.einsum("ib,ib->i", at.points.frames[:, 2], at.force_n)
    arcs[solved.active.elements] -= at.points.compliance[:, 2, 2] * along / at.points.speed
    return arcs


def add_line_rows(
    model: CoupledModel, solved: SolvedStep, turning: Turning, coupled: Lengths, rows: Floats, per_ball: Floats
) -> None:
    """Add to the rows (4a, k) of `constraint_tangent`, gaps first, and to those by the balls (4a, 3p)."""
    for i, element in enumerate(solved.active.elements):
        if element != 0:
            _add_gap(model, solved, i, turning, coupled, rows, per_ball)
            if solved.at.mode[i] % 2 == 1:
                _add_creep(model, solved, i, turning, coupled, rows, per_ball)
        elif solved.active.free[i]:
            _free(solved, i, turning, rows, per_ball)


def _add_gap(
    model: CoupledModel,
    solved: SolvedStep,
    i: int,
    turning: Turning,
    coupled: Lengths,
    rows: Floats,
    per_ball: Floats,
) -> None:
    """d(L F) = L dF + (dP G P + P G dP) F / l - L F dl / l,  dP v = -dtau (tau . v) - tau (dtau . v)."""
    (tau, dtau, _), line, force = turning.axis(i), model.line.compliance_m2_per_n, solved.at.force_n[i]
    length = coupled.length_m[i]
    across = np.eye(3) - np.outer(tau, tau)
    pressed = times(line, times(across, force))
    compliance = product(product(across, line), across) / length
    own = rows[3 * i : 3 * i + 3]
    own += (-dtau * dot(tau, pressed) - np.outer(tau, times(dtau.T, pressed))) / length
    turned = -dtau * dot(tau, force) - np.outer(tau, times(dtau.T, force))
    own += product(product(across, line), turned) / length
    own[:, 3 * i : 3 * i + 3] += compliance
    own -= np.outer(times(compliance, force), coupled.change[i] / length)
    per_ball[3 * i : 3 * i + 3] -= np.outer(times(compliance, force), coupled.by_ball[i] / length)


def _add_creep(
    model: CoupledModel,
    solved: SolvedStep,
    i: int,
    turning: Turning,
    coupled: Lengths,
    rows: Floats,
    per_ball: Floats,
) -> None:
    """d(s + C F_tau / |c'|) = 0 where it sticks; the row has ds already."""
    (tau, dtau, size), line, force = turning.axis(i), model.line.compliance_m2_per_n, solved.at.force_n[i]
    length, row = coupled.length_m[i], 3 * len(solved.active.elements) + i
    along_line, along = times(line, tau), dot(tau, force)
    compliance = dot(tau, along_line) / length
    rows[row] += times(dtau.T, 2.0 * along / length * along_line + compliance * force) / size
    rows[row] -= compliance * along / size**2 * times(turning.change[i].T, tau)
    rows[row, 3 * i : 3 * i + 3] += compliance / size * tau
    rows[row] -= compliance * along / (size * length) * coupled.change[i]
    per_ball[row] -= compliance * along / (size * length) * coupled.by_ball[i]


def _free(solved: SolvedStep, i: int, turning: Turning, rows: Floats, per_ball: Floats) -> None:
    """Along the shaft d(tau . g) = 0, across it d(P F) = P dF - dtau F_tau - tau (...) = 0."""
    tau, dtau, _ = turning.axis(i)
    own, by_ball = rows[3 * i : 3 * i + 3].copy(), per_ball[3 * i : 3 * i + 3].copy()
    lateral = -dtau * dot(tau, solved.at.force_n[i])
    lateral[:, 3 * i : 3 * i + 3] += np.eye(3) - np.outer(tau, tau)
    gap = times(solved.at.points.frames[i].T, solved.at.points.gap[i])
    along = times(own.T, tau) + times(dtau.T, gap)
    rows[3 * i : 3 * i + 3] = np.outer(tau, along) + LATERAL_M_PER_N * lateral
    per_ball[3 * i : 3 * i + 3] = np.outer(tau, times(by_ball.T, tau))
