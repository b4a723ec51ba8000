"""The power fails: QEMU is killed between two instructions of the machine.

What the machine had not flushed to its disk is gone, as on a Pi. What no such test can
say is what an SD card does that tells lies about its own cache.
"""

import json
import time
from random import Random

import pytest

from system.conftest import Measure, plug_in_the_chip
from system.tracker import GRID_S, SYNC_S, Tracker, assert_times_grow, rows_of

pytestmark = pytest.mark.system

CUTS = 6
BEFORE = "/run/before"
"""What was on the disk before the daemon was started again."""


def test_a_power_cut_costs_a_few_seconds_and_nothing_else(
    tracker: Tracker, measure: Measure
) -> None:
    machine, random = tracker.machine, Random(5)
    lost_s, torn = [], 0
    for _ in range(CUTS):
        tracker.wait_for_rows(28)  # more than one sync ago
        time.sleep(random.uniform(0, SYNC_S))
        seen_s = tracker.newest()
        machine.cut_power()
        machine.boot()
        left = machine.runs(f"cat {BEFORE}/imu-tracker/latlong.csv")
        whole, newline, tail = left.rpartition("\n")
        torn += bool(tail)
        kept = rows_of(whole + newline)
        assert_times_grow(kept)
        lost_s.append(max(0.0, seen_s - kept[-1].utc_s))
        for path in machine.runs(f"find {BEFORE}/state -name '*.json'").split():
            assert json.loads(machine.runs(f"cat {path}")), path
        plug_in_the_chip(machine)
        # It was enabled: it comes back by itself, and goes on where it was.
        tracker.wait_for_newer(seen_s)
        rows = tracker.rows()
        assert_times_grow(rows)
        assert rows[: len(kept)] == kept
        tracker.wait_for_imu(is_there=True)
    measure("cuts", CUTS, "")
    measure("lost at most", max(lost_s), "s")
    measure("torn tails", torn, "")
    assert max(lost_s) <= SYNC_S + GRID_S
