"""The power fails: QEMU is killed between two instructions of the machine.

What the machine had not flushed to its disk is gone, as on a Pi. What no such test can
say is what an SD card does that tells lies about its own cache.
"""

import json
import time
from random import Random

import pytest

from system.conftest import LIBRARIES, Measure, plug_in_the_chip
from system.tracker import GRID_S, SYNC_S, Tracker, assert_times_grow, rows_of

pytestmark = pytest.mark.system

CUTS = 6
BEFORE = "/run/before"
"""What was on the disk before the daemon was started again."""

SAVER = "/mnt/host/tests/system/guest/saver.py"
TOLD = "/run/imu-tracker-test-saver"


def test_a_power_cut_costs_a_few_seconds_and_nothing_else(
    tracker: Tracker, measure: Measure
) -> None:
    machine, random = tracker.machine, Random(5)
    lost_s, torn, saved = [], 0, 0
    for _ in range(CUTS):
        machine.runs(
            "systemd-run --quiet --unit imu-tracker-test-saver"
            f" --setenv PYTHONPATH={LIBRARIES} /usr/bin/python3 {SAVER}"
        )
        tracker.wait_for_rows(28)  # more than one sync ago
        time.sleep(random.uniform(0, SYNC_S))
        told = int(machine.runs(f"cat {TOLD}"))
        seen_s = tracker.newest()
        machine.cut_power()
        machine.boot()

        left = machine.runs(f"cat {BEFORE}/imu-tracker/latlong.csv")
        whole, newline, tail = left.rpartition("\n")
        torn += bool(tail)
        kept = rows_of(whole + newline)
        lost_s.append(max(0.0, seen_s - kept[-1].utc_s))
        state = json.loads(machine.runs(f"cat {BEFORE}/state/saver.json"))
        assert state["number"] >= told
        saved += told

        # It was enabled: it comes back by itself, and goes on where it was.
        tracker.wait_for_newer(seen_s)
        rows = tracker.rows()
        assert_times_grow(rows)
        assert rows[: len(kept)] == kept
    plug_in_the_chip(machine)
    measure("cuts", CUTS, "")
    measure("lost at most", max(lost_s), "s")
    measure("torn rows on the disk", torn, "")
    measure("times that a file was replaced meanwhile", saved, "")
    assert max(lost_s) <= SYNC_S + GRID_S
