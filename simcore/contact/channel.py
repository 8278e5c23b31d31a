"""The channel that the needle has cut: constraint points in the tissue, each matched to a point of the shaft.

Element 0 is the channel end X_c (before puncture: the contact point on the surface); elements 1, 2, ... are the shaft
points in order of depth, the first at the puncture. Each is a material ball of tissue (see `spread`), with its rest
depth along the channel S, the arc length s on the needle where it was at the last converged step, and the force that
the needle exerts on it. After Duriez et al. 2009; the rules of creation and removal are in `cutting`.
"""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from enum import IntEnum
from typing import TYPE_CHECKING

import numpy as np

from simcore.compiled import kernel
from simcore.contact.ball import Ball, Balls, displaced, weights_of_ball
from simcore.needle.shaft import shaft_frame

if TYPE_CHECKING:
    from simcore.arrays import Flags, Floats, Ints
    from simcore.mesh.mesh import Mesh


class Phase(IntEnum):
    """Whether the surface has been punctured."""

    CONTACT = 0
    INSERTED = 1


@dataclass(frozen=True)
class ChannelModel:
    """Spacing, ball quadrature and mesh: what the channel needs and a run never changes.

    depths_m: (P - 1,) rest depths of the shaft's points: multiples of the spacing, and one the bevel's length deep,
    since the load falls steeply there: what was cut before the bevel was in bears more than all that was cut later.
    inward: (3,) unit normal of the surface at the entry, into the tissue; it stays the normal of the contact.
    hard: points are rows without compliance, which lock where they are close: they begin a spacing behind X_c.
    """

    spacing_m: float
    depths_m: Floats
    hard: bool
    ball: Ball
    rest_m: Floats
    inward: Floats

    @classmethod
    def of(
        cls,
        *,
        spacing_m: float,
        bevel_m: float,
        spread_m: float,
        longest_m: float,
        mesh: Mesh,
        entry_m: Floats,
        hard: bool,
    ) -> ChannelModel:
        """bevel_m: of the needle's tip. longest_m: a bound on the rest length of the channel; elements are allocated
        once."""
        ball, inward = Ball.of_radius(spread_m, mesh), mesh.inward_normal(entry_m)
        depths = np.array([i * spacing_m for i in range(int(longest_m / spacing_m) + 3)])
        if not hard and bevel_m < spacing_m:
            depths = np.insert(depths, 1, bevel_m)
        return cls(spacing_m, depths, hard, ball, mesh.nodes_m, inward)

    @property
    def capacity(self) -> int:
        """How many elements there can be: X_c and the points of the shaft."""
        return 1 + len(self.depths_m)

    @property
    def lag_m(self) -> float:
        """Rest length by which X_c is ahead of a point that begins to constrain."""
        return self.spacing_m if self.hard else 0.0


@dataclass
class Channel:
    """State of the channel. Arrays have room for `capacity` elements, of which the first `count` exist."""

    phase: Phase
    count: int
    rest_m: Floats  # (P, 3) material points
    depth_m: Floats  # (P,) rest depth S along the channel; element 0: its whole length
    arc_m: Floats  # (P,) needle arc length s at the last converged step
    force_n: Floats  # (P, 3) of the needle on the tissue, world
    force_change_n: Floats  # (P, 3) in the last step
    mode: Ints  # (P,) last position on the axial staircase (see `contact_laws`)
    created: Flags  # (P,) constrains since X_c was far enough ahead
    active: Flags  # (P,) constrains now: the needle reaches it
    nodes: Ints  # (P, K) ball weights
    weights: Floats  # (P, K)
    touched: Ints  # (P,)
    slot: Ints = field(repr=False)  # scratch of ball_weights

    @classmethod
    def at_surface(cls, model: ChannelModel, entry_m: Floats, needle_length_m: float) -> Channel:
        """Before puncture: one contact point where the tip touches."""
        p, k, n = model.capacity, model.ball.capacity, len(model.rest_m)
        channel = cls(
            phase=Phase.CONTACT,
            count=1,
            rest_m=np.zeros((p, 3)),
            depth_m=np.zeros(p),
            arc_m=np.zeros(p),
            force_n=np.zeros((p, 3)),
            force_change_n=np.zeros((p, 3)),
            mode=np.ones(p, np.int64),
            created=np.zeros(p, np.bool_),
            active=np.zeros(p, np.bool_),
            nodes=np.zeros((p, k), np.int64),
            weights=np.zeros((p, k)),
            touched=np.zeros(p, np.int64),
            slot=np.full(n, -1),
        )
        channel.created[0] = channel.active[0] = True
        channel.arc_m[0] = needle_length_m
        channel.place(model, 0, entry_m)
        return channel

    def copy(self) -> Channel:
        """An independent copy; the scratch array is shared, it is empty between calls."""
        values = {f.name: getattr(self, f.name) for f in fields(self)}
        copies = {k: v.copy() for k, v in values.items() if isinstance(v, np.ndarray) and k != "slot"}
        return Channel(**{**values, **copies})

    def place(self, model: ChannelModel, element: int, rest_m: Floats) -> None:
        """Put an element at a rest point and compute its weights."""
        self.rest_m[element] = rest_m
        self.touched[element] = weights_of_ball(
            self.rest_m[element], model.ball.rule, self.slot, self.nodes[element], self.weights[element]
        )

    @property
    def balls(self) -> Balls:
        """The balls of all elements, for kernels."""
        return Balls(self.rest_m, self.nodes, self.weights, self.touched)

    def position(self, model: ChannelModel, element: int, x: Floats) -> Floats:
        """(3,) m, world: where the element is in the deformed tissue x (n, 3)."""
        out = np.empty(3)
        displaced(
            self.rest_m[element],
            self.nodes[element],
            self.weights[element],
            self.touched[element],
            x,
            model.rest_m,
            out,
        )
        return out

    def active_elements(self) -> Ints:
        """Ints of the elements that constrain now."""
        return np.flatnonzero(self.active[: self.count])

    @property
    def length_m(self) -> float:
        """Rest length of the whole channel, entry to X_c."""
        return float(self.depth_m[0]) if self.phase is Phase.INSERTED else 0.0


@kernel
def project(x: Floats, R: Floats, element_length: float, point: Floats, guess: float) -> float:
    """Arc length s with (point - c(s)) . c'(s) = 0, by Newton's method from `guess`."""
    s = guess
    for _ in range(20):
        c, dc, ddc, _, _ = shaft_frame(x, R, element_length, s)
        value, slope = 0.0, 0.0
        for i in range(3):
            value += (point[i] - c[i]) * dc[i]
            slope += dc[i] * dc[i] - (point[i] - c[i]) * ddc[i]
        change = value / slope
        s += change
        if abs(change) < 1e-14:
            break
    return s


@kernel
def inserted_rest_length(depth: Floats, arc: Floats, count: int, needle_length: float) -> float:
    """Rest length of the channel that the needle occupies: where s = L, interpolated in the pairs (s, S).

    A tip ahead of X_c (it cuts in this very step) counts with its advance.
    """
    if arc[0] <= needle_length:
        return float(depth[0] + (needle_length - arc[0]))
    previous_depth, previous_arc = 0.0, arc[1]
    if previous_arc >= needle_length:
        return 0.0
    for k in range(2, count + 1):
        j = k if k < count else 0
        if arc[j] > needle_length:
            share = (needle_length - previous_arc) / (arc[j] - previous_arc)
            return float(previous_depth + share * (depth[j] - previous_depth))
        previous_depth, previous_arc = depth[j], arc[j]
    return float(depth[0])


@kernel
def tributary_lengths(depth: Floats, active: Flags, count: int, inserted: float, out: Floats) -> None:
    """Write out (P,) m: rest length of channel that each active element stands for; they add up to `inserted`.

    The cell of an element ends half-way to its active neighbours; the first begins at the entry, the last ends at the
    needle's tip.
    """
    out[:count] = 0.0
    previous = -1
    start = 0.0
    for k in range(1, count + 1):
        j = k if k < count else 0
        if not active[j]:
            continue
        if previous >= 0:
            end = min(0.5 * (depth[previous] + depth[j]), inserted)
            out[previous] = max(end - start, 0.0)
            start = max(end, start)
        previous = j
    if previous >= 0:
        out[previous] = max(inserted - start, 0.0)
