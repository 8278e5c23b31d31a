"""What changes: the bodies, the iterate of a step, and the step as it was solved."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from simcore.contact.laws import Law, Staircase
from simcore.insertion.compliance import Compliance
from simcore.insertion.residuals import ResidualArrays
from simcore.needle.beam import BeamForces
from simcore.tissue.force_blocks import LANES, ROWS, ForceBlocks

if TYPE_CHECKING:
    from simcore.arrays import Flags, Floats, Ints, Singles
    from simcore.contact.ball import Balls
    from simcore.contact.channel import Channel
    from simcore.contact.kernels import ConstraintPoints
    from simcore.errors import Status
    from simcore.insertion.model import CoupledModel
    from simcore.insertion.residuals import Constraints, Unknowns


@dataclass(frozen=True)
class Pose:
    """Of the needle's base: position (3,) m and rotation (3, 3), world; identity = needle along +z."""

    position_m: Floats
    rotation: Floats


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


class Goal(NamedTuple):
    """Where a step must end: the base's pose, and the held nodes' way from the reference shape, (3,) m, world."""

    base: Pose
    held_shift_m: Floats | None = None  # None = they stay


@dataclass(frozen=True)
class Kept:
    """What of a workspace outlives a step, at one moment. Nothing in it is written again.

    warm: (blocks, 9, lanes) rotations from which the next ones are iterated. factor, rotations (t, 9): the tissue's
    factor and where it was made. columns (k, 3, unknowns), column_rest_m (P, 3), between_points (3P, 3P): with it.
    """

    warm: Floats
    factor: Singles
    rotations: Floats
    columns: Singles
    column_rest_m: Floats
    between_points: Floats


class Workspace:
    """Arrays that solving writes. Two of them outlive a step: the tissue's factor with its columns, and the rotations
    from which the next ones are iterated; results depend on both within the tolerances only."""

    def __init__(self, model: CoupledModel) -> None:
        nodes, tissue = len(model.tissue.mesh.nodes_m), model.tissue
        self.blocks = ForceBlocks(tissue)
        self.compliance = Compliance(tissue, model.dt_s, model.channel.capacity)
        self.held_n, self.damping_n = np.zeros((nodes, 3)), np.zeros((nodes, 3))
        self.right = np.zeros(tissue.unknowns)
        self.beams = BeamForces.of_size(model.needle.elements)
        self.needle_rest = np.zeros((model.needle.elements + 1, 6))
        tributary_m = np.zeros(model.channel.capacity)
        self.arrays = ResidualArrays(self.held_n, self.damping_n, self.right, self.needle_rest, tributary_m, self.beams)

    def kept(self) -> Kept:
        """What outlives a step: with it, the steps that follow are the same to the bit."""
        compliance = self.compliance
        used = np.flatnonzero(compliance.columns.any(axis=(1, 2)))
        return Kept(
            warm=self._warm().copy(),
            factor=compliance.factor,  # with its rotations replaced by a new one, never written
            rotations=compliance.rotations,
            columns=compliance.columns[: int(used[-1]) + 1 if used.size else 0].copy(),
            column_rest_m=compliance.column_rest_m.copy(),
            between_points=compliance.between_points.copy(),
        )

    def restore(self, kept: Kept) -> None:
        """Go back to a moment of this or another workspace of the same model."""
        compliance, count = self.compliance, len(kept.columns)
        self._warm()[:] = kept.warm
        compliance.factor, compliance.rotations = kept.factor, kept.rotations
        compliance.columns[:count], compliance.columns[count:] = kept.columns, 0.0
        compliance.column_rest_m[:] = kept.column_rest_m
        compliance.between_points[:] = kept.between_points

    def _warm(self) -> Floats:
        """(blocks, 9, lanes) a view of the rotations of all blocks."""
        warm: Floats = self.blocks.state.reshape(self.blocks.blocks, ROWS, LANES)[:, 9:18]
        return warm


@dataclass(frozen=True)
class ActiveSet:
    """What constrains in a step: the channel as it was before it, its active elements (a,), their staircases and
    whether they are free sideways (a,).

    constraints: the same, for kernels."""

    channel: Channel
    contact: bool  # the surface has not been punctured: its one element is the contact
    elements: Ints
    balls: Balls
    stair: Staircase
    free: Flags
    constraints: Constraints


@dataclass
class Iterate:
    """Where the iteration is. By active element: forces (a, 3) N of the needle on the tissue, world, modes (a,), the
    geometry of the constraints, adhesion (a,) N. slide (2,): direction of the lateral slip of a surface contact.
    unknowns: the same arrays, for kernels, where they are changed in place."""

    bodies: Bodies
    base_gap: Floats  # (6,) m, rad: of the base to its goal, closed by the first correction
    force_n: Floats
    mode: Ints
    points: ConstraintPoints
    all_arcs_m: Floats  # (P,) of every element of the channel, active or not
    slide: Floats
    adhesion_n: Floats
    unknowns: Unknowns
    inserted_m: float = 0.0  # rest length of channel that the needle occupies
    min_det_f: float = 1.0

    def law(self, model: CoupledModel, active: ActiveSet) -> Law:
        """The laws of the active elements, for kernels."""
        return Law(active.stair, self.adhesion_n, model.law.friction, active.contact, active.free)


@dataclass(frozen=True)
class TissueResponse:
    """The tissue's side of a solved step: polar rotations (t, 9) of its elements; its factor and, computed with it, the
    columns (3a, unknowns) of the active elements, which belong to an EARLIER configuration: see `compliance`."""

    rotations: Floats
    factor: Singles
    columns: Singles


@dataclass(frozen=True)
class SolvedStep:
    """A step as it was solved, and all that a linearisation of it needs: nothing in it is written again.

    beams: of the needle at the end. between_m_per_n: (3P, 3P) compliance of the tissue between the elements.
    base_wrench: (6,) N, N m of the robot on the base. tissue: for the exact Jacobian, where it was asked for.
    """

    active: ActiveSet
    start: Bodies
    at: Iterate
    beams: BeamForces
    between_m_per_n: Floats
    base_wrench: Floats
    report: StepReport
    tissue: TissueResponse | None = None

    @property
    def bodies(self) -> Bodies:
        """At the end of the step."""
        return self.at.bodies
