"""The 32 errors of the error-state filter, and how they grow.

An error is what must be added to the estimate to make it true. The attitude's is a
small rotation `theta_n` in navigation axes: true C_nb = (I + [theta_n x]) C_nb. Easily
got wrong: velocity is in NED and the biases are in body axes, so `C_nb` couples them,
with a minus sign for each.
"""

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from imu_tracker.estimation.tuning import (
    GYRO_BIAS_SIGMA_RADPS,
    GYRO_DRIFT_PSD,
    LEVELLING_SIGMA_RAD,
    RECEIVER_CORRELATION_S,
)
from imu_tracker.geometry.geodesy import LocalFrame
from imu_tracker.geometry.rotation import matrix
from imu_tracker.samples import Quat, Vec3

Array = NDArray[np.float64]

P_N, P_E, P_D = 0, 1, 2  # p_n, m
V_N, V_E, V_D = 3, 4, 5  # v_n, m/s
TILT_N, TILT_E, YAW_D = 6, 7, 8  # theta_n, rad
RECEIVER_N, RECEIVER_E = 17, 18

POSITION: Final = slice(0, 3)  # p_n, m
VELOCITY: Final = slice(3, 6)  # v_n, m/s
ATTITUDE: Final = slice(6, 9)  # theta_n, rad
TILT: Final = slice(6, 8)
YAW: Final = slice(8, 9)
MOTION: Final = slice(0, 6)  # position and velocity
ORIENTATION: Final = slice(6, 15)  # attitude and both biases: what bends the force
GYRO_BIAS: Final = slice(9, 12)  # b_g, body axes, rad/s
ACCEL_BIAS: Final = slice(12, 15)  # b_a, body axes, m/s^2
MOUNT_PITCH: Final = 15  # rad, about vehicle y: true C_vb = (I + [mu x]) C_vb
MOUNT_YAW: Final = 16  # rad, about vehicle z
MOUNTING: Final = slice(15, 17)
RECEIVER: Final = slice(17, 19)  # lasting error of the receiver, NE, m
DELAY: Final = 19  # fixes describe this much later than assumed, s
VELOCITY_DELAY: Final = 20  # the same of their velocities
DELAYS: Final = slice(19, 21)
GYRO_GAIN: Final = slice(21, 30)  # M, column by column: true rate = (I + M) gyro
AXLE: Final = 30  # from the rear axle forward to the box, m
WHEEL_SCALE: Final = 31  # wheels are larger by this share than they are taken to be
N_ERRORS: Final = 32


class NoiseLevel(NamedTuple):
    """How much worse than the datasheet a chip is in the place where it sits.

    Densities are those of a random walk. The chip's own noise is 0.005 deg/s/sqrt(Hz)
    and 400 ug/sqrt(Hz) (PS-MPU-6000A sections 6.1, 6.2); a vehicle shakes it, and what
    is shaken is measured wrong in proportion: aliasing, clipping, scale, g-sensitivity.
    """

    gyro_share: float
    """Part of the last second's scatter of the gyro, as a rate that lasts
    `SHAKEN_S`."""
    accel_share: float
    """The same of the accelerometer."""


SHAKEN_S: Final = 0.1
"""How long an error by vibration lasts."""

GYRO_NOISE_PSD: Final = math.radians(0.01) ** 2
"""(rad/s)^2/Hz: the datasheet's, twice over for clones."""

ACCEL_NOISE_PSD: Final = 0.02**2
"""(m/s^2)^2/Hz: the datasheet's 0.004, five times over: scale errors of what the
vehicle does, and steps of 40 ms."""


ACCEL_DRIFT_PSD: Final = 0.0005**2
"""(m/s^2)^2 per s: 3 mg in an hour, by six kelvins (PS-MPU-6000A section 6.2: 35 mg
over 70)."""

MOUNT_DRIFT_PSD: Final = math.radians(0.01) ** 2
"""rad^2 per s: load and speed tip a car by half a degree in the course of an hour."""

DELAY_DRIFT_PSD: Final = 0.005**2
"""s^2 per s: a receiver's filter changes its lag by 0.04 s in a minute."""

WHEEL_SCALE_SIGMA: Final = 0.01
"""Of a circumference that was just found: the width of a line at 50 km/h, averaged."""

WHEEL_DRIFT_PSD: Final = 0.005**2 / 600.0
"""1/s: tyres warm up in ten minutes and grow with speed, by half a per cent."""

START_SIGMA: Final = (
    (ATTITUDE, LEVELLING_SIGMA_RAD),
    (GYRO_BIAS, GYRO_BIAS_SIGMA_RADPS),
    (ACCEL_BIAS, 0.4),  # PS-MPU-6000A section 6.2: 50, 50, 80 mg
    (GYRO_GAIN, 0.01),  # 6.1: 2 % across the axes; 3 % of scale, see below
    (slice(AXLE, AXLE + 1), 1.0),  # boot to dashboard
)

SCALES: Final = range(GYRO_GAIN.start, GYRO_GAIN.stop, 4)
SCALE_SIGMA: Final = 0.015
"""Of each axis of the gyro, PS-MPU-6000A section 6.1: 3 % tolerance."""

DELAY_SIGMA_S: Final = 0.4
DELAYS_APART_SIGMA_S: Final = 0.25
"""Receivers report 0.05 to 1.2 s late; position and velocity come out of one filter, so
that their delays differ by some tenths only."""

MOUNT_SIGMA_RAD: Final = math.radians(8.0)
"""By hand and eye; larger angles are the coarse stage's."""


class Scene(NamedTuple):
    """What is the same for all filters at an instant.

    Attributes
    ----------
    frame : LocalFrame
        Where positions are counted from.
    alt_origin_m : float or None
    shift_s : float
        What was folded away of the receiver's delay.
    outage_s : float
        Since the last fix that was used.
    is_aligned : bool
    has_imu : bool
        Whether the IMU is used: it delivers, and was not set aside.
    odds_nats : float
        Log odds of the filter against the receiver alone.
    """

    frame: LocalFrame
    alt_origin_m: float | None
    shift_s: float
    outage_s: float
    is_aligned: bool
    has_imu: bool
    odds_nats: float


def skew(v: Vec3) -> Array:
    """Matrix of the cross product: skew(v) @ w = v x w."""
    x, y, z = v
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def start_covariance(*, is_vehicle: bool) -> Array:
    """Covariance of the errors before anything was seen; places are set at a fix."""
    P = np.zeros((N_ERRORS, N_ERRORS))
    for where, sigma in START_SIGMA:
        for i in range(where.start, where.stop):
            P[i, i] = sigma**2
    P[SCALES, SCALES] = SCALE_SIGMA**2
    P[DELAYS, DELAYS] = DELAY_SIGMA_S**2
    P[VELOCITY_DELAY, VELOCITY_DELAY] += DELAYS_APART_SIGMA_S**2
    if is_vehicle:
        P[MOUNT_PITCH, MOUNT_PITCH] = P[MOUNT_YAW, MOUNT_YAW] = MOUNT_SIGMA_RAD**2
    return P


def transition(q_nb: Quat, dt_s: float, dv_n: Vec3, turn_n_rad: Vec3) -> Array:
    """Transition matrix F of the errors over a short stretch.

    Parameters
    ----------
    q_nb : Quat
        Attitude amid the stretch.
    dt_s : float
    dv_n : Vec3, m/s
        Integral of the specific force over the stretch, navigation axes.
    turn_n_rad : Vec3, navigation axes
        Angle turned over the stretch.

    Returns
    -------
    F : ndarray, shape (32, 32)

    Notes
    -----
    v' = v - [dv_n x] theta - C_nb b_a dt
    theta' = theta - C_nb b_g dt + C_nb M turn_b
    p' = p + v dt, and half a stretch of each change of v.
    The receiver's error decays: b_r' = exp(-dt / tau) b_r.
    Source: Sola 2017, arXiv:1711.02508, section 7 (global angular errors).
    """
    F = np.eye(N_ERRORS)
    C_nb = matrix(q_nb)
    C_dt = C_nb * dt_s
    F_v = skew(dv_n)
    F[VELOCITY, ATTITUDE] = -F_v
    F[VELOCITY, ACCEL_BIAS] = -C_dt
    F[VELOCITY, GYRO_BIAS] = 0.5 * (F_v @ C_dt)
    F[POSITION, ORIENTATION] = (0.5 * dt_s) * F[VELOCITY, ORIENTATION]
    F[P_N, V_N] = F[P_E, V_E] = F[P_D, V_D] = dt_s
    F[ATTITUDE, GYRO_BIAS] = -C_dt
    turn_b = turn_n_rad @ C_nb
    F[ATTITUDE, GYRO_GAIN] = (C_nb[:, None, :] * turn_b[:, None]).reshape(3, 9)
    F[RECEIVER_N, RECEIVER_N] = F[RECEIVER_E, RECEIVER_E] = math.exp(
        -dt_s / RECEIVER_CORRELATION_S
    )
    return F


def process_noise(
    dt_s: float,
    gyro_psd: float,
    accel_psd: float,
    receiver_var: float,
    *,
    is_vehicle: bool,
) -> Array:
    """Process noise Q of a short stretch.

    Parameters
    ----------
    dt_s : float
    gyro_psd, accel_psd : float, (rad/s)^2/Hz and (m/s^2)^2/Hz
    receiver_var : float, m^2
        Variance of the receiver's lasting error, in the long run.
    is_vehicle : bool
        Whether there is a mounting that may change.
    """
    q = np.zeros(N_ERRORS)
    q[POSITION] = accel_psd * dt_s**3 / 3.0
    q[VELOCITY] = accel_psd * dt_s
    q[ATTITUDE] = gyro_psd * dt_s
    q[GYRO_BIAS] = GYRO_DRIFT_PSD * dt_s
    q[ACCEL_BIAS] = ACCEL_DRIFT_PSD * dt_s
    if is_vehicle:
        q[MOUNT_PITCH] = q[MOUNT_YAW] = MOUNT_DRIFT_PSD * dt_s
    decay = math.exp(-2.0 * dt_s / RECEIVER_CORRELATION_S)
    q[RECEIVER] = receiver_var * (1.0 - decay)
    q[DELAY] = q[VELOCITY_DELAY] = DELAY_DRIFT_PSD * dt_s
    q[WHEEL_SCALE] = WHEEL_DRIFT_PSD * dt_s
    Q = np.diag(q)
    cross = accel_psd * dt_s**2 / 2.0
    for p, v in ((P_N, V_N), (P_E, V_E), (P_D, V_D)):
        Q[p, v] = Q[v, p] = cross
    return Q
