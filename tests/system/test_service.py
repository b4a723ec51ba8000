"""Installed by its package and run by systemd: started, confined, killed, hung."""

import json
import re

import pytest

from system.conftest import CHECK, CONFIGURATION, LIBRARIES, Measure
from system.machine import Machine
from system.tracker import (
    GRID_S,
    LOG,
    SLOW,
    STATUS,
    Tracker,
    assert_times_grow,
    longest_hole_s,
    rows_of,
)

pytestmark = pytest.mark.system

STATE = "/var/lib/imu-tracker/state.json"
WATCHDOG_S = 30.0
STOP_S = 2.0

PERMITTED_DEVICES = ("/dev/i2c-1", "/dev/ttyS1", "/dev/null")
FORBIDDEN_DEVICES = ("/dev/vda", "/dev/cpu_dma_latency", "/dev/vga_arbiter")


def test_three_commands_install_it_without_a_network(
    installation: dict[str, str], installed: Tracker, measure: Measure
) -> None:
    (table,) = (text for command, text in installation.items() if command == CHECK)
    assert re.search(
        r"^ok +IMU +MPU-6050 at 0x68 on /dev/i2c-1: (1\.0|0\.9)\d g", table, re.M
    )
    assert re.search(r"^ok +GPS port +/dev/serial0 at 9600 baud: GGA RMC", table, re.M)
    installed.wait_for_imu(is_there=True)
    rows = installed.rows()
    assert_times_grow(rows)
    ready_s = int(installed.show("ActiveEnterTimestampMonotonic")) / 1e6
    measure("from start to READY", ready_s - installed.journal()[0].t_s, "s")
    measure("IMU", installed.status()["imu_rate_hz"], "samples/s")


def test_its_files_are_for_it_and_its_group(tracker: Tracker) -> None:
    paths = {
        LOG: "640 imu-tracker imu-tracker",
        STATUS: "640 imu-tracker imu-tracker",
        "/var/log/imu-tracker": "750 imu-tracker imu-tracker",
        "/var/lib/imu-tracker": "750 imu-tracker imu-tracker",
        "/run/imu-tracker": "750 imu-tracker imu-tracker",
    }
    found = tracker.machine.runs(f"stat -c '%a %U %G' {' '.join(paths)}")
    assert found.splitlines() == list(paths.values())
    groups = set(tracker.machine.runs("id -nG imu-tracker").split())
    assert groups == {"imu-tracker", "i2c", "dialout"}
    assert tracker.machine.tries(f"sudo -u pi head -n 1 {LOG}").code == 0
    assert tracker.machine.tries(f"sudo -u nobody head -n 1 {LOG}").code != 0


def test_who_may_read_the_log_may_ask_how_it_is(tracker: Tracker) -> None:
    program = "imu-tracker"
    status = json.loads(tracker.machine.runs(f"sudo -u pi {program} status --json"))
    assert status["state"] == "tracking"
    assert status["pid"] == tracker.pid()


def test_systemd_rates_its_exposure_at_most_one(
    tracker: Tracker, measure: Measure
) -> None:
    said = tracker.machine.runs("systemd-analyze security --no-pager imu-tracker")
    match = re.search(r"Overall exposure level for \S+: ([\d.]+)", said)
    assert match, said
    measure("exposure", float(match[1]), "of 10")
    assert float(match[1]) <= 1.0


def probe(machine: Machine, *devices: str) -> dict[str, str]:
    """Run guest/probe.py as the daemon is run; return what it could do."""
    python = f"/usr/bin/env PYTHONPATH={LIBRARIES} python3"
    script = "tests/system/guest/probe.py"
    machine.runs(
        "sed -e '/^(Restart|WatchdogSec|ExecReload)/d' -e 's/^Type=.*/Type=oneshot/'"
        f" -e 's#^ExecStart=.*#ExecStart={python} /mnt/host/{script}"
        f" {' '.join(devices)}#'"
        " -e 's/^RuntimeDirectory=.*/RuntimeDirectory=imu-tracker-probe/' -E"
        " /usr/lib/systemd/system/imu-tracker.service"
        " > /run/systemd/system/imu-tracker-probe.service"
    )
    machine.runs("systemctl daemon-reload && systemctl start imu-tracker-probe")
    *_, said = (
        line
        for line in machine.runs(
            "journalctl -b -u imu-tracker-probe -o cat --no-pager"
        ).splitlines()
        if line.startswith("{")
    )
    could: dict[str, str] = json.loads(said)
    return could


def test_it_may_do_what_it_needs_and_nothing_else(
    tracker: Tracker, measure: Measure
) -> None:
    # Everybody may open these, were it not for the device policy.
    tracker.machine.runs(f"chmod 666 {' '.join(FORBIDDEN_DEVICES)}")
    for device in FORBIDDEN_DEVICES:
        tracker.machine.runs(
            f"runuser -u imu-tracker -- python3 -c \"open('{device}', 'rb')\""
        )
    could = probe(tracker.machine, *PERMITTED_DEVICES, *FORBIDDEN_DEVICES)
    permitted = {
        *(f"open {device}" for device in PERMITTED_DEVICES),
        "write /var/lib/imu-tracker",
        "write /var/log/imu-tracker",
        "write /run/imu-tracker-probe",
        "write /tmp",  # its own
        "numpy and scipy",
    }
    assert {what for what, how in could.items() if how == "yes"} == permitted
    for device in FORBIDDEN_DEVICES:
        assert could[f"open {device}"] == "EPERM"
    measure("permitted", len(permitted), "attempts")
    measure("refused", len(could) - len(permitted), "attempts")


def test_it_can_be_kept_to_its_own_bus_and_port(tracker: Tracker) -> None:
    # Of the others its groups are members as well: the device policy alone is against.
    machine, others = tracker.machine, ("/dev/i2c-0", "/dev/ttyS0")
    machine.runs(f"chgrp dialout /dev/ttyS0; chmod 660 {' '.join(others)}")
    ours = ("/dev/i2c-1", "/dev/ttyS1")
    could = probe(machine, *ours, *others)
    assert {could[f"open {device}"] for device in (*ours, *others)} == {"yes"}
    drop_in = "/run/systemd/system/imu-tracker-probe.service.d"
    machine.runs(f"install -D -m 644 -t {drop_in} /mnt/host/systemd/narrow.conf")
    try:
        could = probe(machine, *ours, *others)
    finally:
        machine.runs(f"rm -r {drop_in}")
    assert {could[f"open {device}"] for device in ours} == {"yes"}
    assert {could[f"open {device}"] for device in others} == {"EPERM"}


def test_a_daemon_that_is_killed_is_back_and_goes_on(
    tracker: Tracker, measure: Measure
) -> None:
    restarts, newest = tracker.restarts(), tracker.newest()
    tracker.machine.runs(f"kill -KILL {tracker.pid()}")
    tracker.wait_for_restart(restarts)
    tracker.wait_for_rows()
    assert tracker.restarts() == restarts + 1
    rows = tracker.rows()
    assert_times_grow(rows)
    measure("rows missing", longest_hole_s([r for r in rows if r.utc_s >= newest]), "s")


def test_the_watchdog_bites_a_daemon_that_hangs(
    tracker: Tracker, measure: Measure
) -> None:
    restarts, pid = tracker.restarts(), tracker.pid()
    begun_s = tracker.uptime_s()
    tracker.machine.runs(f"kill -STOP {pid}")
    tracker.wait_for_restart(restarts)
    said = tracker.journal(begun_s)
    (bite,) = (line for line in said if "Watchdog timeout" in line.text)
    assert any("Failed with result 'watchdog'" in line.text for line in said)
    assert bite.t_s - begun_s <= WATCHDOG_S * SLOW
    assert tracker.restarts() == restarts + 1
    assert tracker.pid() != pid
    assert_times_grow(tracker.rows())
    ready_s = int(tracker.show("ActiveEnterTimestampMonotonic")) / 1e6
    measure("bitten after", bite.t_s - begun_s, "s")
    measure("ready again", ready_s - bite.t_s, "s later")


def test_a_log_that_is_moved_away_is_begun_anew(tracker: Tracker) -> None:
    newest = tracker.newest()
    tracker.machine.runs(f"mv {LOG} {LOG}.moved && systemctl reload imu-tracker")
    tracker.wait_for_newer(newest)
    rows = rows_of(tracker.text(f"{LOG}.moved")) + tracker.rows()
    tracker.machine.runs(f"rm {LOG}.moved")
    assert longest_hole_s([r for r in rows if r.utc_s >= newest]) == pytest.approx(
        GRID_S
    )


def test_it_ends_in_time_and_keeps_what_it_learnt(
    tracker: Tracker, measure: Measure
) -> None:
    newest = tracker.newest()
    tracker.machine.runs(f"systemctl stop imu-tracker && rm -f {STATE}")
    tracker.machine.runs("systemctl start imu-tracker")
    tracker.wait_for_newer(newest)
    tracker.wait_for_rows(20)  # all of the new process
    tracker.wait_for_imu(is_there=True)
    tracker.wait_for_rows(20)  # which suffice to learn where down is
    begun_s = tracker.uptime_s()
    tracker.machine.runs("systemctl stop imu-tracker")
    try:
        assert tracker.show("Result") == "success"
        assert tracker.show("ExecMainStatus") == "0"
        said = tracker.journal(begun_s)
        rows_of(tracker.text())  # whole, to the last byte
        json.loads(tracker.text(STATE))
        found = tracker.machine.runs(f"stat -c '%a %U %G' {STATE}")
    finally:
        tracker.machine.runs("systemctl start imu-tracker")
    (stopping,) = (line for line in said if line.text.startswith("Stopping "))
    (ended,) = (line for line in said if line.text.startswith("ended: told to"))
    assert not any("is not kept" in line.text for line in said)
    assert ended.t_s - stopping.t_s <= STOP_S * SLOW
    assert found == "640 imu-tracker imu-tracker\n"
    tracker.wait_for(
        "what was learnt",
        lambda: any(
            "begins with what was learnt" in line.text
            for line in tracker.journal(begun_s)
        ),
    )
    measure("from SIGTERM to its last word", ended.t_s - stopping.t_s, "s")


def test_a_wrong_configuration_is_told_once_and_not_tried_again(
    tracker: Tracker,
) -> None:
    tracker.machine.runs(f"cp {CONFIGURATION} /tmp/right.toml")
    tracker.machine.runs(f"sed -i 's/^sync_s = .*/sync_s = -1/' {CONFIGURATION}")
    begun_s = tracker.uptime_s()
    try:
        assert tracker.machine.tries("systemctl restart imu-tracker").code != 0
        tracker.machine.runs("sleep 10")
        assert tracker.show("ExecMainStatus") == "78"
        assert tracker.show("ActiveState") == "failed"
        said = [line.text for line in tracker.journal(begun_s)]
        assert len([text for text in said if text.startswith("log.sync_s = -1")]) == 1
    finally:
        tracker.machine.runs(f"cat /tmp/right.toml > {CONFIGURATION}")
        tracker.machine.runs("systemctl start imu-tracker")
