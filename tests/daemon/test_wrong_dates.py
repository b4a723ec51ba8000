"""Receivers whose date is wrong at first, or moves: their logs end with the right one.

Reported as openbikesensor/OpenBikeSensorFirmware#294 (dates weeks off at the start),
mendhak/gpslogger#1286 (logging stalls behind a wrong time).
"""

from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from itertools import pairwise
from pathlib import Path
from typing import TypeAlias

import pytest

from imu_tracker.cli import main
from imu_tracker.config import load_config
from imu_tracker.daemon.run import run
from imu_tracker.daemon.supervision import Signals
from imu_tracker.recording.files import RecordingWriter
from imu_tracker.samples import Frame, SessionHeader, Source
from imu_tracker.storage.latlong import read_log
from support.fake_clock import FakeClock
from support.nmea_text import rmc

S = 1_000_000_000
NOON = datetime(2026, 11, 22, 12, tzinfo=UTC)
DAY = timedelta(days=1)
STILL = {"speed": "0.0"}


def recorded(path: Path, *stretches: tuple[int, timedelta]) -> Path:
    """Write an RMC a second; each stretch has its error of the date."""
    with RecordingWriter(path) as writer:
        writer.write_header(SessionHeader(4, 500, 100))
        second = 0
        for seconds, off in stretches:
            for _ in range(seconds):
                second += 1
                sent = NOON + timedelta(seconds=second) + off
                line = rmc(f"{sent:%H%M%S}.00", f"{sent:%d%m%y}", **STILL)
                t_ns = second * S + S // 5
                writer.write(Frame(t_ns, Source.GPS, line))
    return path


def times(path: Path) -> list[float]:
    return [float(utc_s - NOON.timestamp()) for utc_s in read_log(path).utc_s]


def played(tmp_path: Path, recording: Path) -> Path:
    log = tmp_path / "latlong.csv"
    own = (
        "source.kind=recording",
        f"source.path={recording}",
        f"log.path={log}",
        "log.min_free_mb=0",
        f"status.path={tmp_path / 'status.json'}",
    )
    config = load_config(None, [*own, "source.speed=50"])
    assert run(config, clock=FakeClock(), signals=Signals()) == 0
    return log


def replayed(tmp_path: Path, recording: Path) -> Path:
    log = tmp_path / "latlong.csv"
    assert main(["replay", str(recording), "--output", str(log), "-q"]) == 0
    return log


BOTH = pytest.mark.parametrize("run_it", [played, replayed])
Run: TypeAlias = Callable[[Path, Path], Path]


@BOTH
@pytest.mark.parametrize("off", [-14 * DAY, -DAY, -timedelta(hours=1)])
def test_first_dates_that_are_early_leave_a_hole(
    tmp_path: Path, run_it: Run, off: timedelta
) -> None:
    log = run_it(tmp_path, recorded(tmp_path / "r.rec", (5, off), (100, 0 * DAY)))
    found = times(log)
    assert found == sorted(found)
    assert found[-1] == pytest.approx(105, abs=1)
    assert not list(tmp_path.glob("latlong-*"))


@BOTH
@pytest.mark.parametrize("off", [14 * DAY, DAY, timedelta(hours=1)])
def test_first_dates_that_are_late_are_put_aside_with_their_log(
    tmp_path: Path, run_it: Run, off: timedelta
) -> None:
    log = run_it(tmp_path, recorded(tmp_path / "r.rec", (30, off), (100, 0 * DAY)))
    found = times(log)
    assert found[0] == pytest.approx(30 + 23, abs=4)
    assert found[-1] == pytest.approx(130, abs=1)
    assert {b - a for a, b in pairwise(found)} == {0.25}
    (aside,) = tmp_path.glob("latlong-*")
    assert times(aside)[0] == pytest.approx(off.total_seconds() + 1, abs=1)


@BOTH
def test_a_minute_at_most_is_slewed_in(tmp_path: Path, run_it: Run) -> None:
    off = timedelta(seconds=-59)
    recording = recorded(tmp_path / "r.rec", (30, 0 * DAY), (700, off))
    found = times(run_it(tmp_path, recording))
    assert found[-1] == pytest.approx(730 - 59, abs=1)
    assert not list(tmp_path.glob("latlong-*"))


@BOTH
@pytest.mark.parametrize("n", [8, 30])
def test_a_date_that_moves_back_and_forth_is_doubted(
    tmp_path: Path, run_it: Run, n: int
) -> None:
    flips = [(n, off) for off in (0 * DAY, DAY)] * 20
    log = run_it(tmp_path, recorded(tmp_path / "r.rec", (60, 0 * DAY), *flips))
    assert len(list(tmp_path.glob("latlong-*"))) <= 1
    found = times(log)
    assert found == sorted(found)
