"""Which day it is."""

from datetime import UTC, datetime

import pytest

from imu_tracker.sensors.gnss.calendar import DAY_S, ROLLOVER_S, Calendar

S = 1_000_000_000
NOON = datetime(2026, 11, 22, 12, tzinfo=UTC).timestamp()
MIDNIGHT = NOON + DAY_S / 2


def test_a_date_is_taken_as_sent_when_nothing_is_known_better() -> None:
    calendar = Calendar()
    calendar.learn(0, NOON - ROLLOVER_S, is_sure=True)
    assert calendar.utc_s(0, DAY_S / 2) == NOON - ROLLOVER_S
    assert calendar.rollovers == 0


def test_without_any_date_the_day_is_unknown() -> None:
    calendar = Calendar()
    assert calendar.utc_s(0, 10.0) is None
    assert not calendar.is_known


@pytest.mark.parametrize("rollovers", [1, 2])
def test_a_live_date_before_the_release_is_whole_rollovers_short(
    rollovers: int,
) -> None:
    calendar = Calendar(earliest_utc_s=NOON - 100 * DAY_S)
    calendar.learn(0, NOON - rollovers * ROLLOVER_S, is_sure=True)
    assert calendar.utc_s(0, DAY_S / 2) == NOON
    assert calendar.rollovers == rollovers


@pytest.mark.parametrize("days", [1, 14, 400])
def test_a_live_date_shortly_before_the_release_is_taken_as_sent(days: int) -> None:
    calendar = Calendar(earliest_utc_s=NOON + days * DAY_S)
    calendar.learn(0, NOON, is_sure=True)
    assert calendar.utc_s(0, DAY_S / 2) == NOON
    assert calendar.rollovers == 0


def test_a_live_date_after_the_release_is_left_alone() -> None:
    calendar = Calendar(earliest_utc_s=NOON)
    calendar.learn(0, NOON, is_sure=True)
    assert calendar.utc_s(0, DAY_S / 2) == NOON


@pytest.mark.parametrize("rollovers", [-1, 0, 1])
def test_a_recorded_date_is_brought_next_to_the_reference(rollovers: int) -> None:
    calendar = Calendar(reference_utc_s=NOON - 5.0)
    calendar.begin(0)
    calendar.learn(0, NOON - rollovers * ROLLOVER_S, is_sure=True)
    assert calendar.utc_s(0, DAY_S / 2) == NOON
    assert calendar.rollovers == rollovers


def test_the_reference_wins_over_the_release() -> None:
    old = NOON - 0.3 * ROLLOVER_S
    calendar = Calendar(reference_utc_s=old, earliest_utc_s=NOON)
    calendar.learn(0, old, is_sure=True)
    assert calendar.utc_s(0, DAY_S / 2 + old % DAY_S - DAY_S / 2) == old


def test_times_without_a_date_pass_midnight() -> None:
    calendar = Calendar(reference_utc_s=MIDNIGHT - 1.0)
    calendar.begin(7 * S)
    assert calendar.utc_s(7 * S, DAY_S - 1.0) == MIDNIGHT - 1.0
    assert calendar.utc_s(8 * S, 0.0) == MIDNIGHT
    # a late sentence of the day before
    assert calendar.utc_s(9 * S, DAY_S - 0.5) == MIDNIGHT - 0.5


def test_times_without_a_date_survive_an_outage_of_days() -> None:
    calendar = Calendar(reference_utc_s=NOON)
    calendar.begin(0)
    later_s = 5 * DAY_S + 100.0
    assert calendar.utc_s(round(later_s * S), DAY_S / 2 + 100.0) == NOON + later_s


def test_only_the_first_instant_of_the_stream_is_that_of_the_reference() -> None:
    calendar = Calendar(reference_utc_s=MIDNIGHT - 1.0)
    calendar.begin(0)
    calendar.begin(round(DAY_S) * S)
    assert calendar.utc_s(0, DAY_S - 1.0) == MIDNIGHT - 1.0


def test_a_configured_day_is_that_of_the_first_time() -> None:
    calendar = Calendar(day="2026-11-22")
    calendar.begin(0)
    assert calendar.utc_s(3600 * S, DAY_S - 1.0) == MIDNIGHT - 1.0
    assert calendar.utc_s(3602 * S, 1.0) == MIDNIGHT + 1.0


def test_a_date_without_a_fix_counts_until_one_comes_with_a_fix() -> None:
    calendar = Calendar()
    calendar.learn(0, NOON - 1000 * DAY_S, is_sure=False)
    assert calendar.utc_s(0, DAY_S / 2) == NOON - 1000 * DAY_S
    calendar.learn(1 * S, NOON, is_sure=True)
    calendar.learn(2 * S, NOON - 1000 * DAY_S, is_sure=False)
    assert calendar.utc_s(2 * S, DAY_S / 2 + 2.0) == NOON + 2.0


@pytest.mark.parametrize("years", [-46.9, -20.5, -8.0, -0.5, 12.0])
def test_a_live_date_of_manufacture_is_not_believed_without_a_fix(
    years: float,
) -> None:
    calendar = Calendar(earliest_utc_s=NOON - 10 * DAY_S)
    calendar.learn(0, NOON + years * 365.25 * DAY_S, is_sure=False)
    assert not calendar.is_known
    assert calendar.rollovers == 0
    calendar.learn(1 * S, NOON, is_sure=True)
    assert calendar.utc_s(1 * S, DAY_S / 2) == NOON


@pytest.mark.parametrize("rollovers", [0, 1, 2])
def test_a_live_clock_with_a_battery_is_believed_without_a_fix(rollovers: int) -> None:
    calendar = Calendar(earliest_utc_s=NOON - 400 * DAY_S)
    calendar.learn(0, NOON - rollovers * ROLLOVER_S, is_sure=False)
    assert calendar.utc_s(0, DAY_S / 2) == NOON
    assert calendar.rollovers == rollovers


@pytest.mark.parametrize("days", [-3000.0, -10.0, 10.0, 3000.0])
def test_a_date_without_a_fix_does_not_move_the_reference(days: float) -> None:
    calendar = Calendar(reference_utc_s=NOON)
    calendar.begin(0)
    calendar.learn(5 * S, NOON + days * DAY_S, is_sure=False)
    assert calendar.utc_s(5 * S, DAY_S / 2 + 5.0) == NOON + 5.0


def test_a_date_without_a_fix_next_to_the_reference_is_better_than_it() -> None:
    calendar = Calendar(reference_utc_s=NOON)
    calendar.begin(0)
    calendar.learn(5 * S, NOON + DAY_S + 5.0, is_sure=False)
    assert calendar.utc_s(5 * S, DAY_S / 2 + 5.0) == NOON + DAY_S + 5.0


def test_a_leap_second_is_the_midnight_that_it_delays() -> None:
    calendar = Calendar()
    calendar.learn(0, MIDNIGHT - 1.0, is_sure=True)
    assert calendar.utc_s(1 * S, DAY_S) == MIDNIGHT
    assert calendar.utc_s(2 * S, 0.0) == MIDNIGHT
