"""UTC against the host's clock: jitter, backlogs, jumps, and rows that only slew."""

import math

import numpy as np
import pytest

from imu_tracker.estimation.receiver.utc import (
    SETTLE_NS,
    SLEW,
    STALE_NS,
    STEADY_EPOCHS,
    SURE_EPOCHS,
    UtcClock,
)

SECOND = 1_000_000_000
MS = 1_000_000
LATENCY = 200 * MS
UTC_S = 1_795_348_800
TRUE_OFFSET = UTC_S * SECOND  # the monotonic clock is 0 at UTC_S


def epoch(
    clock: UtcClock, t_ns: int, late_ns: int = LATENCY, utc_off_s: float = 0.0
) -> None:
    """Tell the clock of the epoch of `t_ns`, `late_ns` after it."""
    clock.add_epoch(t_ns + late_ns, UTC_S + t_ns / SECOND + utc_off_s)


def offset_error_ns(clock: UtcClock) -> int:
    instant = clock.instant_ns(float(UTC_S))
    assert instant is not None
    return -instant


def shown_error_ns(clock: UtcClock) -> int:
    return clock.row_utc_ns(0) - TRUE_OFFSET


def settled(seconds: int = 10) -> UtcClock:
    clock = UtcClock(LATENCY)
    epoch(clock, 0)
    clock.start_rows()
    for k in range(1, seconds):
        epoch(clock, k * SECOND)
    return clock


def test_nothing_is_known_before_the_first_epoch() -> None:
    clock = UtcClock(LATENCY)
    assert clock.settled_ns is None
    assert clock.instant_ns(float(UTC_S)) is None


def test_the_first_epoch_tells_the_time_less_the_latency() -> None:
    clock = UtcClock(LATENCY)
    epoch(clock, 5 * SECOND)
    assert clock.settled_ns == 5 * SECOND + LATENCY + SETTLE_NS
    assert clock.instant_ns(UTC_S + 5.0) == pytest.approx(5 * SECOND, abs=200)


def test_jitter_is_evened_out() -> None:
    rng = np.random.default_rng(5)
    clock = UtcClock(LATENCY)
    for k in range(60):
        epoch(clock, k * SECOND, LATENCY + int(rng.normal(0, 30 * MS)))
        if k == 0:
            clock.start_rows()
    assert abs(offset_error_ns(clock)) < 15 * MS


def test_a_backlog_at_the_start_is_not_now() -> None:
    # The port was open before us: twenty epochs of the last twenty seconds at once.
    clock = UtcClock(LATENCY)
    now = 20 * SECOND
    for k in range(20):
        epoch(clock, k * SECOND, now + k * MS - k * SECOND + LATENCY)
    epoch(clock, now + 1 * SECOND)
    assert abs(offset_error_ns(clock)) < 20 * MS


@pytest.mark.parametrize("n_stale", [1, 5, 30])
def test_a_backlog_later_changes_nothing(n_stale: int) -> None:
    clock = settled(40)
    before = offset_error_ns(clock)
    now = 100 * SECOND
    for k in range(n_stale):
        t = now - (n_stale - k) * SECOND - 2 * SECOND
        epoch(clock, t, now - t + k * MS)
    assert offset_error_ns(clock) == before
    assert clock.jumps == 0


def test_a_backlog_that_drains_slowly_is_no_jump() -> None:
    # 30 s of epochs pass a slow wire in 15 s: each is less late than the one before.
    clock = settled(40)
    now = 100 * SECOND
    for k in range(30):
        t = now - 30 * SECOND + k * SECOND
        epoch(clock, t, now + k * SECOND // 2 - t)
    assert clock.jumps == 0
    assert abs(offset_error_ns(clock)) < STALE_NS


def test_a_change_of_mind_is_believed_after_seconds() -> None:
    clock = settled()
    for k in range(10, 13):
        epoch(clock, k * SECOND, utc_off_s=-3.0)
    assert clock.jumps == 1
    assert offset_error_ns(clock) == pytest.approx(-3 * SECOND, abs=1000)


@pytest.mark.parametrize("leap_s", [-18.0, -2.0, -1.0, 1.0, 2.0, 18.0])
def test_a_leap_of_whole_seconds_is_in_doubt_for_three_epochs(leap_s: float) -> None:
    # The smallest would be taken for jitter, and followed after half of the window.
    rng = np.random.default_rng(6)
    clock = settled(30)
    jumps = []
    for k in range(30, 33):
        assert clock.is_uncertain is (k > 30)
        late_ns = LATENCY + int(rng.uniform(-60, 60) * MS)
        jumps.append(clock.add_epoch(k * SECOND + late_ns, UTC_S + k + leap_s))
    assert not clock.is_uncertain
    assert jumps[:2] == [0.0, 0.0]
    assert jumps[2] == pytest.approx(leap_s, abs=0.1)
    assert offset_error_ns(clock) == pytest.approx(leap_s * SECOND, abs=100 * MS)


def test_an_epoch_that_comes_a_second_late_is_in_doubt_alone() -> None:
    clock, doubts = settled(30), []
    for k, late_ns in ((30, LATENCY + SECOND), (31, LATENCY)):
        epoch(clock, k * SECOND, late_ns)
        doubts.append(clock.is_uncertain)
    assert doubts == [True, False]
    assert clock.jumps == 0
    assert abs(offset_error_ns(clock)) < MS


def test_a_receiver_that_smooths_comes_a_second_late_by_and_by() -> None:
    # As real ones do: from 0.2 s to 1.8 s and back within a minute.
    clock = settled(30)
    for k in range(30, 300):
        late_ns = LATENCY + round(0.8 * SECOND * (1.0 - math.cos(k / 10)))
        epoch(clock, k * SECOND, late_ns)
        assert not clock.is_uncertain
    assert clock.jumps == 0


def test_what_comes_from_the_future_is_in_doubt() -> None:
    clock, doubts = settled(30), []
    for k, utc_off_s in ((30, 7.4), (31, -7.4)):  # the other one a buffer held
        epoch(clock, k * SECOND, utc_off_s=utc_off_s)
        doubts.append(clock.is_uncertain)
    assert doubts == [True, False]


def test_rows_that_are_slewed_say_how_far_off_their_date_is() -> None:
    clock, period = settled(30), 250 * MS
    assert clock.behind_ns(period) == 0
    for k in range(30, 33):
        epoch(clock, k * SECOND, utc_off_s=-1.0)
    behind = []
    while (now := clock.behind_ns(period)) > 0:
        behind.append(now)
        clock.slew(period)
    assert behind[0] == pytest.approx(SECOND, abs=MS)
    assert np.diff(behind) == pytest.approx(-SLEW * period)
    for k in range(33, 36):
        epoch(clock, k * SECOND, utc_off_s=3600.0)
    assert clock.behind_ns(period) == 0  # the time is wrong, the place is not


@pytest.mark.parametrize("jump_s", [-3.0, 3.0, -18.0])
def test_rows_slew_and_never_jump(jump_s: float) -> None:
    clock = settled()
    period = 250 * MS
    shown = [shown_error_ns(clock)]
    utc_ns, instants = TRUE_OFFSET + 10 * SECOND, []
    for k in range(10, 400):
        epoch(clock, k * SECOND, utc_off_s=jump_s)
        for _ in range(4):
            utc_ns += period
            instants.append(clock.row_instant_ns(utc_ns))
            clock.slew(period)
            shown.append(shown_error_ns(clock))
    assert np.abs(np.diff(shown)).max() <= SLEW * period
    assert np.diff(instants).min() >= (1 - SLEW) * period - 1
    assert shown[-1] == pytest.approx(jump_s * SECOND, abs=1 * MS)


def test_rows_go_forward_at_once_by_more_than_5_s() -> None:
    clock = settled()
    for k in range(10, 13 + SURE_EPOCHS):
        assert clock.slew(0) == 0  # a time that may go back again
        epoch(clock, k * SECOND, utc_off_s=14 * 86_400.0)
    hole_ns = clock.slew(250 * MS)
    assert hole_ns == pytest.approx(14 * 86_400 * SECOND, abs=MS)
    assert shown_error_ns(clock) == pytest.approx(hole_ns, abs=MS)
    assert (clock.holes, clock.slew(250 * MS)) == (1, 0)


def test_before_the_first_row_a_fresher_epoch_counts_at_once() -> None:
    clock = UtcClock(LATENCY)
    epoch(clock, 0, LATENCY + 9 * SECOND)
    epoch(clock, 9 * SECOND)
    assert offset_error_ns(clock) == pytest.approx(0, abs=1000)
    clock.start_rows()
    assert shown_error_ns(clock) == pytest.approx(0, abs=1000)


def test_a_wandering_crystal_is_followed() -> None:
    # 50 parts in a million: 180 ms in an hour.
    clock = settled()
    for k in range(10, 3600):
        epoch(clock, k * SECOND, utc_off_s=50e-6 * k)
        clock.slew(SECOND)
    assert shown_error_ns(clock) == pytest.approx(180 * MS, abs=3 * MS)


def test_rows_go_back_at_once_by_more_than_a_minute() -> None:
    clock = settled()
    for k in range(10, 13 + SURE_EPOCHS):
        assert clock.slew(250 * MS) == 0  # nor are they slewed: that would take hours
        epoch(clock, k * SECOND, utc_off_s=-3600.0)
    assert clock.slew(250 * MS) == pytest.approx(-3600 * SECOND, abs=MS)
    assert shown_error_ns(clock) == pytest.approx(-3600 * SECOND, abs=MS)
    assert clock.is_sure


def test_a_date_that_moves_back_and_forth_is_followed_less_and_less() -> None:
    # A day ahead for half a minute, right for half a minute, for two hours.
    clock, steps = settled(30), []
    for k in range(30, 7200):
        epoch(clock, k * SECOND, utc_off_s=86_400.0 * (k // 30 % 2))
        steps += [k] if clock.slew(250 * MS) else []
    assert len(steps) == 1
    assert "back and forth" in clock.follows(86_400.0)


def test_after_a_steady_day_a_receiver_is_believed_as_at_the_start() -> None:
    clock, second = settled(), 10

    def stay(epochs: int, utc_off_s: float) -> None:
        nonlocal second
        for _ in range(epochs):
            epoch(clock, second * SECOND, utc_off_s=utc_off_s)
            clock.slew(250 * MS)
            second += 1

    stay(50, 3600.0)
    assert f"once {2 * SURE_EPOCHS} fixes" in clock.follows(3600.0)
    stay(STEADY_EPOCHS, 3600.0)
    assert f"once {SURE_EPOCHS} fixes" in clock.follows(3600.0)


def test_a_date_that_came_to_stay_is_followed_whatever_it_did_before() -> None:
    clock, steps = settled(30), 0
    for k in range(30, 3600):
        epoch(clock, k * SECOND, utc_off_s=86_400.0 * (k // 30 % 2))
        steps += bool(clock.slew(250 * MS))
    for k in range(3600, 5000):
        epoch(clock, k * SECOND)
        clock.slew(250 * MS)
    assert shown_error_ns(clock) == pytest.approx(0, abs=MS)
