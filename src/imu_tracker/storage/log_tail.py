"""Follow the lat/long log while the daemon writes it.

In: the path of a log. Out: its rows, each once, in the order of the file, through
rotation, deletion and restarts of the daemon. No thread, no clock: each call of
`rows` gives what there is by now. What a newcomer gets wrong: a file that was renamed
still grows for whoever has it open, so it is read to its end before the next one.
"""

import codecs
import logging
import math
import os
from collections import Counter
from collections.abc import Generator, Iterator
from contextlib import suppress
from pathlib import Path
from typing import BinaryIO, Final, NamedTuple

from imu_tracker.errors import InputMissingError, LogError
from imu_tracker.storage.latlong import HEADER, LogRow, format_utc, parse_row
from imu_tracker.storage.rotated_files import RotatedFiles
from imu_tracker.storage.torn_lines import MAX_LINE_BYTES, read_lines

_BLOCK_BYTES: Final = 1 << 16
_HEADER_LINE: Final = HEADER.encode()

log = logging.getLogger(__name__)


class TailPosition(NamedTuple):
    """Where a reader is; as JSON it outlasts the reader.

    Attributes
    ----------
    utc_s : float
        Of the last row that was given.
    inode, offset : int
        The file it stands in, and where it ends there; 0 for a rotated file.
    """

    utc_s: float = -math.inf
    inode: int = 0
    offset: int = 0


class LogTail:
    """Gives the rows of a log, rotated files first, then those that come.

    Parameters
    ----------
    path : Path
        The file that the daemon writes; it need not be there yet.
    position : TailPosition, optional
        Where to go on: rows up to it are left out. By default at the oldest row.

    Attributes
    ----------
    position : TailPosition
        After the last row that was given.
    counters : Counter[str]
        `bad_lines` (neither row nor header), `unreadable_files`, `changes_of_file`.

    Notes
    -----
    A position whose file is still there is exact. One whose file was compressed
    meanwhile goes on by the time of its row: within a file times strictly grow.
    """

    def __init__(self, path: Path, position: TailPosition | None = None) -> None:
        self.position = position or TailPosition()
        self.counters: Counter[str] = Counter()
        self._path = path
        self._file: BinaryIO | None = None
        self._inode, self._offset, self._rest = 0, 0, b""
        self._seen: set[str] | None = None  # rotated files that were read, or are older
        self._after_s = self.position.utc_s  # what was given before this reader began

    def rows(self) -> Generator[LogRow, None, None]:
        """Yield the rows that were not given yet; ends where the log ends now."""
        if self._file is None and not self._resume():
            yield from self._rotated_rows()
            if not self._open():
                return
        while True:
            yield from self._current_rows()
            if not self._is_replaced():
                return
            yield from self._current_rows()  # written between the two looks
            self.close()
            self.counters["changes_of_file"] += 1
            yield from self._rotated_rows()
            if not self._open():
                return

    def close(self) -> None:
        """Let the file go; `rows` opens it again."""
        if self._file is not None:
            if self._seen is not None and (name := self._rotated_name()):
                self._seen.add(name)
            self._file.close()
        self._file, self._rest = None, b""

    def _resume(self) -> bool:
        """Go on in the file of the position, if it still stands under the path."""
        if not self.position.inode or self._seen is not None or not self._open():
            return False
        if self._inode == self.position.inode and self._stands_at_its_row():
            self._offset = self.position.offset
            self._seen, self._after_s = set(self._rotated()), -math.inf
            return True
        self.close()
        return False

    def _stands_at_its_row(self) -> bool:
        """Whether the file has the row of the position there: inodes are used again."""
        if self._file is None:
            return False
        begin = max(0, self.position.offset - MAX_LINE_BYTES)
        self._file.seek(begin)
        line = self._file.read(self.position.offset - begin).split(b"\n")[-2:-1]
        with suppress(ValueError):
            return bool(line) and parse_row(line[0]).utc_s == self.position.utc_s
        return False

    def _open(self) -> bool:
        try:
            self._file = self._path.open("rb", buffering=0)
        except OSError:
            return False
        self._inode, self._offset, self._rest = os.fstat(self._fileno()).st_ino, 0, b""
        return True

    def _fileno(self) -> int:
        return -1 if self._file is None else self._file.fileno()

    def _is_replaced(self) -> bool:
        try:
            return os.stat(self._path).st_ino != self._inode  # noqa: PTH116
        except OSError:
            return self._rotated_name() is not None  # between rename and new file

    def _current_rows(self) -> Iterator[LogRow]:
        if self._file is None:
            return
        if os.fstat(self._fileno()).st_size < self._offset:
            # A torn tail was cut off, or the file was emptied: rows of before are
            # known by their times.
            self._offset, self._rest = 0, b""
            self._after_s = self.position.utc_s
        is_overlong = False
        while self._file is not None:
            self._file.seek(self._offset)
            block = self._file.read(_BLOCK_BYTES)
            if not block:
                self._offset -= len(self._rest)  # half a line is read again, whole
                self._rest, self._after_s = b"", -math.inf
                return
            start = self._offset - len(self._rest)
            self._offset += len(block)
            lines = (self._rest + block).split(b"\n")
            self._rest = lines.pop()
            for line in lines:
                start += len(line) + 1
                if not is_overlong and (row := self._row(line)) is not None:
                    self.position = TailPosition(row.utc_s, self._inode, start)
                    yield row
                is_overlong = False
            if len(self._rest) > MAX_LINE_BYTES:
                self._rest, is_overlong = b"", True

    def _rotated_rows(self) -> Iterator[LogRow]:
        """Read the rotated files that are new since the last look, oldest first."""
        files = self._rotated()
        names = list(files)
        if self._seen is None:
            # Of those that are older than the position the last one may hold more.
            begins = [_stamp(self._path, name) for name in names]
            after = _stamp_of(self._after_s)
            first = max(
                (i for i, begin in enumerate(begins) if begin < after), default=0
            )
            self._seen = set(names[:first])
        for name in names:
            if name in self._seen:
                continue
            self._seen.add(name)
            try:
                for lines in read_lines(_as_it_is_now(files[name]), LogError):
                    for row in filter(None, map(self._row, lines)):
                        self.position = TailPosition(row.utc_s)
                        yield row
            except (LogError, InputMissingError):
                self.counters["unreadable_files"] += 1

    def _rotated(self) -> dict[str, Path]:
        """Return the rotated files by their names without `.gz`, oldest first."""
        with suppress(OSError):
            found = RotatedFiles(self._path, lambda _: None).find()
            return {path.name.removesuffix(".gz"): path for path in found}
        return {}

    def _rotated_name(self) -> str | None:
        """Return the name under which the open file was put aside, if it was."""
        for name, path in self._rotated().items():
            with suppress(OSError):
                if path.stat().st_ino == self._inode:
                    return name
        # Compressed already: it is the file of its own first row.
        stamp = _stamp_of(self._first_utc_s())
        unseen = [name for name in self._rotated() if name not in (self._seen or ())]
        return next(
            (name for name in unseen if _stamp(self._path, name) == stamp), None
        )

    def _first_utc_s(self) -> float:
        if self._file is None:
            return -math.inf
        self._file.seek(0)
        for line in self._file.read(4096).split(b"\n")[:2]:
            with suppress(ValueError):
                return parse_row(line).utc_s
        return -math.inf

    def _row(self, line: bytes) -> LogRow | None:
        line = line.removeprefix(codecs.BOM_UTF8).removesuffix(b"\r")
        if line == _HEADER_LINE:
            return None
        try:
            row = parse_row(line)
        except ValueError:
            if not self.counters["bad_lines"]:
                told = "%s: a damaged row is left out, and so are more like it: %r"
                log.warning(told, self._path, line[:80])
            self.counters["bad_lines"] += 1
            return None
        if row.utc_s == self._after_s:
            # The row of the position: what stands behind it is new, whatever its time.
            self._after_s = -math.inf
            return None
        return row if row.utc_s > self._after_s else None


def _as_it_is_now(path: Path) -> Path:
    """Return a rotated file's path: it may have been compressed since it was found."""
    return path if path.exists() else path.with_name(f"{path.name}.gz")


def newest_position(path: Path) -> TailPosition:
    """Return where a reader of everything is; of an empty log, before its begin."""
    with suppress(OSError), path.open("rb") as file:
        found = os.fstat(file.fileno())
        file.seek(max(0, found.st_size - _BLOCK_BYTES))
        lines = file.read(_BLOCK_BYTES).split(b"\n")
        end = found.st_size - len(lines.pop())
        for line in reversed(lines):
            with suppress(ValueError):
                return TailPosition(parse_row(line).utc_s, found.st_ino, end)
            end -= len(line) + 1
    return TailPosition()


def newest_utc_s(path: Path) -> float:
    """Return the time of the newest row of a log; -inf when it has none yet."""
    return newest_position(path).utc_s


def _stamp(path: Path, name: str) -> str:
    """Return the UTC in the name of a rotated file; "" for one without."""
    stamp = name.removeprefix(f"{path.name.removesuffix('.gz').rpartition('.')[0]}-")
    return stamp[:16] if stamp[8:9] == "T" else ""


def _stamp_of(utc_s: float) -> str:
    """Return a time as the names of rotated files have it."""
    if not math.isfinite(utc_s):
        return ""
    text = format_utc(math.floor(utc_s))
    return text[:19].replace("-", "").replace(":", "") + "Z"
