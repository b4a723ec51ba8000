"""The Kalman filter of the errors of a strapdown solution.

`Eskf` integrates steps (`propagate`), grows the covariance (`predict`), and corrects
the solution by measurements (`update`). What is measured, and when, is decided
elsewhere.
"""

import math
from copy import copy
from operator import add
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from imu_tracker.estimation.error_state.kalman import predicted, updated
from imu_tracker.estimation.error_state.mechanisation import (
    NO_GAIN,
    Nominal,
    Strapdown,
)
from imu_tracker.estimation.error_state.smoothing.kept import Kept
from imu_tracker.estimation.error_state.states import (
    ACCEL_BIAS,
    ACCEL_NOISE_PSD,
    ATTITUDE,
    AXLE,
    DELAY,
    GYRO_BIAS,
    GYRO_GAIN,
    GYRO_NOISE_PSD,
    MOTION,
    MOUNT_PITCH,
    MOUNT_YAW,
    MOUNTING,
    N_ERRORS,
    ORIENTATION,
    P_D,
    P_E,
    P_N,
    RECEIVER,
    RECEIVER_E,
    RECEIVER_N,
    SHAKEN_S,
    TILT,
    V_D,
    V_E,
    V_N,
    VELOCITY_DELAY,
    WHEEL_SCALE,
    Array,
    NoiseLevel,
    process_noise,
    skew,
    start_covariance,
    transition,
)
from imu_tracker.estimation.tuning import RECEIVER_CORRELATION_S, SHRINK_VAR_RATIO
from imu_tracker.geometry.rotation import (
    IDENTITY,
    conjugate,
    from_rotation_vector,
    matrix,
    multiply,
    normalise,
)
from imu_tracker.samples import Quat

START_AXLE_M: Final = 1.2
"""A box on the dashboard sits 1.8 m ahead of the rear axle, one in the boot behind."""


_DOUBTED_TILT_RAD: Final = math.radians(3.0)  # half a m/s^2 taken for gravity


class Measurement(NamedTuple):
    """An innovation `z = H errors + noise(R)`."""

    z: Array  # shape (m,)
    H: Array  # shape (m, 32)
    R: Array  # shape (m, m)


class Eskf(Strapdown, Kept):
    """Position, velocity, attitude, and the parameters that distort them.

    Parameters
    ----------
    noise : NoiseLevel
    is_vehicle : bool
        Whether the mounting is learnt.

    Attributes
    ----------
    q_vb : Quat
        Mounting: takes the box's axes to the vehicle's.
    receiver_ne_m : (north, east), m
        Lasting error of the receiver.
    delay_s, velocity_delay_s, axle_m, wheel_scale : float
        As their errors in `states`.
    receiver_var : float, m^2
        Of the receiver's lasting error, per axis.
    P : ndarray, shape (32, 32)
    """

    def __init__(self, noise: NoiseLevel, *, is_vehicle: bool) -> None:
        super().__init__()
        self.noise = noise
        self._is_vehicle = is_vehicle
        self.P = start_covariance(is_vehicle=is_vehicle)
        self.q_vb: Quat = IDENTITY
        self.receiver_ne_m = (0.0, 0.0)
        self.receiver_var = 4.0
        self.delay_s = self.velocity_delay_s = self.wheel_scale = 0.0
        self.axle_m = START_AXLE_M
        self._granted_var, self._granted_ns = 0.0, 0

    def clone(self, noise: NoiseLevel) -> "Eskf":
        """Copy with another noise level; arrays are replaced, never changed."""
        other = copy(self)
        other.noise = noise
        return other

    def set_variances(self, where: slice | int, variances: ArrayLike) -> None:
        """Make some errors known so well, and independent of all others."""
        if isinstance(where, int):
            where = slice(where, where + 1)
        P = self.P.copy()
        P[where, :] = P[:, where] = 0.0
        P[where, where] = np.diag(np.atleast_1d(variances))
        self.P = P
        self.note_reset(where)

    def set_vehicle(self, *, is_vehicle: bool) -> None:
        """Begin, or cease, to learn a mounting."""
        self._is_vehicle = is_vehicle
        fresh = start_covariance(is_vehicle=is_vehicle).diagonal()
        self.set_variances(MOUNTING, fresh[MOUNTING])

    @property
    def level_accel_var(self) -> float:
        """Variance per axis of the level acceleration at rest, (m/s^2)^2.

        Notes
        -----
        da_n = -[f_n x] theta - C_nb db_a: without turns tilt and bias cannot be
        separated, but their sum is well known.
        """
        H = np.zeros((2, N_ERRORS))
        H[:, ATTITUDE] = skew((0.0, 0.0, self.gravity_mps2))[:2]
        H[:, ACCEL_BIAS] = -matrix(self.nominal.q_nb)[:2]
        return 0.5 * float(np.trace(H @ self.P @ H.T))

    @property
    def down_bias(self) -> tuple[float, float]:
        """Gyro bias about down, rad/s, and its variance."""
        down_b = matrix(self.nominal.q_nb)[2]
        variance = float(down_b @ self.P[GYRO_BIAS, GYRO_BIAS] @ down_b)
        return float(down_b @ np.array(self.gyro_bias_radps)), variance

    def turn_mounting_half(self) -> None:
        """Exchange the vehicle's front and back; the attitude stays.

        Notes
        -----
        C_vb' = Rz(pi) C_vb: x and y of the vehicle change their signs, and with them
        the errors of the mounting's pitch and of the way to the rear axle.
        """
        self.q_vb = multiply((0.0, 0.0, 0.0, 1.0), self.q_vb)
        self.axle_m = -self.axle_m
        T = np.eye(N_ERRORS)
        T[MOUNT_PITCH, MOUNT_PITCH] = T[AXLE, AXLE] = -1.0
        self.transform(T)

    def inflate_orientation(self, yaw_sigma_rad: float, *, is_vehicle: bool) -> None:
        """Keep the attitude, but inflate it and all that was learnt through it."""
        fresh = start_covariance(is_vehicle=is_vehicle).diagonal()
        tilt_var = max(_DOUBTED_TILT_RAD**2, *self.P.diagonal()[TILT])
        for where in (ACCEL_BIAS, MOUNTING, GYRO_GAIN, AXLE):
            self.set_variances(where, fresh[where])
        self.set_variances(ATTITUDE, [tilt_var, tilt_var, yaw_sigma_rad**2])
        self.accel_bias_mps2 = (0.0, 0.0, 0.0)
        self.gyro_gain, self.axle_m = NO_GAIN, START_AXLE_M

    def predict(self, *, use_force: bool, unknown_accel_psd: float = 0.0) -> None:
        """Let the errors grow over the stretch since the last prediction."""
        dt = self._dt
        if dt <= 0.0:
            return
        level = self.noise
        gyro_psd = GYRO_NOISE_PSD + (
            level.gyro_share**2 * self._gyro_scatter_var * SHAKEN_S
        )
        accel_psd = ACCEL_NOISE_PSD + (
            level.accel_share**2 * self._accel_scatter_var * SHAKEN_S
        )
        moved = self.nominal.q_nb, dt, self._dv_n, self._turn_n
        F = transition(*moved)
        if not use_force:
            F[MOTION, ORIENTATION] = 0.0
        Q = process_noise(
            dt,
            gyro_psd,
            accel_psd + unknown_accel_psd,
            self.receiver_var,
            is_vehicle=self._is_vehicle,
        )
        self.P = predicted(self.P, F, Q)
        self.note_prediction(*moved, use_force=use_force)
        north, east = self.receiver_ne_m
        decay = float(F[RECEIVER_N, RECEIVER_N])
        self.receiver_ne_m = (north * decay, east * decay)
        self._end_interval()

    def innovation_covariance(self, measured: Measurement) -> Array:
        """S = H P H' + R."""
        S: Array = measured.H @ self.P @ measured.H.T + measured.R
        return S

    def update(self, measured: Measurement) -> None:
        """Fold a measurement into the solution."""
        self.note_correction(self.P, *measured)
        errors, self.P = updated(self.P, *measured)
        self._inject(errors)

    def _inject(self, x: Array) -> None:
        """Add the errors to the solution."""
        e = x.tolist()
        t_ns, p_n, v_n, q_nb = self.nominal
        self.nominal = Nominal(
            t_ns,
            (p_n[0] + e[P_N], p_n[1] + e[P_E], p_n[2] + e[P_D]),
            (v_n[0] + e[V_N], v_n[1] + e[V_E], v_n[2] + e[V_D]),
            normalise(multiply(from_rotation_vector(tuple(e[ATTITUDE])), q_nb)),
        )
        bx, by, bz = map(add, self.gyro_bias_radps, e[GYRO_BIAS])
        self.gyro_bias_radps = (bx, by, bz)
        bx, by, bz = map(add, self.accel_bias_mps2, e[ACCEL_BIAS])
        self.accel_bias_mps2 = (bx, by, bz)
        mounting = from_rotation_vector((0.0, e[MOUNT_PITCH], e[MOUNT_YAW]))
        self.q_vb = normalise(multiply(mounting, self.q_vb))
        north, east = self.receiver_ne_m
        self.receiver_ne_m = (north + e[RECEIVER_N], east + e[RECEIVER_E])
        self.delay_s += e[DELAY]
        self.velocity_delay_s += e[VELOCITY_DELAY]
        xx, yx, zx, xy, yy, zy, xz, yz, zz = map(add, self.gyro_gain, e[GYRO_GAIN])
        self.gyro_gain = (xx, yx, zx, xy, yy, zy, xz, yz, zz)
        self.axle_m += e[AXLE]
        self.wheel_scale += e[WHEEL_SCALE]

    def C_vn(self) -> Array:
        """Matrix from navigation to vehicle axes."""
        return matrix(multiply(self.q_vb, conjugate(self.nominal.q_nb)))

    def sigma(self, i: int) -> float:
        """Standard deviation of an error."""
        return math.sqrt(max(float(self.P[i, i]), 0.0))

    def set_receiver_var(self, variance: float) -> None:
        """Let the receiver's lasting error be as large as it is found to be now.

        Notes
        -----
        What was learnt of position and lasting error b_r against a receiver that is
        worse than it was taken to be is worth less, and only their sum is known: the
        growth is (-1, 1) (-1, 1)' in (p, b_r). A variance that comes and goes is
        granted once, until the errors of that time are over.
        """
        elapsed_s = max(self.nominal.t_ns - self._granted_ns, 0) * 1e-9
        kept = math.exp(-elapsed_s / RECEIVER_CORRELATION_S)
        over = max(self._granted_var - self.receiver_var, 0.0)
        before = self.receiver_var + kept * over
        self._granted_var, self._granted_ns = max(before, variance), self.nominal.t_ns
        self.receiver_var = variance
        P = self.P
        variances = P.diagonal()[RECEIVER]
        mean = 0.5 * float(variances.sum())
        growth = min((variance / before - 1.0) * mean, variance - mean)
        if growth > 0.0:
            P = P.copy()
            for p, b in ((P_N, RECEIVER_N), (P_E, RECEIVER_E)):
                P[p, p] += growth
                P[b, b] += growth
                P[p, b] -= growth
                P[b, p] -= growth
            self.P = P
            return
        worst = max(variances)
        if worst > SHRINK_VAR_RATIO * variance > 0.0:
            shrink = math.sqrt(variance / worst)
            P = P.copy()
            P[RECEIVER, :] *= shrink
            P[:, RECEIVER] *= shrink
            self.P = P
            north, east = self.receiver_ne_m
            self.receiver_ne_m = (north * shrink, east * shrink)
            self.note_scaling(slice(17, 19), shrink)
