"""Vehicle constraints as pseudo-measurements: non-holonomic, zero velocity, priors.

Each function returns innovation, H and R; `schedule` decides when it is applied. Axes
are the vehicle's (x forward, y right, z down), rotated from the box's by the mounting
that is being learnt.
"""

import math
from typing import Final

import numpy as np

from imu_tracker.estimation.error_state.filter import Eskf, Measurement
from imu_tracker.estimation.error_state.states import (
    ACCEL_BIAS,
    ATTITUDE,
    AXLE,
    GYRO_BIAS,
    MOUNT_PITCH,
    MOUNT_YAW,
    N_ERRORS,
    VELOCITY,
    Array,
    skew,
)
from imu_tracker.estimation.tuning import (
    FORWARD_CORRELATION_S,
    GENTLE_STOP_MPS,
    GENTLE_STOP_S,
    LATERAL_SIGMA_MPS,
    REST_RATE_SIGMA_RADPS,
    REST_SHAKING_SHARE,
    REST_SPEED_SIGMA_MPS,
    SLIP_CORRELATION_S,
    SLIP_RAD_PER_MPS2,
    SLOPE_CORRELATION_S,
    SOFT_GATE_SIGMAS,
    VERTICAL_RATIO,
)
from imu_tracker.geometry.rotation import matrix
from imu_tracker.motion.standstill import Rest

REST_CORRELATION_S: Final = 1.0
"""Correlation time of the mean of a second."""


def non_holonomic(eskf: Eskf, period_s: float) -> Measurement:
    """Zero velocity across and, weakly, along the vehicle's vertical.

    Notes
    -----
    v_v = C_vb C_bn v_n. At the rear axle, which does not swing,
    0 = v_y - axle r and 0 = v_z, r the yaw rate. With the errors:
    dv_v = C_vn dv + C_vn [v_n x] theta + mu x v_v.
    """
    C_vn = eskf.C_vn()
    v_n = eskf.nominal.v_n
    ahead, right, down = (C_vn @ v_n).tolist()
    rate = eskf.rate_n[2]
    lateral_mps2 = abs(rate * ahead)
    H = np.zeros((2, N_ERRORS))
    H[:, VELOCITY] = C_vn[1:]
    H[:, ATTITUDE] = (C_vn @ skew(v_n))[1:]
    H[0, MOUNT_YAW] = ahead
    H[1, MOUNT_PITCH] = -ahead
    H[0, AXLE] = -rate
    z = np.array([eskf.axle_m * rate - right, -down])
    slip = SLIP_RAD_PER_MPS2 * lateral_mps2 * ahead
    factor = max(1.0, SLIP_CORRELATION_S / period_s)
    lateral_var = factor * (LATERAL_SIGMA_MPS**2 + slip**2)
    vertical_var = factor * (VERTICAL_RATIO * LATERAL_SIGMA_MPS) ** 2
    R = np.diag([lateral_var, vertical_var])
    return soft_gated(eskf, Measurement(z, H, R))


def zero_velocity(eskf: Eskf, seen: Rest, period_s: float) -> Measurement:
    """Zero velocity and zero rate: the mean rate of a second is the gyro's bias."""
    H = np.zeros((6, N_ERRORS))
    H[0:3, VELOCITY] = np.eye(3)
    H[3:6, GYRO_BIAS] = np.eye(3)
    z = np.concatenate(
        [
            np.negative(eskf.nominal.v_n),
            np.subtract(seen.gyro_radps, eskf.gyro_bias_radps),
        ]
    )
    factor = max(1.0, REST_CORRELATION_S / period_s)
    left_mps = GENTLE_STOP_MPS * math.exp(-seen.duration_s / GENTLE_STOP_S)
    speed_var = factor * (REST_SPEED_SIGMA_MPS + left_mps) ** 2
    shaken_radps = REST_SHAKING_SHARE * seen.gyro_std_radps
    rate_var = factor * (REST_RATE_SIGMA_RADPS**2 + shaken_radps**2)
    return Measurement(z, H, np.diag([speed_var] * 3 + [rate_var] * 3))


def road_slope_prior(eskf: Eskf, sigma_rad: float, period_s: float) -> Measurement:
    """Pseudo-measurement: the vehicle's pitch is 0 within the spread of road slopes.

    Notes
    -----
    sin(pitch) = -C_vn[0, 2] (down component of the forward axis, up positive):
    d(C_vn) = [mu x] C_vn - C_vn [theta x].
    """
    C_vn = eskf.C_vn()
    H = np.zeros((1, N_ERRORS))
    # forward axis in NED: f = C_vn[0]; its down component changes with theta x f.
    fn, fe, _ = C_vn[0].tolist()
    H[0, ATTITUDE] = (fe, -fn, 0.0)
    H[0, MOUNT_PITCH] = C_vn[2, 2]
    H[0, MOUNT_YAW] = -C_vn[1, 2]
    z = np.array([-C_vn[0, 2]])
    factor = max(1.0, SLOPE_CORRELATION_S / period_s)
    return soft_gated(eskf, Measurement(z, H, np.array([[factor * sigma_rad**2]])))


def longitudinal_accel_prior(
    eskf: Eskf, sigma_mps2: float, period_s: float
) -> Measurement:
    """Pseudo-measurement: mean forward acceleration over 1 s is 0 within sigma.

    Notes
    -----
    0 = x . C_vn a_n = x . (C_vb (f_b - b_a) + C_vn g): the attitude counts through
    gravity alone. d(C_vn) = [mu x] C_vn - C_vn [theta x], da_b = -db_a.
    """
    C_vn = eskf.C_vn()
    a_v = C_vn @ np.array(eskf.mean_a_n)
    fn, fe, _ = C_vn[0].tolist()
    H = np.zeros((1, N_ERRORS))
    H[0, ATTITUDE] = (fe * eskf.gravity_mps2, -fn * eskf.gravity_mps2, 0.0)
    H[0, ACCEL_BIAS] = -(C_vn[0] @ matrix(eskf.nominal.q_nb))
    H[0, MOUNT_PITCH], H[0, MOUNT_YAW] = a_v[2], -a_v[1]
    z = np.array([-a_v[0]])
    factor = max(1.0, FORWARD_CORRELATION_S / period_s)
    return soft_gated(eskf, Measurement(z, H, np.array([[factor * sigma_mps2**2]])))


def soft_gated(eskf: Eskf, measured: Measurement) -> Measurement:
    """Inflate R where an innovation lies beyond the soft gate, row by row."""
    z, H, R = measured
    predicted: Array = np.einsum("ij,jk,ik->i", H, eskf.P, H)
    needed = (z / SOFT_GATE_SIGMAS) ** 2 - predicted
    return Measurement(z, H, np.diag(np.maximum(R.diagonal(), needed)))
