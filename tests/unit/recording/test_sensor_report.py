"""Two simulated hours of stillness: the noise that was put in is read off again.

At 10 Hz by default, which takes seconds; `make acceptance` does it at 100 Hz and for
several chips. The oracle are the coefficients of the simulation, which knows nothing
of Allan deviations: white noise by its density, flicker by sums of Gauss-Markov
processes. The gyroscope measures in its finest steps: at 10 Hz the noise of rounding,
a twelfth of a step squared, would else be 8 % of all that there is.
"""

import math

import pytest

from imu_tracker.recording.capture import capture
from imu_tracker.recording.sensor_report import Report, report_of
from imu_tracker.simulation import simulate
from imu_tracker.simulation.imu.errors import SensorErrors

TWO_HOURS_S = 7200.0

ACCEL_DENSITY, GYRO_DENSITY = 400e-6 * 9.80665, math.radians(0.005)
ACCEL_FLICKER, GYRO_FLICKER = 1.2e-3, math.radians(0.002)
"""Flat from 10 to 60 s on: white noise there is less than the flicker."""

ERRORS = SensorErrors(
    accel_bias_sigma_mps2=(0.3, 0.3, 0.3),
    gyro_bias_sigma_radps=math.radians(2.0),
    accel_noise_mps2_rthz=ACCEL_DENSITY,
    gyro_noise_radps_rthz=GYRO_DENSITY,
    accel_flicker_mps2=ACCEL_FLICKER,
    gyro_flicker_radps=GYRO_FLICKER,
    clock_limit=0.01,
    jitter_sigma_s=2e-4,
)


def report(seed: int, rate_hz: float) -> Report:
    made = simulate(
        "still",
        seed=seed,
        duration_s=TWO_HOURS_S,
        rate_hz=rate_hz,
        gyro_range_dps=250,
        gps_every_s=60.0,
        errors=ERRORS,
    )
    return report_of(capture([made.header, *made.frames]))


def hits(told: Report) -> int:
    """Hold the white noise of all axes to 5 %; count the bias instabilities found."""
    assert told.stretches == 1
    found = 0
    for axis in told.axes:
        is_gyro = axis.name.startswith("gyro")
        density = GYRO_DENSITY if is_gyro else ACCEL_DENSITY
        flicker = GYRO_FLICKER if is_gyro else ACCEL_FLICKER
        assert axis.noise is not None
        walk, instability = axis.noise.random_walk, axis.noise.bias_instability
        assert walk.value == pytest.approx(density / math.sqrt(2.0), rel=0.05)
        assert instability.high - instability.low < flicker  # it says something
        found += instability.low <= flicker <= instability.high
    return found


def test_the_noise_of_two_hours_is_found() -> None:
    assert hits(report(seed=1, rate_hz=10.0)) >= 5  # of 6, each with 95 %


@pytest.mark.acceptance
def test_the_noise_of_two_hours_at_full_rate_is_found_on_many_chips() -> None:
    found = sum(hits(report(seed, rate_hz=100.0)) for seed in range(8))
    assert found >= 42  # of 48 at 95 %: fewer have a probability of 0.6 %
