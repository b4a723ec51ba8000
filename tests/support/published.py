"""Logs to publish, and the program that publishes them."""

import math
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from datetime import UTC, datetime
from pathlib import Path
from threading import Event
from typing import Final

from imu_tracker.config import load_config
from imu_tracker.publish.program import worker_of
from imu_tracker.publish.worker import Worker
from imu_tracker.storage.latlong import HEADER, LogRow, format_utc

NOON_S: Final = datetime(2026, 11, 22, 12, tzinfo=UTC).timestamp()


def row(
    second: float,
    *,
    lat_deg: float = 51.99,
    lon_deg: float = 4.37,
    speed_mps: float = 13.8,
    course_deg: float = 40.1,
    r95_m: float = 3.94,
    mode: str = "gps",
) -> LogRow:
    """Return a row so many seconds after noon; only what a test is about is said."""
    return LogRow(
        NOON_S + second, lat_deg, lon_deg, 5.2, speed_mps, course_deg, r95_m, mode
    )


def line(row: LogRow) -> str:
    """Return a row as the log has it."""
    texts = [
        f"{row.lat_deg:.8f}",
        f"{row.lon_deg:.8f}",
        "" if math.isnan(row.alt_m) else f"{row.alt_m:.1f}",
        f"{row.speed_mps:.2f}",
        "" if math.isnan(row.course_deg) else f"{row.course_deg:.1f}",
        f"{row.r95_m:.2f}",
        row.mode,
    ]
    return f"{format_utc(row.utc_s)},{','.join(texts)}\n"


def write_log(path: Path, rows: list[LogRow]) -> None:
    path.write_text(f"{HEADER}\n" + "".join(map(line, rows)))


def drive(rows: int, begin: int = 0) -> list[LogRow]:
    """Return rows of a straight drive at 4 Hz."""
    return [
        row(number / 4, lat_deg=round(40.0 + number * 3e-5, 8))
        for number in range(begin, begin + rows)
    ]


def arguments(log: Path, folder: Path, name: str, **keys: object) -> list[str]:
    """Return what the program is started with for one destination."""
    chosen = {
        "log.path": log,
        "status.path": folder / "daemon.json",
        "status.publish": folder / "publish.json",
        f"publish.{name}.cursor_dir": folder / "cursors",
        f"publish.{name}.device": "car",
        **{f"publish.{name}.{key}": value for key, value in keys.items()},
    }
    pairs = [f"{key}={value}" for key, value in chosen.items()]
    return [part for pair in pairs for part in ("--set", pair)]


def publish_once(*arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "imu_tracker", "publish", "--once", *arguments],
        capture_output=True,
        text=True,
        check=False,
    )


@contextmanager
def publishing(*arguments: str) -> Iterator[subprocess.Popen[str]]:
    """Run the real program until the end of the block."""
    process = subprocess.Popen(
        [sys.executable, "-m", "imu_tracker", "publish", *arguments],
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        yield process
    finally:
        if process.poll() is None:
            process.send_signal(signal.SIGTERM)
        process.communicate()


@contextmanager
def working(*arguments: str) -> Iterator[Worker]:
    """Run what serves one destination in this process until the end of the block."""
    config = load_config(None, arguments[1::2])
    stop = Event()
    with ExitStack() as opened:
        worker = worker_of(config, config.publish[0], stop, opened)
        opened.pop_all()
    worker.start()
    try:
        yield worker
    finally:
        stop.set()
        assert worker.join(60.0)
        if worker.error is not None:
            raise worker.error
