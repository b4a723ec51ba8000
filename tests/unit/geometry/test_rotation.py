"""Rotations against scipy's, which shares no line with ours."""

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation  # type: ignore[import-untyped]

from imu_tracker.geometry.rotation import (
    IDENTITY,
    conjugate,
    from_euler,
    from_rotation_vector,
    level_from_gravity,
    matrix,
    multiply,
    normalise,
    rotate,
    to_euler,
    to_rotation_vector,
    turn_about_down,
    wrap_pi,
)
from imu_tracker.samples import Quat, Vec3

ATTITUDES = [
    (0.0, 0.0, 0.0),
    (0.3, -0.2, 1.0),
    (-3.0, 1.5, -3.1),
    (math.pi, 0.0, 0.0),
    (0.1, -1.57, 2.0),
]


def scipy_of(q: Quat) -> Rotation:
    return Rotation.from_quat([q[1], q[2], q[3], q[0]])


@pytest.mark.parametrize("rpy", ATTITUDES)
def test_euler_angles_are_yaw_then_pitch_then_roll(rpy: Vec3) -> None:
    roll, pitch, yaw = rpy
    expected = Rotation.from_euler("ZYX", [yaw, pitch, roll])
    assert np.allclose(matrix(from_euler(*rpy)), expected.as_matrix(), atol=1e-12)


@pytest.mark.parametrize("rpy", ATTITUDES)
def test_euler_angles_come_back(rpy: Vec3) -> None:
    q = from_euler(*rpy)
    again = from_euler(*to_euler(q))
    assert np.allclose(matrix(again), matrix(q), atol=1e-7)


@pytest.mark.parametrize("rpy", ATTITUDES)
def test_rotating_a_vector_is_what_the_matrix_does(rpy: Vec3) -> None:
    q, v_b = from_euler(*rpy), (0.3, -1.2, 9.0)
    assert np.allclose(rotate(q, v_b), scipy_of(q).apply(v_b), atol=1e-12)
    assert np.allclose(rotate(q, v_b), matrix(q) @ v_b, atol=1e-12)
    assert np.allclose(rotate(conjugate(q), rotate(q, v_b)), v_b, atol=1e-12)


def test_the_product_turns_by_the_right_factor_first() -> None:
    q_ab, q_bc = from_euler(0.4, 0.1, -2.0), from_euler(-1.0, 0.6, 0.3)
    expected = scipy_of(q_ab) * scipy_of(q_bc)
    assert np.allclose(matrix(multiply(q_ab, q_bc)), expected.as_matrix(), atol=1e-12)


@pytest.mark.parametrize(
    "angle", [(0.0, 0.0, 0.0), (1e-10, 0.0, 0.0), (0.0, 2e-8, 0.0), (1.0, -2.0, 0.5)]
)
def test_rotation_vectors_agree_with_scipy(angle: Vec3) -> None:
    q = from_rotation_vector(angle)
    expected = Rotation.from_rotvec(angle)
    assert np.allclose(matrix(q), expected.as_matrix(), atol=1e-14)
    assert np.allclose(to_rotation_vector(q), expected.as_rotvec(), atol=1e-14)


def test_a_rotation_vector_goes_the_short_way_round() -> None:
    q = from_rotation_vector((0.0, 0.0, 1.5 * math.pi))
    assert to_rotation_vector(q) == pytest.approx((0.0, 0.0, -0.5 * math.pi))


def test_positive_yaw_turns_north_to_east() -> None:
    q = turn_about_down(IDENTITY, math.radians(90.0))
    assert rotate(q, (1.0, 0.0, 0.0)) == pytest.approx((0.0, 1.0, 0.0))
    assert to_euler(q)[2] == pytest.approx(math.radians(90.0))


def test_turning_about_down_keeps_the_tilt() -> None:
    q = turn_about_down(from_euler(0.2, -0.4, 1.0), 1.1)
    assert to_euler(q) == pytest.approx((0.2, -0.4, 2.1))


@pytest.mark.parametrize(("roll", "pitch"), [(0.0, 0.0), (0.5, -0.3), (3.0, 1.2)])
def test_levelling_finds_the_tilt_from_gravity(roll: float, pitch: float) -> None:
    # At rest f_n is straight up; the oracle turns it into the body.
    up = Rotation.from_euler("ZYX", [0.7, pitch, roll]).inv().apply([0, 0, -9.81])
    found = to_euler(level_from_gravity((up[0], up[1], up[2])))
    assert found == pytest.approx((roll, pitch, 0.0), abs=1e-12)


def test_normalising_keeps_the_direction() -> None:
    q = from_euler(0.1, 0.2, 0.3)
    long = (2.0 * q[0], 2.0 * q[1], 2.0 * q[2], 2.0 * q[3])
    assert normalise(long) == pytest.approx(q)


@pytest.mark.parametrize(
    ("angle", "wrapped"),
    [
        (0.0, 0.0),
        (math.pi, -math.pi),
        (-math.pi, -math.pi),
        (3.0 * math.pi - 0.1, math.pi - 0.1),
        (-7.0, -7.0 + 2.0 * math.pi),
    ],
)
def test_an_angle_wraps_to_half_a_turn(angle: float, wrapped: float) -> None:
    assert wrap_pi(angle) == pytest.approx(wrapped)
