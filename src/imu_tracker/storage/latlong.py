"""The lat/long log: one row of CSV at each instant of the output grid.

Rows can be watched with `tail -F`; each is written at once and whole, and their times
strictly grow, also over a restart. How the file survives power cuts and full disks
is `append_file`'s affair. A newcomer trips over `r95_m`: it is rounded up, because it
is a promise.
"""

import logging
import math
import re
from collections import Counter
from collections.abc import Iterator
from datetime import UTC, datetime, timedelta
from functools import lru_cache, partial
from math import atan2, ceil, degrees, hypot
from pathlib import Path
from typing import TYPE_CHECKING, Final, NamedTuple, TypeAlias

from imu_tracker.errors import InputMissingError, LogError
from imu_tracker.samples import NavState
from imu_tracker.storage.append_file import AppendFile, Layout, Limits
from imu_tracker.storage.torn_lines import end_of_lines, is_our_format, read_lines

HEADER: Final = "time_utc,lat_deg,lon_deg,alt_m,speed_mps,course_deg,r95_m,mode"

MIN_COURSE_SPEED_MPS: Final = 0.3
"""Below it the course is noise, and left empty."""

MAX_GAP_S: Final = 2.5
"""Rows further apart are not joined: the tracker was off between them."""

_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
_HEADER_LINE = HEADER.encode()
_ROW = re.compile(
    rb"((?:19[89]|[23]\d\d)\d-[01]\d-[0-3]\dT[0-2]\d:[0-5]\d:[0-6]\d(?:\.\d{1,6})?)Z"
    rb",(-?\d{1,2}(?:\.\d+)?),(-?\d{1,3}(?:\.\d+)?),(-?\d{1,9}(?:\.\d+)?)?"
    rb",(\d{1,9}(?:\.\d+)?),(\d{1,3}(?:\.\d+)?)?,(\d{1,9}(?:\.\d+)?)"
    rb",(gpsonly|still|gps|dr)"
)

if TYPE_CHECKING:  # who follows the log row by row needs no 25 MB of numpy
    import numpy as np
    from numpy.typing import NDArray

log = logging.getLogger(__name__)

Column: TypeAlias = "NDArray[np.float64]"


@lru_cache(maxsize=2)
def _minute_text(minute: int) -> str:
    """Everything of a time but its seconds: formatting a date is slow."""
    return f"{_EPOCH + timedelta(minutes=minute):%Y-%m-%dT%H:%M:}"


@lru_cache(maxsize=2)
def _minute_utc_s(text: bytes) -> float:
    return datetime.fromisoformat(f"{text.decode()}Z").timestamp()


def _utc_s(time: bytes) -> float:
    return _minute_utc_s(time[:16]) + float(time[17:])


def _utc_ms(utc_s: float) -> int:
    return round(utc_s * 1000.0)


def format_utc(utc_s: float) -> str:
    """Return a time as the log has it, to the millisecond."""
    minute, ms = divmod(_utc_ms(utc_s), 60_000)
    return f"{_minute_text(minute)}{ms // 1000:02d}.{ms % 1000:03d}Z"


def format_row(state: NavState) -> str:
    """Format one row of the log, without newline.

    Notes
    -----
    Rows lie on a grid whose instants are whole milliseconds. The speed that is printed
    decides whether there is a course, so that a row never contradicts itself.
    """
    lat_deg = degrees(state.lat_rad)
    lon_deg = degrees(state.lon_rad)
    if not -179.999999 < lon_deg < 179.999999:
        lon_deg = 180.0 - (180.0 - round(lon_deg, 8)) % 360.0
    alt = "" if state.alt_m is None else f"{state.alt_m:z.1f}"
    v_north, v_east, _ = state.v_n_mps
    speed_mps = round(hypot(v_north, v_east), 2)
    course = ""
    if speed_mps >= MIN_COURSE_SPEED_MPS:
        course = f"{round(degrees(atan2(v_east, v_north)) % 360.0, 1) % 360.0:.1f}"
    r95_m = ceil(state.r95_m * 100.0 - 1e-7) / 100.0  # 3.94 is not 3.95
    return (
        f"{format_utc(state.utc_s)},"
        f"{lat_deg:z.8f},{lon_deg:z.8f},{alt},{speed_mps:.2f},{course},"
        f"{r95_m:.2f},{state.mode}"
    )


class LatLongLog:
    """The log of a running tracker.

    Parameters
    ----------
    path : Path
        Its file; a torn tail is cut off, one with an older header is moved away.
    sync_s : float
        So much is lost at most in a power cut.
    max_mb : float
        Size of the file at which it is rotated.
    min_free_mb : float
        Rotated files are kept until the disk has less.

    Raises
    ------
    OutputError
        When the file cannot be opened, is no log of ours, or another daemon is
        writing it.
    """

    def __init__(
        self,
        path: Path,
        *,
        sync_s: float = 5.0,
        max_mb: float = 16.0,
        min_free_mb: float = 500.0,
    ) -> None:
        self._file = AppendFile(
            path, LAYOUT, Limits(sync_s, max_mb, min_free_mb), _HEADER_LINE + b"\n"
        )
        self.counters: Counter[str] = self._file.counters
        self._last_ms = self._last_logged_ms()
        self._is_behind = False

    @property
    def is_failing(self) -> bool:
        """Whether rows wait in memory because the disk does not take them."""
        return self._file.is_failing

    def write(self, state: NavState) -> None:
        """Append a row, unless the log has reached a later instant already."""
        utc_ms = _utc_ms(state.utc_s)
        if utc_ms <= self._last_ms:
            self._skip()
            return
        self._last_ms, self._is_behind = utc_ms, False
        is_kept = self._file.append(f"{format_row(state)}\n".encode("ascii"))
        self.counters["rows" if is_kept else "lost_rows"] += 1

    def tick(self, now_ns: int) -> None:
        """Sync when due, try again after a failure; call it at every turn."""
        self._file.tick(now_ns)

    def reopen(self) -> None:
        """Open the path anew, for SIGHUP: the file may have been moved away."""
        self._file.reopen()

    def close(self) -> None:
        """Sync and close the file."""
        self._file.close()

    def _skip(self) -> None:
        self.counters["skipped_rows"] += 1
        if not self._is_behind:
            self._is_behind = True
            log.warning(
                "%s: rows are left out until they are later than its last one; "
                "move the file away if that one's time is wrong",
                self._file.path,
            )

    def _last_logged_ms(self) -> int:
        """Find the last time in this file, or in the newest that was rotated."""
        for path in (self._file.path, *reversed(self._file.rotated.find())):
            try:
                if (row := _last_row(path)) is not None:
                    return row
            except (LogError, InputMissingError, ValueError) as error:
                log.warning("%s", error)  # the next older one will have to do
        return -1


def _last_row(path: Path) -> int | None:
    last = None
    for lines in read_lines(path, LogError):
        last = next((m for m in map(_ROW.fullmatch, reversed(lines)) if m), last)
    return None if last is None else _utc_ms(_utc_s(last[1]))


def _is_whole(line: bytes) -> bool:
    return line == _HEADER_LINE or _ROW.fullmatch(line) is not None


def _first_utc(path: Path) -> str | None:
    with path.open("rb") as file:
        file.readline(len(_HEADER_LINE) * 2)
        time = re.match(rb"(\d{4})-(\d\d)-(\d\dT\d\d):(\d\d):(\d\d)", file.readline(99))
    return b"".join(time.groups()).decode() + "Z" if time else None


LAYOUT: Final = Layout(
    partial(end_of_lines, first_line=_HEADER_LINE, is_whole=_is_whole),
    partial(is_our_format, first_words=b"time_utc,", is_whole=_is_whole),
    _first_utc,
)


class LogRow(NamedTuple):
    """One row of a lat/long log; what is empty in the file is NaN."""

    utc_s: float
    lat_deg: float
    lon_deg: float
    alt_m: float
    speed_mps: float
    course_deg: float
    r95_m: float
    mode: str


class LoggedTrack(NamedTuple):
    """The columns of a lat/long log; what is empty in the file is NaN."""

    utc_s: "Column"
    lat_deg: "Column"
    lon_deg: "Column"
    alt_m: "Column"
    speed_mps: "Column"
    course_deg: "Column"
    r95_m: "Column"
    mode: "NDArray[np.str_]"


def read_log(path: Path) -> LoggedTrack:
    """Read a lat/long log, plain or rotated, or several one after another in a file.

    Raises
    ------
    LogError
        When a row is malformed; a last row that was cut is left out with a warning.
    InputMissingError
        When there is no such file.
    """
    import numpy as np

    rows = list(read_rows(path))
    columns = list(zip(*rows, strict=True)) or [()] * 8
    numbers = [np.array(column, dtype=np.float64) for column in columns[:7]]
    return LoggedTrack._make([*numbers, np.array(columns[7], dtype=np.str_)])


def read_rows(path: Path) -> Iterator[LogRow]:
    """Read a lat/long log row by row, in little memory; see `read_log`."""
    done = 0
    for lines in read_lines(path, LogError):
        for number, line in enumerate(lines, done + 1):
            if line == _HEADER_LINE:
                continue
            try:
                if number == 1:
                    raise ValueError
                yield parse_row(line)
            except ValueError as error:
                expected = f"{'the header' if number == 1 else 'a row of'} {HEADER}"
                raise LogError(
                    f"{path}:{number}: expected {expected}, not {line[:80]!r}"
                ) from error
        done += len(lines)
    if not done:
        raise LogError(f"{path}:1: expected the header {HEADER}, not the end")


def parse_row(line: bytes) -> LogRow:
    """Read one line, without its newline; ValueError when it is no row."""
    match = _ROW.fullmatch(line)
    if match is None:
        raise ValueError
    time, *texts, mode = match.groups()
    lat_deg, lon_deg, alt_m, speed_mps, course_deg, r95_m = (
        float(text) if text else math.nan for text in texts
    )
    if abs(lat_deg) > 90.0 or abs(lon_deg) > 180.0:
        raise ValueError
    return LogRow(
        _utc_s(time),
        lat_deg,
        lon_deg,
        alt_m,
        speed_mps,
        course_deg,
        r95_m,
        mode.decode(),
    )
