"""Attitude and gyro bias: what the six-state filter rotates its samples with.

A multiplicative Kalman filter on six errors: a small rotation `theta_n` (true =
exp(theta_n) * estimate, navigation axes) and the gyro bias. The gyro predicts;
gravity corrects the tilt, as far as the body's own acceleration is known; the course
over ground corrects the yaw, and rest the bias. Yaw is unknown until a
course was seen: an MPU-6050 has no magnetometer.
"""

import math
from typing import Final, NamedTuple

import numpy as np
from filterpy.kalman import KalmanFilter
from numpy.typing import NDArray

from imu_tracker.estimation.tuning import (
    GYRO_BIAS_SIGMA_RADPS,
    GYRO_DRIFT_PSD,
    SIX_GYRO_NOISE_PSD,
    UNOBSERVED_TURN_RADPS,
    USABLE_YAW_SIGMA_RAD,
)
from imu_tracker.geometry.rotation import (
    IDENTITY,
    from_rotation_vector,
    level_from_gravity,
    matrix,
    multiply,
    normalise,
    to_euler,
    turn_about_down,
    wrap_pi,
)
from imu_tracker.motion.preintegration import ImuStep
from imu_tracker.samples import Quat, Vec3

GYRO_BIAS_VAR: Final = GYRO_BIAS_SIGMA_RADPS**2

UNKNOWN_YAW_SIGMA_RAD: Final = math.pi / math.sqrt(3.0)
"""Of an angle that may be anything."""

TILT_N, TILT_E, YAW = 0, 1, 2  # theta_n, rad
TILT: Final = slice(0, 2)
THETA: Final = slice(0, 3)
BIAS: Final = slice(3, 6)  # of the gyro, body axes, rad/s

_PREDICT_S: Final = 0.2
"""The covariance moves slowly and is predicted at 5 Hz; the attitude at every step."""

_RANDOM_WALKS: Final = np.diag([SIX_GYRO_NOISE_PSD] * 3 + [GYRO_DRIFT_PSD] * 3)
_H_BIAS: Final = np.eye(6)[BIAS]

_LOST_TILT_SIGMA_RAD: Final = 0.5  # beyond, the filter levels again


class AttitudeSnapshot(NamedTuple):
    """All that the filter knows at one instant."""

    q_nb: Quat
    gyro_bias_radps: Vec3
    P: NDArray[np.float64]
    pending_s: float
    is_level: bool
    has_yaw: bool


class AttitudeFilter:
    """Attitude `q_nb`, gyro bias, and how sure they are.

    Attributes
    ----------
    q_nb : Quat
    gyro_bias_radps : Vec3, body axes
    is_level : bool
        Whether gravity was seen; before, `q_nb` means nothing.
    has_yaw : bool
        Whether any course was seen; before, the yaw of `q_nb` means nothing.
    """

    def __init__(self) -> None:
        self._kf = KalmanFilter(dim_x=6, dim_z=3)
        self._kf.x = np.zeros(6)
        self._kf.P = np.diag([UNKNOWN_YAW_SIGMA_RAD**2] * 3 + [GYRO_BIAS_VAR] * 3)
        self.q_nb: Quat = IDENTITY
        self.gyro_bias_radps: Vec3 = (0.0, 0.0, 0.0)
        self.is_level = self.has_yaw = False
        self._pending_s = 0.0

    @property
    def tilt_sigma_rad(self) -> float:
        """Standard deviation of the tilt, about either level axis."""
        P = self._kf.P
        return math.sqrt(0.5 * (P[TILT_N, TILT_N] + P[TILT_E, TILT_E]))

    @property
    def yaw_sigma_rad(self) -> float:
        """Standard deviation of the yaw."""
        return math.sqrt(self._kf.P[YAW, YAW])

    @property
    def gyro_bias_sigma_radps(self) -> float:
        """Standard deviation of the gyro bias, of the worst axis."""
        return math.sqrt(max(self._kf.P.diagonal().tolist()[BIAS]))

    @property
    def is_yaw_usable(self) -> bool:
        """Whether the yaw is known well enough to rotate with."""
        return self.has_yaw and self._kf.P[YAW, YAW] < USABLE_YAW_SIGMA_RAD**2

    @property
    def yaw_rad(self) -> float:
        """Heading of body x, clockwise from north."""
        return to_euler(self.q_nb)[2]

    def start(self, f_b: Vec3, tilt_sigma_rad: float) -> None:
        """Level from a mean specific force.

        Parameters
        ----------
        f_b : Vec3
            Direction of the mean specific force, body axes; any length.
        tilt_sigma_rad : float
            How far it may be from gravity.
        """
        yaw_rad = self.yaw_rad
        self.q_nb = turn_about_down(level_from_gravity(f_b), yaw_rad)
        P = self._kf.P.copy()
        P[TILT, :] = P[:, TILT] = 0.0
        P[TILT_N, TILT_N] = P[TILT_E, TILT_E] = tilt_sigma_rad**2
        self._kf.P = P
        self.is_level = True

    def snapshot(self) -> AttitudeSnapshot:
        """All that is known now; arrays are replaced, never changed in place."""
        return AttitudeSnapshot(
            self.q_nb,
            self.gyro_bias_radps,
            self._kf.P,
            self._pending_s,
            self.is_level,
            self.has_yaw,
        )

    def restore(self, saved: AttitudeSnapshot) -> None:
        """Go back to what was known then."""
        self.q_nb, self.gyro_bias_radps, self._kf.P = saved[:3]
        self._pending_s, self.is_level, self.has_yaw = saved[3:]

    def propagate(self, step: ImuStep) -> None:
        """Turn with the gyro, its bias taken out."""
        tx, ty, tz = step.dtheta_b_rad
        bx, by, bz = self.gyro_bias_radps
        dt = step.dt_s
        turn = from_rotation_vector((tx - bx * dt, ty - by * dt, tz - bz * dt))
        self.q_nb = normalise(multiply(self.q_nb, turn))
        self._pending_s += dt
        if self._pending_s >= _PREDICT_S:
            self._predict_covariance()

    def propagate_gap(self, dt_s: float) -> None:
        """Grow the covariance over a gap of the gyro."""
        self._pending_s += dt_s
        self.inflate(UNOBSERVED_TURN_RADPS * dt_s)

    def inflate(self, angle_rad: float) -> None:
        """Let the attitude be off by so much more about any axis, at one sigma."""
        self._predict_covariance()
        P = self._kf.P + np.diag([angle_rad**2] * 3 + [0.0] * 3)
        # An angle has an end; its correlations shrink with it.
        bound = np.sqrt(np.minimum(1.0, UNKNOWN_YAW_SIGMA_RAD**2 / P.diagonal()[THETA]))
        scale = np.append(bound, np.ones(3))
        self._kf.P = P * np.outer(scale, scale)
        if self.tilt_sigma_rad > _LOST_TILT_SIGMA_RAD:
            self.is_level = False
        if not self.is_yaw_usable:
            self.reset_yaw()

    def reset_yaw(self) -> None:
        """Let the next heading set the yaw outright."""
        self.has_yaw = False

    def _predict_covariance(self) -> None:
        """Predict theta' = theta - C_nb dt b, with random walks on both.

        Source: Sola 2017, arXiv:1711.02508, section 7.
        """
        dt, self._pending_s = self._pending_s, 0.0
        self._kf.F[THETA, BIAS] = -dt * matrix(self.q_nb)
        self._kf.predict(Q=_RANDOM_WALKS * dt)

    def _update(
        self,
        z: NDArray[np.float64],
        H: NDArray[np.float64],
        R: NDArray[np.float64],
    ) -> float:
        """Apply an innovation z = H (theta_n, b), fold the errors in; return NIS."""
        kf = self._kf
        kf.update(z, R=R, H=H)
        tx, ty, tz, bx, by, bz = kf.x.tolist()
        self.q_nb = normalise(multiply(from_rotation_vector((tx, ty, tz)), self.q_nb))
        ox, oy, oz = self.gyro_bias_radps
        self.gyro_bias_radps = (ox + bx, oy + by, oz + bz)
        kf.x = np.zeros(6)
        return float(z @ kf.SI @ z)

    def update_level(
        self, f_n: Vec3, a_ne_mps2: tuple[float, float], sigma_mps2: float
    ) -> float:
        """Correct the tilt by an acceleration that is known otherwise; return NIS.

        Parameters
        ----------
        f_n : Vec3, m/s^2
            Mean specific force as this attitude turns it to navigation axes.
        a_ne_mps2 : (north, east), m/s^2
            The body's acceleration over the same time: from the receiver's velocity,
            or zero at rest.
        sigma_mps2 : float
            How well that is known.

        Notes
        -----
        a = f_n + theta x f_n + g: in the level axes a_N - f_N = theta_E f_D and
        a_E - f_E = -theta_N f_D. What the yaw adds is left out: where the box sits
        turned in the vehicle and the course leads the yaw, a forward acceleration
        would turn it back.
        """
        innovation = np.array([a_ne_mps2[0] - f_n[0], a_ne_mps2[1] - f_n[1]])
        H = np.zeros((2, 6))
        H[0, TILT_E], H[1, TILT_N] = f_n[2], -f_n[2]
        return self._update(innovation, H, np.eye(2) * sigma_mps2**2)

    def update_yaw(self, yaw_rad: float, sigma_rad: float) -> float:
        """Correct the yaw by a heading; return the innovation in radians.

        The first heading sets the yaw outright: until then it was any angle, which
        no Gaussian describes.
        """
        innovation = wrap_pi(yaw_rad - self.yaw_rad)
        if not self.has_yaw:
            self.has_yaw = True
            self.q_nb = turn_about_down(self.q_nb, innovation)
            P = self._kf.P.copy()
            P[YAW, :] = P[:, YAW] = 0.0
            P[YAW, YAW] = sigma_rad**2
            self._kf.P = P
            return innovation
        H = np.zeros((1, 6))
        H[0, YAW] = 1.0
        self._update(np.array([innovation]), H, np.array([[sigma_rad**2]]))
        return innovation

    def update_gyro_bias(self, rest_rate_radps: Vec3, sigma_radps: float) -> None:
        """Correct the gyro bias by what the gyro reads at rest."""
        innovation = np.subtract(rest_rate_radps, self.gyro_bias_radps)
        self._update(innovation, _H_BIAS, np.eye(3) * sigma_radps**2)
