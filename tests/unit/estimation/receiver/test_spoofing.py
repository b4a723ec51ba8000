"""Sensors that speak flawlessly and do not speak the truth."""

import math
from collections.abc import Callable, Iterator
from struct import pack

import numpy as np
import pytest

from imu_tracker.estimation.receiver.backlog import Backlog
from imu_tracker.estimation.receiver.spoofing import DRAWN_M, SpoofingMonitor
from imu_tracker.motion.preintegration import Preintegrator
from imu_tracker.motion.standstill import StandstillDetector
from imu_tracker.motion.stuck_axes import StuckAxes
from imu_tracker.samples import GpsFix, ImuSample, UtcTime

S = 1_000_000_000
METRES_PER_RAD = 6.37e6
NAMES = ("accel x", "accel y", "accel z", "gyro x", "gyro y", "gyro z")


# --------------------------------------------------------------------------- the axes


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
    assert watch.take_notices() == [f"imu: stuck: {NAMES[axis]}; the IMU is not used"]
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


# ------------------------------------------------------------------------ the backlog


def fix(
    t_s: float,
    *,
    lag_s: float = 0.2,
    north_m: float = 0.0,
    v_north_mps: float | None = 0.0,
) -> GpsFix:
    """Return a fix that describes `t_s` and arrives so much later."""
    return GpsFix(
        t_ns=round((t_s + lag_s) * S),
        utc_s=1.8e9 + t_s,
        lat_rad=0.9 + north_m / METRES_PER_RAD,
        lon_rad=0.07,
        alt_m=None,
        vel_ne_mps=None if v_north_mps is None else (v_north_mps, 0.0),
        sigma_h_m=2.0,
        quality=1,
    )


def relieved(lags: Callable[[float], float], seconds: int, hz: int) -> Backlog:
    """Hear epochs with a lag that depends on time; each is dated right or left."""
    backlog = Backlog()
    rng = np.random.default_rng(3)
    for number in range(seconds * hz):
        t_s = number / hz
        lag_s = lags(t_s) + rng.normal(0.0, 0.02)
        (told,) = backlog.relieved([fix(t_s, lag_s=lag_s)])
        if backlog.counters["overdue_epochs"]:
            assert told.t_ns / S - t_s == pytest.approx(0.2, abs=0.1)
    return backlog


def test_epochs_that_come_later_and_later_are_dated_by_the_freshest() -> None:
    backlog = relieved(lambda t_s: 0.2 + max(0.0, t_s - 10.0) * 0.5, 40, 10)
    assert backlog.counters["overdue_epochs"] > 270
    (notice,) = backlog.take_notices()
    assert "more than its line carries" in notice


def test_a_backlog_that_is_worked_off_is_told() -> None:
    def lag_s(t_s: float) -> float:
        return 0.2 + min(max(0.0, t_s - 10.0), max(0.0, 30.0 - t_s)) * 0.3

    backlog = relieved(lag_s, 60, 5)
    assert len(backlog.take_notices()) == 2


@pytest.mark.parametrize(
    "lag_s",
    [
        lambda t_s: 0.2,
        lambda t_s: 0.2 + 1e-4 * t_s,
        lambda t_s: 0.2 + (1.0 if t_s > 20 else 0.0),
        lambda t_s: 0.2 + (3600.0 if t_s > 20 else 0.0),
        lambda t_s: 0.8 + 0.4 * math.sin(t_s / 9.0),
        lambda t_s: max(0.2, 5.2 - t_s * 0.5),
    ],
    ids=["none", "a clock", "leap second", "an hour", "moody", "an old buffer"],
)
def test_other_reasons_to_come_late_are_left_alone(
    lag_s: Callable[[float], float],
) -> None:
    backlog = relieved(lag_s, 120, 1)
    assert backlog.counters["overdue_epochs"] == 0


def test_a_time_without_a_place_counts_as_well() -> None:
    backlog = Backlog()
    for number in range(20):
        t_ns = round((0.1 * number + 0.06 * number) * S)
        backlog.relieved([UtcTime(t_ns, 1.8e9 + 0.1 * number)])
    assert backlog.counters["overdue_epochs"] > 8


def test_a_fix_without_a_date_passes() -> None:
    undated = fix(1.0)._replace(utc_s=None)
    assert Backlog().relieved([undated]) == [undated]


# --------------------------------------------------------------------------- the drag


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
