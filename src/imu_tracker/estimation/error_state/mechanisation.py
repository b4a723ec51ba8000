"""Mechanisation: the strapdown solution, integrated step by step.

`propagate` also sums what the next prediction of the covariance needs: the interval
since the last one, its velocity increment and rotation, and the scatter of the samples.
"""

from typing import Final, NamedTuple, TypeAlias

from imu_tracker.geometry.rotation import (
    IDENTITY,
    from_rotation_vector,
    multiply,
    normalise,
    rotate,
)
from imu_tracker.motion.preintegration import ImuStep
from imu_tracker.samples import Quat, Vec3

_ZERO: Final[Vec3] = (0.0, 0.0, 0.0)
_SHAKING_MEMORY_S: Final = 1.0  # roads change within a second, not within a step

GyroGain: TypeAlias = tuple[
    float, float, float, float, float, float, float, float, float
]
NO_GAIN: Final[GyroGain] = (0.0,) * 9


class Nominal(NamedTuple):
    """Where the body is, how it moves and how it lies, at one instant."""

    t_ns: int
    p_n: Vec3
    v_n: Vec3
    q_nb: Quat


class Strapdown:
    """Position, velocity and attitude by integration of the IMU.

    Attributes
    ----------
    nominal : Nominal
    gravity_mps2 : float
    gyro_bias_radps, accel_bias_mps2 : Vec3, body axes
    gyro_gain : tuple of 9 floats
        What the gyro misses of a rate, M column by column: scale and cross-axis terms.
    a_n, rate_n : Vec3
        Mean acceleration and rate of the last interval; zero without samples.
    """

    def __init__(self) -> None:
        self.nominal = Nominal(0, _ZERO, _ZERO, IDENTITY)
        self.gravity_mps2 = 9.81
        self.gyro_bias_radps: Vec3 = _ZERO
        self.accel_bias_mps2: Vec3 = _ZERO
        self.gyro_gain: GyroGain = NO_GAIN
        self.a_n: Vec3 = _ZERO
        self.rate_n: Vec3 = _ZERO
        self._mean_f_b: Vec3 = _ZERO  # raw specific force, mean of the last second
        self._dt = self._felt_s = 0.0  # the interval, and that with samples
        self._dv_n: Vec3 = _ZERO
        self._dv_b: Vec3 = _ZERO
        self._turn_n: Vec3 = _ZERO
        self._gyro_scatter_var = self._accel_scatter_var = 0.0

    @property
    def mean_a_n(self) -> Vec3:
        """Acceleration of the last second, by the attitude and the bias of now."""
        (x, y, z), (bx, by, bz) = self._mean_f_b, self.accel_bias_mps2
        an, ae, ad = rotate(self.nominal.q_nb, (x - bx, y - by, z - bz))
        return (an, ae, ad + self.gravity_mps2)

    # ------------------------------------------------------------------ strapdown

    def mechanise(self, start: Nominal, step: ImuStep, *, use_force: bool) -> Nominal:
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
        self.nominal = self.mechanise(start, step, use_force=use_force)
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

    def _update_means(self) -> None:
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

    def _end_interval(self) -> None:
        """Take the means, and begin the next interval."""
        self._update_means()
        self._dt = self._felt_s = 0.0
        self._dv_n = self._dv_b = self._turn_n = _ZERO


def _scatter(n: int, total: Vec3, sq_sum: float) -> float:
    """Variance of a step's samples about their mean, of a mean axis."""
    if n < 2:
        return 0.0
    x, y, z = total
    return max(sq_sum - (x * x + y * y + z * z) / n, 0.0) / (3.0 * (n - 1))
