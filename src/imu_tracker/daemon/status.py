"""What `imu-tracker status` reads: one JSON object, replaced as a whole each second.

Version 1 of the object::

    version, pid     1; the process
    t_ns             CLOCK_MONOTONIC at writing: older than 5 s means that it hangs
    uptime_s         since the start of the daemon
    source           "hardware", "simulation" or "recording"
    state            "starting", "waiting for the first fix" or "tracking"
    mode, r95_m      of the last row; null before
    row_age_s        since the instant of the last row; null unless hardware
    fix_age_s        since a fix was used, to the second; null before
    imu_rate_hz      samples per second, measured; 0 while none come; null when played
    disk_free_mb     where the log is; null when it cannot be told
    row              the last row, by the columns of the log; null before
    prediction       where it will be so many seconds after the newest sample, and the
                     radius that holds it with 95 %: after_s, lat_deg, lon_deg, r95_m,
                     a list each; null before the first row
    imu, gps         how each sensor is; absent for other sources
    log              path, is_failing (rows wait in memory: the disk takes none)
    faults           how many were counted since the start, by kind, see `faults`
    counters         everything that was counted since the start, by name
    learnt           what the estimator found out

A key may come without a new version; one that goes or changes its meaning brings it.
"""

import os
from pathlib import Path
from typing import Any, Final

from imu_tracker.config.outputs import StatusConfig
from imu_tracker.daemon.prometheus import exposition
from imu_tracker.samples import NavState
from imu_tracker.storage.latlong import HEADER, format_row
from imu_tracker.storage.status_file import StatusFile

VERSION: Final = 1


def status_files(config: StatusConfig) -> list[StatusFile]:
    """Return the files that are configured."""
    files = [StatusFile(config.path)]
    if config.prometheus is not None:
        files.append(StatusFile(config.prometheus, exposition))
    return files


def row_of(state: NavState) -> dict[str, Any]:
    """Return a row by the columns of the log: what it says, in its precision."""
    texts = dict(zip(HEADER.split(","), format_row(state).split(","), strict=True))
    words = {key: texts.pop(key) for key in ("time_utc", "mode")}
    return {
        "time_utc": words["time_utc"],
        **{key: float(text) if text else None for key, text in texts.items()},
        "mode": words["mode"],
    }


def disk_free_mb(path: Path) -> int | None:
    """Return the space that is left for the log, in MB of 10^6 bytes."""
    try:
        disk = os.statvfs(path.parent)
    except OSError:
        return None
    return disk.f_bavail * disk.f_frsize // 1_000_000
