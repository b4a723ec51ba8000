"""A receiver that is led astray: places against velocities and a resting IMU."""

from collections.abc import Callable

import numpy as np
import pytest

from imu_tracker.estimation.receiver.spoofing import DRAWN_M, SpoofingMonitor
from imu_tracker.motion.preintegration import Preintegrator
from imu_tracker.motion.standstill import StandstillDetector
from imu_tracker.samples import ImuSample
from support.fixes import fix

S = 1_000_000_000


def watched(
    seconds: int,
    north_m: Callable[[float], float],
    v_north_mps: Callable[[float], float | None],
    accel_mps2: Callable[[float], float] | None = None,
) -> SpoofingMonitor:
    """Let a receiver speak; with an IMU when it is given."""
    watch = SpoofingMonitor()
    detector, preintegrator = StandstillDetector(), Preintegrator()
    rng = np.random.default_rng(5)
    for second in range(seconds):
        if accel_mps2 is not None:
            for k in range(100):
                t_s = second + k / 100
                ax, ay, az, gx, gy, gz = (rng.standard_normal(6) * 0.03).tolist()
                step = preintegrator.add_sample(
                    ImuSample(
                        round(t_s * S),
                        (ax + accel_mps2(t_s), ay, az - 9.81),
                        (gx / 30, gy / 30, gz / 30),
                        25.0,
                    )
                )
                if step is not None:
                    detector.add_step(step, (0.0, 0.0, 0.0), 0.001, 0.0, 1.0)
        v_north = v_north_mps(second)
        here = fix(second, north_m=north_m(second), v_north_mps=v_north)
        watch.add_fix(here, is_standing=detector.is_standing)
        if v_north is not None:
            detector.add_speed(here.t_ns, v_north)
    return watch


def test_places_that_move_without_their_velocity_are_suspect() -> None:
    watch = watched(200, lambda t: 10.0 * t + max(0.0, t - 60), lambda _: 10.0)
    assert watch.counters["suspect_fixes"] > 50
    (notice,) = watch.take_notices()
    assert "without its own velocity" in notice


def test_a_receiver_that_moves_as_it_says_is_not() -> None:
    watch = watched(200, lambda t: 5.0 * t, lambda _: 5.0)
    assert watch.counters == {}


def test_a_leap_is_the_gates_affair() -> None:
    watch = watched(200, lambda t: 50_000.0 * (60 < t < 65), lambda _: 0.0)
    assert watch.counters == {}


def test_a_leap_second_is_no_way() -> None:
    # By UTC the second epoch after it comes a second after the last one before it, by
    # the clock two; that one in between has the time of the last one, and is dropped.
    watch = SpoofingMonitor()
    for second in range(200):
        here = fix(second, north_m=70.0 * second, v_north_mps=70.0)
        assert here.utc_s is not None
        if second > 100:
            here = here._replace(utc_s=here.utc_s - 1.0)
        if second != 100:
            watch.add_fix(here, is_standing=False)
    assert watch.counters == {}


def test_a_receiver_without_velocities_says_nothing_by_its_places() -> None:
    assert watched(200, lambda t: 10.0 * t, lambda _: None).counters == {}


def test_places_and_velocities_that_move_while_the_imu_rests_are_suspect() -> None:
    watch = watched(
        120, lambda t: max(0.0, t - 20), lambda t: float(t > 20), lambda _: 0.0
    )
    assert watch.counters["suspect_fixes"] == pytest.approx(100 - DRAWN_M, abs=3)
    (notice,) = watch.take_notices()
    assert "the IMU feels nothing" in notice


def test_a_start_that_the_imu_feels_is_none() -> None:
    watch = watched(
        120,
        lambda t: max(0.0, t - 20),
        lambda t: float(t > 20),
        lambda t: 0.3 * (20 < t < 23),
    )
    assert watch.counters == {}


def test_a_place_that_repeats_while_the_speed_runs_on_is_frozen() -> None:
    """Reported as KumarRobotics/ublox#253 and punch-mission/punchbowl#1025."""
    watch = watched(120, lambda _: 0.0, lambda t: 10.0 * (t < 100))
    (frozen,) = watch.take_notices()
    assert frozen.startswith("the receiver repeats one place while its speed runs on")
    assert "restart the receiver" in frozen
    assert watch.counters == {}


def test_a_receiver_that_stands_and_says_so_is_not_frozen() -> None:
    watch = watched(300, lambda _: 0.0, lambda _: 0.0)
    assert watch.take_notices() == []
