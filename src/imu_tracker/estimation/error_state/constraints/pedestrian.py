"""Pedestrian constraints: in an outage a walker keeps his speed and turns by the gyro.

Steps are too violent for dead reckoning from a pocket, but they are regular. With fixes
the velocity is learnt relative to the box; in an outage it is turned by the gyro and
used as a pseudo-measurement. This needs no heading: the box may lie in any way, and
only turns count.
"""

import math

import numpy as np

from imu_tracker.estimation.error_state.filter import Eskf, Measurement
from imu_tracker.estimation.error_state.states import N_ERRORS, VELOCITY
from imu_tracker.estimation.tuning import (
    GAIT_CORRELATION_S,
    GAIT_DIRECTION_SIGMA_RAD,
    GAIT_LEARNING_S,
    LEAST_GAIT_SCATTER_MPS,
    START_GAIT_SCATTER_MPS,
    START_WALK_MPS,
    WALK_SPEED_CORRELATION_S,
    WALK_SPEED_LEARNING_S,
    WALKING_MPS,
)


class Gait:
    """Learns a walker's velocity relative to the box, and predicts it in an outage."""

    def __init__(self) -> None:
        self._own = (0.0, 0.0)  # velocity, turned back by all turns so far
        self._scatter_var = START_GAIT_SCATTER_MPS**2
        self._speed_square = START_WALK_MPS**2
        self._learnt_s = 0.0

    def learn(
        self,
        v_ne_mps: tuple[float, float],
        turned_rad: float,
        period_s: float,
        *,
        is_stepping: bool,
    ) -> None:
        """Take a stretch of a walk whose velocity is known.

        Parameters
        ----------
        v_ne_mps : (north, east)
        turned_rad : float
            To the right since the start, by the gyro alone.
        period_s : float
        is_stepping : bool
        """
        vn, ve = v_ne_mps
        square = vn * vn + ve * ve
        share = period_s / WALK_SPEED_LEARNING_S
        self._speed_square += share * (square - self._speed_square)
        if square < WALKING_MPS**2 or not is_stepping:
            return
        own = _turned((vn, ve), -turned_rad)
        self._learnt_s += period_s
        share = max(period_s / GAIT_LEARNING_S, period_s / self._learnt_s)
        (a, b), (x, y) = self._own, own
        off_var = 0.5 * ((x - a) ** 2 + (y - b) ** 2)
        self._own = (a + share * (x - a), b + share * (y - b))
        self._scatter_var += period_s / GAIT_LEARNING_S * (off_var - self._scatter_var)

    def speed_bound(self, eskf: Eskf, period_s: float) -> Measurement:
        """Pseudo-measurement: 0 = v within the rms speed of the last minutes."""
        H = np.zeros((2, N_ERRORS))
        H[:, VELOCITY] = np.eye(2, 3)
        z = -np.array(eskf.nominal.v_n[:2])
        factor = max(1.0, WALK_SPEED_CORRELATION_S / period_s)
        variance = max(0.5 * self._speed_square, LEAST_GAIT_SCATTER_MPS**2)
        return Measurement(z, H, np.eye(2) * factor * variance)

    def continued_velocity(
        self, eskf: Eskf, turned_rad: float, outage_s: float, period_s: float
    ) -> Measurement | None:
        """Pseudo-measurement: the learnt velocity, turned by the gyro; None: unknown.

        Notes
        -----
        0 = R(turned) own - v. What the gyro has drifted since goes into R, across.
        """
        if self._learnt_s < GAIT_LEARNING_S:
            return None
        vn, ve = _turned(self._own, turned_rad)
        H = np.zeros((2, N_ERRORS))
        H[:, VELOCITY] = np.eye(2, 3)
        z = np.array([vn, ve]) - eskf.nominal.v_n[:2]
        drift_var = eskf.down_bias[1] * outage_s**2 + GAIT_DIRECTION_SIGMA_RAD**2
        across = np.array([-ve, vn])
        scatter_var = max(self._scatter_var, LEAST_GAIT_SCATTER_MPS**2)
        factor = max(1.0, GAIT_CORRELATION_S / period_s)
        R = factor * (scatter_var * np.eye(2) + drift_var * np.outer(across, across))
        return Measurement(z, H, R)


def _turned(v_ne: tuple[float, float], yaw_rad: float) -> tuple[float, float]:
    north, east = v_ne
    cosine, sine = math.cos(yaw_rad), math.sin(yaw_rad)
    return north * cosine - east * sine, north * sine + east * cosine
