"""The speed by the wheels: lines made by a formula of our own, found again.

The sound of a wheel is `sum of a_k cos(2 pi k s / C)`, s the way: exact at any speed
profile, and it shares nothing with the code under test.
"""

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from imu_tracker.samples import ImuSample
from imu_tracker.wheels.orders import OrderLearner
from imu_tracker.wheels.posterior import ERRORS_MPS, SpeedError, Weighed, posterior
from imu_tracker.wheels.speed import LEAST_SPEED_MPS, WheelSpeed
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
    way_m = np.cumsum(speeds(t_s)) * (t_s[1] - t_s[0])
    values = 0.3 * rng.standard_normal((len(t_s), CHANNELS))
    for order, share in ((1, 1.0), (2, 0.6)):
        phase = rng.uniform(0.0, 2.0 * math.pi, CHANNELS)
        angle = 2.0 * math.pi * order * way_m / TRUE_M
        values += loud * share * np.cos(angle[:, None] + phase)
    return values


class Driver:
    """Drives `WheelSpeed` as the estimator does; its circumference is the true one."""

    def __init__(self, values: Array, rate_hz: float = RATE_HZ) -> None:
        self.wheels = WheelSpeed()
        self._values, self._rate_hz = values, rate_hz
        self._t_s = np.arange(len(values)) / rate_hz
        self._true_mps = speeds(self._t_s)

    def drive(self, gps_s: float, wrong_mps: float) -> list[SpeedError]:
        """From `gps_s` on the filter's speed is too low by `wrong_mps`."""
        found = []
        every = round(0.12 * self._rate_hz)
        for k, t in enumerate(self._t_s.tolist()):
            ax, ay, az, gx, gy, gz = self._values[k].tolist()
            t_ns = round((t + 100.0) * 1e9)
            sample = ImuSample(t_ns, (ax, ay, az), (gx, gy, gz), 30.0)
            self.wheels.add_sample(sample)
            if k % every:
                continue
            has_gps = t < gps_s
            speed = float(self._true_mps[k]) - (0.0 if has_gps else wrong_mps)
            if not self.wheels.add_motion(t_ns, speed, 0.0):
                continue
            spectrum = self.wheels.spectrum()
            if spectrum is None:
                continue
            if has_gps:
                self.wheels.learn(spectrum)
                continue
            answer = self.wheels.weigh(spectrum, TRUE_M, 1.0)
            if answer is not None:
                found.append(answer)
        return found


def driver(seconds: float, loud: float = 0.12, rate_hz: float = RATE_HZ) -> Driver:
    """Make a driver on a road with the wheels' lines, or without any."""
    t_s = np.arange(0.0, seconds, 1.0 / rate_hz)
    return Driver(sound(t_s, 3, loud), rate_hz)


def test_the_circumference_is_learnt_with_gps() -> None:
    drive = driver(90.0)
    assert drive.drive(gps_s=90.0, wrong_mps=0.0) == []
    wheels = drive.wheels.wheels
    assert wheels is not None
    assert wheels.circumference_m == pytest.approx(TRUE_M, rel=0.005)
    assert wheels.clarity > 1.2


@pytest.mark.parametrize("rate_hz", [50.0, 100.0, 200.0])
@pytest.mark.parametrize("wrong_mps", [-1.2, 0.0, 1.5])
def test_the_error_of_the_speed_is_told_without_gps(
    wrong_mps: float, rate_hz: float
) -> None:
    found = driver(150.0, rate_hz=rate_hz).drive(gps_s=90.0, wrong_mps=wrong_mps)
    assert len(found) >= 3
    for answer in found:
        sigma = math.sqrt(answer.var)
        assert answer.error_mps == pytest.approx(wrong_mps, abs=3.0 * sigma)
        assert sigma < 0.6


def test_where_there_are_no_lines_nothing_is_said() -> None:
    drive = driver(200.0, loud=0.0)
    assert drive.drive(gps_s=120.0, wrong_mps=1.0) == []
    assert drive.wheels.wheels is None


def test_lines_that_cease_are_not_replaced_by_noise() -> None:
    # From good tarmac to cobbles as the tunnel begins: the highest peak is no speed.
    t_s = np.arange(0.0, 240.0, 1.0 / RATE_HZ)
    values = sound(t_s, 3)
    silent = t_s > 90.0
    values[silent] = sound(t_s, 5, loud=0.0)[silent]
    drive = Driver(values)
    assert drive.drive(gps_s=90.0, wrong_mps=1.0) == []
    assert drive.wheels.wheels is not None


def test_an_engine_that_is_as_loud_as_the_wheels_is_no_speed() -> None:
    # A steady line at 9 Hz in every channel: it crosses the wheels' own.
    t_s = np.arange(0.0, 210.0, 1.0 / RATE_HZ)
    engine = 0.12 * np.cos(2.0 * math.pi * 9.0 * t_s)[:, None]
    found = Driver(sound(t_s, 3) + engine).drive(gps_s=90.0, wrong_mps=0.5)
    assert found
    for answer in found:
        sigma = math.sqrt(answer.var)
        assert answer.error_mps == pytest.approx(0.5, abs=3.0 * sigma)


def test_a_line_that_does_not_follow_the_speed_is_not_a_wheel() -> None:
    learner, rng = OrderLearner(), np.random.default_rng(5)
    t_s = np.arange(-4.0, 0.0, 1.0 / RATE_HZ)
    engine = np.cos(2.0 * math.pi * 13.0 * t_s)[:, None]
    for k in range(120):
        speed = float(speeds(np.array([float(k)]))[0])
        values = engine + 0.3 * rng.standard_normal((len(t_s), CHANNELS))
        learner.learn(spectrum(t_s, values, RATE_HZ, 0.0 * t_s), speed, 1.0)
    assert learner.wheels is None


def test_nothing_is_said_before_a_minute_of_driving_or_in_slow_traffic() -> None:
    drive = driver(30.0)
    drive.drive(gps_s=30.0, wrong_mps=0.0)
    assert drive.wheels.wheels is None
    for k in range(100):
        slow = LEAST_SPEED_MPS - 1.0
        assert not drive.wheels.add_motion((1000 + k) * SECOND_NS, slow, 0.0)


@pytest.mark.parametrize(("turn_radps", "is_due"), [(0.2, False), (0.1, True)])
def test_no_window_is_due_in_a_tight_bend(turn_radps: float, *, is_due: bool) -> None:
    wheels = WheelSpeed()
    # 10 m/s round 50 m: wheels outside turn by 1.5 % faster; round 100 m half of it.
    due = [wheels.add_motion(k * SECOND_NS // 8, 10.0, turn_radps) for k in range(200)]
    assert any(due) is is_due


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


@pytest.mark.parametrize("hole", [0, 50])
def test_samples_with_a_hole_make_no_window(hole: int) -> None:
    samples = Samples()
    for k in range(620):
        if not 300 <= k < 300 + hole:
            t_ns = round(k * 1e7)
            samples.add(ImuSample(t_ns, (0.0, 0.0, 9.8), (0.0, 0.0, 0.0), 30.0))
    assert (samples.until(600 * 10_000_000) is None) is (hole > 0)


def test_memory_does_not_grow_with_the_drive() -> None:
    samples = Samples()
    for k in range(20_000):
        t_ns = round(k * 1e7)
        samples.add(ImuSample(t_ns, (0.0, 0.0, 9.8), (0.0, 0.0, 0.0), 30.0))
    assert len(samples._t_ns) + len(samples._waiting) < 3000


def windows(log_l: Array, sigma_mps: float, n: int = 1) -> list[Weighed]:
    """Make windows that all say the same."""
    return [Weighed(2 * k * SECOND_NS, sigma_mps, log_l) for k in range(n)]


def bump(at_mps: float) -> Array:
    return 20.0 * np.exp(-0.5 * ((ERRORS_MPS - at_mps) / 0.2) ** 2)


def test_one_top_is_an_answer_and_two_are_none() -> None:
    single, left = posterior(windows(bump(0.5), 1.0), 20.0)
    assert single is not None
    assert single.error_mps == pytest.approx(0.5, abs=0.05)
    assert left < 0.1
    double, _ = posterior(windows(bump(0.8) + bump(-0.8), 1.0), 20.0)
    assert double is None


@pytest.mark.parametrize("sigma_mps", [0.1, 1.0, 4.0, 8.0, 20.0])
def test_a_flat_likelihood_says_nothing_however_wide_the_prior_is(
    sigma_mps: float,
) -> None:
    # The grid ends at 8 m/s: a prior that is cut off there is narrower, by no evidence.
    flat = np.zeros(len(ERRORS_MPS))
    assert posterior(windows(flat, sigma_mps), 30.0) == (None, 1.0)


def test_an_error_that_grows_evenly_is_followed() -> None:
    # Tilt is wrong: the error is 0.2, 0.6, 1.0 m/s, and the filter says it may be.
    together = [
        Weighed(2 * k * SECOND_NS, 0.5 + 0.4 * k, bump(0.2 + 0.4 * k)) for k in range(3)
    ]
    answer, _ = posterior(together, 20.0)
    assert answer is not None
    assert answer.error_mps == pytest.approx(1.0, abs=0.15)


def test_the_windows_of_another_filter_do_not_count() -> None:
    drive = driver(94.5)
    drive.drive(gps_s=90.0, wrong_mps=0.5)
    wheels = drive.wheels
    t_ns, speed_mps, _ = wheels._motion[-1]
    wheels.add_motion(t_ns + SECOND_NS // 8, speed_mps + 0.1, 0.0)
    assert wheels._together
    wheels.add_motion(t_ns + SECOND_NS // 4, speed_mps + 2.5, 0.0)
    assert not wheels._together


def test_windows_before_a_break_do_not_count() -> None:
    # Before and after a crawl of 20 s; found on a car whose engine was louder uphill.
    drive = driver(94.5)
    drive.drive(gps_s=90.0, wrong_mps=0.5)
    before = len(drive.wheels._together)
    later_ns = drive.wheels._together[-1].t_ns + 20 * SECOND_NS
    spectrum = drive.wheels.spectrum()
    assert before > 0
    assert spectrum is not None
    drive.wheels.add_motion(later_ns, 15.0, 0.0)
    assert drive.wheels.weigh(spectrum, TRUE_M, 1.0) is None
    assert len(drive.wheels._together) == 1
