"""imu-tracker as the machine's systemd runs it: its unit, its journal, its files."""

import json
import math
import re
import time
from collections.abc import Callable
from datetime import datetime
from itertools import pairwise
from typing import Any, NamedTuple

from system.machine import Machine
from system.receiver import error_m

TELL = "/mnt/host/tests/system/guest/tell.py"
UNIT = "imu-tracker"
SLOW = 6.0
"""By how much a promise about time may be exceeded: emulated, it takes ten times as
long; what is promised for a Pi is measured elsewhere, and here only printed."""

LOG = "/var/log/imu-tracker/latlong.csv"
STATUS = "/run/imu-tracker/status.json"

PATIENCE_S = 900.0
"""For everything that must come: a start may take a minute in there."""

GRID_S = 0.25
SYNC_S = 5.0
WITH_IMU = ("still", "gps", "dr")

_ROW = re.compile(
    r"(\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d\.\d{3}Z)"
    r",(-?\d+\.\d{8}),(-?\d+\.\d{8}),(?:-?\d+\.\d)?"
    r",(\d+\.\d\d),(?:\d+\.\d)?,(\d+\.\d\d)"
    r",(gpsonly|still|gps|dr)"
)


class Row(NamedTuple):
    """What a row of the log says."""

    utc_s: float
    lat_deg: float
    lon_deg: float
    speed_mps: float
    r95_m: float
    mode: str


class Line(NamedTuple):
    """One line of the journal."""

    t_s: float
    text: str


class Tracker:
    """The service in a machine."""

    def __init__(self, machine: Machine) -> None:
        self.machine = machine

    # systemd.

    def show(self, name: str) -> str:
        """Return a property of the unit."""
        return self.machine.runs(f"systemctl show {UNIT} -p {name} --value").strip()

    def pid(self) -> int:
        return int(self.show("MainPID"))

    def restarts(self) -> int:
        return int(self.show("NRestarts"))

    def wait_for_restart(self, restarts: int) -> None:
        """Wait until systemd has started it again and rows come."""
        newest = self.newest()
        self.wait_for("a restart", lambda: self.restarts() > restarts)
        self.wait_for("READY", lambda: self.show("ActiveState") == "active")
        self.wait_for_newer(newest)

    def uptime_s(self) -> float:
        """Return the machine's CLOCK_MONOTONIC, which its journal has as well."""
        return float(self.machine.runs("cut -d ' ' -f 1 /proc/uptime"))

    def journal(self, since_s: float = 0.0) -> list[Line]:
        """Return what the daemon said, and systemd about it, since an instant."""
        fields = "--output-fields=MESSAGE"
        text = self.machine.runs(f"journalctl -b -u {UNIT} -o json {fields}")
        lines = [json.loads(line) for line in text.splitlines()]
        said = [
            Line(int(line["__MONOTONIC_TIMESTAMP"]) / 1e6, str(line["MESSAGE"]))
            for line in lines
        ]
        return [line for line in said if line.t_s >= since_s]

    # The sensors.

    def bus(self, words: str) -> dict[str, Any]:
        """Tell the bus of the chip something; see guest/bus.py."""
        answer: dict[str, Any] = json.loads(
            self.machine.runs(f"python3 -I -S {TELL} {words}")
        )
        assert "error" not in answer, answer
        return answer

    # The files.

    def status(self) -> dict[str, Any]:
        """Return the status, {} while there is none."""
        done = self.machine.tries(f"cat {STATUS}")
        status: dict[str, Any] = json.loads(done.out) if done.code == 0 else {}
        return status

    def text(self, path: str = LOG) -> str:
        return self.machine.runs(f"cat {path}")

    def rows(self, last: int = 0) -> list[Row]:
        """Return all rows, or so many of the newest; each must be whole.

        But for what follows the last newline: a row that is just being written, or
        after a power cut what the daemon has not cut off yet. Were it to stay there,
        the next row would not be one.
        """
        text = self.machine.runs(f"tail -n {last} {LOG}") if last else self.text()
        return rows_of(_whole_lines(text))

    # Waiting.

    def wait_for(self, what: str, condition: Callable[[], bool]) -> float:
        """Wait until something is so; return how long it took."""
        begun_s = time.monotonic()
        while not condition():
            waited_s = time.monotonic() - begun_s
            assert waited_s < PATIENCE_S, f"in vain: {what}\n{self._last_words()}"
            time.sleep(0.3)
        return time.monotonic() - begun_s

    def wait_for_newer(self, utc_s: float) -> None:
        """Wait for a row that is later than this."""
        self.wait_for("a new row", lambda: self.newest() > utc_s)

    def wait_for_rows(self, more: int = 8) -> None:
        """Wait until there are so many rows more."""
        newest = self.newest()
        self.wait_for(
            f"{more} more rows", lambda: self.newest() >= newest + more * GRID_S
        )

    def wait_for_imu(self, *, is_there: bool) -> None:
        """Wait until the rows of two seconds have been made with an IMU, or without.

        An emulated computer that shares its processor delivers some samples too late
        to be used, as no Pi does: half of the rows will do.
        """

        def holds() -> bool:
            modes = [row.mode for row in self.rows(last=8)]
            n_with = sum(mode in WITH_IMU for mode in modes)
            return n_with >= 4 if is_there else bool(modes) and not n_with

        self.wait_for(f"IMU {'there' if is_there else 'not there'}", holds)

    def newest(self) -> float:
        """Return the time of the newest row, minus infinity without any."""
        rows = rows_of(_whole_lines(self.machine.tries(f"tail -n 2 {LOG}").out))
        return rows[-1].utc_s if rows else -math.inf

    def _last_words(self) -> str:
        return "\n".join(line.text for line in self.journal()[-20:])


def _whole_lines(text: str) -> str:
    return text[: text.rfind("\n") + 1]


def rows_of(text: str) -> list[Row]:
    """Read the text of a log; nothing but whole rows and headers may be in it."""
    assert not text or text.endswith("\n"), f"a torn row: {text[-100:]!r}"
    rows = []
    for line in text.splitlines():
        if line.startswith("time_utc,"):
            continue
        match = _ROW.fullmatch(line)
        assert match, f"not a row: {line!r}"
        time_utc, lat, lon, speed, r95, mode = match.groups()
        utc_s = datetime.fromisoformat(time_utc).timestamp()
        rows.append(Row(utc_s, float(lat), float(lon), float(speed), float(r95), mode))
    return rows


def assert_times_grow(rows: list[Row]) -> None:
    """Fail when a row is not later than the one before it."""
    for before, after in pairwise(rows):
        assert after.utc_s > before.utc_s, (before, after)


def longest_hole_s(rows: list[Row]) -> float:
    """Return the longest time between two rows."""
    return max(after.utc_s - before.utc_s for before, after in pairwise(rows))


def truth_inside_r95(rows: list[Row]) -> float:
    """Return the share of rows whose circle holds the true position."""
    inside = [error_m(row.utc_s, row.lat_deg, row.lon_deg) <= row.r95_m for row in rows]
    return sum(inside) / len(inside)


def worst_error_m(rows: list[Row]) -> float:
    """Return how far off the worst row is."""
    return max(error_m(row.utc_s, row.lat_deg, row.lon_deg) for row in rows)
