"""The package after it was installed: the next version, removal, purge.

The last file of this folder: nothing runs after it.
"""

import pytest

from system.conftest import CONFIGURATION, INSTALL_S, Measure
from system.tracker import (
    LOG,
    SYNC_S,
    Tracker,
    assert_times_grow,
    longest_hole_s,
    rows_of,
)

pytestmark = pytest.mark.system

NEXT = "/mnt/host/packages/next.deb"
UNIT = "imu-tracker"


def test_an_upgrade_restarts_what_runs_and_keeps_everything(
    tracker: Tracker, measure: Measure
) -> None:
    machine = tracker.machine
    machine.runs(f"echo '# mine' >> {CONFIGURATION}")
    pid, before = tracker.pid(), tracker.rows()
    machine.runs(f"apt-get install --yes {NEXT}", INSTALL_S)
    assert "next" in machine.runs("dpkg-query --show imu-tracker")
    tracker.wait_for_imu(is_there=True)
    assert tracker.pid() != pid
    tracker.wait_for_rows()
    rows = tracker.rows()
    assert rows[: len(before)] == before
    assert_times_grow(rows)
    hole_s = longest_hole_s(rows[len(before) - 1 :])
    measure("hole of the restart", hole_s, "s")
    # While the files are replaced the old one goes on: rows are missing from its end
    # to the READY of the new one, and no longer.
    ready_s = int(tracker.show("ActiveEnterTimestampMonotonic")) / 1e6
    ended_s = int(tracker.show("InactiveEnterTimestampMonotonic")) / 1e6
    assert hole_s <= ready_s - ended_s + SYNC_S
    assert machine.runs(f"tail -n 1 {CONFIGURATION}") == "# mine\n"


def test_removed_it_is_stopped_and_leaves_what_is_the_users(tracker: Tracker) -> None:
    machine = tracker.machine
    machine.runs("apt-get remove --yes imu-tracker", INSTALL_S)
    assert machine.tries(f"systemctl is-active {UNIT}").code != 0
    assert machine.tries("pgrep -u imu-tracker").code != 0
    machine.runs(f"test ! -e /usr/lib/imu-tracker && test -s {CONFIGURATION}")
    assert_times_grow(rows_of(machine.runs(f"cat {LOG}")))


def test_purged_it_leaves_the_log(tracker_is_gone: Tracker) -> None:
    machine = tracker_is_gone.machine
    machine.runs("apt-get purge --yes imu-tracker", INSTALL_S)
    machine.runs("test ! -e /etc/imu-tracker && test ! -e /var/lib/imu-tracker")
    machine.runs(f"test -s {LOG}")


@pytest.fixture
def tracker_is_gone(installed: Tracker) -> Tracker:
    """The machine after the removal: nobody to wait for."""
    return installed
