"""Axes that stand or clip: noticed, named, and used again when they move."""

import math
from collections.abc import Iterator
from struct import pack

import numpy as np
import pytest

from imu_tracker.motion.stuck_axes import StuckAxes
from imu_tracker.samples import ImuSample

S = 1_000_000_000
NAMES = ("accel x", "accel y", "accel z", "gyro x", "gyro y", "gyro z")


def bursts(
    seconds: float,
    sigma: float | tuple[float, ...] = 3.0,
    *,
    stuck: tuple[int, ...] = (),
    at: int = 77,
    begin_s: float = 0.0,
) -> Iterator[tuple[int, bytes]]:
    """Read a chip at 100 Hz whose axes have so much noise, in counts."""
    noise = np.random.default_rng(7).standard_normal((round(seconds * 100), 6))
    counts = np.rint(noise * sigma).astype(int)
    for axis in stuck:
        counts[:, axis] = at
    for number, (ax, ay, az, gx, gy, gz) in enumerate(counts.tolist(), 1):
        t_ns = round(begin_s * S) + number * 10_000_000
        yield t_ns, pack(">7h", ax, ay, az, -4000, gx, gy, gz)


def refused(watch: StuckAxes, stream: Iterator[tuple[int, bytes]]) -> list[bool]:
    return [watch.look(*burst) for burst in stream]


@pytest.mark.parametrize("axis", range(6))
def test_an_axis_that_stands_is_noticed_within_a_second_and_named(axis: int) -> None:
    watch = StuckAxes()
    found = refused(watch, bursts(5, stuck=(axis,)))
    assert found.index(True) <= 100
    assert all(found[100:])
    (told,) = watch.take_notices()
    assert told.startswith(f"imu: stuck: {NAMES[axis]}; the IMU is not used: run ")
    assert watch.stuck == (NAMES[axis],)
    assert watch.take_notices() == []
    assert watch.counters["stuck_samples"] == sum(found)


def test_an_axis_that_moves_again_is_used_again_within_a_second() -> None:
    watch = StuckAxes()
    refused(watch, bursts(3, stuck=(5,)))
    watch.take_notices()
    found = refused(watch, bursts(3, begin_s=3))
    assert not any(found[100:])
    assert watch.take_notices() == ["imu: all axes move again"]


def test_a_stuck_axis_stays_refused_while_the_others_come_to_rest() -> None:
    watch = StuckAxes()
    refused(watch, bursts(3, stuck=(5,)))
    assert all(refused(watch, bursts(20, 0.0, stuck=(5,), begin_s=3)))


@pytest.mark.parametrize(
    "sigma",
    [3.0, 0.4, 0.2, 0.05, 0.0, (9.0, 9.0, 9.0, 0.2, 0.2, 0.2)],
    ids=["usual", "coarse", "coarser", "nearly none", "none", "a quiet gyro"],
)
def test_a_quiet_chip_is_no_stuck_one(sigma: float | tuple[float, ...]) -> None:
    watch = StuckAxes()
    assert not any(refused(watch, bursts(600, sigma)))


def test_smooth_motion_without_any_noise_is_no_reason_to_doubt_the_third_axis() -> None:
    # A simulation in the plane: x and y swing, z is constant for ever.
    watch = StuckAxes()
    for number in range(6000):
        swing = round(3000 * math.sin(number / 50.0))
        burst = pack(">7h", swing, -swing, 8192, -4000, 0, 0, swing)
        assert not watch.look(number * 10_000_000, burst)


def clipped_for(seconds: float) -> tuple[StuckAxes, list[bool]]:
    watch, samples = StuckAxes(), []
    for number in range(200):
        is_clipped = 50 <= number < 50 + seconds * 100
        zero = (0.0, 0.0, 0.0)
        samples.append(ImuSample(number * 10_000_000, zero, zero, 25.0, is_clipped))
    return watch, [watch.clips(sample) for sample in samples]


def test_an_impact_is_left_to_the_estimator() -> None:
    watch, refusals = clipped_for(0.15)
    assert not any(refusals)
    assert watch.take_notices() == []


def test_what_stays_clipped_is_refused_until_it_is_not() -> None:
    watch, refusals = clipped_for(1.0)
    assert [i for i, is_refused in enumerate(refusals) if is_refused] == [
        *range(70, 150)
    ]
    assert watch.counters == {"clipped_samples": 80}
    assert len(watch.take_notices()) == 1


def test_bursts_of_clipping_are_told_once_a_minute_with_a_count() -> None:
    watch, zero, notices = StuckAxes(), (0.0, 0.0, 0.0), []
    for number in range(25_000):  # 250 s; half of each of the first 150 s is clipped
        is_clipped = number < 15_000 and number % 100 < 50
        sample = ImuSample(number * 10_000_000, zero, zero, 25.0, is_clipped)
        watch.clips(sample)
        notices += watch.take_notices()
    assert len(notices) == 5
    assert "(60 times in a minute)" in notices[1]
    assert notices[-1] == "imu: no axis was clipped for a minute"
