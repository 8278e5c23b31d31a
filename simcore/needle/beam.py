"""Two-node co-rotational Timoshenko beams: internal forces and their exact tangent.

After J.-M. Battini and C. Pacoste, "Co-rotational beam elements with warping effects in instability
problems", Comput. Methods Appl. Mech. Engrg. 191 (2002) 1755-1789, without warping, and with their axes
(1, 2, 3) renamed (3, 1, 2): the beam axis is the THIRD column of a nodal rotation. Spins are spatial,
R <- exp(dw) R; a node's six degrees of freedom are translation, then spin, both in world axes.

Inside one element nothing depends on the absolute position, so it works on nine increments, d = dx2 - dx1,
dw1 and dw2, and on nine forces, n (on node 2, -n on node 1), M1 and M2. Triples are components in the element
frame.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from simcore.compiled import kernel
from simcore.rotations import compose, jacobian_coefficients, log_map

if TYPE_CHECKING:
    from simcore.arrays import Floats

Triple = tuple[float, float, float]


class Stiffness(NamedTuple):
    """Of one beam in its own frame: moments m1 = near theta1 + far theta2, m2 = far theta1 + near theta2."""

    axial: float  # EA / l, N/m
    near: float  # (4 + phi) EI / (l (1 + phi)), N m
    far: float  # (2 - phi) EI / (l (1 + phi)), N m
    torsion: float  # GJ / l, N m


class Section(NamedTuple):
    """What kernels know of a needle: its beams and, if it is curved at rest, the frames (n, 2, 3, 3) of its beams."""

    element_length_m: float
    axial_n: float  # EA
    bending_nm2: float  # EI
    torsion_nm2: float  # GJ
    shear_parameter: float  # phi
    rest_frames: Floats


class BeamForces(NamedTuple):
    """Internal forces (n+1, 6) N, N m and their tangent d f / d(dx, dw) by pairs of nodes: diag (n+1, 6, 6) of a node
    with itself, upper (n, 6, 6) rows of node i and columns of node i+1, lower (n, 6, 6) the other way round."""

    forces: Floats
    diag: Floats
    upper: Floats
    lower: Floats

    @classmethod
    def of_size(cls, elements: int) -> BeamForces:
        """Zeros, for a chain of so many beams."""
        n = elements
        return cls(np.zeros((n + 1, 6)), np.zeros((n + 1, 6, 6)), np.zeros((n, 6, 6)), np.zeros((n, 6, 6)))


class End(NamedTuple):
    """One end of a beam, as seen from the element frame."""

    theta: Triple  # rotation vector of the node, rad
    eta: float  # coefficients of the inverse left Jacobian at theta
    mu: float
    axis: Triple  # the node's first axis, "p_i" of the paper with the axes renamed


class Element(NamedTuple):
    """Deformed state of one beam."""

    length: float  # m
    tension: float  # N
    end1: End
    end2: End
    m1: Triple  # moments that work on the increments of theta, N m
    m2: Triple
    s1: Triple  # the same, working on spins, N m
    s2: Triple


@kernel
def stiffness(section: Section) -> Stiffness:
    """Of a beam of this section."""
    length, phi = section.element_length_m, section.shear_parameter
    c = section.bending_nm2 / (length * (1.0 + phi))
    return Stiffness(section.axial_n / length, (4.0 + phi) * c, (2.0 - phi) * c, section.torsion_nm2 / length)


@kernel
def _cross(a: Triple, b: Triple) -> Triple:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@kernel
def _dot(a: Triple, b: Triple) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@kernel
def _sum(a: float, u: Triple, b: float, v: Triple) -> Triple:
    """Sum a u + b v."""
    return a * u[0] + b * v[0], a * u[1] + b * v[1], a * u[2] + b * v[2]


@kernel
def _jacobian(end: End, v: Triple, sign: float) -> Triple:
    """T_s^-1 v for sign = -1, its transpose times v for sign = +1."""
    once = _cross(end.theta, v)
    return _sum(1.0, v, 1.0, _sum(0.5 * sign, once, end.eta, _cross(end.theta, once)))


@kernel
def _jacobian_change(end: End, m: Triple, change: Triple) -> Triple:
    """d(T_s^-T m) for the increment `change` of theta at fixed m."""
    theta, along = end.theta, _dot(end.theta, change)
    twice = _cross(theta, _cross(theta, m))
    straight = _sum(0.5, _cross(change, m), end.mu * along, twice)
    spread = _sum(_dot(m, change), theta, -2.0 * along, m)
    return _sum(1.0, straight, end.eta, _sum(1.0, spread, _dot(theta, m), change))


@kernel
def _moment(k: Stiffness, own: Triple, other: Triple) -> Triple:
    """Local stiffness: moment at one end from the rotation vectors of both."""
    x, y = k.near * own[0] + k.far * other[0], k.near * own[1] + k.far * other[1]
    return x, y, k.torsion * (own[2] - other[2])


@kernel
def _frame(chord: Triple, axis: Triple, frame: Floats) -> float:
    """Write the frame (3, 3), columns r1 r2 r3, of a chord and mean first axis (world); return the length."""
    length = math.sqrt(_dot(chord, chord))
    r3 = _sum(1.0 / length, chord, 0.0, chord)
    normal = _cross(r3, axis)
    r2 = _sum(1.0 / math.sqrt(_dot(normal, normal)), normal, 0.0, normal)
    r1 = _cross(r2, r3)
    for i in range(3):
        frame[i, 0], frame[i, 1], frame[i, 2] = r1[i], r2[i], r3[i]
    return length


@kernel
def _end(frame: Floats, rotation: Floats, relative: Floats) -> End:
    """One end from the element frame and the nodal rotation, (3, 3) each; `relative` is scratch."""
    for i in range(3):
        for j in range(3):
            relative[i, j] = frame[0, i] * rotation[0, j] + frame[1, i] * rotation[1, j] + frame[2, i] * rotation[2, j]
    log = log_map(relative)
    theta = (log[0], log[1], log[2])
    eta, mu = jacobian_coefficients(_dot(theta, theta))
    return End(theta, eta, mu, (relative[0, 0], relative[1, 0], relative[2, 0]))


@kernel
def deform(
    x1: Floats, x2: Floats, R1: Floats, R2: Floats, rest_length: float, k: Stiffness, scratch: Floats
) -> Element:
    """State of the beam between two nodes; writes its frame to scratch[0] (scratch is (2, 3, 3))."""
    chord = (x2[0] - x1[0], x2[1] - x1[1], x2[2] - x1[2])
    axis = (R1[0, 0] + R2[0, 0], R1[1, 0] + R2[1, 0], R1[2, 0] + R2[2, 0])
    length = _frame(chord, axis, scratch[0])
    end1 = _end(scratch[0], R1, scratch[1])
    end2 = _end(scratch[0], R2, scratch[1])
    m1 = _moment(k, end1.theta, end2.theta)
    m2 = _moment(k, end2.theta, end1.theta)
    s1, s2 = _jacobian(end1, m1, 1.0), _jacobian(end2, m2, 1.0)
    return Element(length, k.axial * (length - rest_length), end1, end2, m1, m2, s1, s2)


@kernel
def _forces(e: Element) -> tuple[Triple, Triple, Triple]:
    """n, M1, M2 = B^T (tension, s1, s2): what is left after the element frame has turned with its nodes."""
    a, b = e.end1.axis, e.end2.axis
    q1, q3 = 0.5 * (a[0] + b[0]), 0.5 * (a[2] + b[2])
    s = _sum(1.0, e.s1, 1.0, e.s2)
    twist = 0.5 * s[2] / q1
    n = (-s[1] / e.length, (s[0] + s[2] * q3 / q1) / e.length, e.tension)
    moment1 = (e.s1[0] + twist * a[2], e.s1[1], e.s1[2] - twist * a[0])
    moment2 = (e.s2[0] + twist * b[2], e.s2[1], e.s2[2] - twist * b[0])
    return n, moment1, moment2


@kernel
def _frame_spin(e: Element, d: Triple, dw1: Triple, dw2: Triple) -> Triple:
    """Spin of the element frame, G^T of the paper: it follows the chord and the mean first axis."""
    a, b = e.end1.axis, e.end2.axis
    q1, q3 = 0.5 * (a[0] + b[0]), 0.5 * (a[2] + b[2])
    w1 = -d[1] / e.length
    lateral = 0.5 * (dw1[2] * a[0] - dw1[0] * a[2] + dw2[2] * b[0] - dw2[0] * b[2])
    return w1, d[0] / e.length, (lateral + q3 * w1) / q1


@kernel
def _force_changes(e: Element, k: Stiffness, d: Triple, dw1: Triple, dw2: Triple) -> tuple[Triple, Triple, Triple]:
    """Exact increments of n, M1, M2 (components in the unturned element frame): `_forces`, differentiated."""
    w = _frame_spin(e, d, dw1, dw2)
    spin1, spin2 = _sum(1.0, dw1, -1.0, w), _sum(1.0, dw2, -1.0, w)
    t1, t2 = _jacobian(e.end1, spin1, -1.0), _jacobian(e.end2, spin2, -1.0)
    ds1 = _sum(1.0, _jacobian(e.end1, _moment(k, t1, t2), 1.0), 1.0, _jacobian_change(e.end1, e.m1, t1))
    ds2 = _sum(1.0, _jacobian(e.end2, _moment(k, t2, t1), 1.0), 1.0, _jacobian_change(e.end2, e.m2, t2))
    a, b = e.end1.axis, e.end2.axis
    da, db = _cross(spin1, a), _cross(spin2, b)
    q1, q3 = 0.5 * (a[0] + b[0]), 0.5 * (a[2] + b[2])
    dq1, dq3 = 0.5 * (da[0] + db[0]), 0.5 * (da[2] + db[2])
    s, ds = _sum(1.0, e.s1, 1.0, e.s2), _sum(1.0, ds1, 1.0, ds2)
    twist = 0.5 * s[2] / q1
    dtwist = 0.5 * ds[2] / q1 - twist * dq1 / q1
    n, moment1, moment2 = _forces(e)
    stretch = d[2] / e.length
    bend = (ds[0] + 2.0 * (dtwist * q3 + twist * dq3)) / e.length
    dn = (-ds[1] / e.length - n[0] * stretch, bend - n[1] * stretch, k.axial * d[2])
    dm1 = (ds1[0] + dtwist * a[2] + twist * da[2], ds1[1], ds1[2] - dtwist * a[0] - twist * da[0])
    dm2 = (ds2[0] + dtwist * b[2] + twist * db[2], ds2[1], ds2[2] - dtwist * b[0] - twist * db[0])
    turned1, turned2 = _cross(w, moment1), _cross(w, moment2)
    return _sum(1.0, dn, 1.0, _cross(w, n)), _sum(1.0, dm1, 1.0, turned1), _sum(1.0, dm2, 1.0, turned2)


@kernel
def _to_world(frame: Floats, v: Triple) -> Triple:
    return (
        frame[0, 0] * v[0] + frame[0, 1] * v[1] + frame[0, 2] * v[2],
        frame[1, 0] * v[0] + frame[1, 1] * v[1] + frame[1, 2] * v[2],
        frame[2, 0] * v[0] + frame[2, 1] * v[1] + frame[2, 2] * v[2],
    )


@kernel
def _add_column(node1: Floats, node2: Floats, j: int, sign: float, n: Triple, moment1: Triple, moment2: Triple) -> None:
    """Add to column j of the blocks (6, 6) of the rows of both nodes the force changes of one increment."""
    for i in range(3):
        node1[i, j] -= sign * n[i]
        node1[3 + i, j] += sign * moment1[i]
        node2[i, j] += sign * n[i]
        node2[3 + i, j] += sign * moment2[i]


@kernel
def _add_tangent(
    e: Element, k: Stiffness, frame: Floats, first: Floats, upper: Floats, lower: Floats, second: Floats
) -> None:
    """Add the 12 x 12 tangent of one beam, a column per unit increment; (6, 6) blocks by pairs of nodes."""
    zero = (0.0, 0.0, 0.0)
    for column in range(9):
        kind, j = column // 3, column % 3
        unit = (frame[j, 0], frame[j, 1], frame[j, 2])
        d, dw1, dw2 = unit if kind == 0 else zero, unit if kind == 1 else zero, unit if kind == 2 else zero
        n, moment1, moment2 = _force_changes(e, k, d, dw1, dw2)
        n, moment1, moment2 = _to_world(frame, n), _to_world(frame, moment1), _to_world(frame, moment2)
        if kind == 0:
            _add_column(first, lower, j, -1.0, n, moment1, moment2)
            _add_column(upper, second, j, 1.0, n, moment1, moment2)
        elif kind == 1:
            _add_column(first, lower, 3 + j, 1.0, n, moment1, moment2)
        else:
            _add_column(upper, second, 3 + j, 1.0, n, moment1, moment2)


@kernel
def internal(x: Floats, R: Floats, section: Section, out: BeamForces) -> None:
    """Internal forces and tangent of a chain of n beams; equilibrium is out.forces = external forces.

    x: (n+1, 3) m, R: (n+1, 3, 3), world. section: `NeedleModel.section`. out is written.
    """
    element_length, rest_frames, k = section.element_length_m, section.rest_frames, stiffness(section)
    f_out, diag_out, upper_out, lower_out = out
    n = len(x) - 1
    scratch = np.empty((2, 3, 3))
    frame = scratch[0]
    f_out[:] = 0.0
    diag_out[:] = 0.0
    upper_out[:] = 0.0
    lower_out[:] = 0.0
    for i in range(n):
        R1, R2 = R[i], R[i + 1]
        if len(rest_frames) > 0:
            R1, R2 = compose(R1, rest_frames[i, 0]), compose(R2, rest_frames[i, 1])
        e = deform(x[i], x[i + 1], R1, R2, element_length, k, scratch)
        force, moment1, moment2 = _forces(e)
        force, moment1, moment2 = (
            _to_world(frame, force),
            _to_world(frame, moment1),
            _to_world(frame, moment2),
        )
        for j in range(3):
            f_out[i, j] -= force[j]
            f_out[i + 1, j] += force[j]
            f_out[i, 3 + j] += moment1[j]
            f_out[i + 1, 3 + j] += moment2[j]
        _add_tangent(e, k, frame, diag_out[i], upper_out[i], lower_out[i], diag_out[i + 1])
