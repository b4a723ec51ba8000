"""What a perfect IMU at the origin of the body reads.

Values are those of the instant, not means over the sample's interval: the chip
low-passes and samples, and at 42 Hz of bandwidth a motion of a few hertz passes
unchanged (the filter's delay is already taken out of `t_ns`). Strapdown by the
trapezoid rule then errs by h^2/12 times the change of jerk, 2e-5 m/s in a car at
100 Hz.
"""

import numpy as np

from imu_tracker.simulation.motion.paths import FloatArray
from imu_tracker.simulation.motion.trajectory import Motion


def attitude_matrix(rpy_rad: FloatArray) -> FloatArray:
    """Direction cosine matrices `C_nb`, shape (n, 3, 3), of roll, pitch and yaw."""
    (sr, sp, sy), (cr, cp, cy) = np.sin(rpy_rad.T), np.cos(rpy_rad.T)
    rows = [
        [cp * cy, sr * sp * cy - cr * sy, cr * sp * cy + sr * sy],
        [cp * sy, sr * sp * sy + cr * cy, cr * sp * sy - sr * cy],
        [-sp, sr * cp, cr * cp],
    ]
    return np.moveaxis(np.array(rows), -1, 0)


def specific_force(motion: Motion, gravity_mps2: float) -> FloatArray:
    """Specific force in body axes, shape (n, 3), m/s^2.

    Notes
    -----
    f_b = C_nb^T (a_n - g_n), with g_n = (0, 0, g).
    """
    f_n = motion.a_n - np.array([0.0, 0.0, gravity_mps2])
    f_b: FloatArray = np.einsum("kij,ki->kj", attitude_matrix(motion.rpy_rad), f_n)
    return f_b


def angular_rate(motion: Motion) -> FloatArray:
    """Angular rate of the body in body axes, shape (n, 3), rad/s.

    Notes
    -----
    w_b = (r' - y' sin p, p' cos r + y' sin r cos p, -p' sin r + y' cos r cos p).
    Source: Groves 2013, equation 2.58.
    """
    roll, pitch, _ = motion.rpy_rad.T
    roll_rate, pitch_rate, yaw_rate = motion.rpy_rate_radps.T
    sr, cr, cp = np.sin(roll), np.cos(roll), np.cos(pitch)
    return np.column_stack(
        [
            roll_rate - yaw_rate * np.sin(pitch),
            pitch_rate * cr + yaw_rate * sr * cp,
            -pitch_rate * sr + yaw_rate * cr * cp,
        ]
    )
