"""The steps of the last second: their means and their scatter.

One running sum is kept per quantity, so that a step costs the same at any window.
"""

import math
from collections import deque
from typing import Final

from imu_tracker.motion.preintegration import ImuStep
from imu_tracker.samples import Vec3

WINDOW_NS: Final = 1_000_000_000
"""Long enough to see an idling engine, short enough for a stop at a junction."""

FULL_SHARE: Final = 0.8
"""A window that spans this share of it is full: the last step may be short."""


class StepWindow:
    """A sliding window over steps."""

    def __init__(self) -> None:
        self._steps: deque[ImuStep] = deque()
        self._sums: tuple[float, ...] = (0.0,) * 9  # n, gyro, accel, their squares

    @property
    def is_full(self) -> bool:
        """Whether it spans a second."""
        return self._steps[-1].t_ns - self._steps[0].t_ns >= FULL_SHARE * WINDOW_NS

    def clear(self) -> None:
        """Begin again, after a gap."""
        self._steps.clear()
        self._sums = (0.0,) * 9

    def add_step(self, step: ImuStep) -> None:
        """Move on by a step."""
        steps = self._steps
        steps.append(step)
        sums = _added(self._sums, step, 1.0)
        while step.t_ns - steps[0].t_ns > WINDOW_NS:
            sums = _added(sums, steps.popleft(), -1.0)
        self._sums = sums

    def statistics(self) -> tuple[tuple[Vec3, float], tuple[Vec3, float]]:
        """Mean and standard deviation (all axes together) of gyro and accelerometer."""
        n, gx, gy, gz, ax, ay, az, gyro_sq, accel_sq = self._sums
        gyro = _mean_and_std(n, (gx, gy, gz), gyro_sq)
        return gyro, _mean_and_std(n, (ax, ay, az), accel_sq)

    def latest_means(self, n_steps: int) -> tuple[Vec3, Vec3]:
        """Means of gyro and accelerometer over the latest steps."""
        latest = [self._steps[-i] for i in range(1, n_steps + 1)]
        n = sum(s.n_samples for s in latest)
        gx, gy, gz = (
            sum(c) / n for c in zip(*(s.gyro_sum_radps for s in latest), strict=True)
        )
        ax, ay, az = (
            sum(c) / n for c in zip(*(s.accel_sum_mps2 for s in latest), strict=True)
        )
        return (gx, gy, gz), (ax, ay, az)


def _added(sums: tuple[float, ...], step: ImuStep, sign: float) -> tuple[float, ...]:
    n, gx, gy, gz, ax, ay, az, gyro_sq, accel_sq = sums
    sgx, sgy, sgz = step.gyro_sum_radps
    sax, say, saz = step.accel_sum_mps2
    return (
        n + sign * step.n_samples,
        gx + sign * sgx,
        gy + sign * sgy,
        gz + sign * sgz,
        ax + sign * sax,
        ay + sign * say,
        az + sign * saz,
        gyro_sq + sign * step.gyro_sq_sum,
        accel_sq + sign * step.accel_sq_sum,
    )


def _mean_and_std(n: float, total: Vec3, sq_sum: float) -> tuple[Vec3, float]:
    x, y, z = total[0] / n, total[1] / n, total[2] / n
    variance = sq_sum / n - (x * x + y * y + z * z)
    return (x, y, z), math.sqrt(max(variance, 0.0))
