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

from imu_tracker.geometry.rotation import IDENTITY, to_rotation_vector
from imu_tracker.samples import ImuSample, Vec3

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


def gap_step(t_ns: int, dt_s: float, temp_degc: float = math.nan) -> ImuStep:
    """Step over a gap of the sensor."""
    zero = (0.0, 0.0, 0.0)
    return ImuStep(
        t_ns, dt_s, zero, zero, 0, zero, zero, 0.0, 0.0, temp_degc, False, True
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
        self._previous: ImuSample | None = None  # the last one seen
        self._n_equal = 0
        # Of the step that is being summed: when it began, and its samples, of which
        # the first is the last one of the step before.
        self._start_ns: int | None = None
        self._samples: list[ImuSample] = []

    def bridge(self, t_ns: int, dt_s: float) -> ImuStep:
        """Return a step through silence, up to `t_ns`; what was summed is forgotten."""
        self._start_ns, self._samples = t_ns, []
        return self._gap(t_ns, dt_s)

    def add_sample(self, sample: ImuSample) -> ImuStep | None:
        """Take one sample; return the step that it completes, if it does.

        The interval between two samples is integrated by the trapezoid rule. After a
        gap the step returned is the gap itself.
        """
        t_ns, start_ns, samples = sample.t_ns, self._start_ns, self._samples
        last_ns = samples[-1].t_ns if samples else start_ns
        if last_ns is not None and t_ns <= last_ns:
            self.counters["repeated_samples"] += 1
            return None
        if not self._is_usable(sample):
            return None
        if start_ns is None or last_ns is None:
            self._begin(sample)
            return None
        dt_ns = t_ns - last_ns
        if not samples or dt_ns > GAP_NS:
            self.counters["imu_gaps"] += 1
            self._begin(sample)
            return self._gap(t_ns, (t_ns - start_ns) * 1e-9)
        samples.append(sample)
        # Half an interval of tolerance, so that jitter does not change the count.
        if t_ns - start_ns + dt_ns // 2 < STEP_NS:
            return None
        self._begin(sample)
        return _integrate(samples, self.gyro_bias_radps)

    def _gap(self, t_ns: int, dt_s: float) -> ImuStep:
        last = self._previous
        return gap_step(t_ns, dt_s, math.nan if last is None else last.temp_degc)

    def _begin(self, sample: ImuSample) -> None:
        self._start_ns, self._samples = sample.t_ns, [sample]

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
        return True


def _integrate(samples: list[ImuSample], gyro_bias_radps: Vec3) -> ImuStep:
    """Sum a step from its samples, the first of which only begins it.

    Notes
    -----
    q_k = q_(k-1) exp((w_(k-1) + w_k) / 2 dt),
    dv += (C(q_(k-1)) f_(k-1) + C(q_k) f_k) / 2 dt.
    Written out: this is the innermost loop of the program.
    """
    bx, by, bz = gyro_bias_radps
    start_ns, (fx, fy, fz), (lgx, lgy, lgz), _, _ = samples[0]
    last_ns = start_ns
    w, x, y, z = IDENTITY
    vx = vy = vz = 0.0
    gx_sum = gy_sum = gz_sum = gyro_sq = 0.0
    ax_sum = ay_sum = az_sum = accel_sq = 0.0
    for t_ns, (ax, ay, az), (gx, gy, gz), _, _ in samples[1:]:
        dt_s = (t_ns - last_ns) * 1e-9
        half = 0.25 * dt_s  # half the angle of the mean of two rates
        hx = (gx + lgx - 2.0 * bx) * half
        hy = (gy + lgy - 2.0 * by) * half
        hz = (gz + lgz - 2.0 * bz) * half
        square = hx * hx + hy * hy + hz * hz
        # cos and sinc of half the angle to 4th order: 1e-9 at 1000 deg/s and 100 Hz
        dw = 1.0 - square * (0.5 - square / 24.0)
        sinc = 1.0 - square * (1.0 / 6.0 - square / 120.0)
        dx, dy, dz = hx * sinc, hy * sinc, hz * sinc
        w, x, y, z = (
            w * dw - x * dx - y * dy - z * dz,
            w * dx + x * dw + y * dz - z * dy,
            w * dy - x * dz + y * dw + z * dx,
            w * dz + x * dy - y * dx + z * dw,
        )

        half_dt = 0.5 * dt_s
        vx, vy, vz = vx + fx * half_dt, vy + fy * half_dt, vz + fz * half_dt
        tx = 2.0 * (y * az - z * ay)
        ty = 2.0 * (z * ax - x * az)
        tz = 2.0 * (x * ay - y * ax)
        fx = ax + w * tx + y * tz - z * ty  # the force in the axes of the start
        fy = ay + w * ty + z * tx - x * tz
        fz = az + w * tz + x * ty - y * tx
        vx, vy, vz = vx + fx * half_dt, vy + fy * half_dt, vz + fz * half_dt

        gx_sum, gy_sum, gz_sum = gx_sum + gx, gy_sum + gy, gz_sum + gz
        ax_sum, ay_sum, az_sum = ax_sum + ax, ay_sum + ay, az_sum + az
        gyro_sq += gx * gx + gy * gy + gz * gz
        accel_sq += ax * ax + ay * ay + az * az
        last_ns, lgx, lgy, lgz = t_ns, gx, gy, gz

    dt_s = (last_ns - start_ns) * 1e-9
    tx, ty, tz = to_rotation_vector((w, x, y, z))
    return ImuStep(
        last_ns,
        dt_s,
        (tx + bx * dt_s, ty + by * dt_s, tz + bz * dt_s),
        (vx, vy, vz),
        len(samples) - 1,
        (gx_sum, gy_sum, gz_sum),
        (ax_sum, ay_sum, az_sum),
        gyro_sq,
        accel_sq,
        samples[-1].temp_degc,
        any(sample.is_saturated for sample in samples[1:]),
        False,
    )
