"""Changing a filter's attitude and mounting outright, with its covariance.

The fact that a newcomer gets wrong: a turn about down turns the tilt's covariance with
it, and a heading of the vehicle says something of the box's yaw and its mounting only
together.
"""

import math
from typing import Final

import numpy as np

from imu_tracker.estimation.error_state.filter import Eskf
from imu_tracker.estimation.error_state.states import (
    GYRO_BIAS,
    MOUNT_YAW,
    N_ERRORS,
    TILT,
    YAW_D,
    start_covariance,
)
from imu_tracker.geometry.rotation import (
    conjugate,
    from_euler,
    multiply,
    rotate,
    to_euler,
    turn_about_down,
    wrap_pi,
)
from imu_tracker.samples import Quat

MOUNTING_SPEED_MPS: Final = 3.0
"""From here on the course is known to some degrees."""

TURNED_BOX_RAD: Final = math.radians(35.0)
"""Between course and the box's own ahead: no hand's error."""

REVERSE_RAD: Final = math.radians(150.0)
REVERSE_MPS: Final = 5.0
"""Nobody reverses faster."""


def rotate_yaw(eskf: Eskf, yaw_rad: float) -> None:
    """Turn the attitude about down, and its covariance with it."""
    nominal = eskf.nominal
    eskf.nominal = nominal._replace(q_nb=turn_about_down(nominal.q_nb, yaw_rad))
    sine, cosine = math.sin(yaw_rad), math.cos(yaw_rad)
    T = np.eye(N_ERRORS)
    T[TILT, TILT] = [[cosine, -sine], [sine, cosine]]
    eskf.P = T @ eskf.P @ T.T


def set_course_heading(eskf: Eskf, course_rad: float, sigma_rad: float) -> None:
    """Turn so that the vehicle heads along a course, known to `sigma_rad`.

    Notes
    -----
    The box's yaw is the course less the mounting: theta_d = course - mu_yaw, so that
    var = sigma^2 + var(mu), cov(theta_d, mu) = -var(mu).
    """
    rotate_yaw(eskf, off_course(eskf, course_rad))
    P = eskf.P.copy()
    P[YAW_D, :] = P[:, YAW_D] = 0.0
    row = -P[MOUNT_YAW, :].copy()
    P[YAW_D, :] = P[:, YAW_D] = row
    P[YAW_D, YAW_D] = sigma_rad**2 + P[MOUNT_YAW, MOUNT_YAW]
    eskf.P = P


def set_bank_heading(
    eskf: Eskf, yaw_rad: float, sigma_rad: float, *, is_vehicle: bool
) -> None:
    """Turn to a heading that accelerations have shown; see how the box sits.

    A vehicle goes where its course goes: if that is not ahead, it is the box that sits
    turned. But a half turn at low speed is a vehicle that goes backwards.
    """
    rotate_yaw(eskf, yaw_rad)
    eskf.inflate_orientation(sigma_rad, is_vehicle=is_vehicle)
    vn, ve, _ = eskf.nominal.v_n
    speed_mps = math.hypot(vn, ve)
    if not is_vehicle or speed_mps < MOUNTING_SPEED_MPS:
        return
    off_rad = off_course(eskf, math.atan2(ve, vn))
    is_reversing = abs(off_rad) > REVERSE_RAD and speed_mps < REVERSE_MPS
    if abs(off_rad) > TURNED_BOX_RAD and not is_reversing:
        mount_along_course(eskf)


def mount_along_course(eskf: Eskf) -> None:
    """Take the vehicle for level and headed where it goes: the rest is the box's."""
    vn, ve, _ = eskf.nominal.v_n
    q_vn = from_euler(0.0, 0.0, -math.atan2(ve, vn))
    eskf.q_vb = multiply(q_vn, eskf.nominal.q_nb)


def inflate_gyro_bias(eskf: Eskf) -> None:
    """Keep the gyro's bias, but doubt it as at the first start."""
    fresh = start_covariance(is_vehicle=False)
    eskf.set_variances(GYRO_BIAS, fresh.diagonal()[GYRO_BIAS])


def off_course(eskf: Eskf, course_rad: float) -> float:
    """Angle about down from the vehicle's heading to a course."""
    ahead_n = eskf.C_vn()[0]
    return wrap_pi(course_rad - math.atan2(ahead_n[1], ahead_n[0]))


def yaw_between(q_nb: Quat, other_q_nb: Quat) -> float:
    """Angle about down from the other attitude to this one."""
    return to_euler(multiply(q_nb, conjugate(other_q_nb)))[2]


def lean_right(eskf: Eskf, level_q: Quat) -> float:
    """Angle by which the body leans to the right of its way, against `level_q`."""
    vn, ve, _ = eskf.nominal.v_n
    q_leaning = multiply(eskf.nominal.q_nb, conjugate(level_q))
    foot_n, foot_e, _ = rotate(q_leaning, (0.0, 0.0, 1.0))
    to_the_left = (foot_n * ve - foot_e * vn) / max(math.hypot(vn, ve), 0.1)
    return math.asin(min(1.0, max(-1.0, to_the_left)))
