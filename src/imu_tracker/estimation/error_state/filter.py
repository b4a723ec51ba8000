"""A strapdown solution, and the Kalman filter of its errors.

`Eskf` integrates steps (`propagate`), lets the errors grow (`predict`), and folds
measurements in (`apply`). What is measured, when, and whether it is believed is
decided elsewhere.
"""

import math
from copy import copy
from operator import add
from typing import Final, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from imu_tracker.estimation.error_state.kalman import predicted, updated
from imu_tracker.estimation.error_state.states import (
    ACCEL_BIAS,
    ACCEL_NOISE_PSD,
    ATTITUDE,
    AXLE,
    DELAY,
    DELAYS,
    GYRO_BIAS,
    GYRO_GAIN,
    GYRO_NOISE_PSD,
    MOUNT_PITCH,
    MOUNT_YAW,
    MOUNTING,
    N_ERRORS,
    RECEIVER_CORRELATION_S,
    SHAKEN_S,
    TILT,
    VELOCITY_DELAY,
    WHEEL_SCALE,
    Array,
    NoiseLevel,
    process_noise,
    skew,
    start_covariance,
    transition,
)
from imu_tracker.geometry.rotation import (
    IDENTITY,
    conjugate,
    from_rotation_vector,
    matrix,
    multiply,
    normalise,
    rotate,
)
from imu_tracker.motion.preintegration import ImuStep
from imu_tracker.samples import Quat, Vec3

START_AXLE_M: Final = 1.2
"""A box on the dashboard sits 1.8 m ahead of the rear axle, one in the boot behind."""

MUCH_LARGER: Final = 2.0
"""Of variances: a receiver's noise is found to a quarter, and wavers by as much. Were
the lasting error shrunk each time, and grown again in a minute, it would always be
too small."""

_ZERO: Final[Vec3] = (0.0, 0.0, 0.0)
_DOUBTED_TILT_RAD: Final = math.radians(3.0)  # half a m/s^2 taken for gravity
_SHAKING_MEMORY_S: Final = 1.0  # roads change within a second, not within a step


GyroGain: TypeAlias = tuple[
    float, float, float, float, float, float, float, float, float
]
NO_GAIN: Final[GyroGain] = (0.0,) * 9


class Measurement(NamedTuple):
    """An innovation `z = H errors + noise(R)`."""

    z: Array  # shape (m,)
    H: Array  # shape (m, 32)
    R: Array  # shape (m, m)


class Nominal(NamedTuple):
    """Where the body is, how it moves and how it lies, at one instant."""

    t_ns: int
    p_n: Vec3
    v_n: Vec3
    q_nb: Quat


class Eskf:
    """Position, velocity, attitude and all that bends them.

    Parameters
    ----------
    noise : NoiseLevel
    is_vehicle : bool
        Whether the mounting is learnt.

    Attributes
    ----------
    nominal : Nominal
    gyro_bias_radps, accel_bias_mps2 : Vec3, body axes
    q_vb : Quat
        Mounting: takes the box's axes to the vehicle's.
    receiver_ne_m : (north, east), m
        Lasting error of the receiver.
    delay_s, velocity_delay_s : float
        A fix describes so much later than its nominal instant.
    gyro_gain : tuple of 9 floats
        What the gyro misses of a rate, M column by column: scale, and what crosses
        over.
    axle_m : float
    wheel_scale : float
        Wheels are larger by this share than where the scale began.
    a_n, rate_n : Vec3
        Acceleration and rate of the last stretch; zero where nothing was felt.
    receiver_var : float, m^2
        Of the receiver's lasting error, per axis.
    P : ndarray, shape (32, 32)
    """

    def __init__(self, noise: NoiseLevel, *, is_vehicle: bool) -> None:
        self.noise = noise
        self._is_vehicle = is_vehicle
        self.P = start_covariance(is_vehicle=is_vehicle)
        self.nominal = Nominal(0, _ZERO, _ZERO, IDENTITY)
        self.gravity_mps2 = 9.81
        self.gyro_bias_radps: Vec3 = _ZERO
        self.accel_bias_mps2: Vec3 = _ZERO
        self.q_vb: Quat = IDENTITY
        self.receiver_ne_m = (0.0, 0.0)
        self.receiver_var = 4.0
        self.delay_s = self.velocity_delay_s = 0.0
        self.gyro_gain: GyroGain = NO_GAIN
        self.axle_m = START_AXLE_M
        self.wheel_scale = 0.0
        self.a_n: Vec3 = _ZERO  # mean of the last stretch
        self.rate_n: Vec3 = _ZERO
        self._mean_f_b: Vec3 = _ZERO  # force of the last second, as it was read
        self._granted_var, self._granted_ns = 0.0, 0
        self._dt = self._felt_s = 0.0
        self._dv_n: Vec3 = _ZERO
        self._dv_b: Vec3 = _ZERO
        self._turn_n: Vec3 = _ZERO
        self._gyro_scatter_var = self._accel_scatter_var = 0.0

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
        da_n = -[f_n x] theta - C_nb db_a: a body that does not turn cannot tell its
        tilt from its bias, but knows well what they do together.
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

    @property
    def mean_a_n(self) -> Vec3:
        """Acceleration of the last second, by the attitude and the bias of now."""
        (x, y, z), (bx, by, bz) = self._mean_f_b, self.accel_bias_mps2
        an, ae, ad = rotate(self.nominal.q_nb, (x - bx, y - by, z - bz))
        return (an, ae, ad + self.gravity_mps2)

    # ------------------------------------------------------------------ strapdown

    def advanced(self, start: Nominal, step: ImuStep, *, use_force: bool) -> Nominal:
        """Strapdown over a step; `use_force` unless the yaw is unknown.

        Notes
        -----
        v' = v + C_nb (dv_b - b_a dt) + g dt, p' = p + (v + v') / 2 dt,
        q' = q exp((I + M) (dtheta_b - b_g dt)).
        """
        dt = step.dt_s
        _, (pn, pe, pd), (vn, ve, vd), q_nb = start
        if step.is_gap:
            p_n = (pn + vn * dt, pe + ve * dt, pd + vd * dt)
            return Nominal(step.t_ns, p_n, start.v_n, q_nb)
        if use_force:
            dvn, dve, dvd = self._force(q_nb, step)
            dvd += self.gravity_mps2 * dt
        else:
            dvn = dve = dvd = 0.0
        half = 0.5 * dt
        p_n = (
            pn + (vn + 0.5 * dvn) * dt,
            pe + (ve + 0.5 * dve) * dt,
            pd + vd * dt + dvd * half,
        )
        q_nb = multiply(q_nb, from_rotation_vector(self._turn_b(step)))
        return Nominal(step.t_ns, p_n, (vn + dvn, ve + dve, vd + dvd), normalise(q_nb))

    def _force(self, q_nb: Quat, step: ImuStep) -> Vec3:
        (x, y, z), (bx, by, bz), dt = step.dv_b_mps, self.accel_bias_mps2, step.dt_s
        return rotate(q_nb, (x - bx * dt, y - by * dt, z - bz * dt))

    def _turn_b(self, step: ImuStep) -> Vec3:
        (x, y, z), (bx, by, bz), dt = step.dtheta_b_rad, self.gyro_bias_radps, step.dt_s
        x, y, z = x - bx * dt, y - by * dt, z - bz * dt
        xx, yx, zx, xy, yy, zy, xz, yz, zz = self.gyro_gain
        return (
            x + xx * x + xy * y + xz * z,
            y + yx * x + yy * y + yz * z,
            z + zx * x + zy * y + zz * z,
        )

    def propagate(self, step: ImuStep, *, use_force: bool) -> None:
        """Move the solution on by a step, and remember what the errors need."""
        start = self.nominal
        self.nominal = self.advanced(start, step, use_force=use_force)
        dt = step.dt_s
        self._dt += dt
        if step.is_gap:
            return
        self._felt_s += dt
        fx, fy, fz = self._force(start.q_nb, step)
        x, y, z = self._dv_n
        self._dv_n = (x + fx, y + fy, z + fz)
        (x, y, z), (fx, fy, fz) = self._dv_b, step.dv_b_mps
        self._dv_b = (x + fx, y + fy, z + fz)
        tx, ty, tz = rotate(start.q_nb, self._turn_b(step))
        x, y, z = self._turn_n
        self._turn_n = (x + tx, y + ty, z + tz)
        forget = min(dt / _SHAKING_MEMORY_S, 1.0)
        self._gyro_scatter_var += forget * (
            _scatter(step.n_samples, step.gyro_sum_radps, step.gyro_sq_sum)
            - self._gyro_scatter_var
        )
        self._accel_scatter_var += forget * (
            _scatter(step.n_samples, step.accel_sum_mps2, step.accel_sq_sum)
            - self._accel_scatter_var
        )

    @property
    def stretch(self) -> tuple[Vec3, float]:
        """Level acceleration summed since the last prediction, and its time."""
        x, y, z = self._dv_n
        return (x, y, z + self.gravity_mps2 * self._dt), self._dt

    # --------------------------------------------------------------------- errors

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
        self.P = T @ self.P @ T.T

    def take_over(self, other: "Eskf") -> None:
        """Become another filter, but for the noise level and what it cannot know."""
        delay_s, velocity_delay_s = self.delay_s, self.velocity_delay_s
        kept, noise = self.P.diagonal(), self.noise
        self.__dict__.update(other.clone(noise).__dict__)
        self.set_variances(DELAYS, kept[DELAYS])
        self.delay_s, self.velocity_delay_s = delay_s, velocity_delay_s

    def forget_orientation(self, yaw_sigma_rad: float, *, is_vehicle: bool) -> None:
        """Keep the attitude, but doubt it and all that was learnt through it."""
        fresh = start_covariance(is_vehicle=is_vehicle).diagonal()
        tilt_var = max(_DOUBTED_TILT_RAD**2, *self.P.diagonal()[TILT])
        for where in (ACCEL_BIAS, MOUNTING, GYRO_GAIN, AXLE):
            self.set_variances(where, fresh[where])
        self.set_variances(ATTITUDE, [tilt_var, tilt_var, yaw_sigma_rad**2])
        self.accel_bias_mps2 = _ZERO
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
        F = transition(self.nominal.q_nb, dt, self._dv_n, self._turn_n)
        if not use_force:
            F[0:6, 6:15] = 0.0
        Q = process_noise(
            dt,
            gyro_psd,
            accel_psd + unknown_accel_psd,
            self.receiver_var,
            is_vehicle=self._is_vehicle,
        )
        self.P = predicted(self.P, F, Q)
        north, east = self.receiver_ne_m
        decay = float(F[17, 17])
        self.receiver_ne_m = (north * decay, east * decay)
        self._see_motion()
        self._dt = self._felt_s = 0.0
        self._dv_n = self._dv_b = self._turn_n = _ZERO

    def _see_motion(self) -> None:
        """Take the means of the stretch."""
        felt_s = self._felt_s
        if felt_s <= 0.0:
            self.a_n = self.rate_n = _ZERO
            return
        (x, y, z), (tx, ty, tz) = self._dv_n, self._turn_n
        self.a_n = (x / felt_s, y / felt_s, z / felt_s + self.gravity_mps2)
        self.rate_n = (tx / felt_s, ty / felt_s, tz / felt_s)
        share = min(felt_s / _SHAKING_MEMORY_S, 1.0)
        (mx, my, mz), (x, y, z) = self._mean_f_b, self._dv_b
        self._mean_f_b = (
            mx + share * (x / felt_s - mx),
            my + share * (y / felt_s - my),
            mz + share * (z / felt_s - mz),
        )

    def innovation_covariance(self, measured: Measurement) -> Array:
        """S = H P H' + R."""
        S: Array = measured.H @ self.P @ measured.H.T + measured.R
        return S

    def apply(self, measured: Measurement) -> None:
        """Fold a measurement into the solution."""
        errors, self.P = updated(self.P, *measured)
        self._inject(errors)

    def _inject(self, x: Array) -> None:
        """Add the errors to the solution."""
        e = x.tolist()
        t_ns, p_n, v_n, q_nb = self.nominal
        self.nominal = Nominal(
            t_ns,
            (p_n[0] + e[0], p_n[1] + e[1], p_n[2] + e[2]),
            (v_n[0] + e[3], v_n[1] + e[4], v_n[2] + e[5]),
            normalise(multiply(from_rotation_vector((e[6], e[7], e[8])), q_nb)),
        )
        bx, by, bz = self.gyro_bias_radps
        self.gyro_bias_radps = (bx + e[9], by + e[10], bz + e[11])
        bx, by, bz = self.accel_bias_mps2
        self.accel_bias_mps2 = (bx + e[12], by + e[13], bz + e[14])
        mounting = from_rotation_vector((0.0, e[MOUNT_PITCH], e[MOUNT_YAW]))
        self.q_vb = normalise(multiply(mounting, self.q_vb))
        north, east = self.receiver_ne_m
        self.receiver_ne_m = (north + e[17], east + e[18])
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

    def take_receiver_var(self, variance: float) -> None:
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
        mean = 0.5 * float(P[17, 17] + P[18, 18])
        growth = min((variance / before - 1.0) * mean, variance - mean)
        if growth > 0.0:
            P = P.copy()
            for p, b in ((0, 17), (1, 18)):
                P[p, p] += growth
                P[b, b] += growth
                P[p, b] -= growth
                P[b, p] -= growth
            self.P = P
            return
        worst = max(P[17, 17], P[18, 18])
        if worst > MUCH_LARGER * variance > 0.0:
            shrink = math.sqrt(variance / worst)
            P = P.copy()
            P[17:19, :] *= shrink
            P[:, 17:19] *= shrink
            self.P = P
            north, east = self.receiver_ne_m
            self.receiver_ne_m = (north * shrink, east * shrink)


def _scatter(n: int, total: Vec3, sq_sum: float) -> float:
    """Variance of a step's samples about their mean, of a mean axis."""
    if n < 2:
        return 0.0
    x, y, z = total
    return max(sq_sum - (x * x + y * y + z * z) / n, 0.0) / (3.0 * (n - 1))
