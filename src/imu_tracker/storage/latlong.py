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
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Final, NamedTuple, TypeAlias

from imu_tracker.errors import InputMissingError, LogError, OutputError
from imu_tracker.samples import NavState
from imu_tracker.storage.append_file import AppendFile, Layout, Limits
from imu_tracker.storage.log_text import format_row as format_row
from imu_tracker.storage.log_text import format_utc as format_utc
from imu_tracker.storage.log_text import utc_ms_of, utc_s_of
from imu_tracker.storage.rotated_files import RotatedFiles
from imu_tracker.storage.torn_lines import end_of_lines, is_our_format, read_lines

HEADER: Final = "time_utc,lat_deg,lon_deg,alt_m,speed_mps,course_deg,r95_m,mode"

BACK_S: Final = 60.0
"""Rows that go back by more than this were dated wrong before; by less, they wait until
the log is reached again."""

MAX_GAP_S: Final = 2.5
"""Rows further apart are not joined: the tracker was off between them."""

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


def goes_back(state: NavState, last_utc_s: float) -> bool:
    """Whether the last row was dated wrong, so that a new log begins with this one."""
    return state.is_date_sure and last_utc_s - state.utc_s > BACK_S


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

    @property
    def trouble(self) -> str:
        """Why rows are not written now, and what to do; "" while they are."""
        if self._is_behind:
            last = format_utc(self._last_ms / 1000)
            return (
                f"rows are left out: the log ends later than they are, at {last}; a "
                "new one begins by itself once the receiver's time has proved itself"
            )
        if self._file.is_failing:
            return "rows wait in memory: the disk takes none; see the journal"
        return ""

    def write(self, state: NavState) -> None:
        """Append a row, unless the log has reached a later instant already.

        One that lies more than a minute back, and is surely dated right, begins a new
        file: the last row of the old one had a wrong date.
        """
        utc_ms = utc_ms_of(state.utc_s)
        if utc_ms <= self._last_ms and not self._is_begun_anew(state):
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

    def _is_begun_anew(self, state: NavState) -> bool:
        """Put a file aside whose last row lies in the future of a date that is sure."""
        if not goes_back(state, self._last_ms / 1000) or not self._file.put_aside():
            return False
        self.counters["logs_put_aside"] += 1
        times = format_utc(self._last_ms / 1000), format_utc(state.utc_s)
        told = "%s: ends at %s, later than it is now, %s: put aside, and begun anew"
        log.warning(told, self._file.path, *times)
        return True

    def _skip(self) -> None:
        self.counters["skipped_rows"] += 1
        if not self._is_behind:
            self._is_behind = True
            log.warning("%s: %s", self._file.path, self.trouble)

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
    return None if last is None else utc_ms_of(utc_s_of(last[1]))


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
    """The columns of a lat/long log; NaN as in `LogRow`."""

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
        When it is no log, or has no sound row among damaged ones. Rows that are
        damaged, by a card or an editor, are left out with a warning that counts them.
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
    done = n_rows = n_bad = 0
    first_bad: LogError | None = None
    for lines in read_lines(path, LogError):
        for number, line in enumerate(lines, done + 1):
            if line == _HEADER_LINE:
                continue
            if number == 1:
                raise _unexpected(path, number, "the header", line)
            try:
                row = parse_row(line)
            except ValueError:
                first_bad = first_bad or _unexpected(path, number, "a row of", line)
                n_bad += 1
                continue
            n_rows += 1
            yield row
        done += len(lines)
    if not done:
        raise LogError(f"{path}:1: expected the header {HEADER}, not the end")
    if first_bad is not None:
        if not n_rows:
            raise first_bad
        rows = "1 damaged row" if n_bad == 1 else f"{n_bad} damaged rows"
        log.warning("%s left out of %d; the first: %s", rows, n_bad + n_rows, first_bad)


def _unexpected(path: Path, number: int, expected: str, line: bytes) -> LogError:
    return LogError(f"{path}:{number}: expected {expected} {HEADER}, not {line[:80]!r}")


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
        utc_s_of(time),
        lat_deg,
        lon_deg,
        alt_m,
        speed_mps,
        course_deg,
        r95_m,
        mode.decode(),
    )


def put_aside(path: Path) -> Path:
    """Rename a log after its first row, and return its new name; OutputError."""
    try:
        return RotatedFiles(path, _first_utc).rotate()
    except OSError as error:
        raise OutputError(f"{path}: cannot be renamed: {error.strerror}") from error
