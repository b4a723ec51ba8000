"""The linear algebra of the six-state filter: predict, measure, constrain."""

from typing import Final

import numpy as np
from filterpy.kalman import KalmanFilter
from numpy.typing import NDArray

from imu_tracker.estimation.six_state.constraints import VelocityMeasurement
from imu_tracker.estimation.tuning import SOFT_GATE_NIS
from imu_tracker.samples import Vec3

Array = NDArray[np.float64]

POSITION_NE: Final = slice(0, 2)
DOWN: Final = slice(2, 3)
VELOCITY: Final = slice(3, 6)
VELOCITY_NE: Final = slice(3, 5)
VELOCITY_DOWN: Final = slice(5, 6)

CONSTRAINT_CORRELATION_FACTOR: Final = 5.0
"""Constraints come at 5 Hz, and their errors last about a second."""


class PositionFilter:
    """Kalman filter of position and velocity, driven by acceleration.

    Notes
    -----
    x = (p_n, v_n), u = a_n; A = [[I, dt I], [0, I]], B = [[dt^2/2 I], [dt I]],
    P = A P A' + Q, Q that of white acceleration noise.
    """

    def __init__(self) -> None:
        self._kf = KalmanFilter(dim_x=6, dim_z=2, dim_u=3)
        self._kf.B = np.zeros((6, 3))
        # The diagonals of their 3x3 blocks, as views that are filled at each step.
        self._F_pv = np.einsum("aa->a", self._kf.F[:3, 3:])
        self._B_p, self._B_v = np.einsum("iaa->ia", self._kf.B.reshape(2, 3, 3))
        self._Q_blocks = np.einsum("iaja->ija", self._kf.Q.reshape(2, 3, 2, 3))
        self._kf.x = np.zeros(6)  # one-dimensional: filterpy would broadcast (6, 1)
        self._kf.P = np.eye(6)

    @property
    def x(self) -> Array:
        """Position and velocity, shape (6,); replaced, never changed in place."""
        x: Array = self._kf.x
        return x

    @x.setter
    def x(self, x: Array) -> None:
        self._kf.x = x

    @property
    def P(self) -> Array:
        """Covariance, shape (6, 6); replaced, never changed in place."""
        P: Array = self._kf.P
        return P

    @P.setter
    def P(self, P: Array) -> None:
        self._kf.P = P

    @property
    def v_n(self) -> Vec3:
        """Velocity in m/s."""
        vn, ve, vd = self._kf.x[VELOCITY].tolist()
        return vn, ve, vd

    def predict(self, dt_s: float, a_n_mps2: Vec3, psd: Vec3) -> None:
        """Move on by a mean acceleration, with white noise of (m/s^2)^2/Hz per axis."""
        self._F_pv.fill(dt_s)
        self._B_p.fill(0.5 * dt_s * dt_s)
        self._B_v.fill(dt_s)
        growth = np.array((dt_s**3 / 3.0, dt_s * dt_s / 2.0, dt_s * dt_s / 2.0, dt_s))
        self._Q_blocks[...] = growth.reshape(2, 2, 1) * np.array(psd)
        self._kf.predict(np.array(a_n_mps2))

    def update(self, z: Array, states: slice, variance: float) -> None:
        """Measure some states directly."""
        self._kf.update(z, R=np.eye(len(z)) * variance, H=np.eye(6)[states])

    def update_velocity(self, z: Array, variance: float) -> None:
        """Measure the level velocity; a wild one weighs little, but never nothing."""
        innovation = z - self._kf.x[VELOCITY_NE]
        S = self._kf.P[VELOCITY_NE, VELOCITY_NE] + np.eye(2) * variance
        nis = float(innovation @ np.linalg.solve(S, innovation))
        self.update(z, VELOCITY_NE, variance * max(1.0, nis / SOFT_GATE_NIS))

    def update_constraint(self, measured: VelocityMeasurement) -> None:
        """Apply what the body cannot do."""
        H = np.zeros((len(measured.z), 6))
        H[:, VELOCITY] = measured.H
        z = measured.z + H @ self._kf.x
        self._kf.update(z, R=measured.R * CONSTRAINT_CORRELATION_FACTOR, H=H)
