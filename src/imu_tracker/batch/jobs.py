"""One recording of many: what a worker does with it, and what is left behind.

Beside each log stands a small JSON file with its line of the table. It is written last
and as a whole: where it stands, the recording is done. What a newcomer gets wrong: a
file that cannot be read is done as well, for it will not be better next time; a full
disk or a killed worker is not.
"""

import glob
import hashlib
import json
import math
import os
from collections import deque
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from statistics import median
from typing import Any, Final, NamedTuple

from imu_tracker import __version__
from imu_tracker.config import Config, load_config
from imu_tracker.errors import (
    InputMissingError,
    OutputError,
    RecordingError,
    TrackerError,
    UsageError,
)
from imu_tracker.recording.files import is_recording, read_recording
from imu_tracker.recording.layout import is_cut
from imu_tracker.recording.smoothing import Smoothing
from imu_tracker.report.collect import Collected, Tracked
from imu_tracker.report.findings import findings_of
from imu_tracker.samples import Mode, NavState
from imu_tracker.storage.latlong import HEADER, format_row, format_utc

SUFFIXES: Final = (".rec", ".rec.gz")

Line = dict[str, Any]


class Job(NamedTuple):
    """A recording, where its results go, and how it is tracked; plain to be sent."""

    recording: str  # absolute
    name: str  # below the folder that all share
    output: str  # absolute, without suffix
    config: str | None
    overrides: tuple[str, ...]
    is_smoothed: bool = False

    @property
    def log(self) -> Path:
        """The lat/long log."""
        return Path(f"{self.output}.csv")

    @property
    def result(self) -> Path:
        """Its line of the table."""
        return Path(f"{self.output}.json")


def find_jobs(
    patterns: Iterable[str],
    output: Path,
    config: Path | None,
    overrides: list[str],
    *,
    is_smoothed: bool = False,
) -> list[Job]:
    """Find recordings in folders, by globs, or by name.

    Raises
    ------
    UsageError, InputMissingError
        When there is none, or the results would lie among them.
    """
    paths = sorted({path.resolve() for each in patterns for path in _expand(each)})
    if not paths:
        raise UsageError(f"no recording: expected files that end in {SUFFIXES[0]}(.gz)")
    root = Path(os.path.commonpath([path.parent for path in paths]))
    target = output.resolve()
    chosen = None if config is None else str(config.resolve())
    jobs = []
    for path in paths:
        name = str(path.relative_to(root))
        stem = name.removesuffix(".gz").removesuffix(".rec")
        # drive.rec and drive.rec.gz are two recordings.
        stem += "-gz" * (name.endswith(".gz") and path.with_suffix("") in paths)
        where = str(target / stem)
        how = chosen, tuple(overrides), is_smoothed
        jobs.append(Job(str(path), name, where, *how))
    return jobs


def _expand(pattern: str) -> Iterator[Path]:
    path = Path(pattern)
    if path.is_dir():
        yield from (p for p in path.rglob("*") if p.name.endswith(SUFFIXES))
        return
    found = [Path(name) for name in glob.glob(pattern, recursive=True)]  # noqa: PTH207
    if not found:
        raise InputMissingError(f"{pattern}: no such file or folder")
    for each in found:
        yield from _expand(str(each)) if each.is_dir() else [each]


def done_before(job: Job) -> Line | None:
    """Return the line of an earlier batch, if it was the same job."""
    try:
        line = json.loads(job.result.read_text("utf-8"))
    except (OSError, ValueError):
        return None
    if not isinstance(line, dict) or line.get("job") != fingerprint(job):
        return None
    return line if line.get("failed") or job.log.exists() else None


def fingerprint(job: Job) -> str:
    """Name what the result depends on: recording, configuration, program."""
    try:
        stat = Path(job.recording).stat()
        file = f"{stat.st_size} {stat.st_mtime_ns}"
    except OSError:
        file = "missing"
    config = ""
    if job.config is not None:
        with suppress(OSError):
            config = Path(job.config).read_text("utf-8", "replace")
    how = "smooth" if job.is_smoothed else "replay"
    text = "\n".join([__version__, how, job.recording, file, config, *job.overrides])
    return hashlib.sha256(text.encode("utf-8", "replace")).hexdigest()[:16]


def run_job(job: Job) -> Line:
    """Track one recording, in a worker; write its log and its line.

    Returns
    -------
    dict
        The line of the table. Of a recording that cannot be read it has `failed`.

    Raises
    ------
    OutputError
        When the disk takes no more: the job is not done.
    """
    config = load_config(
        None if job.config is None else Path(job.config), list(job.overrides)
    )
    job.log.parent.mkdir(parents=True, exist_ok=True)
    try:
        line = _tracked(job, config)
    except (RecordingError, InputMissingError) as error:
        line = failed_line(job, str(error))
    with _replacing(job.result) as path:
        path.write_text(json.dumps(line) + "\n", "utf-8")
    return line


def failed_line(job: Job, reason: str) -> Line:
    """Return the line of a recording of which nothing came."""
    return {"recording": job.name, "job": fingerprint(job), "failed": reason}


def _tracked(job: Job, config: Config) -> Line:
    path = Path(job.recording)
    if not is_recording(path):
        next(read_recording(path), None)  # says what is wrong with it
    tracked = Tracked(path.name, config)
    rows: Iterable[NavState] = tracked.rows(read_recording(path))
    if job.is_smoothed:  # the figures are the tracker's, which knew no future
        deque(rows, maxlen=0)
        rows = Smoothing(config).rows(read_recording(path))
    with _replacing(job.log) as new:
        _write(new, rows)
    collected = tracked.collected(is_cut=is_cut(path))
    return {"recording": job.name, "job": fingerprint(job), **line_of(collected)}


def _write(path: Path, rows: Iterable[NavState]) -> None:
    with path.open("w", encoding="utf-8", newline="\n") as file:
        file.write(f"{HEADER}\n")
        for row in rows:
            file.write(f"{format_row(row)}\n")


@contextmanager
def _replacing(path: Path) -> Iterator[Path]:
    """Write beside a file, and put it in place when it is whole and on the disk."""
    for left in path.parent.glob(f".{glob.escape(path.name)}.*.new"):
        left.unlink(missing_ok=True)  # by a worker that was killed
    new = path.with_name(f".{path.name}.{os.getpid()}.new")
    try:
        yield new
        with new.open("rb") as file:
            os.fsync(file.fileno())
        new.replace(path)
    except TrackerError:
        raise
    except OSError as error:
        raise OutputError(f"{path}: {error.strerror or error}") from error
    finally:
        with suppress(OSError):
            new.unlink(missing_ok=True)


def line_of(collected: Collected) -> Line:
    """Return what the table says of a recording that was tracked."""
    track, overall = collected.track, collected.track.overall()
    misses = [o.miss_m for o in track.outages if not math.isnan(o.miss_m)]
    lengths = [o.length_s for o in track.outages]
    total_s = sum(track.modes_s.values())
    line: Line = {
        "failed": "",
        "begin_utc": format_utc(track.first_utc_s) if track.rows else None,
        "length_s": round(collected.length_s, 3),
        "rows": track.rows,
        "km": round(track.way_m / 1000.0, 4),
        "dr_share": track.modes_s[Mode.DR] / total_s if total_s else None,
        "still_share": track.modes_s[Mode.STILL] / total_s if total_s else None,
        "outages": len(lengths),
        "longest_outage_s": max(lengths, default=None),
        "reacquisitions": len(misses),
        "miss_rms_m": math.sqrt(sum(m**2 for m in misses) / len(misses))
        if misses
        else None,
        "miss_median_m": median(misses) if misses else None,
        "miss_max_m": max(misses, default=None),
        "miss_inside": sum(o.is_true for o in track.outages) / len(misses)
        if misses
        else None,
        "fixes": overall.fixes if overall else 0,
        "fix_inside": overall.inside if overall else None,
        "fix_miss_rms_m": overall.miss_m if overall else None,
        "nis": overall.nis if overall else None,
        "r95_mean_m": overall.r95_m if overall else None,
    }
    if collected.sensors is not None:
        imu = collected.sensors.imu
        line["imu_rate_hz"] = imu.rate_hz if imu else None
        line["imu_missing_share"] = imu.missing_share if imu else None
        line["profile"] = collected.sensors.result["learnt"].get("profile")
    line["faults"] = " ".join(finding.kind for finding in findings_of(collected))
    return line
