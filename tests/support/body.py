"""A body that the tests move by hand: what its IMU reads, as samples and as steps."""

import math
from collections.abc import Iterator

import numpy as np

from imu_tracker.motion.preintegration import ImuStep, Preintegrator
from imu_tracker.samples import ImuSample, Vec3

G = 9.81
DPS = math.radians(1.0)
SECOND_NS = 1_000_000_000


class Body:
    """Reads out a chip with little noise, at 100 Hz unless told otherwise.

    Attributes
    ----------
    t_ns : int
        The instant of the last sample.
    gyro_sigma_radps, accel_sigma_mps2 : float
        Noise per sample: a quiet MPU-6050 by default.
    gyro_bias_radps : Vec3
    """

    def __init__(self, seed: int = 0, rate_hz: float = 100.0) -> None:
        self._rng = np.random.default_rng(seed)
        self._period_ns = round(SECOND_NS / rate_hz)
        self.t_ns = 0
        self.gyro_sigma_radps = 0.05 * DPS
        self.accel_sigma_mps2 = 0.03
        self.gyro_bias_radps: Vec3 = (0.0, 0.0, 0.0)

    def samples(
        self,
        duration_s: float,
        gyro: Vec3 = (0.0, 0.0, 0.0),
        accel: Vec3 = (0.0, 0.0, 0.0),
    ) -> Iterator[ImuSample]:
        """Read a body that turns and accelerates like this, level all the while."""
        n = round(duration_s * SECOND_NS / self._period_ns)
        noise = self._rng.standard_normal((n, 6))
        noise *= [self.accel_sigma_mps2] * 3 + [self.gyro_sigma_radps] * 3
        still = [accel[0], accel[1], accel[2] - G]
        rate = np.add(gyro, self.gyro_bias_radps).tolist()
        for ax, ay, az, gx, gy, gz in (noise + (still + rate)).tolist():
            self.t_ns += self._period_ns
            yield ImuSample(self.t_ns, (ax, ay, az), (gx, gy, gz), 25.0)


def steps_of(
    body: Body,
    into: Preintegrator,
    duration_s: float,
    gyro: Vec3 = (0.0, 0.0, 0.0),
    accel: Vec3 = (0.0, 0.0, 0.0),
) -> Iterator[ImuStep]:
    """Sum the samples of such a motion to steps."""
    for sample in body.samples(duration_s, gyro, accel):
        if (step := into.add_sample(sample)) is not None:
            yield step
