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
    DELAY,
    DELAYS,
    GYRO_BIAS,
    MOUNT_YAW,
    N_ERRORS,
    P_E,
    P_N,
    TILT,
    V_E,
    V_N,
    VELOCITY_DELAY,
    YAW_D,
    Array,
    start_covariance,
)
from imu_tracker.estimation.tuning import (
    INFLATION_S,
    MAX_RECEIVER_SIGMAS,
    ODD_MOUNTING_RAD,
    REVERSE_MPS,
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
from imu_tracker.samples import GpsFix, Quat

COURSE_SPEED_MPS: Final = 2.0
COURSE_SIGMA_RAD: Final = math.radians(5.0)
COURSE_SIGMA_MPS: Final = 0.2
"""Between course and direction of travel of a vehicle that does not turn tightly, from
this speed on; and across it, at low speed."""

COURSE_TURN_RADPS: Final = 0.3
"""A vehicle that turns more tightly does not head along its course."""

RESTED_SIGMA_RADPS: Final = math.radians(0.05)
"""Better known than this is a gyro's bias only after a rest (`vehicle.rest`)."""

RELEVELLED_SIGMA_RAD: Final = 0.5
"""What a level may be wrong by that was found amid a turn: an aeroplane banks so."""

TURNED_BOX_RAD: Final = math.radians(35.0)
"""Between course and the box's own ahead: no hand's error."""

REVERSE_RAD: Final = math.radians(150.0)
"""A course this far from the heading, below `REVERSE_MPS`, is a vehicle in reverse."""


def rotate_yaw(eskf: Eskf, yaw_rad: float) -> None:
    """Turn the attitude about down, and its covariance with it."""
    nominal = eskf.nominal
    eskf.nominal = nominal._replace(q_nb=turn_about_down(nominal.q_nb, yaw_rad))
    sine, cosine = math.sin(yaw_rad), math.cos(yaw_rad)
    T = np.eye(N_ERRORS)
    T[TILT, TILT] = [[cosine, -sine], [sine, cosine]]
    eskf.transform(T)


def set_level(eskf: Eskf, q_nb: Quat) -> None:
    """Set an attitude found from gravity; far from flat, the box was mounted so."""
    eskf.nominal = eskf.nominal._replace(q_nb=q_nb)
    if max(eskf.P.diagonal()[TILT]) > RELEVELLED_SIGMA_RAD**2:
        eskf.set_variances(TILT, [RELEVELLED_SIGMA_RAD**2] * 2)
    if is_odd_mounting(q_nb):
        eskf.q_vb = q_nb


def is_odd_mounting(level_q: Quat) -> bool:
    """Whether a box levelled so lies far from flat in its vehicle."""
    roll, pitch, _ = to_euler(level_q)
    return max(abs(roll), abs(pitch)) > ODD_MOUNTING_RAD


def set_course_heading(eskf: Eskf, course_rad: float, sigma_rad: float) -> None:
    """Turn so that the vehicle heads along a course, known to `sigma_rad`.

    Notes
    -----
    The box's yaw is the course less the mounting: theta_d = course - mu_yaw, so that
    var = sigma^2 + var(mu), cov(theta_d, mu) = -var(mu).
    """
    rotate_yaw(eskf, off_course(eskf, course_rad))
    T = np.eye(N_ERRORS)
    T[YAW_D, YAW_D], T[YAW_D, MOUNT_YAW] = 0.0, -1.0
    eskf.transform(T)
    eskf.P[YAW_D, YAW_D] += sigma_rad**2


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
    if not is_vehicle or speed_mps < COURSE_SPEED_MPS:
        return
    off_rad = off_course(eskf, math.atan2(ve, vn))
    is_reversing = abs(off_rad) > REVERSE_RAD and speed_mps < REVERSE_MPS
    if abs(off_rad) > TURNED_BOX_RAD and not is_reversing:
        mount_along_course(eskf)


def course_sigma_rad(speed_mps: float) -> float:
    """Standard deviation between the course and a vehicle's heading."""
    return math.hypot(COURSE_SIGMA_RAD, COURSE_SIGMA_MPS / max(speed_mps, 0.1))


def course_heading(eskf: Eskf, fix: GpsFix) -> tuple[float, float] | None:
    """Return a vehicle's heading by its course and the sigma, rad; None if unknown.

    Unknown without velocity, at low speed and in a tight turn.
    """
    if fix.vel_ne_mps is None:
        return None
    vn, ve = fix.vel_ne_mps
    speed_mps = math.hypot(vn, ve)
    turn_radps = abs(eskf.rate_n[2])
    if speed_mps < COURSE_SPEED_MPS or turn_radps > COURSE_TURN_RADPS:
        return None
    return math.atan2(ve, vn), course_sigma_rad(speed_mps)


def mount(eskf: Eskf, yaw_rad: float, sigma_rad: float) -> None:
    """Take the box to sit turned by an angle about the vehicle's down."""
    eskf.q_vb = multiply(from_euler(0.0, 0.0, yaw_rad), eskf.q_vb)
    eskf.set_variances(MOUNT_YAW, sigma_rad**2)


def mount_along_course(eskf: Eskf) -> None:
    """Take the vehicle for level and headed where it goes: the rest is the box's.

    Notes
    -----
    The mounting's yaw is the course less the box's: mu_yaw = course - theta_d, so that
    var = sigma^2 + var(theta_d), cov(theta_d, mu) = -var(theta_d).
    """
    vn, ve, _ = eskf.nominal.v_n
    q_vn = from_euler(0.0, 0.0, -math.atan2(ve, vn))
    eskf.q_vb = multiply(q_vn, eskf.nominal.q_nb)
    T = np.eye(N_ERRORS)
    T[MOUNT_YAW, MOUNT_YAW], T[MOUNT_YAW, YAW_D] = 0.0, -1.0
    eskf.transform(T)
    eskf.P[MOUNT_YAW, MOUNT_YAW] += course_sigma_rad(math.hypot(vn, ve)) ** 2


def inflate_gyro_bias(eskf: Eskf) -> None:
    """Keep the gyro's bias, but doubt it as at the first start."""
    fresh = start_covariance(is_vehicle=False)
    eskf.set_variances(GYRO_BIAS, fresh.diagonal()[GYRO_BIAS])


def inflate_unrested_gyro_bias(eskf: Eskf) -> None:
    """Doubt the gyro's bias, unless a rest has shown it."""
    if eskf.sigma(GYRO_BIAS.start) > RESTED_SIGMA_RADPS:
        inflate_gyro_bias(eskf)


def set_delay_covariance(eskf: Eskf, block: Array) -> None:
    """Make the two delays known so well, and independent of all other errors."""
    P = eskf.P.copy()
    P[DELAYS, :] = P[:, DELAYS] = 0.0
    P[DELAYS, DELAYS] = block
    eskf.P = P
    eskf.note_reset(DELAYS)


def separate_delays(eskf: Eskf) -> None:
    """Take position and velocity for the receiver's, late by unknown delays.

    Without a heading the filter follows the fixes: its position and velocity are those
    that the receiver reports. With one they are the body's.

    Notes
    -----
    p_r = p + v delay, v_r = v + a velocity_delay: the sums stay as well known as they
    were, p and v become as uncertain as the delays.
    """
    (pn, pe, pd), (vn, ve, vd) = eskf.nominal.p_n, eskf.nominal.v_n
    an, ae, _ = eskf.mean_a_n
    late_s, v_late_s = eskf.delay_s, eskf.velocity_delay_s
    eskf.nominal = eskf.nominal._replace(
        p_n=(pn - vn * late_s, pe - ve * late_s, pd),
        v_n=(vn - an * v_late_s, ve - ae * v_late_s, vd),
    )
    T = np.eye(N_ERRORS)
    T[P_N, DELAY], T[P_E, DELAY] = -vn, -ve
    T[V_N, VELOCITY_DELAY], T[V_E, VELOCITY_DELAY] = -an, -ae
    eskf.transform(T)


def inflate_unexplained(eskf: Eskf, variance: float, period_s: float) -> None:
    """Open up where the receiver's error would have to be larger than it can be.

    A filter that is wrong and sure of itself explains the difference by the receiver.
    The part beyond `MAX_RECEIVER_SIGMAS` becomes its own uncertainty, within some
    seconds.
    """
    error_m = math.hypot(*eskf.receiver_ne_m)
    beyond_m = error_m - MAX_RECEIVER_SIGMAS * math.sqrt(variance)
    if beyond_m > 0.0:
        P = eskf.P.copy()
        share = min(period_s / INFLATION_S, 1.0)
        for p, v in ((P_N, V_N), (P_E, V_E)):
            P[p, p] += share * beyond_m**2
            P[v, v] += share * (beyond_m / INFLATION_S) ** 2
        eskf.P = P


def off_course(eskf: Eskf, course_rad: float) -> float:
    """Angle about down from the vehicle's heading to a course."""
    ahead_n = eskf.C_vn()[0]
    return wrap_pi(course_rad - math.atan2(ahead_n[1], ahead_n[0]))


def lean_right(eskf: Eskf, level_q: Quat) -> float:
    """Angle by which the body leans to the right of its way, against `level_q`."""
    vn, ve, _ = eskf.nominal.v_n
    q_leaning = multiply(eskf.nominal.q_nb, conjugate(level_q))
    foot_n, foot_e, _ = rotate(q_leaning, (0.0, 0.0, 1.0))
    to_the_left = (foot_n * ve - foot_e * vn) / max(math.hypot(vn, ve), 0.1)
    return math.asin(min(1.0, max(-1.0, to_the_left)))
