"""How the channel changes: puncture, cutting, creation and removal of constraint points (after Duriez et al. 2009).

A point is created where the tip cuts, and stays there. It constrains at once; a hard one as soon as X_c is a spacing
ahead. It is dropped, and taken up again, when the tip is half-way to the point before it, where the length that it
stands for is zero.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from simcore.compiled import kernel
from simcore.contact.ball import BallRule, displaced, fill_ball
from simcore.contact.channel import Channel, ChannelModel, Phase, project
from simcore.linear_algebra.entries import largest_size
from simcore.linear_algebra.products import dot, norm
from simcore.needle.shaft import shaft_frame

if TYPE_CHECKING:
    from simcore.arrays import Floats, Ints

POINT_TOLERANCE_M = 1e-12  # a ball sits at its place to this; far below every constraint tolerance


def advance_end(channel: Channel, model: ChannelModel, x: Floats, tip_m: Floats) -> None:
    """Cutting: move X_c to the material point where the tip is now, and note every point's depth that it passes.

    Afterwards p(X_c) = tip exactly, so that the next step begins without a gap.
    """
    before, start = channel.rest_m[0].copy(), channel.length_m
    after = _material_point(channel, model, 0, x, tip_m).copy()
    channel.depth_m[0] = start + norm(after - before)
    while channel.count < model.capacity and channel.depth_m[0] >= (depth := model.depths_m[channel.count - 1]):
        share = (depth - start) / (channel.depth_m[0] - start)
        _append(channel, model, before + share * (after - before), depth)


def _append(channel: Channel, model: ChannelModel, rest_m: Floats, depth_m: float) -> None:
    element = channel.count
    channel.count += 1
    channel.place(model, element, rest_m)
    channel.depth_m[element] = depth_m
    channel.arc_m[element] = channel.arc_m[0]
    channel.force_n[element] = 0.0
    channel.mode[element] = 1 if model.hard else 2  # the tip that cuts it slides past it
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
        if largest_size(miss) < POINT_TOLERANCE_M:
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
    channel.created[1] = channel.active[1] = not model.hard
    channel.mode[0] = 1


def slide_contact(channel: Channel, model: ChannelModel, x: Floats, tip_m: Floats) -> None:
    """Before puncture: after tangential slip the contact point is the surface point beside the tip.

    It slides in the plane of the surface at the entry.
    """
    for _ in range(20):
        miss = channel.position(model, 0, x) - tip_m
        miss -= dot(miss, model.inward) * model.inward
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

    Created: at once, or X_c is a spacing ahead of a hard one, which is moved sideways onto the shaft, so that it begins
    without a force. Dropped: the tip is half-way to the point before it, at the entry as soon as the tip is outside.
    Taken up again: there too, a hard one when the tip reaches it; X_c, dropped half a spacing behind, a quarter of a
    spacing earlier, so that no tip passes it unnoticed.
    """
    length = element_length_m * (len(needle_x) - 1)
    end_dropped = channel.arc_m[0] > length + 0.5 * model.spacing_m
    ahead = model.lag_m * (0.5 if end_dropped else 1.0)
    largest = 0.0
    for j in _in_question(channel, length):
        if not channel.active[j]:
            place = channel.position(model, j, x)
            guess = min(channel.arc_m[j], length)
            channel.arc_m[j] = project(needle_x, needle_R, element_length_m, place, guess)
        behind = channel.arc_m[j] - length  # of the tip behind this element
        if channel.active[j] and behind > _dropped_m(channel, model, j):
            channel.active[j] = False
            channel.force_n[j] = 0.0
        elif not channel.created[j] and channel.depth_m[0] >= channel.depth_m[j] + ahead:
            channel.created[j] = channel.active[j] = behind <= 0.0
            if model.hard:
                _onto_shaft(channel, model, j, x, needle_x, needle_R, element_length_m)
        elif channel.created[j] and not channel.active[j] and behind <= _taken_up_m(channel, model, j):
            c, _, _, _, _ = shaft_frame(needle_x, needle_R, element_length_m, channel.arc_m[j])
            largest = max(largest, norm(c - channel.position(model, j, x)))
            channel.active[j] = True
            channel.mode[j] = 1
    return largest


def _dropped_m(channel: Channel, model: ChannelModel, element: int) -> float:
    """How far the tip may be behind an element that constrains: half-way to the one before, where the length that it
    stands for ends."""
    if element == 0:
        return 0.5 * model.spacing_m
    return 0.5 * float(channel.depth_m[element] - channel.depth_m[element - 1]) if element > 1 else 0.0


def _taken_up_m(channel: Channel, model: ChannelModel, element: int) -> float:
    """How far the tip may be behind an element that constrains again."""
    if element == 0:
        return 0.25 * model.spacing_m
    return 0.0 if model.hard else _dropped_m(channel, model, element)


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
