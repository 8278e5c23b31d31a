"""Identities of the rotation kernels; the references are SciPy's Rotation and central differences."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.linalg import polar
from scipy.spatial.transform import Rotation

from simcore import rotations
from tests.budget import examples

directions = arrays(np.float64, 3, elements=st.floats(-1.0, 1.0)).filter(lambda v: np.linalg.norm(v) > 1e-3)
angles = st.one_of(
    st.floats(0.0, 3.14),
    st.floats(-16.0, -2.0).map(lambda e: 10.0**e),  # small angles
    st.floats(-12.0, -2.0).map(lambda e: np.pi - 10.0**e),  # close to half a turn
)
quick = settings(max_examples=examples(150), deadline=None)


def turn(direction: np.ndarray, angle: float) -> np.ndarray:
    return angle * direction / np.linalg.norm(direction)


@pytest.mark.slow
@quick
@given(directions, angles)
def test_exp_is_scipys_and_orthonormal(direction: np.ndarray, angle: float) -> None:
    R = rotations.exp_map(turn(direction, angle))
    np.testing.assert_allclose(R, Rotation.from_rotvec(turn(direction, angle)).as_matrix(), atol=1e-15)
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=2e-15)


@pytest.mark.slow
@quick
@given(directions, angles)
def test_log_inverts_exp(direction: np.ndarray, angle: float) -> None:
    w = turn(direction, angle)
    found = rotations.log_map(rotations.exp_map(w))
    np.testing.assert_allclose(found, w, rtol=1e-12, atol=4e-16 + 2e-15 * angle)


@pytest.mark.parametrize("axis", [[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.6, 0.0, 0.8], [-0.48, 0.6, 0.64]])
def test_log_at_half_a_turn_is_one_of_the_two(axis: list[float]) -> None:
    w = np.pi * np.array(axis)
    found = rotations.log_map(rotations.exp_map(w))
    assert min(np.linalg.norm(found - w), np.linalg.norm(found + w)) < 1e-14


def test_log_of_identity_is_zero() -> None:
    assert not rotations.log_map(np.eye(3)).any()


@pytest.mark.slow
@quick
@given(directions, directions)
def test_skew_is_the_cross_product(w: np.ndarray, v: np.ndarray) -> None:
    np.testing.assert_allclose(rotations.skew(w) @ v, np.cross(w, v), atol=1e-15)
    np.testing.assert_allclose(
        rotations.compose(rotations.skew(w), rotations.skew(v)) @ w, np.cross(w, np.cross(v, w)), atol=1e-15
    )


@pytest.mark.slow
@quick
@given(directions, st.floats(0.0, 2.9))
def test_inverse_left_jacobian_is_the_derivative_of_log(direction: np.ndarray, angle: float) -> None:
    w, h = turn(direction, angle), 1e-5
    R = rotations.exp_map(w)
    columns = [
        (rotations.log_map(rotations.exp_map(h * e) @ R) - rotations.log_map(rotations.exp_map(-h * e) @ R)) / (2 * h)
        for e in np.eye(3)
    ]
    np.testing.assert_allclose(rotations.inverse_left_jacobian(w), np.array(columns).T, atol=2e-8)


def test_jacobian_coefficients_meet_where_the_series_ends() -> None:
    # eta rises by mu da / 2; both branches carry 12 digits or more at the change-over
    edge, da = rotations._SERIES_BELOW, 1e-10
    eta_below, mu_below = rotations.jacobian_coefficients(edge - da)
    eta_above, mu_above = rotations.jacobian_coefficients(edge + da)
    assert eta_above - eta_below == pytest.approx(mu_above * da, abs=1e-14)
    assert mu_above == pytest.approx(mu_below, abs=1e-13)


@pytest.mark.parametrize("angle2", [1e-8, 0.01, 0.2, 0.3, 2.0, 8.0])
def test_mu_is_the_derivative_of_eta(angle2: float) -> None:
    da = 1e-4 * angle2
    difference = rotations.jacobian_coefficients(angle2 + da)[0] - rotations.jacobian_coefficients(angle2 - da)[0]
    noise = 1e-16 / da
    assert rotations.jacobian_coefficients(angle2)[1] == pytest.approx(difference / da, rel=1e-7, abs=noise)


def test_projection_is_quadratic() -> None:
    rng = np.random.default_rng(3)
    R = Rotation.random(rng=rng).as_matrix()
    noise = rng.normal(size=(3, 3))
    errors = []
    for size in (1e-2, 1e-3):
        projected = rotations.project_rotation(R + size * noise)
        errors.append(np.abs(projected - polar(R + size * noise)[0]).max())
    assert 1.8 < np.log10(errors[0] / errors[1]) < 2.2


@pytest.mark.slow
@quick
@given(directions, angles)
def test_quaternions_are_scipys(direction: np.ndarray, angle: float) -> None:
    rotation = Rotation.from_rotvec(turn(direction, angle))
    q = rotations.quaternion_from_matrix(rotation.as_matrix())
    expected = rotation.as_quat(canonical=True, scalar_first=True)
    assert q[0] >= 0.0
    assert min(np.abs(q - expected).max(), np.abs(q + expected).max()) < 4e-16 * 4
    np.testing.assert_allclose(rotations.matrix_from_quaternion(3.0 * q), rotation.as_matrix(), atol=1e-15)
