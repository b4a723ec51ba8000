"""Left alone for months: the daemon's loop in accelerated time, on a drive without end.

Nothing may grow but the log, and that within its bound; and no time, no place and no
number may come at which rows stop, turn back or stop keeping their promise.
"""

import gc
import logging
import math
import os
import sys
import threading
import tracemalloc
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import UTC, datetime, timedelta
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np
import pytest

from imu_tracker.config import load_config
from imu_tracker.daemon.run import run
from imu_tracker.daemon.supervision import Signals
from imu_tracker.simulation.motion.positions import Place
from imu_tracker.storage.latlong import LoggedTrack, read_log
from support.endless import RATE_HZ, Edit, EndlessDrive, Silences, Where
from support.fake_clock import FakeClock
from support.nmea_text import sentence

S = 1_000_000_000
HOUR_S = 3600.0
DAY_S = 86_400.0
MB = 1_000_000

LAST_EXACT_NS = 2**53
"""Above it, 104 days after the start of a computer, a float has no nanoseconds."""

CORNER = Place(0.0, math.pi - 1e-6, -400.0)
"""Equator and antimeridian, below the sea: a drive about crosses both, again and again.
"""

ESTIMATORS = ("six-state", "error-state")

IMU_SILENCE: Silences = (3000.0, 900.0, 20.0)
GPS_SILENCE: Silences = (1900.0, 500.0, 60.0)

# The receiver counts weeks in ten bits; leap seconds are 18, as since 2017.
ROLLOVER = datetime(2038, 11, 20, 23, 59, 42, tzinfo=UTC)
LEAP = datetime(2029, 1, 1, tzinfo=UTC)
"""The first midnight after a leap second, had one been ordered."""


class Seen(NamedTuple):
    """What the process holds at an instant."""

    hours: float
    rss_kb: int
    blocks: int  # of Python's allocator, garbage collected
    traced_bytes: int  # 0 while nobody traces
    open_files: int
    threads: int
    bytes_on_disk: int


OURS = tuple(
    tracemalloc.Filter(True, f"*/{name}/*")
    for name in ("imu_tracker", "filterpy", "pynmea2", "numpy")
)
"""What the tracker allocates; pytest and its plugins hold things of their own."""


def traced_bytes() -> int:
    """Return what the tracker allocated since tracing began and still holds, or 0."""
    if not tracemalloc.is_tracing():
        return 0
    kept = tracemalloc.take_snapshot().filter_traces(OURS)
    return sum(trace.size for trace in kept.traces)


class Bench:
    """The daemon alone with an endless drive, and somebody who looks now and then."""

    def __init__(self, directory: Path, capacity_mb: float) -> None:
        self.directory = directory
        self.files = directory / "log"
        self.clock = FakeClock(LAST_EXACT_NS - 1800 * S)
        self.start_ns = self.clock.now_ns()
        self.signals = Signals()
        self.drive: EndlessDrive
        self.seen: list[Seen] = []
        self.counters: dict[str, int] = {}
        self._capacity = capacity_mb * MB

    def at(self, seconds: float, action: Any) -> None:
        self.clock.at(self.start_ns + round(seconds * S), action)

    def bytes_on_disk(self) -> int:
        with os.scandir(self.files) as entries:
            return sum(entry.stat().st_size for entry in entries)

    def statvfs(self, _path: Any) -> Any:
        """A disk of so many MB, of which the logs are all that there is."""
        free = max(0, round(self._capacity) - self.bytes_on_disk())
        return SimpleNamespace(f_bavail=free, f_frsize=1)

    def look(self, every_s: float) -> None:
        """Note what is held, and plan the next look."""
        gc.collect()
        self.seen.append(
            Seen(
                (self.clock.now_ns() - self.start_ns) / S / HOUR_S,
                _resident_kb(),
                sys.getallocatedblocks(),
                traced_bytes(),
                len(list(Path("/proc/self/fd").iterdir())),
                threading.active_count(),
                self.bytes_on_disk(),
            )
        )
        if told := os.environ.get("IMU_TRACKER_SOAK_PROGRESS"):
            with Path(told).open("a", encoding="utf-8") as file:
                file.write(f"{self.seen[-1]}\n")
        self.clock.at(
            self.clock.now_ns() + round(every_s * S), lambda: self.look(every_s)
        )

    def run(self, estimator: str, seconds: float, *overrides: str) -> None:
        self.at(seconds, self.signals.stop)
        own = (
            f"filter.estimator={estimator}",
            "filter.profile=vehicle",
            f"imu.rate_hz={RATE_HZ:g}",
            "imu.bandwidth_hz=5",
            f"log.path={self.files / 'latlong.csv'}",
            f"status.path={self.directory / 'run' / 'status.json'}",
            f"state.path={self.directory / 'state.json'}",
        )
        config = load_config(None, [*own, *overrides])
        code = run(
            config,
            clock=self.clock,
            signals=self.signals,
            notify=lambda _: None,
            **self.drive.readers,
        )
        assert code == 0

    def logged(self) -> LoggedTrack:
        """All rows that the disk still holds."""
        packed = sorted(self.files.glob("latlong-*.csv*"))
        tracks = [read_log(path) for path in (*packed, self.files / "latlong.csv")]
        return LoggedTrack(*map(np.concatenate, zip(*tracks, strict=True)))


def _resident_kb() -> int:
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") // 1024


class _Count(logging.Handler):
    """A journal that keeps nothing; pytest's would keep every line of a month."""

    def __init__(self) -> None:
        super().__init__()
        self.lines = 0

    def emit(self, record: logging.LogRecord) -> None:
        record.getMessage()
        self.lines += 1


@contextmanager
def counted_journal() -> Iterator[_Count]:
    package, count = logging.getLogger("imu_tracker"), _Count()
    before = package.handlers, package.level, package.propagate
    package.handlers, package.propagate = [count], False
    package.setLevel(logging.INFO)
    yield count
    package.handlers, package.level, package.propagate = before


@pytest.fixture
def bench(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Bench:
    bench = Bench(tmp_path, capacity_mb=8)
    monkeypatch.setattr(os, "statvfs", bench.statvfs)
    return bench


# ----------------------------------------------------------------------- what is held


def assert_nothing_grows(seen: list[Seen], since_hours: float) -> None:
    settled = [look for look in seen if look.hours >= since_hours]
    assert len(settled) > 4
    for name in ("open_files", "threads"):
        counts = {getattr(look, name) for look in settled}
        assert max(counts) - min(counts) <= 1, (name, counts)  # a file is being packed
    blocks = [look.blocks for look in settled]
    assert max(blocks) - min(blocks) < 3000  # the trail of the last seconds breathes
    untraced = [look.rss_kb for look in settled if not look.traced_bytes]
    assert untraced[-1] - untraced[0] < 2048
    # What was allocated since tracing began, and is still held.
    traced = [look.traced_bytes for look in settled if look.traced_bytes]
    assert len(traced) > 3
    assert traced[-1] - traced[1] < 100_000


def assert_rows_go_on(track: LoggedTrack, rate_hz: float) -> None:
    steps = np.rint(np.diff(track.utc_s) * 1000.0).astype(int)
    assert set(steps.tolist()) == {round(1000 / rate_hz)}
    for column in (track.lat_deg, track.lon_deg, track.speed_mps, track.r95_m):
        assert np.isfinite(column).all()


def share_inside(track: LoggedTrack, truth: list[Where], offset_ns: int) -> float:
    """The share of the truth inside of r95; `offset_ns` leads to UTC.

    An oracle of its own: a sphere is good enough for differences of metres.
    """
    told = {round(utc_s * 1000): row for row, utc_s in enumerate(track.utc_s)}
    kept: list[bool] = []
    for where in truth:
        row = told.get(round((where.t_ns + offset_ns) / 1e6))
        if row is None:
            continue
        north = math.radians(track.lat_deg[row]) - where.lat_rad
        east = math.remainder(
            math.radians(track.lon_deg[row]) - where.lon_rad, 2.0 * math.pi
        ) * math.cos(where.lat_rad)
        kept.append(bool(math.hypot(north, east) * 6.37e6 <= track.r95_m[row]))
    assert len(kept) > 0.9 * len(truth)
    return sum(kept) / len(kept)


def rolled_over(start: datetime, clock: FakeClock) -> Edit:
    """A receiver whose weeks begin again at `ROLLOVER`."""
    start_ns = clock.now_ns()

    def edit(line: bytes) -> bytes:
        body = line.decode()[1:-3]
        fields = body.split(",")
        now = start + timedelta(seconds=(clock.now_ns() - start_ns) / S)
        if fields[0] == "GNRMC" and fields[9] and now > ROLLOVER - timedelta(seconds=9):
            day, month, year = fields[9][:2], fields[9][2:4], fields[9][4:6]
            told = datetime.fromisoformat(f"20{year}-{month}-{day}T00:00Z")
            clock_s = float(fields[1][4:]) + 60 * int(fields[1][2:4])
            told += timedelta(hours=int(fields[1][:2]), seconds=clock_s)
            if told >= ROLLOVER:
                fields[9] = f"{told - timedelta(weeks=1024):%d%m%y}"
        return sentence(",".join(fields))

    return edit


def set_out(bench: Bench) -> float:
    """Drive across the corner and the rollover; return UTC at the beginning."""
    start = ROLLOVER - timedelta(seconds=2400)
    bench.drive = EndlessDrive(
        bench.clock,
        CORNER,
        start.timestamp(),
        edit=rolled_over(start, bench.clock),
        imu_silence=IMU_SILENCE,
        gps_silence=GPS_SILENCE,
    )
    return start.timestamp()


def soak(
    bench: Bench, estimator: str, seconds: float, look_s: float, *overrides: str
) -> int:
    """Run; look all the time, with tracemalloc in the last four looks; count lines."""
    bench.at(look_s, lambda: bench.look(look_s))
    bench.at(seconds - 4.5 * look_s, tracemalloc.start)
    raw = f"record.path={bench.files / 'raw.rec.gz'}"
    try:
        with counted_journal() as journal:
            bench.run(estimator, seconds, raw, *overrides)
    finally:
        tracemalloc.stop()
    return journal.lines


@pytest.mark.no_cover  # which would take longer than the test
def test_two_hours_hold_no_more_than_one(bench: Bench) -> None:
    seconds = 2 * HOUR_S
    start_s = set_out(bench)
    sizes = ("log.max_mb=0.2", "log.min_free_mb=7")
    lines = soak(bench, "six-state", seconds, 450.0, "log.sync_s=30", *sizes)

    assert_nothing_grows(bench.seen, 0.6)
    assert lines < 2 * 60 * 3  # one a minute, and the transitions
    assert max(look.bytes_on_disk for look in bench.seen) < (1.0 + 4 * 0.2) * MB
    track = bench.logged()
    assert_rows_go_on(track, 4)
    assert track.utc_s[-1] == pytest.approx(start_s + seconds, abs=1)
    truth = list(bench.drive.truth(seconds))
    assert len({where.lon_rad > math.pi for where in truth}) == 2  # both were crossed
    assert len({where.lat_rad > 0.0 for where in truth}) == 2
    first_ns = bench.start_ns + (track.utc_s[0] - start_s) * S
    logged = [where for where in truth if where.t_ns > first_ns]
    offset_ns = round(start_s * S) - bench.start_ns
    assert share_inside(track, logged, offset_ns) > 0.95


# ------------------------------------------------------------------- places and times

PLACES = {
    "equator and antimeridian, below the sea": CORNER,
    "a degree from the pole": Place(math.radians(89.0), 0.3, 2800.0),
    "a degree from the other": Place(math.radians(-89.0), -3.0, 2800.0),
}


@pytest.mark.parametrize("estimator", ESTIMATORS)
@pytest.mark.parametrize("place", PLACES.values(), ids=PLACES)
def test_no_place_breaks_the_promise(
    bench: Bench, place: Place, estimator: str
) -> None:
    seconds, start_s = 240.0, ROLLOVER.timestamp() - DAY_S
    bench.drive = EndlessDrive(bench.clock, place, start_s)
    with counted_journal():
        bench.run(estimator, seconds)
    track = bench.logged()
    assert_rows_go_on(track, 4)
    assert np.nanmax(np.abs(track.alt_m - place.alt_m)) < 100
    logged = [w for w in bench.drive.truth(seconds) if w.t_ns > bench.start_ns + 10 * S]
    # Four minutes hold few independent errors.
    assert share_inside(track, logged, round(start_s * S) - bench.start_ns) > 0.9


@pytest.mark.parametrize("estimator", ESTIMATORS)
def test_beside_a_pole_rows_go_on(bench: Bench, estimator: str) -> None:
    # A hundred metres from it a meridian bends faster than any frame moves along: the
    # promise does not hold there, and nobody drives there. Yet rows stay numbers.
    bench.drive = EndlessDrive(
        bench.clock, Place(math.radians(89.999), 0.3, 2800.0), ROLLOVER.timestamp()
    )
    with counted_journal():
        bench.run(estimator, 120.0)
    assert_rows_go_on(bench.logged(), 4)


def with_a_leap_second(start: datetime) -> Edit:
    """A receiver that says 23:59:60, and from then on a second less."""
    seconds = iter(range(10**9))

    def edit(line: bytes) -> bytes:
        fields = line.decode()[1:-3].split(",")
        if fields[1]:
            # Two sentences a second, of which the first three seconds have no time.
            now = start + timedelta(seconds=next(seconds) // 2 + 3)
            if now >= LEAP:
                told = now - timedelta(seconds=1)
                fields[1] = f"{told:%H%M%S}.00" if now > LEAP else "235960.00"
                if fields[0] == "GNRMC":
                    fields[9] = f"{told:%d%m%y}"
        return sentence(",".join(fields))

    return edit


@pytest.mark.parametrize("estimator", ESTIMATORS)
def test_a_leap_second_is_slewed_away(bench: Bench, estimator: str) -> None:
    start, seconds = LEAP - timedelta(seconds=60), 180.0
    bench.drive = EndlessDrive(
        bench.clock,
        CORNER,
        start.timestamp(),
        edit=with_a_leap_second(start),
    )
    with counted_journal():
        bench.run(estimator, seconds)
    track = bench.logged()
    assert_rows_go_on(track, 4)
    # After the leap second UTC is one less than it would have been.
    assert track.utc_s[-1] == pytest.approx(LEAP.timestamp() + 120 - 1, abs=0.6)
    later = [w for w in bench.drive.truth(seconds) if w.t_ns > bench.start_ns + 120 * S]
    offset_ns = round((start.timestamp() - 1) * S) - bench.start_ns
    assert share_inside(track, later, offset_ns) > 0.95


# ------------------------------------------------------------------------ acceptance

MONTH_DAYS = float(os.environ.get("IMU_TRACKER_SOAK_DAYS", "30"))


@pytest.mark.acceptance
@pytest.mark.parametrize("estimator", ESTIMATORS)
def test_a_month_holds_no_more_than_a_day(
    estimator: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # 30 days of rows at 10 Hz: hours of work. IMU_TRACKER_SOAK_DAYS shortens it, and
    # IMU_TRACKER_SOAK_PROGRESS names a file that tells how far it is.
    bench = Bench(tmp_path, capacity_mb=700)
    monkeypatch.setattr(os, "statvfs", bench.statvfs)
    seconds = MONTH_DAYS * DAY_S
    start_s = set_out(bench)
    lines = soak(bench, estimator, seconds, HOUR_S, "log.rate_hz=10")

    assert_nothing_grows(bench.seen, min(24.0, MONTH_DAYS * 12))
    assert lines < seconds / 60 * 3
    assert max(look.bytes_on_disk for look in bench.seen) < (200 + 4 * 16) * MB
    track = bench.logged()
    assert_rows_go_on(track, 10)
    assert track.utc_s[-1] == pytest.approx(start_s + seconds, abs=1)
