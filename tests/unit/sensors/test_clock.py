"""The grid, the back-off and the two clocks."""

import threading
import time

from imu_tracker.sensors.clock import Backoff, Clock, MonotonicClock, Pacer
from support.fake_clock import FakeClock

CLOCKS: list[Clock] = [MonotonicClock(), FakeClock()]


def test_the_pacer_wakes_on_an_absolute_grid() -> None:
    clock = FakeClock(now_ns=0)
    pacer = Pacer(clock, 10)
    wakes = []
    for busy_ns in (3, 9, 0, 5):
        assert not pacer.wait()
        wakes.append(clock.now_ns())
        clock.advance(ns=busy_ns)
    assert wakes == [10, 20, 30, 40]
    assert pacer.take_missed() == 0


def test_missed_slots_are_skipped_and_counted() -> None:
    clock = FakeClock(now_ns=0)
    pacer = Pacer(clock, 10)
    pacer.wait()
    clock.advance(ns=35)  # now 45: the slots 20 and 30 are gone, 40 is late
    pacer.wait()
    assert clock.now_ns() == 45
    pacer.wait()
    assert clock.now_ns() == 50
    assert [pacer.take_missed(), pacer.take_missed()] == [2, 0]


def test_a_set_stop_event_ends_every_wait_at_once() -> None:
    stop = threading.Event()
    stop.set()
    for clock in CLOCKS:
        before_ns = clock.now_ns()
        assert clock.sleep_until_ns(before_ns + 3600 * 10**9, stop)
        assert Pacer(clock, 3600 * 10**9).wait(stop)


def test_an_instant_in_the_past_is_no_wait() -> None:
    for clock in CLOCKS:
        assert not clock.sleep_until_ns(clock.now_ns() - 1)
        assert not clock.sleep_until_ns(clock.now_ns() - 1, threading.Event())


def test_the_monotonic_clock_sleeps_until_the_instant() -> None:
    clock = MonotonicClock()
    until_ns = clock.now_ns() + 1_000_000
    clock.sleep_until_ns(until_ns)
    assert clock.now_ns() >= until_ns


def test_the_back_off_doubles_up_to_its_cap_and_starts_over() -> None:
    backoff = Backoff(100, 500)
    assert [backoff.next_ns() for _ in range(5)] == [100, 200, 400, 500, 500]
    backoff.reset()
    assert backoff.next_ns() == 100


def test_the_fake_clock_does_what_was_planned_when_its_time_comes() -> None:
    clock = FakeClock(now_ns=0)
    seen: list[int] = []
    clock.at(20, lambda: seen.append(clock.now_ns()))
    clock.at(10, lambda: seen.append(clock.now_ns()))
    clock.advance(ns=15)
    assert seen == [10]
    clock.advance(ns=15)
    assert seen == [10, 20]
    assert clock.now_ns() == 30


def test_a_plan_that_stops_the_sleeper_ends_its_sleep() -> None:
    clock, stop = FakeClock(now_ns=0), threading.Event()
    clock.at(10, stop.set)
    assert clock.sleep_until_ns(100, stop)
    assert clock.now_ns() == 10


def test_a_step_of_the_system_clock_is_not_felt() -> None:
    before_ns = time.monotonic_ns()
    assert before_ns <= MonotonicClock().now_ns() <= time.monotonic_ns()
