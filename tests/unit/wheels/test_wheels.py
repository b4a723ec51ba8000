"""Wheels that are heard: lines made by a formula of our own, found again.

The sound of a wheel is `sum of a_k cos(2 pi k s / C)`, s the way: exact at any speed
profile, and it shares nothing with the code under test.
"""

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from imu_tracker.samples import ImuSample
from imu_tracker.wheels.orders import HEARD, OrderLearner
from imu_tracker.wheels.speed import (
    LEAST_SPEED_MPS,
    SpeedError,
    WheelSpeed,
    posterior,
)
from imu_tracker.wheels.windows import CHANNELS, Samples, spectrum

Array = NDArray[np.float64]

RATE_HZ = 100.0
SECOND_NS = 1_000_000_000
TRUE_M = 1.93


def speeds(t_s: Array) -> Array:
    """A road with bends: 10 to 22 m/s, never steady for long."""
    return 16.0 + 4.0 * np.sin(t_s / 9.0) + 2.0 * np.sin(t_s / 3.1)


def sound(t_s: Array, seed: int, loud: float = 0.12) -> Array:
    """Make the wheels' lines in noise, shape (n, channels)."""
    rng = np.random.default_rng(seed)
    way_m = np.cumsum(speeds(t_s)) / RATE_HZ
    values = 0.3 * rng.standard_normal((len(t_s), CHANNELS))
    for order, share in ((1, 1.0), (2, 0.6)):
        phase = rng.uniform(0.0, 2.0 * math.pi, CHANNELS)
        angle = 2.0 * math.pi * order * way_m / TRUE_M
        values += loud * share * np.cos(angle[:, None] + phase)
    return values


def drive(
    listener: WheelSpeed,
    seconds: float,
    gps_s: float,
    wrong_mps: float,
    loud: float = 0.12,
) -> list[SpeedError]:
    """Drive; from `gps_s` on the filter's speed is too low by `wrong_mps`."""
    t_s = np.arange(0.0, seconds, 1.0 / RATE_HZ)
    values, true_mps = sound(t_s, 3, loud), speeds(t_s)
    found = []
    for k, t in enumerate(t_s.tolist()):
        ax, ay, az, gx, gy, gz = values[k].tolist()
        t_ns = round((t + 100.0) * 1e9)
        listener.add_sample(ImuSample(t_ns, (ax, ay, az), (gx, gy, gz), 30.0))
        if k % 12:
            continue
        has_gps = t < gps_s
        speed = float(true_mps[k]) - (0.0 if has_gps else wrong_mps)
        answer = listener.add_speed(
            t_ns, speed, 0.2 if has_gps else 1.0, has_gps=has_gps
        )
        if answer is not None:
            found.append(answer)
    return found


def test_the_circumference_is_learnt_with_gps() -> None:
    listener = WheelSpeed()
    assert drive(listener, 90.0, gps_s=90.0, wrong_mps=0.0) == []
    assert listener.wheels is not None
    assert listener.wheels.circumference_m == pytest.approx(TRUE_M, rel=0.005)
    assert listener.wheels.clarity > HEARD


@pytest.mark.parametrize("wrong_mps", [-1.2, 0.0, 0.8, 1.5])
def test_the_error_of_the_speed_is_told_without_gps(wrong_mps: float) -> None:
    found = drive(WheelSpeed(), 150.0, gps_s=90.0, wrong_mps=wrong_mps)
    assert len(found) > 5
    for answer in found:
        sigma = math.sqrt(answer.var)
        assert answer.error_mps == pytest.approx(wrong_mps, abs=3.0 * sigma)
        assert sigma < 0.6


def test_where_there_are_no_lines_nothing_is_said() -> None:
    listener = WheelSpeed()
    assert drive(listener, 200.0, gps_s=120.0, wrong_mps=1.0, loud=0.0) == []
    assert listener.wheels is None


def test_a_line_that_does_not_follow_the_speed_is_not_a_wheel() -> None:
    learner, rng = OrderLearner(), np.random.default_rng(5)
    t_s = np.arange(-4.0, 0.0, 1.0 / RATE_HZ)
    engine = np.cos(2.0 * math.pi * 13.0 * t_s)[:, None]
    for k in range(120):
        speed = float(speeds(np.array([float(k)]))[0])
        values = engine + 0.3 * rng.standard_normal((len(t_s), CHANNELS))
        learner.learn(spectrum(t_s, values, RATE_HZ, 0.0 * t_s), speed, 1.0)
    assert learner.wheels is None


def test_nothing_is_heard_before_a_minute_of_driving_or_in_slow_traffic() -> None:
    listener = WheelSpeed()
    drive(listener, 30.0, gps_s=30.0, wrong_mps=0.0)
    assert listener.wheels is None
    for k in range(100):
        slow = LEAST_SPEED_MPS - 1.0
        t_ns = (1000 + k) * SECOND_NS
        assert listener.add_speed(t_ns, slow, 0.2, has_gps=False) is None


def test_a_change_of_speed_within_a_window_does_not_smear_its_line() -> None:
    t_s = np.arange(-4.0, 0.0, 1.0 / RATE_HZ)
    over = 1.0 * t_s  # 1 m/s^2, 15 m/s at the end
    way_m = 15.0 * t_s + 0.5 * t_s**2
    line = np.cos(2.0 * math.pi * way_m / TRUE_M)[:, None] * np.ones(CHANNELS)
    noise = 0.3 * np.random.default_rng(1).standard_normal((len(t_s), CHANNELS))
    values = line + noise
    extra_m = np.cumsum(over) / RATE_HZ
    turns = np.array([15.0 / TRUE_M])
    sharp = spectrum(t_s, values, RATE_HZ, extra_m - extra_m[-1]).at(turns)
    smeared = spectrum(t_s, values, RATE_HZ, 0.0 * t_s).at(turns)
    assert sharp[0, 0].mean() > 2.0 * smeared[0, 0].mean()


def test_samples_with_a_hole_make_no_window() -> None:
    samples = Samples()
    for k in range(600):
        if not 300 <= k < 350:
            t_ns = round(k * 1e7)
            samples.add(ImuSample(t_ns, (0.0, 0.0, 9.8), (0.0, 0.0, 0.0), 30.0))
    assert samples.until(600 * 10_000_000) is None


def test_memory_does_not_grow_with_the_drive() -> None:
    samples = Samples()
    for k in range(20_000):
        t_ns = round(k * 1e7)
        samples.add(ImuSample(t_ns, (0.0, 0.0, 9.8), (0.0, 0.0, 0.0), 30.0))
    assert len(samples._t_ns) + len(samples._waiting) < 3000


def test_two_tops_make_a_wide_answer_and_none_says_nothing() -> None:
    errors = np.arange(-8.0, 8.0, 0.05)
    flat = np.zeros(len(errors))
    assert posterior(errors, flat, 20.0, 1.0) is None
    one = -0.5 * ((errors - 0.5) / 0.1) ** 2 * 100.0
    two = np.logaddexp(one, -0.5 * ((errors + 1.0) / 0.1) ** 2 * 100.0)
    single, double = (posterior(errors, log_l, 20.0, 1.0) for log_l in (one, two))
    assert single is not None
    assert single.error_mps == pytest.approx(0.5, abs=0.05)
    assert double is None or double.var > 5.0 * single.var


@pytest.mark.parametrize("sigma_mps", [0.1, 1.0, 4.0, 8.0, 20.0])
def test_a_flat_likelihood_says_nothing_however_wide_the_prior_is(
    sigma_mps: float,
) -> None:
    # The grid ends at 8 m/s: a prior that is cut off there is narrower, by no evidence.
    errors = np.arange(-8.0, 8.0, 0.05)
    assert posterior(errors, np.zeros(len(errors)), 30.0, sigma_mps) is None


def test_the_windows_of_another_filter_do_not_count() -> None:
    steady, told = WheelSpeed(), WheelSpeed()
    for listener in (steady, told):
        drive(listener, 94.5, gps_s=90.0, wrong_mps=0.5)
    told.reset_evidence()
    assert steady._n_together > 0
    assert told._n_together == 0
