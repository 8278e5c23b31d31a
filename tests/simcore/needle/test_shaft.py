"""The shaft between the nodes: through them along their tangents, its weights derivatives of each other."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from simcore.needle.model import (
    advance,
    straight,
)
from simcore.needle.shaft import shaft_columns, shaft_frame, shaft_weights
from tests.simcore.needle.rods import EIGHTEEN_GAUGE, bent, loaded, unit_rod

# the shaft between nodes

STATIONS = [-0.02, 0.0, 0.004, 0.009, 0.0471, 0.1799, 0.18, 0.2]  # m, of 0.18 m


def test_shaft_of_a_straight_needle_is_a_line() -> None:
    base, rotation = np.array([0.01, 0.02, 0.03]), Rotation.random(rng=np.random.default_rng(6)).as_matrix()
    x, R = straight(EIGHTEEN_GAUGE, base, rotation)
    for s in STATIONS:
        c, dc, ddc, _, _ = shaft_frame(x, R, EIGHTEEN_GAUGE.element_length_m, s)
        np.testing.assert_allclose(c, base + s * rotation[:, 2], atol=1e-15)
        np.testing.assert_allclose(dc, rotation[:, 2], atol=1e-13)
        np.testing.assert_allclose(ddc, 0.0, atol=1e-10)


def test_shaft_passes_through_the_nodes_along_their_tangents() -> None:
    x, R = bent(EIGHTEEN_GAUGE)
    for i in range(len(x)):
        c, dc, _, _, _ = shaft_frame(x, R, EIGHTEEN_GAUGE.element_length_m, i * EIGHTEEN_GAUGE.element_length_m)
        np.testing.assert_allclose(c, x[i], atol=1e-14)
        np.testing.assert_allclose(dc, R[i, :, 2], atol=1e-12)


def test_shaft_between_nodes_is_the_deflection_curve_of_a_slender_beam() -> None:
    # y = P s^2 (3 L - s) / 6 EI, y' and y'' (Euler-Bernoulli cantilever), here with two beams and no shear
    model, load, s = unit_rod(2), 1e-5, 0.7
    solution = loaded(model, load * np.eye(6)[0], 1, *straight(model, np.zeros(3), np.eye(3)))
    c, dc, ddc, _, _ = shaft_frame(solution.x, solution.R, model.element_length_m, s)
    expected = np.array([s**2 * (3 - s) / 6, s * (2 - s) / 2, 1 - s]) * load
    np.testing.assert_allclose([c[0], dc[0], ddc[0]], expected, rtol=1e-6)


@pytest.mark.parametrize("s", [-0.02, 0.004, 0.0471, 0.1795, 0.2])
def test_shaft_weights_are_derivatives_of_each_other(s: float) -> None:
    h, (n, length) = 1e-6, (EIGHTEEN_GAUGE.elements, EIGHTEEN_GAUGE.element_length_m)
    w = shaft_weights(n, length, s)[1]
    slope = (shaft_weights(n, length, s + h)[1] - shaft_weights(n, length, s - h)[1])[:2] / (2 * h)
    np.testing.assert_allclose(slope[0], w[1], atol=1e-6 * max(np.abs(w[1]).max(), 1.0))
    np.testing.assert_allclose(slope[1], w[2], atol=1e-6 * max(np.abs(w[2]).max(), 1.0))


@pytest.mark.parametrize("s", STATIONS)
@pytest.mark.parametrize("order", [0, 1, 2])
def test_shaft_gradient_is_the_derivative_of_the_shaft(s: float, order: int) -> None:
    model, h = EIGHTEEN_GAUGE, 1e-6
    x, R = bent(model)
    e, w = shaft_weights(model.elements, model.element_length_m, s)
    columns, differences = np.empty((3, 12)), np.zeros((3, 12))
    shaft_columns(R, e, w[order], columns)
    for j in range(12):
        for sign in (1.0, -1.0):
            dq, moved_x, moved_R = np.zeros((model.elements + 1, 6)), x.copy(), R.copy()
            dq[e + j // 6, j % 6] = sign * h
            advance(moved_x, moved_R, dq)
            differences[:, j] += sign * shaft_frame(moved_x, moved_R, model.element_length_m, s)[order] / (2 * h)
    np.testing.assert_allclose(columns, differences, atol=1e-8 * np.abs(columns).max())
