"""The receiver on a real serial port: silent for a while, and late all at once."""

import time

import pytest

from system.conftest import Measure
from system.receiver import Receiver
from system.tracker import (
    GRID_S,
    SLOW,
    Tracker,
    assert_times_grow,
    longest_hole_s,
    truth_inside_r95,
    worst_error_m,
)

pytestmark = pytest.mark.system

OUTAGE_S = 20.0
GPS_MODE_S = 2.0
BACK_S = 2.0


def test_a_receiver_that_falls_silent_is_missed_and_used_again(
    tracker: Tracker, receiver: Receiver, measure: Measure
) -> None:
    newest = tracker.newest()
    silent_s = receiver.utc().timestamp()
    receiver.silence()
    time.sleep(OUTAGE_S)
    epoch_s = receiver.speak()
    tracker.wait_for("a fix", lambda: tracker.status()["fix_age_s"] < GPS_MODE_S)
    tracker.wait_for("its rows", lambda: tracker.newest() > epoch_s + 10)
    rows = [row for row in tracker.rows() if row.utc_s >= newest]
    blind = [r for r in rows if silent_s + GPS_MODE_S + 1 < r.utc_s < epoch_s]
    assert {row.mode for row in blind} <= {"dr", "gpsonly"}
    assert blind[-1].r95_m > 2 * blind[0].r95_m, "the radius tells of the outage"
    seen = next(r for r in rows if r.utc_s >= epoch_s and r.r95_m < blind[-1].r95_m / 2)
    assert longest_hole_s(rows) == pytest.approx(GRID_S), "rows never stop"
    assert truth_inside_r95(rows) >= 0.9
    measure("used again after", seen.utc_s - epoch_s, "s")
    measure("truth inside r95", 100 * truth_inside_r95(rows), "%")
    assert seen.utc_s - epoch_s <= BACK_S * SLOW


def test_a_burst_of_stale_fixes_drags_nothing_back(
    tracker: Tracker, receiver: Receiver, measure: Measure
) -> None:
    newest, jumps = tracker.newest(), tracker.status()["learnt"]["utc_jumps"]
    receiver.hold()
    time.sleep(OUTAGE_S)
    n_stale = receiver.release()
    released_s = receiver.utc().timestamp()
    tracker.wait_for("later rows", lambda: tracker.newest() > released_s + 10)
    asked_s, newest_s = receiver.utc().timestamp(), tracker.newest()
    told_s = receiver.utc().timestamp()
    rows = [row for row in tracker.rows() if row.utc_s >= newest]
    after = [row for row in rows if row.utc_s > released_s]
    assert n_stale >= OUTAGE_S - 2, "the test itself"
    assert_times_grow(rows)
    assert longest_hole_s(rows) == pytest.approx(GRID_S), "rows never stop"
    assert tracker.status()["learnt"]["utc_jumps"] == jumps
    assert asked_s - SLOW <= newest_s <= told_s, "UTC is what it was"
    assert truth_inside_r95(after) >= 0.9
    measure("stale fixes at once", n_stale, "")
    measure("worst error after them", worst_error_m(after), "m")
    measure("truth inside r95", 100 * truth_inside_r95(after), "%")
    # The oldest of them lay 200 m back.
    assert worst_error_m(after) < 30
