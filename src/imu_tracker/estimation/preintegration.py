"""Strapdown at every sample, handed on in steps.

Rotation and velocity are integrated at the sensor's own rate, in the body axes of
the step's start; coning and sculling are in the sum. A step of 40 ms then costs the
filters as much as one sample would, at any rate of the sensor, and a late fix can be
put in its place by going over steps instead of samples.

Here samples that cannot be integrated are noticed and counted: NaN, repeated or
backward time, gaps, saturation, a sensor that stands frozen.
"""

import math
from collections import Counter
from typing import Final, NamedTuple

from imu_tracker.estimation.rotation import IDENTITY, to_rotation_vector
from imu_tracker.samples import ImuSample, Quat, Vec3

STEP_NS: Final = 40_000_000
"""Length of a step. A car changes its acceleration at some m/s^3: within 40 ms the
filters lose less than a millimetre by holding it."""

GAP_NS: Final = 250_000_000
"""Longest time between two samples that is bridged by the straight line between
them; after more than that nobody knows how the body turned."""

FROZEN_SAMPLES: Final = 50
"""So many equal samples in a row are a hanging sensor: noise moves the last bits of
six axes of a living one."""


class ImuStep(NamedTuple):
    """What the body did between the end of the last step and `t_ns`.

    Increments are in body axes at the start of the step, as the sensor reads: with
    its biases. The sums are those of its samples, for statistics.
    """

    t_ns: int
    dt_s: float
    dtheta_b_rad: Vec3  # rotation vector
    dv_b_mps: Vec3  # integral of specific force
    n_samples: int
    gyro_sum_radps: Vec3
    accel_sum_mps2: Vec3
    gyro_sq_sum: float
    accel_sq_sum: float
    temp_degc: float
    is_saturated: bool
    is_gap: bool  # nothing is known of this time; increments are zero


def gap_step(t_ns: int, dt_s: float) -> ImuStep:
    """Step over a time in which the sensor said nothing."""
    zero = (0.0, 0.0, 0.0)
    return ImuStep(
        t_ns, dt_s, zero, zero, 0, zero, zero, 0.0, 0.0, math.nan, False, True
    )


class Preintegrator:
    """Sums samples to steps.

    Attributes
    ----------
    gyro_bias_radps : Vec3
        Taken out of the rate inside a step, where rotation and acceleration mix,
        and put back into `dtheta_b_rad`: the filters see the sensor's own reading.
    counters : Counter
        `invalid_samples`, `repeated_samples`, `imu_gaps`, `saturated_samples`,
        `frozen_samples`.
    """

    def __init__(self) -> None:
        self.gyro_bias_radps: Vec3 = (0.0, 0.0, 0.0)
        self.counters: Counter[str] = Counter()
        self._last: ImuSample | None = None  # the last one integrated
        self._previous: ImuSample | None = None  # the last one seen
        self._n_equal = 0
        self._begin(-1)

    def _begin(self, t_ns: int) -> None:
        self._start_ns = t_ns
        self._q: Quat = IDENTITY
        self._dv: Vec3 = (0.0, 0.0, 0.0)
        self._n = 0
        self._gyro_sum: Vec3 = (0.0, 0.0, 0.0)
        self._accel_sum: Vec3 = (0.0, 0.0, 0.0)
        self._gyro_sq = self._accel_sq = 0.0
        self._is_saturated = False

    def skip_to(self, t_ns: int) -> None:
        """Forget what was summed: the time up to `t_ns` was bridged by gap steps."""
        self._last = None
        self._begin(t_ns)

    def add(self, sample: ImuSample) -> ImuStep | None:
        """Take one sample; return the step that it completes, if it does.

        The interval between two samples is integrated by the trapezoid rule. After a
        gap the step returned is the gap itself.
        """
        last = self._last
        dt_ns = sample.t_ns - (self._start_ns if last is None else last.t_ns)
        if dt_ns <= 0:
            self.counters["repeated_samples"] += 1
            return None
        if not self._is_usable(sample):
            return None
        self._last = sample
        if last is None and self._start_ns < 0:
            self._begin(sample.t_ns)
            return None
        if last is None or dt_ns > GAP_NS:
            self.counters["imu_gaps"] += 1
            return self._gap_until(sample)
        self._integrate(last, sample, dt_ns * 1e-9)
        elapsed_ns = sample.t_ns - self._start_ns
        # Half an interval of tolerance, so that jitter does not change the count.
        return self._close() if elapsed_ns + dt_ns // 2 >= STEP_NS else None

    def _is_usable(self, sample: ImuSample) -> bool:
        _, accel, gyro, _, is_saturated = sample
        # NaN and infinity survive a sum.
        if not math.isfinite(sum(accel) + sum(gyro)):
            self.counters["invalid_samples"] += 1
            return False
        previous, self._previous = self._previous, sample
        if previous is not None and previous[1] == accel and previous[2] == gyro:
            self._n_equal += 1
            if self._n_equal >= FROZEN_SAMPLES:
                self.counters["frozen_samples"] += 1
                return False
        else:
            self._n_equal = 0
        if is_saturated:
            self.counters["saturated_samples"] += 1
            self._is_saturated = True
        return True

    def _gap_until(self, sample: ImuSample) -> ImuStep:
        dt_s = (sample.t_ns - self._start_ns) * 1e-9
        self._begin(sample.t_ns)
        return gap_step(sample.t_ns, dt_s)

    def _integrate(self, last: ImuSample, sample: ImuSample, dt_s: float) -> None:
        """Add the time between two samples.

        Notes
        -----
        q_k = q_(k-1) exp((w_(k-1) + w_k) / 2 dt),
        dv += (C(q_(k-1)) f_(k-1) + C(q_k) f_k) / 2 dt.
        Written out: this is the innermost loop of the program.
        """
        _, (ax, ay, az), (gx, gy, gz), _, _ = sample
        _, (lax, lay, laz), (lgx, lgy, lgz), _, _ = last
        bx, by, bz = self.gyro_bias_radps
        half = 0.25 * dt_s  # half the angle of the mean of two rates
        hx = (gx + lgx - 2.0 * bx) * half
        hy = (gy + lgy - 2.0 * by) * half
        hz = (gz + lgz - 2.0 * bz) * half
        square = hx * hx + hy * hy + hz * hz
        # cos and sinc of half the angle to 4th order: 1e-9 at 1000 deg/s and 100 Hz
        dw = 1.0 - square * (0.5 - square / 24.0)
        sinc = 1.0 - square * (1.0 / 6.0 - square / 120.0)
        dx, dy, dz = hx * sinc, hy * sinc, hz * sinc
        w, x, y, z = self._q
        vx, vy, vz = self._dv

        half_dt = 0.5 * dt_s
        tx = 2.0 * (y * laz - z * lay)
        ty = 2.0 * (z * lax - x * laz)
        tz = 2.0 * (x * lay - y * lax)
        vx += (lax + w * tx + y * tz - z * ty) * half_dt
        vy += (lay + w * ty + z * tx - x * tz) * half_dt
        vz += (laz + w * tz + x * ty - y * tx) * half_dt

        w, x, y, z = (
            w * dw - x * dx - y * dy - z * dz,
            w * dx + x * dw + y * dz - z * dy,
            w * dy - x * dz + y * dw + z * dx,
            w * dz + x * dy - y * dx + z * dw,
        )
        self._q = (w, x, y, z)
        tx = 2.0 * (y * az - z * ay)
        ty = 2.0 * (z * ax - x * az)
        tz = 2.0 * (x * ay - y * ax)
        self._dv = (
            vx + (ax + w * tx + y * tz - z * ty) * half_dt,
            vy + (ay + w * ty + z * tx - x * tz) * half_dt,
            vz + (az + w * tz + x * ty - y * tx) * half_dt,
        )

        self._n += 1
        sx, sy, sz = self._accel_sum
        self._accel_sum = (sx + ax, sy + ay, sz + az)
        sx, sy, sz = self._gyro_sum
        self._gyro_sum = (sx + gx, sy + gy, sz + gz)
        self._accel_sq += ax * ax + ay * ay + az * az
        self._gyro_sq += gx * gx + gy * gy + gz * gz

    def _close(self) -> ImuStep:
        last = self._last
        assert last is not None
        dt_s = (last.t_ns - self._start_ns) * 1e-9
        tx, ty, tz = to_rotation_vector(self._q)
        bx, by, bz = self.gyro_bias_radps
        step = ImuStep(
            last.t_ns,
            dt_s,
            (tx + bx * dt_s, ty + by * dt_s, tz + bz * dt_s),
            self._dv,
            self._n,
            self._gyro_sum,
            self._accel_sum,
            self._gyro_sq,
            self._accel_sq,
            last.temp_degc,
            self._is_saturated,
            False,
        )
        self._begin(last.t_ns)
        return step
