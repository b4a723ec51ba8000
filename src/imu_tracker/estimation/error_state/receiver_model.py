"""A fix as a measurement of the errors, and the noise of this receiver.

Easily got wrong: sixty fixes of a minute are not sixty
independent measurements. The lasting part of a receiver's error is a state of the
filter; the rest is white from second to second, at any rate of fixes.
"""

import math
from typing import Final, NamedTuple

import numpy as np

from imu_tracker.estimation.error_state.filter import Eskf, Measurement
from imu_tracker.estimation.error_state.hypotheses.receiver_alone import FixNoise
from imu_tracker.estimation.error_state.states import (
    DELAY,
    N_ERRORS,
    P_D,
    POSITION,
    RECEIVER,
    V_D,
    VELOCITY,
    VELOCITY_DELAY,
    Array,
)
from imu_tracker.estimation.receiver.fix_period import FixPeriod
from imu_tracker.estimation.tuning import (
    ACCEL_OVER_S,
    ALTITUDE_CORRELATION_S,
    ALTITUDE_FACTOR,
    BEST_LASTING_SIGMA_M,
    CATCHING_UP_S,
    HOLDING_S,
    LASTING_VAR_SHARE,
    MAX_NIS_LEVEL,
    MIN_NIS_LEVEL,
    NOISE_LEARNING_S,
    PAUSE_S,
    RESTING_CORRELATION_S,
    SOFT_GATE_NIS,
    VELOCITY_CEILING_MPS,
    VELOCITY_CORRELATION_S,
    VELOCITY_FLOOR_MPS,
    VELOCITY_LATE_S,
    VELOCITY_LEARNING_S,
    VELOCITY_SMEAR_S,
    VELOCITY_START_MPS,
)
from imu_tracker.geometry.geodesy import LocalFrame
from imu_tracker.geometry.rotation import rotate
from imu_tracker.samples import GpsFix, Vec3

RESOLUTION_M: Final = 0.01
TIMING_SIGMA_S: Final = 0.002
"""However good a receiver: its digits, and the time stamps of IMU and host."""


HELD_PLACE_VAR: Final = 5.0**2 * np.eye(2)
HELD_SPEED_VAR: Final = 1.0**2 * np.eye(2)
"""m^2, (m/s)^2: what a receiver that holds its place at rest does not report of a slow
motion, until it has caught up."""


class FixGeometry(NamedTuple):
    """The antenna against the chip, navigation axes."""

    lever_n_m: Vec3
    swing_n_mps: Vec3


class ReceiverModel:
    """Learns a receiver's noise from its innovations.

    Attributes
    ----------
    accel_mps2 : float or None
        Change of its velocity within the last seconds, the larger of two; None: not
        known, or it sends no velocity.
    velocity_var : float, (m/s)^2
    nis_level : float
        Factor on the variance that the receiver claims for its position.
    is_resting : bool
        Whether the IMU shows that the antenna stands still.
    """

    def __init__(self, period: FixPeriod) -> None:
        self._period = period
        self.velocity_var = VELOCITY_START_MPS**2
        self.nis_level = 1.0
        self.is_resting = False
        self.accel_mps2: float | None = None
        self._held: tuple[float, float] | None = None  # place that is repeated
        self._fix_ns = self._held_since_ns = 0
        self._last_held_ns: int | None = None
        self._vel: tuple[int, float, float] | None = None
        self._last_accel_mps2 = 0.0

    @property
    def period_s(self) -> float:
        """Mean time between fixes."""
        return self._period.mean_s

    @property
    def correlation_factor(self) -> float:
        """Fixes that count as one: those of a second, or of a rest."""
        lasts_s = RESTING_CORRELATION_S if self.is_resting else 1.0
        return max(1.0, lasts_s / self.period_s)

    @property
    def velocity_correlation_factor(self) -> float:
        """Velocities that count as one."""
        return max(1.0, VELOCITY_CORRELATION_S / self.period_s)

    @property
    def is_catching_up(self) -> bool:
        """Whether it holds its place, or did some seconds ago, while the body moves."""
        if self._last_held_ns is None or self.is_resting:
            return False
        return self._fix_ns - self._last_held_ns < CATCHING_UP_S * 1e9

    def _add_place(self, fix: GpsFix) -> None:
        place = (fix.lat_rad, fix.lon_rad)
        if place != self._held:
            self._held, self._held_since_ns = place, fix.t_ns
        elif fix.t_ns - self._held_since_ns > HOLDING_S * 1e9:
            self._last_held_ns = fix.t_ns
        self._fix_ns = fix.t_ns

    def add_fix(self, fix: GpsFix) -> None:
        """Learn how often fixes come, and how their place and velocity change."""
        self._period.add_fix(fix)
        self._add_place(fix)
        if fix.vel_ne_mps is None:
            self.accel_mps2 = self._vel = None
            return
        now = (fix.t_ns, *fix.vel_ne_mps)
        if self._vel is None:
            self._vel = now
        dt_s = (now[0] - self._vel[0]) * 1e-9
        if dt_s > PAUSE_S:
            self._vel, self.accel_mps2, self._last_accel_mps2 = now, None, 0.0
        elif dt_s > ACCEL_OVER_S:
            change_mps = math.hypot(now[1] - self._vel[1], now[2] - self._vel[2])
            accel_mps2, before_mps2 = change_mps / dt_s, self._last_accel_mps2
            self.accel_mps2 = max(accel_mps2, before_mps2)
            self._vel, self._last_accel_mps2 = now, accel_mps2

    def lasting_var(self, fix: GpsFix) -> float:
        """Variance of the lasting part of the error."""
        claimed = LASTING_VAR_SHARE * fix.sigma_h_m**2
        return max(claimed * self.nis_level, min(claimed, BEST_LASTING_SIGMA_M**2))

    def noise(self, fix: GpsFix, position: Measurement) -> FixNoise:
        """Noise of a fix for a hypothesis without an IMU.

        Without an IMU a receiver is never taken to be better than it claims.

        Parameters
        ----------
        fix : GpsFix
        position : Measurement
            The same fix for a hypothesis with an IMU.
        """
        lasting_var = max(self.nis_level, 1.0) * fix.sigma_h_m**2
        late_var = (VELOCITY_LATE_S * (self.accel_mps2 or 0.0)) ** 2
        velocity_var = self.velocity_var * self.velocity_correlation_factor
        return FixNoise(float(position.R[0, 0]), velocity_var, lasting_var, late_var)

    def position(
        self,
        eskf: Eskf,
        fix: GpsFix,
        frame: LocalFrame,
        geometry: FixGeometry,
        ahead_s: float,
    ) -> Measurement:
        """Horizontal position.

        Notes
        -----
        z = fix - lever - (p + v (ahead + delay) + b_r);
        H = [I, (ahead + delay) I, ..., I (b_r), v (delay)].
        """
        (pn, pe, _), (vn, ve, _) = eskf.nominal.p_n, eskf.nominal.v_n
        after_s = ahead_s + eskf.delay_s
        north, east = frame.to_ne(fix.lat_rad, fix.lon_rad)
        (ln, le, _), (bn, be) = geometry.lever_n_m, eskf.receiver_ne_m
        z = np.array(
            [north - ln - pn - vn * after_s - bn, east - le - pe - ve * after_s - be]
        )
        H = np.zeros((2, N_ERRORS))
        H[:, POSITION] = np.eye(2, 3)
        H[:, VELOCITY] = after_s * np.eye(2, 3)
        H[:, RECEIVER] = np.eye(2)
        H[:, DELAY] = (vn, ve)
        white = (1.0 - LASTING_VAR_SHARE) * fix.sigma_h_m**2 * self.nis_level
        timing = RESOLUTION_M**2 + TIMING_SIGMA_S**2 * (vn * vn + ve * ve)
        # Carried over a time of which the acceleration is not known exactly.
        carried = (0.5 * max(abs(after_s) - 0.05, 0.0) ** 2) ** 2
        return Measurement(
            z, H, np.eye(2) * (white * self.correlation_factor + timing + carried)
        )

    def velocity(
        self, eskf: Eskf, fix: GpsFix, geometry: FixGeometry, ahead_s: float
    ) -> Measurement | None:
        """Horizontal velocity, with a delay of its own.

        Notes
        -----
        z = fix - swing - (v + a (ahead + velocity_delay)); H = [I (v), a (delay)].
        """
        if fix.vel_ne_mps is None:
            return None
        (vn, ve, _), (an, ae, _) = eskf.nominal.v_n, eskf.a_n
        after_s = ahead_s + eskf.velocity_delay_s
        zn, ze = fix.vel_ne_mps
        un, ue, _ = geometry.swing_n_mps
        z = np.array([zn - un - vn - an * after_s, ze - ue - ve - ae * after_s])
        H = np.zeros((2, N_ERRORS))
        H[:, VELOCITY] = np.eye(2, 3)
        H[:, VELOCITY_DELAY] = (an, ae)
        smeared_var = VELOCITY_SMEAR_S**2 * (an * an + ae * ae)
        variance = self.velocity_var * self.velocity_correlation_factor + smeared_var
        return Measurement(z, H, np.eye(2) * variance)

    def altitude(self, eskf: Eskf, fix: GpsFix, origin_m: float | None) -> Measurement:
        """Height, or without one a vertical velocity of about zero.

        Notes
        -----
        z = origin - altitude - p_d.
        """
        H = np.zeros((1, N_ERRORS))
        if fix.alt_m is None or origin_m is None:
            H[0, V_D] = 1.0
            return Measurement(np.array([-eskf.nominal.v_n[2]]), H, np.eye(1))
        H[0, P_D] = 1.0
        z = np.array([origin_m - fix.alt_m - eskf.nominal.p_n[2]])
        variance = (ALTITUDE_FACTOR * fix.sigma_h_m) ** 2
        factor = max(1.0, ALTITUDE_CORRELATION_S / self.period_s)
        return Measurement(z, H, np.eye(1) * variance * factor)

    def reset_noise(self) -> None:
        """Return to the claimed noise: what was learnt came from a wrong filter."""
        self.nis_level, self.velocity_var = 1.0, VELOCITY_START_MPS**2

    def learn_position_noise(self, nis: float) -> None:
        """Follow how true the receiver's claim is: E[NIS] = 2."""
        forget = min(0.5 * self.period_s / NOISE_LEARNING_S, 0.2)
        level = self.nis_level * (1.0 + forget * (0.5 * min(nis, 25.0) - 1.0))
        self.nis_level = min(max(level, MIN_NIS_LEVEL), MAX_NIS_LEVEL)

    def learn_velocity_noise(self, z: Array, predicted: Array) -> None:
        """Follow the scatter of the velocities: E[z z'] = H P H' + R."""
        scatter = 0.5 * float(z @ z - predicted.trace())
        forget = min(self.period_s / VELOCITY_LEARNING_S, 0.2)
        limited = min(max(scatter, 0.0), SOFT_GATE_NIS * self.velocity_var)
        variance = self.velocity_var + forget * (limited - self.velocity_var)
        self.velocity_var = min(
            max(variance, VELOCITY_FLOOR_MPS**2), VELOCITY_CEILING_MPS**2
        )


def geometry_of(eskf: Eskf, lever_b_m: Vec3, *, has_yaw: bool) -> FixGeometry:
    """Lever arm in navigation axes, and how fast its end moves: rate x lever."""
    if not has_yaw or not any(lever_b_m):
        return FixGeometry((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    lever = rotate(eskf.nominal.q_nb, lever_b_m)
    (wx, wy, wz), (lx, ly, lz) = eskf.rate_n, lever
    swing = (wy * lz - wz * ly, wz * lx - wx * lz, wx * ly - wy * lx)
    return FixGeometry(lever, swing)


def soft_gated(measured: Measurement, S: Array) -> Measurement:
    """A wild velocity weighs little, but never nothing."""
    z, H, R = measured
    nis = float(z @ np.linalg.solve(S, z))
    return (
        measured
        if nis <= SOFT_GATE_NIS
        else Measurement(z, H, R * (nis / SOFT_GATE_NIS))
    )


def soft_gated_1d(measured: Measurement, S: Array) -> Measurement:
    """The same of a single number, beyond 3 sigma."""
    z, H, R = measured
    excess = float(z[0]) ** 2 / SOFT_GATE_NIS - float(S[0, 0])
    return measured if excess <= 0.0 else Measurement(z, H, R + excess)


def log_likelihood(z: Array, S: Array) -> float:
    """Of an innovation under its covariance."""
    (a, b), (_, c) = S.tolist()
    det = a * c - b * b
    nis = float(z @ np.linalg.solve(S, z))
    return -0.5 * (nis + math.log(det)) - math.log(2.0 * math.pi)
