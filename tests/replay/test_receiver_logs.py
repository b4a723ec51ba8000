"""Logs of real receivers, read as gpsd reads them.

The logs lie beside the recordings that `IMU_TRACKER_RECORDINGS` names; without them
the tests skip. They have no times of arrival, so the bytes are taken to follow one
another at 115200 baud: an epoch is never torn by it, and closes as it does live.
"""

import csv
import gzip
import os
import re
from collections import Counter
from itertools import pairwise
from math import degrees
from pathlib import Path
from typing import Final, NamedTuple

import pytest

from imu_tracker.samples import GpsFix
from imu_tracker.sensors.gnss.epoch_reader import EpochReader, LineSplitter, Positions

BYTE_NS: Final = 86_806
NEAR_DEG: Final = 1e-6

Place = tuple[float, float]


def _logs() -> Path | None:
    recordings = os.environ.get("IMU_TRACKER_RECORDINGS")
    folder = Path(recordings).parent / "nmea" if recordings else None
    return folder if folder is not None and folder.is_dir() else None


LOGS: Final = _logs()
ENDING: Final = ".log.gz"
NAMES: Final = sorted(
    path.name.removesuffix(ENDING) for path in (LOGS.glob(f"*{ENDING}") if LOGS else ())
)
pytestmark = pytest.mark.skipif(not LOGS, reason="IMU_TRACKER_RECORDINGS is not set")


class Difference(NamedTuple):
    """Where gpsd and we differ: how many places of whom, and why."""

    only_ours: int
    only_gpsds: int
    reason: str


NO_LAST = "gpsd tells an epoch when the next one begins, so not the last of the log"
DEMO = "quality 8 and mode S: a receiver in demo mode, which gpsd passes on"
MODE_BY_GSA = "quality 0 and status V, while GSA already claims a fix"

DIFFERENCES: Final = {
    "GPSmap-76S": Difference(0, 1, DEMO),
    "garmin-geko201": Difference(0, 1, DEMO),
    "ait250": Difference(1, 0, NO_LAST),
    "gps-360": Difference(1, 0, NO_LAST),
    "neo-m8n": Difference(1, 0, NO_LAST),
    "ublox-lea-4h": Difference(1, 0, NO_LAST),
    "mtk-3301": Difference(0, 1, MODE_BY_GSA),
    "tr737A+": Difference(0, 1, MODE_BY_GSA),
    "bundg_zeus_9": Difference(
        0, 45, "a plotter that moves on between RMC and GLL of a second; we take one"
    ),
}
SAME: Final = Difference(0, 0, "")


def stream_of(name: str) -> bytes:
    assert LOGS is not None
    with gzip.open(LOGS / f"{name}{ENDING}") as log:
        return log.read()


def places_of_gpsd(name: str) -> set[Place]:
    assert LOGS is not None
    with (LOGS / f"{name}.gpsd.csv").open(newline="") as table:
        return {
            (float(row["lat"]), float(row["lon"]))
            for row in csv.DictReader(table)
            if row["mode"] in ("2", "3") and row["lat"]
        }


def read(stream: bytes, chunk_bytes: int = 4096) -> Positions:
    splitter, reader = LineSplitter(), EpochReader()
    positions = []
    for start in range(0, len(stream), chunk_bytes):
        for line in splitter.split(stream[start : start + chunk_bytes]):
            positions += reader.feed(line.offset * BYTE_NS, line.data)
    return positions + reader.advance(len(stream) * BYTE_NS + 10**9)


def places_of(positions: Positions) -> set[Place]:
    return {
        (degrees(fix.lat_rad), degrees(fix.lon_rad))
        for fix in positions
        if type(fix) is GpsFix
    }


def missing(places: set[Place], among: set[Place]) -> int:
    """Count the places that are not among others."""
    return sum(
        not any(max(abs(lat - a), abs(lon - b)) <= NEAR_DEG for a, b in among)
        for lat, lon in places
    )


@pytest.mark.parametrize("name", NAMES)
def test_a_log_gives_the_same_at_any_chunk_size(name: str) -> None:
    stream = stream_of(name)[:300_000]
    whole = read(stream)
    for chunk_bytes in (1, 7, 64):
        assert read(stream, chunk_bytes) == whole


@pytest.mark.parametrize("name", [name for name in NAMES if "f9k" not in name])
def test_a_log_differs_from_gpsd_only_where_there_is_a_reason(name: str) -> None:
    ours, gpsds = places_of(read(stream_of(name))), places_of_gpsd(name)
    difference = DIFFERENCES.get(name, SAME)
    assert missing(ours, gpsds) == difference.only_ours, difference.reason
    assert missing(gpsds, ours) == difference.only_gpsds, difference.reason


def test_of_all_places_that_gpsd_knows_few_are_missing() -> None:
    explained = {"bundg_zeus_9", "GPSmap-76S", "garmin-geko201", "ublox-f9k-drive"}
    total = lost = 0
    for name in set(NAMES) - explained:
        gpsds = places_of_gpsd(name)
        total += len(gpsds)
        lost += missing(gpsds, places_of(read(stream_of(name))))
    assert total > 600
    assert lost / total < 0.05


@pytest.mark.parametrize("name", NAMES)
def test_no_fix_is_of_an_instant_that_a_sentence_calls_without(name: str) -> None:
    stream = stream_of(name)
    refused = re.findall(
        rb"\$..(?:RMC,([\d.]+),V|GGA,([\d.]+),[^*]*,[NS],[^*]*,[EW],[0678],"
        rb"|GLL,[^*]*,([\d.]+),V)",
        stream,
    )
    refused_times = {_seconds(b"".join(times)) for times in refused}
    fixes = [fix for fix in read(stream) if type(fix) is GpsFix and fix.utc_s]
    assert not refused_times & {
        round(fix.utc_s % 86400, 3) for fix in fixes if fix.utc_s
    }


def test_a_long_drive_keeps_every_second_and_the_kind_of_each_fix() -> None:
    if "ublox-f9k-drive" not in NAMES:
        pytest.skip("no such log")
    fixes = [fix for fix in read(stream_of("ublox-f9k-drive")) if type(fix) is GpsFix]
    assert Counter(fix.quality for fix in fixes) == {4: 967, 5: 632, 2: 55}
    times = [fix.utc_s for fix in fixes if fix.utc_s is not None]
    steps = [after - before for before, after in pairwise(times)]
    assert (len(steps), steps.count(1.0)) == (1653, 1647)
    assert min(steps) == 1.0  # the others are gaps of the log


def _seconds(tod: bytes) -> float:
    return int(tod[:2]) * 3600 + int(tod[2:4]) * 60 + float(tod[4:])
