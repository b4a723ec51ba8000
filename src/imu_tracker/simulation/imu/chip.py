"""A simulated MPU-6050: motion in, bursts of counts with time stamps out."""

from collections.abc import Iterator
from itertools import count
from typing import Final

import numpy as np

from imu_tracker.calibration.counts import CountsModel
from imu_tracker.simulation.imu.errors import ChipErrors, ChipTraits, SensorErrors
from imu_tracker.simulation.imu.ideal import angular_rate, specific_force
from imu_tracker.simulation.motion.paths import FloatArray
from imu_tracker.simulation.motion.trajectory import Trajectory

_CHUNK: Final = 1024  # samples made at once: fast, and small

_MOST_JITTER: Final = 0.4  # of a sample interval: time stamps never change order


class Imu:
    """Samples a trajectory as one chip in one box does.

    Parameters
    ----------
    errors : SensorErrors
        Sizes of the errors.
    traits : ChipTraits
        The chip and its mounting.
    rng : Generator
        Source of all its noise.
    rate_hz : float
        Nominal sample rate.
    has_engine, has_wheels : bool
        As for `ChipErrors`.
    """

    def __init__(
        self,
        errors: SensorErrors,
        traits: ChipTraits,
        rng: np.random.Generator,
        rate_hz: float,
        *,
        has_engine: bool,
        has_wheels: bool = False,
    ) -> None:
        self._errors = errors
        self._interval_s = 1.0 / (rate_hz * (1.0 + traits.clock_error))
        self._timing_rng, noise_rng = rng.spawn(2)
        self._chip = ChipErrors(
            *(errors, traits, noise_rng, rate_hz),
            has_engine=has_engine,
            has_wheels=has_wheels,
        )

    def bursts(
        self, trajectory: Trajectory, gravity_mps2: float, counts: CountsModel
    ) -> Iterator[tuple[int, bytes]]:
        """Yield nanoseconds since the start and 14 bytes, without end."""
        encode = counts.encode
        for chunk in count():
            samples: FloatArray = np.arange(_CHUNK, dtype=float) + chunk * _CHUNK
            t_s = samples * self._interval_s
            motion = trajectory.at(t_s)
            readings = self._chip.spoil(
                t_s,
                np.linalg.norm(motion.v_n, axis=1),
                specific_force(motion, gravity_mps2),
                angular_rate(motion),
            )
            jitter_s = self._errors.jitter_sigma_s * self._timing_rng.standard_normal(
                _CHUNK
            )
            most_s = _MOST_JITTER * self._interval_s
            stamps_ns = np.rint(1e9 * (t_s + np.clip(jitter_s, -most_s, most_s)))
            is_kept = self._timing_rng.random(_CHUNK) >= self._errors.dropped_share
            for t_ns, (ax, ay, az), (gx, gy, gz), temp_degc in zip(
                stamps_ns[is_kept].astype(np.int64).tolist(),
                readings.accel_mps2[is_kept].tolist(),
                readings.gyro_radps[is_kept].tolist(),
                readings.temp_degc[is_kept].tolist(),
                strict=True,
            ):
                yield t_ns, encode((ax, ay, az), (gx, gy, gz), temp_degc)
