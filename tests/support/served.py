"""A log and a status as the daemon would write them, and the server beside them."""

import json
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

from imu_tracker.storage.latlong import HEADER

NOON = datetime(2026, 11, 22, 12, tzinfo=UTC)


def line(number: int, mode: str = "gps", r95: float = 3.94) -> str:
    """A row of a drive to the north-east at 4 Hz."""
    time_utc = (NOON + timedelta(seconds=number / 4)).isoformat(timespec="milliseconds")
    lat = 51.99 + number * 1e-5
    return (
        f"{time_utc.removesuffix('+00:00')}Z,{lat:.8f},4.37000034,5.2,13.80,40.1,"
        f"{r95:.2f},{mode}\n"
    )


class Daemon:
    """What stands for it: it writes rows and a status, and may be gone."""

    def __init__(self, folder: Path) -> None:
        self.log, self.status = folder / "latlong.csv", folder / "status.json"
        self.rows = 0
        self.log.write_text(f"{HEADER}\n")

    def write(self, *modes: str, r95: float = 3.94) -> None:
        with self.log.open("a") as file:
            for mode in modes:
                file.write(line(self.rows, mode, r95))
                self.rows += 1

    def append(self, data: bytes) -> None:
        with self.log.open("ab") as file:
            file.write(data)

    def tell(self, **more: Any) -> None:
        status = {"t_ns": time.monotonic_ns(), "pid": os.getpid(), "fix_age_s": 0}
        new = self.status.with_suffix(".new")
        new.write_text(json.dumps(status | {"state": "tracking"} | more))
        new.replace(self.status)

    def leave(self) -> None:
        self.status.unlink(missing_ok=True)


class Served:
    """A running `imu-tracker serve`."""

    def __init__(self, process: subprocess.Popen[str], ports: dict[str, int]) -> None:
        self.process, self.ports = process, ports

    @property
    def url(self) -> str:
        return f"http://127.0.0.1:{self.ports['page']}/"


@contextmanager
def serving(daemon: Daemon, *settings: str) -> Iterator[Served]:
    """Run the real program on free ports until the end of the block."""
    chosen = [f"log.path={daemon.log}", f"status.path={daemon.status}"]
    chosen += [f"serve.{name}=127.0.0.1:0" for name in ("page", "gpsd", "nmea")]
    arguments = [part for key in (*chosen, *settings) for part in ("--set", key)]
    process = subprocess.Popen(
        [sys.executable, "-m", "imu_tracker", "serve", *arguments],
        stderr=subprocess.PIPE,
        text=True,
    )
    assert process.stderr is not None
    try:
        ports: dict[str, int] = {}
        for name in ("page", "gpsd", "nmea"):
            said = process.stderr.readline()
            match = re.search(r":(\d+)/?$", said.strip())
            assert match, said
            ports[name] = int(match[1])
        yield Served(process, ports)
    finally:
        process.send_signal(signal.SIGTERM)
        process.wait(10)
        process.stderr.close()
