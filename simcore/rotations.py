"""Finite rotations: exponential and logarithm, the left Jacobian, quaternions.

A rotation matrix maps body components to world components. A spin increment dw is spatial: R <- exp(dw) R.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from simcore.compiled import kernel
from simcore.elementary_kernels import arc_tangent, sine_cosine

if TYPE_CHECKING:
    from simcore.arrays import Floats

_SERIES_BELOW = 0.25  # squared angle; above it the closed forms keep 12 digits and more


@kernel
def skew(w: Floats) -> Floats:
    """(3, 3) matrix W of the vector w (3,) with W v = w x v."""
    return np.array([[0.0, -w[2], w[1]], [w[2], 0.0, -w[0]], [-w[1], w[0], 0.0]])


@kernel
def compose(a: Floats, b: Floats) -> Floats:
    """Product a b of two (3, 3) matrices."""
    out = np.empty((3, 3))
    for i in range(3):
        for j in range(3):
            out[i, j] = a[i, 0] * b[0, j] + a[i, 1] * b[1, j] + a[i, 2] * b[2, j]
    return out


@kernel
def is_rotation(matrix: Floats, skew_allowed: float) -> bool:
    """Whether matrix (3, 3) is a rotation: no entry of M^T M differs from the identity by more, and det M > 0."""
    for i in range(3):
        for j in range(3):
            found = matrix[0, i] * matrix[0, j] + matrix[1, i] * matrix[1, j] + matrix[2, i] * matrix[2, j]
            if not abs(found - (1.0 if i == j else 0.0)) <= skew_allowed:
                return False
    across = np.empty(3)
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        across[i] = matrix[1, j] * matrix[2, k] - matrix[1, k] * matrix[2, j]
    return bool(matrix[0, 0] * across[0] + matrix[0, 1] * across[1] + matrix[0, 2] * across[2] > 0.0)


@kernel
def exp_map(w: Floats) -> Floats:
    """Rotation (3, 3) by the vector w (3,) rad: I + sin(t)/t W + (1 - cos t)/t^2 W^2 (Rodrigues)."""
    angle2 = w[0] * w[0] + w[1] * w[1] + w[2] * w[2]
    if angle2 < 1e-8:
        first, second = 1.0 - angle2 / 6.0, 0.5 - angle2 / 24.0
    else:
        angle = math.sqrt(angle2)
        half, (sine, _) = sine_cosine(0.5 * angle)[0], sine_cosine(angle)
        first, second = sine / angle, 2.0 * half * half / angle2
    out = np.empty((3, 3))
    for i in range(3):
        for j in range(3):
            out[i, j] = second * w[i] * w[j]
        out[i, i] += 1.0 - second * angle2
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        out[k, j] += first * w[i]
        out[j, k] -= first * w[i]
    return out


@kernel
def log_map(R: Floats) -> Floats:
    """Rotation vector (3,) rad, of length 0 to pi, of the rotation R (3, 3).

    Through the quaternion, which is well conditioned at every angle; the trace alone is not near 0 and pi.
    """
    q = quaternion_from_matrix(R)
    sine = math.sqrt(q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    scale = 2.0 if sine < 1e-150 else 2.0 * arc_tangent(sine, q[0]) / sine
    return scale * q[1:]


@kernel
def jacobian_coefficients(angle2: float) -> tuple[float, float]:
    """Coefficients eta = (1 - (t/2) cot(t/2)) / t^2 and mu = (d eta / dt) / t at the squared angle t^2 < (2 pi)^2.

    Battini & Pacoste 2002; series coefficients |B_2k| / (2k)! of the Bernoulli numbers.
    """
    if angle2 < _SERIES_BELOW:
        a = angle2
        eta = 1 / 47900160.0 + a * (691 / 1307674368000.0 + a * (1 / 74724249600.0))
        eta = 1 / 12.0 + a * (1 / 720.0 + a * (1 / 30240.0 + a * (1 / 1209600.0 + a * eta)))
        mu = 8 / 47900160.0 + a * (6910 / 1307674368000.0 + a * (12 / 74724249600.0))
        mu = 2 / 720.0 + a * (4 / 30240.0 + a * (6 / 1209600.0 + a * mu))
        return eta, mu
    angle = math.sqrt(angle2)
    sine, cosine = sine_cosine(0.5 * angle)
    half2 = sine * sine
    eta = (1.0 - 0.5 * angle * cosine / sine) / angle2
    mu = (angle * (angle + 2.0 * sine * cosine) - 8.0 * half2) / (4.0 * angle2 * angle2 * half2)
    return eta, mu


@kernel
def inverse_left_jacobian(theta: Floats) -> Floats:
    """T_s^-1 (3, 3) at the rotation vector theta (3,): d log(exp(dw) exp(theta)) = T_s^-1 dw.

    I - Theta/2 + eta Theta^2 (Battini & Pacoste 2002).
    """
    t0, t1, t2 = theta[0], theta[1], theta[2]
    angle2 = t0 * t0 + t1 * t1 + t2 * t2
    eta, _ = jacobian_coefficients(angle2)
    out = -0.5 * skew(theta)
    for i in range(3):
        for j in range(3):
            out[i, j] += eta * theta[i] * theta[j]
        out[i, i] += 1.0 - eta * angle2
    return out


@kernel
def project_rotation(R: Floats) -> Floats:
    """The (3, 3) matrix R, orthonormal but for rounding, pulled back to the rotations: R (3 I - R^T R) / 2.

    One Newton step towards the polar factor (Higham 1986): an error e becomes one of order e^2.
    """
    correction = np.empty((3, 3))
    for i in range(3):
        for j in range(3):
            correction[i, j] = -0.5 * (R[0, i] * R[0, j] + R[1, i] * R[1, j] + R[2, i] * R[2, j])
        correction[i, i] += 1.5
    return compose(R, correction)


@kernel
def matrix_from_quaternion(q: Floats) -> Floats:
    """Rotation (3, 3) of the quaternion q (4,) = w, x, y, z; q is normalised first."""
    w, x, y, z = q / math.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


@kernel
def quaternion_from_matrix(R: Floats) -> Floats:
    """Unit quaternion (4,) = w, x, y, z with w >= 0 of the rotation R (3, 3).

    Divides by the largest component (Shepperd 1978), so that it is accurate at every angle.
    """
    q = np.empty(4)
    trace = R[0, 0] + R[1, 1] + R[2, 2]
    i = 0
    if R[1, 1] > R[0, 0]:
        i = 1
    if R[2, 2] > R[i, i]:
        i = 2
    if trace > R[i, i]:
        q[0] = 1.0 + trace
        for i in range(3):
            j, k = (i + 1) % 3, (i + 2) % 3
            q[1 + i] = R[k, j] - R[j, k]
    else:
        j, k = (i + 1) % 3, (i + 2) % 3
        q[0] = R[k, j] - R[j, k]
        q[1 + i] = 1.0 + 2.0 * R[i, i] - trace
        q[1 + j] = R[i, j] + R[j, i]
        q[1 + k] = R[i, k] + R[k, i]
    norm = math.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    return q / (-norm if q[0] < 0.0 else norm)
