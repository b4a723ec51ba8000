"""Heading without a magnetometer: hypotheses, each tested against the receiver.

An accelerometer that is level knows how the body accelerates, but not where north is.
Twelve small filters each assume another direction, rotate the same accelerations by it,
and compare the way and the speed that follow with the receiver's. After some seconds
of speeding up, braking or turning one direction is left. Positions alone are enough;
the way the box is turned in its vehicle does not matter.

The fact that a newcomer gets wrong: course is not heading. A box may lie turned, a car
may reverse, a walker carries it in a pocket; only accelerations tell.

Source: the idea is PX4's EKF-GSF yaw estimator; here a step of the filters spans the
time between two fixes, which costs a hundredth.
"""

import math
from typing import Final

import numpy as np

from imu_tracker.estimation.error_state.states import Array
from imu_tracker.estimation.tuning import GYRO_DRIFT_PSD

N_HYPOTHESES: Final = 12
"""30 degrees apart: each filter is linear over the 15 to its border."""

ACCEL_SIGMA_MPS2: Final = 0.3
ACCEL_CORRELATION_S: Final = 1.0
"""Error of the acceleration beside that of the levelling: vibration, scale."""

LEVELLING_CORRELATION_S: Final = 2.0
"""An error of the levelling turns with the body: white over longer than that."""

CONVERGED_SIGMA_RAD: Final = math.radians(20.0)
"""So well a filter that is linear about its heading can begin with it."""

CONTRADICTED_RAD: Final = math.radians(35.0)
"""How far the bank must differ before it is used: delay and tilt make it err by 10
degrees."""

GUESS_SIGMA_RAD: Final = math.radians(30.0)
"""A bank less sure than this says nothing."""

FELT_SIGMAS: Final = 3.0
UNFELT_MPS2: Final = 0.5
"""Accelerations that are no larger than what levelling may be wrong by tell nothing,
and the body may go as it likes by so much."""

YAW_NOISE_PSD: Final = math.radians(0.3) ** 2
"""rad^2/s: scale and cross-axis sensitivity in turns, and shaking."""

RESPAWN_S: Final = 120.0
"""After so long all hypotheses have become the same one, and could not contradict."""

DOUBTED_SHARE: Final = 0.2
"""Probability that an answer is wrong altogether: a receiver that follows late."""

N_STATES: Final = 6

_LEAST_LOG_WEIGHT: Final = -30.0


class YawBank:
    """What must be added to the yaw of an attitude to make it true.

    Notes
    -----
    Each hypothesis has the state (p_n, p_e, v_n, v_e, yaw, b), b the gyro's bias about
    down. Over the time dt between two fixes, with dp and dv what the level
    accelerations add in the frame of the attitude, whose filter believes in a bias b_0:
    p' = p + v dt + R(yaw) dp, v' = v + R(yaw) dv, yaw' = yaw - (b - b_0) dt.
    """

    def __init__(self) -> None:
        self._x = np.zeros((N_HYPOTHESES, N_STATES))
        self._P = np.zeros((N_HYPOTHESES, N_STATES, N_STATES))
        self._log_w = np.zeros(N_HYPOTHESES)
        self._dt = 0.0
        self._dv = [0.0, 0.0]
        self._dp = [0.0, 0.0]
        self.age_s = math.inf  # not begun

    def reset(self) -> None:
        """Begin anew with the next fix."""
        self.age_s = math.inf

    def rotate_yaw(self, yaw_rad: float) -> None:
        """Follow a turn of the attitude by this angle."""
        self._x[:, 4] -= yaw_rad

    def shift_origin(self, north_m: float, east_m: float) -> None:
        """Follow a move of the origin of positions."""
        self._x[:, 0] -= north_m
        self._x[:, 1] -= east_m

    def add_stretch(self, dt_s: float, dv_ne_mps: tuple[float, float]) -> None:
        """Sum a stretch of level acceleration."""
        for i in (0, 1):
            self._dp[i] += (self._dv[i] + 0.5 * dv_ne_mps[i]) * dt_s
            self._dv[i] += dv_ne_mps[i]
        self._dt += dt_s

    def update(
        self,
        z_p: Array,
        position_var: float,
        z_v: Array | None,
        velocity_var: float,
        delay_var: float,
        accel_var: float,
        bias: tuple[float, float],
    ) -> None:
        """Take a fix: predict over the time since the last one, and compare.

        Parameters
        ----------
        z_p, z_v : ndarray, shape (2,), m and m/s
            Position and velocity, north and east.
        position_var, velocity_var : float
        delay_var : float, s^2
            Of the instant that the fix describes: accelerations are prompt.
        accel_var : float, (m/s^2)^2
            Of the level accelerations, per axis: what tilt and bias do together.
        bias : (float, float)
            What its filter believes of the gyro's bias about down, and the variance of
            that, rad/s and (rad/s)^2.
        """
        dt, dv, dp = self._dt, np.array(self._dv), np.array(self._dp)
        self._dt, self._dv, self._dp = 0.0, [0.0, 0.0], [0.0, 0.0]
        if dv @ dv < (FELT_SIGMAS * dt) ** 2 * accel_var:
            # An error of the levelling, the same again and again, is no evidence.
            dv, dp, accel_var = np.zeros(2), np.zeros(2), UNFELT_MPS2**2
        if self._is_worn_out or dt > 10.0:
            self._begin(z_p, position_var, z_v, velocity_var, bias)
            return
        self.age_s += dt
        late_var = delay_var * float(dv @ dv)
        self._predict(dt, dv, dp, accel_var, bias[0])
        self._compare(0, z_p, position_var + late_var)
        if z_v is not None:
            self._compare(2, z_v, velocity_var + late_var / max(dt, 0.1) ** 2)
        if bias[1] < self._P[:, 5, 5].min():
            self._measure_bias(*bias)  # a rest has shown it
        self._log_w = np.maximum(self._log_w - self._log_w.max(), _LEAST_LOG_WEIGHT)

    @property
    def _is_worn_out(self) -> bool:
        """Whether all hypotheses have become one."""
        return math.isinf(self.age_s) or (
            self.age_s > RESPAWN_S and self.yaw()[1] < CONVERGED_SIGMA_RAD
        )

    def _begin(
        self,
        z_p: Array,
        position_var: float,
        z_v: Array | None,
        velocity_var: float,
        bias: tuple[float, float],
    ) -> None:
        self.age_s = 0.0
        self._log_w[:] = 0.0
        self._x[:] = 0.0
        self._x[:, :2] = z_p
        spacing = 2.0 * math.pi / N_HYPOTHESES
        self._x[:, 4] = np.arange(N_HYPOTHESES) * spacing
        self._x[:, 5] = bias[0]
        speed_var = 400.0
        if z_v is not None:
            self._x[:, 2:4] = z_v
            speed_var = velocity_var
        self._P[:] = np.diag(
            [position_var] * 2 + [speed_var] * 2 + [(0.5 * spacing) ** 2, bias[1]]
        )

    def _predict(
        self, dt: float, dv: Array, dp: Array, accel_var: float, bias_radps: float
    ) -> None:
        x, n = self._x, N_HYPOTHESES
        cosine, sine = np.cos(x[:, 4]), np.sin(x[:, 4])
        R = np.stack([cosine, -sine, sine, cosine], axis=1).reshape(n, 2, 2)
        R_rate = np.stack([-sine, -cosine, cosine, -sine], axis=1).reshape(n, 2, 2)
        F = np.tile(np.eye(N_STATES), (n, 1, 1))
        F[:, 0, 2] = F[:, 1, 3] = dt
        F[:, 4, 5] = -dt
        F[:, 0:2, 4] = R_rate @ dp
        F[:, 2:4, 4] = R_rate @ dv
        x[:, :2] += x[:, 2:4] * dt + R @ dp
        x[:, 2:4] += R @ dv
        x[:, 4] -= (x[:, 5] - bias_radps) * dt
        psd = (
            ACCEL_SIGMA_MPS2**2 * ACCEL_CORRELATION_S
            + LEVELLING_CORRELATION_S * accel_var
        )
        q = np.diag(
            [psd * dt**3 / 3.0] * 2
            + [psd * dt] * 2
            + [YAW_NOISE_PSD * dt, GYRO_DRIFT_PSD * dt]
        )
        q[0, 2] = q[2, 0] = q[1, 3] = q[3, 1] = psd * dt**2 / 2.0
        self._P = F @ self._P @ F.transpose(0, 2, 1) + q

    def _compare(self, first: int, z: Array, variance: float) -> None:
        """Update each hypothesis by two of its states, and its weight."""
        x, P, two = self._x, self._P, slice(first, first + 2)
        innovation = z - x[:, two]
        S = P[:, two, two] + np.eye(2) * variance
        SI = np.linalg.inv(S)
        K = P[:, :, two] @ SI
        nis = np.einsum("ni,nij,nj->n", innovation, SI, innovation)
        self._x = x + np.einsum("nij,nj->ni", K, innovation)
        P = P - K @ P[:, two, :]
        self._P = 0.5 * (P + P.transpose(0, 2, 1))
        # One wild fix must not decide.
        self._log_w += -0.5 * (np.minimum(nis, 16.0) + np.log(np.linalg.det(S)))

    def _measure_bias(self, bias_radps: float, variance: float) -> None:
        """Take over what the attitude's filter knows of the bias."""
        gain = self._P[:, :, 5] / (self._P[:, 5, 5] + variance)[:, None]
        self._x = self._x + gain * (bias_radps - self._x[:, 5])[:, None]
        P = self._P - gain[:, :, None] * self._P[:, None, 5, :]
        self._P = 0.5 * (P + P.transpose(0, 2, 1))

    def log_density(self, yaw_rad: float) -> float:
        """Log of the probability density of a yaw, 1/rad; uniform when not begun.

        A part of it is uniform: the small filters are surer than they may be.
        """
        uniform = 0.5 / math.pi
        if math.isinf(self.age_s):
            return math.log(uniform)
        w = np.exp(self._log_w - self._log_w.max())
        w /= w.sum()
        away = np.mod(yaw_rad - self._x[:, 4] + math.pi, 2.0 * math.pi) - math.pi
        variance = self._P[:, 4, 4] + CONVERGED_SIGMA_RAD**2
        each = np.exp(-0.5 * away**2 / variance) / np.sqrt(2.0 * math.pi * variance)
        density = (1.0 - DOUBTED_SHARE) * float(w @ each) + DOUBTED_SHARE * uniform
        return math.log(density)

    def yaw(self) -> tuple[float, float]:
        """Mean of the yaw and its standard deviation, radians."""
        if math.isinf(self.age_s):
            return 0.0, math.pi
        w = np.exp(self._log_w - self._log_w.max())
        w /= w.sum()
        yaw = self._x[:, 4]
        mean = math.atan2(float(w @ np.sin(yaw)), float(w @ np.cos(yaw)))
        away = np.mod(yaw - mean + math.pi, 2.0 * math.pi) - math.pi
        variance = float(w @ (self._P[:, 4, 4] + away**2))
        return mean, math.sqrt(variance)

    def contradiction(self) -> tuple[float, float] | None:
        """Return `yaw()` if it differs from zero beyond its sigma and its errors."""
        yaw_rad, sigma_rad = self.yaw()
        if sigma_rad >= GUESS_SIGMA_RAD:
            return None
        is_beyond = abs(yaw_rad) > CONTRADICTED_RAD + 2.0 * sigma_rad
        return (yaw_rad, sigma_rad) if is_beyond else None
