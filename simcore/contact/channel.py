"""The channel that the needle has cut: constraint points in the tissue, each matched to a point of the shaft.

Element 0 is the channel end X_c (before puncture: the contact point on the surface); elements 1, 2, ... are the shaft
points in order of depth, the first at the puncture. Each is a material ball of tissue (see `spread`), with its rest
depth along the channel S, the arc length s on the needle where it was at the last converged step, and the force that
the needle exerts on it. After Duriez et al. 2009, with the rules of creation and removal spelled out below.
"""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from enum import IntEnum

import numpy as np

from simcore.arrays import Flags, Floats, Ints
from simcore.compiled import kernel
from simcore.contact.ball import Ball, BallRule, Balls, displaced, fill_ball, weights_of_ball
from simcore.mesh.mesh import Mesh
from simcore.needle.shaft import shaft_frame

POINT_TOLERANCE_M = 1e-12  # a ball sits at its place to this; far below every constraint tolerance


class Phase(IntEnum):
    """Whether the surface has been punctured."""

    CONTACT = 0
    INSERTED = 1


@dataclass(frozen=True)
class ChannelModel:
    """Spacing, ball quadrature and mesh: what the channel needs and a run never changes.

    inward: (3,) unit normal of the surface at the entry, into the tissue; it stays the normal of the contact.
    """

    spacing_m: float
    ball: Ball
    rest_m: Floats
    inward: Floats
    capacity: int

    @classmethod
    def of(cls, *, spacing_m: float, spread_m: float, longest_m: float, mesh: Mesh, entry_m: Floats) -> ChannelModel:
        """longest_m: a bound on the rest length of the channel; elements are allocated once."""
        ball = Ball.of_radius(spread_m, mesh)
        inward = mesh.inward_normal(entry_m)
        return cls(spacing_m, ball, mesh.nodes_m, inward, int(longest_m / spacing_m) + 4)


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
    created: Flags  # (P,) constrains since X_c is far enough ahead
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


def advance_end(channel: Channel, model: ChannelModel, x: Floats, tip_m: Floats) -> None:
    """Cutting: move X_c to the material point where the tip is now, and note every multiple of the spacing it passes.

    Afterwards p(X_c) = tip exactly, so that the next step begins without a gap.
    """
    before, start = channel.rest_m[0].copy(), channel.length_m
    after = _material_point(channel, model, 0, x, tip_m).copy()
    channel.depth_m[0] = start + float(np.linalg.norm(after - before))
    while channel.count < model.capacity and channel.depth_m[0] >= (channel.count - 1) * model.spacing_m:
        depth = (channel.count - 1) * model.spacing_m
        share = (depth - start) / (channel.depth_m[0] - start)
        _append(channel, model, before + share * (after - before), depth)


def _append(channel: Channel, model: ChannelModel, rest_m: Floats, depth_m: float) -> None:
    element = channel.count
    channel.count += 1
    channel.place(model, element, rest_m)
    channel.depth_m[element] = depth_m
    channel.arc_m[element] = channel.arc_m[0]
    channel.force_n[element] = 0.0
    channel.mode[element] = 1
    channel.created[element] = channel.active[element] = False


def _material_point(channel: Channel, model: ChannelModel, element: int, x: Floats, target_m: Floats) -> Floats:
    """Move an element in rest space until its ball sits at `target_m` (3,) m, world; returns the rest point."""
    c = channel
    weights = (c.slot, c.nodes[element], c.weights[element])
    c.touched[element] = material_point(c.rest_m[element], target_m, x, model.rest_m, model.ball.rule, *weights)
    return np.asarray(c.rest_m[element])


@kernel
def material_point(
    rest: Floats,
    target: Floats,
    x: Floats,
    x_rest: Floats,
    rule: BallRule,
    slot: Ints,
    nodes: Ints,
    weights: Floats,
) -> int:
    """Solve p(X) = target for the rest point X, from and into `rest` (3,) m, by Broyden's method; returns the number
    of its weights, which are written with their nodes."""
    # p(X) - X varies slowly, so the inverse of dp/dX starts as the identity; its derivative would cost a ball for each
    # axis. Broyden's good update (1965), for the inverse B after a move dX that changed the place by dp, costs none:
    # B += (dX - B dp) (dX^T B) / (dX^T B dp). It is superlinear, and only p itself decides when it is solved.
    inverse = np.eye(3)
    move, miss, now, change, row = np.zeros(3), np.zeros(3), np.zeros(3), np.zeros(3), np.zeros(3)
    count = fill_ball(rest, rule, slot, nodes, weights)
    displaced(rest, nodes, weights, count, x, x_rest, miss)
    miss -= target
    for _ in range(50):
        if np.abs(miss).max() < POINT_TOLERANCE_M:
            break
        for i in range(3):
            move[i] = -(inverse[i, 0] * miss[0] + inverse[i, 1] * miss[1] + inverse[i, 2] * miss[2])
        for i in range(3):
            rest[i] += move[i]
        count = fill_ball(rest, rule, slot, nodes, weights)
        displaced(rest, nodes, weights, count, x, x_rest, now)
        now -= target
        along = 0.0
        for i in range(3):
            change[i], row[i] = 0.0, 0.0
            for j in range(3):
                change[i] += inverse[i, j] * (now[j] - miss[j])
                row[i] += move[j] * inverse[j, i]
            along += move[i] * change[i]
        for i in range(3):
            for j in range(3):
                inverse[i, j] += (move[i] - change[i]) * row[j] / along
            miss[i] = now[i]
    return count


def puncture(channel: Channel, model: ChannelModel) -> None:
    """Open the channel at the contact point: X_c and the entry are there, the tip at its end."""
    channel.phase = Phase.INSERTED
    channel.depth_m[0] = 0.0
    _append(channel, model, channel.rest_m[0].copy(), 0.0)
    channel.mode[0] = 1


def slide_contact(channel: Channel, model: ChannelModel, x: Floats, tip_m: Floats) -> None:
    """Before puncture: after tangential slip the contact point is the surface point beside the tip.

    It slides in the plane of the surface at the entry.
    """
    for _ in range(20):
        miss = channel.position(model, 0, x) - tip_m
        miss -= (miss @ model.inward) * model.inward
        if np.abs(miss).max() < 1e-12:
            break
        channel.place(model, 0, channel.rest_m[0] - miss)


def refresh_elements(
    channel: Channel,
    model: ChannelModel,
    x: Floats,
    needle_x: Floats,
    needle_R: Floats,
    element_length_m: float,
) -> float:
    """Create, drop and take up elements after a converged step; returns the largest lateral gap (m) taken up.

    Created: X_c is a spacing ahead of it. Dropped: the tip is half a spacing behind it (no chatter), at the entry as
    soon as the tip is outside. Taken up again: the tip reaches it; X_c a quarter of a spacing earlier, so that no tip
    passes it unnoticed. A new element is moved sideways onto the shaft, so that it begins without a force.
    """
    length = element_length_m * (len(needle_x) - 1)
    end_dropped = channel.arc_m[0] > length + 0.5 * model.spacing_m
    ahead = model.spacing_m * (0.5 if end_dropped else 1.0)
    largest = 0.0
    for j in _in_question(channel, length):
        if not channel.active[j]:
            place = channel.position(model, j, x)
            guess = min(channel.arc_m[j], length)
            channel.arc_m[j] = project(needle_x, needle_R, element_length_m, place, guess)
        behind = channel.arc_m[j] - length  # of the tip behind this element
        if channel.active[j] and behind > (0.0 if j == 1 else 0.5 * model.spacing_m):
            channel.active[j] = False
            channel.force_n[j] = 0.0
        elif not channel.created[j] and channel.depth_m[0] >= channel.depth_m[j] + ahead:
            channel.created[j] = channel.active[j] = behind <= 0.0
            _onto_shaft(channel, model, j, x, needle_x, needle_R, element_length_m)
        elif channel.created[j] and not channel.active[j] and behind <= (0.25 * model.spacing_m if j == 0 else 0.0):
            c, _, _, _, _ = shaft_frame(needle_x, needle_R, element_length_m, channel.arc_m[j])
            largest = max(largest, float(np.linalg.norm(c - channel.position(model, j, x))))
            channel.active[j] = True
            channel.mode[j] = 1
    return largest


def _in_question(channel: Channel, needle_length_m: float) -> Ints:
    """Elements that the tip may have reached or left: all others stay as they are."""
    n = channel.count
    return np.flatnonzero(~channel.active[:n] | (channel.arc_m[:n] > needle_length_m))


def _onto_shaft(
    channel: Channel,
    model: ChannelModel,
    element: int,
    x: Floats,
    needle_x: Floats,
    needle_R: Floats,
    element_length_m: float,
) -> None:
    place = channel.position(model, element, x)
    s = project(needle_x, needle_R, element_length_m, place, channel.arc_m[element])
    c, _, _, _, _ = shaft_frame(needle_x, needle_R, element_length_m, s)
    _material_point(channel, model, element, x, c)
    channel.arc_m[element] = s
