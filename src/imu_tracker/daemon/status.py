"""What `imu-tracker status` reads: one JSON object, replaced as a whole each second.

`Status` is version 1 of it. A key may come without a new version; one that goes or
changes its meaning brings it.
"""

import math
import os
from pathlib import Path
from typing import Final, Literal, TypedDict, cast

from imu_tracker.config.outputs import StatusConfig
from imu_tracker.daemon.prometheus import exposition
from imu_tracker.estimation.prediction import Prediction
from imu_tracker.estimation.report import EstimatorReport
from imu_tracker.samples import NavState
from imu_tracker.sources.feed import SensorHealth
from imu_tracker.storage.latlong import HEADER, LatLongLog, format_row
from imu_tracker.storage.status_file import StatusFile

VERSION: Final = 1


class RowStatus(TypedDict):
    """A row by the columns of the log."""

    time_utc: str
    lat_deg: float | None
    lon_deg: float | None
    alt_m: float | None
    speed_mps: float | None
    course_deg: float | None
    r95_m: float | None
    mode: str


class PredictionStatus(TypedDict):
    """Where it will be so long after the newest sample, within r95_m with 95 %."""

    after_s: list[float]
    lat_deg: list[float]
    lon_deg: list[float]
    r95_m: list[float]


class LogStatus(TypedDict):
    """The log; while it is failing, rows wait in memory."""

    path: str
    is_failing: bool
    trouble: str | None  # why rows do not reach it now


class Status(SensorHealth):
    """The whole object; `imu` and `gps` are absent for other sources than hardware."""

    version: Literal[1]
    pid: int
    t_ns: int  # CLOCK_MONOTONIC at writing: older than 5 s means that it hangs
    uptime_s: int  # since the start of the daemon
    source: str  # "hardware", "simulation" or "recording"
    state: str  # "starting", "waiting for the first fix", "tracking", "not logging"
    mode: str | None  # of the last row; null before
    r95_m: float | None
    row_age_s: float | None  # since the instant of the last row; null unless hardware
    fix_age_s: int | None  # since a fix was used, to the second; null before
    imu_rate_hz: float | None  # measured; 0 while none come; null when played
    disk_free_mb: int | None  # where the log is; null when it cannot be told
    row: RowStatus | None  # the last one; null before
    prediction: PredictionStatus | None  # null before the first row
    unread_sentences: dict[str, int]  # of the receiver, by reason
    log: LogStatus
    faults: dict[str, int]  # since the start, by kind, see `faults`
    counters: dict[str, int]  # everything that was counted since the start
    learnt: EstimatorReport


def status_files(config: StatusConfig) -> list[StatusFile]:
    """Return the files that are configured."""
    files = [StatusFile(config.path)]
    if config.prometheus is not None:
        files.append(StatusFile(config.prometheus, exposition))
    return files


def row_of(state: NavState) -> RowStatus:
    """Return a row by the columns of the log: what it says, in its precision."""
    texts = dict(zip(HEADER.split(","), format_row(state).split(","), strict=True))
    words, mode = {"time_utc": texts.pop("time_utc")}, texts.pop("mode")
    numbers = {key: float(text) if text else None for key, text in texts.items()}
    return cast("RowStatus", {**words, **numbers, "mode": mode})


def log_of(path: Path, latlong: LatLongLog) -> LogStatus:
    """Return how the log is."""
    trouble = latlong.trouble or None
    return {"path": str(path), "is_failing": latlong.is_failing, "trouble": trouble}


def prediction_of(found: list[Prediction]) -> PredictionStatus:
    """Return predictions column by column; the radius is rounded up."""
    return {
        "after_s": [each.after_s for each in found],
        "lat_deg": [round(math.degrees(each.lat_rad), 6) for each in found],
        "lon_deg": [round(math.degrees(each.lon_rad), 6) for each in found],
        "r95_m": [math.ceil(each.r95_m * 10.0) / 10.0 for each in found],
    }


def disk_free_mb(path: Path) -> int | None:
    """Return the space that is left for the log, in MB of 10^6 bytes."""
    try:
        disk = os.statvfs(path.parent)
    except OSError:
        return None
    return disk.f_bavail * disk.f_frsize // 1_000_000
