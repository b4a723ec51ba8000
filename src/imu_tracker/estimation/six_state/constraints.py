"""What a body cannot do, as measurements of its velocity.

Each function returns innovation z, H and R for a velocity in NED; the caller decides
when they are applied.
"""

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from imu_tracker.estimation.tuning import (
    REST_SPEED_SIGMA_MPS,
    SIX_LATERAL_SIGMA_MPS,
    SOFT_GATE_SIGMAS,
)
from imu_tracker.samples import Vec3

LATERAL_LEVER_M: Final = 1.5
"""From the rear axle, which does not slip, forward to the box: turns swing it."""


class VelocityMeasurement(NamedTuple):
    """An innovation `z = H v_error + noise(R)` of the velocity in NED."""

    z: NDArray[np.float64]  # shape (m,), m/s
    H: NDArray[np.float64]  # shape (m, 3)
    R: NDArray[np.float64]  # shape (m, m)


def zero_velocity(v_n: Vec3) -> VelocityMeasurement:
    """Zero velocity."""
    return VelocityMeasurement(
        -np.array(v_n), np.eye(3), np.eye(3) * REST_SPEED_SIGMA_MPS**2
    )


def non_holonomic(
    v_n: Vec3,
    P_v: NDArray[np.float64],
    yaw_rad: float,
    yaw_sigma_rad: float,
    yaw_rate_radps: float,
) -> VelocityMeasurement:
    """Zero velocity across the heading, for what rolls on wheels.

    Parameters
    ----------
    v_n : Vec3, m/s
    P_v : ndarray, shape (3, 3), (m/s)^2
        Covariance of v_n.
    yaw_rad, yaw_sigma_rad : float
        Direction of travel, and how well it is known.
    yaw_rate_radps : float
        Turning swings the box, which sits ahead of the axle that does not slip.

    Notes
    -----
    0 = -sin(yaw) v_N + cos(yaw) v_E. An innovation beyond three sigma inflates R
    to meet it: a slide is followed, not forced to zero.
    """
    sine, cosine = math.sin(yaw_rad), math.cos(yaw_rad)
    speed = math.hypot(v_n[0], v_n[1])
    H = np.array([[-sine, cosine, 0.0]])
    z = sine * v_n[0] - cosine * v_n[1]
    variance = (
        SIX_LATERAL_SIGMA_MPS**2
        + (LATERAL_LEVER_M * yaw_rate_radps) ** 2
        + (speed * yaw_sigma_rad) ** 2
    )
    predicted = float((H @ P_v @ H.T)[0, 0])
    variance = max(variance, (z / SOFT_GATE_SIGMAS) ** 2 - predicted)
    return VelocityMeasurement(np.array([z]), H, np.array([[variance]]))
