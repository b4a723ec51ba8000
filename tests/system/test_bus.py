"""The chip behind the kernel's own bus, and what happens on the way there."""

import time

import pytest

from system.conftest import Measure
from system.tracker import (
    GRID_S,
    SLOW,
    Row,
    Tracker,
    assert_times_grow,
    longest_hole_s,
    truth_inside_r95,
)

pytestmark = pytest.mark.system

DEVICE = "test -c /dev/i2c-1"
BACK_S = 2.0
SCRUB_S = 1.0

FAULTS = {
    "nobody acknowledges": ("nack on", "nack off", 10),
    "every transfer is refused": ("stall on", "stall off", 10),
    "every transfer hangs": ("hang on", "hang off", 25),
    "the adapter is unplugged": ("unplug", "plug", 10),
}


def rows_since(tracker: Tracker, utc_s: float) -> list[Row]:
    rows = [row for row in tracker.rows() if row.utc_s >= utc_s]
    assert_times_grow(rows)
    return rows


@pytest.mark.parametrize("fault", FAULTS)
def test_the_bus_may_fail_and_come_back(
    tracker: Tracker, measure: Measure, fault: str
) -> None:
    begin, end, lasts_s = FAULTS[fault]
    pid, newest = tracker.pid(), tracker.newest()
    begun_s = tracker.bus(begin)["t_s"]
    time.sleep(lasts_s)
    tracker.wait_for_imu(is_there=False)
    tracker.bus(end)
    # An adapter is back when the kernel and udev have made its device anew.
    tracker.wait_for("its device", lambda: tracker.machine.tries(DEVICE).code == 0)
    tracker.machine.runs("udevadm settle")
    mended_s = tracker.uptime_s()
    tracker.wait_for_imu(is_there=True)
    assert tracker.pid() == pid, "no fault of a sensor ends the daemon"
    said = [line for line in tracker.journal(begun_s) if line.text.startswith("imu ")]
    lost, ready = said  # one line for each transition
    assert lost.text.startswith("imu lost: ")
    assert ready.text.startswith("imu ready: MPU-6050")
    rows = rows_since(tracker, newest)
    assert longest_hole_s(rows) == pytest.approx(GRID_S), "rows never stop"
    measure("said after", lost.t_s - begun_s, "s")
    measure("back after", max(0.0, ready.t_s - mended_s), "s")
    measure("truth inside r95", 100 * truth_inside_r95(rows), "%")
    assert ready.t_s - mended_s <= BACK_S * SLOW
    assert truth_inside_r95(rows) >= 0.9


def test_a_chip_that_lost_its_power_is_set_up_again(
    tracker: Tracker, measure: Measure
) -> None:
    pid, newest = tracker.pid(), tracker.newest()
    cut_s = tracker.bus("brownout")["t_s"]
    tracker.wait_for("a chip awake", lambda: tracker.bus("report")["woke_s"] > cut_s)
    awake_s = tracker.bus("report")["woke_s"] - cut_s
    tracker.wait_for_rows(20)
    tracker.wait_for_imu(is_there=True)
    assert tracker.pid() == pid
    assert longest_hole_s(rows_since(tracker, newest)) == pytest.approx(GRID_S)
    measure("noticed and woken after", awake_s, "s")
    assert awake_s <= SCRUB_S * SLOW


def test_a_transfer_now_and_then_may_fail(tracker: Tracker) -> None:
    begun_s, pid = tracker.uptime_s(), tracker.pid()
    for _ in range(5):
        tracker.bus("nack once")
        tracker.wait_for_rows(8)
    lost = [line for line in tracker.journal(begun_s) if "imu lost" in line.text]
    assert not lost
    assert tracker.pid() == pid
