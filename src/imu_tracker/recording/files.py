"""The recording: what the wires delivered and when, one line a frame.

The lowest layer is stored, so that a replay exercises decoding and parsing too, and
a bug of either can be found, and mended, afterwards. The format is text, so that it
can be grepped, cut and appended. A newcomer expects one header: its two lines may
come again further down, and start a new session whose clock begins anew.
"""

import gzip
import logging
import zlib
from abc import ABC, abstractmethod
from binascii import unhexlify
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final, Self

from imu_tracker.errors import OutputError, RecordingError
from imu_tracker.recording.format import (
    EXPECTED,
    MAGIC,
    MAX_T_NS,
    format_frame,
    format_header,
    parse_frame,
    parse_header,
)
from imu_tracker.recording.layout import layout_of
from imu_tracker.samples import Frame, SessionHeader, Source
from imu_tracker.storage.append_file import AppendFile, Limits
from imu_tracker.storage.torn_lines import (
    read_lines,
)

_CHUNK_BYTES = 1 << 16

LONGEST_SILENCE_NS: Final = 7 * 86_400 * 1_000_000_000
"""A week without a frame is a damaged time, which would be tracked row by row."""

_SILENCE: Final = (
    "time goes on by more than a week; expected the next frame, or the two lines that "
    "begin a session"
)

log = logging.getLogger(__name__)


def read_recording(path: Path) -> Iterator[SessionHeader | Frame]:
    """Read a recording: a header, its frames, perhaps a header again.

    Parameters
    ----------
    path : Path
        Plain or gzip; cut anywhere behind its header, it gives a prefix of its items.

    Raises
    ------
    RecordingError
        With `path:line` and what was expected there.
    InputMissingError
        When there is no such file.
    """
    header: SessionHeader | None = None
    is_open = has_magic = False
    done, imu = 0, Source.IMU
    limit_ns = MAX_T_NS  # of the next frame
    try:
        for lines in read_lines(path, RecordingError):
            for number, line in enumerate(lines, done + 1):
                if is_open and line[:2] == b"I ":  # nearly always: keep this path short
                    _, time, digits = line.split(b" ")
                    t_ns = int(time)
                    if len(digits) != 28 or t_ns > MAX_T_NS or not time.isdigit():
                        raise ValueError
                    if t_ns > limit_ns:
                        raise RecordingError(f"{path}:{number}: {_SILENCE}")
                    limit_ns = t_ns + LONGEST_SILENCE_NS
                    yield Frame(t_ns, imu, unhexlify(digits))
                elif is_open and line != MAGIC:
                    frame = parse_frame(line)
                    if frame.t_ns > limit_ns:
                        raise RecordingError(f"{path}:{number}: {_SILENCE}")
                    limit_ns = frame.t_ns + LONGEST_SILENCE_NS
                    yield frame
                elif has_magic:
                    header = parse_header(line)
                    yield header
                    is_open, has_magic, limit_ns = True, False, MAX_T_NS
                elif line == MAGIC:
                    is_open, has_magic = False, True
                else:
                    raise ValueError(f"expected {MAGIC.decode()!r}, the first line")
            done += len(lines)
    except RecordingError:
        raise
    except ValueError as error:
        complaint = EXPECTED if is_open and line[:2] == b"I " else error
        where = f"{path}:{number}"
        raise RecordingError(f"{where}: {complaint}, not {line[:60]!r}") from error
    if header is None:
        raise RecordingError(
            f"{path}:{done + 1}: the file ends before its header is complete: "
            f"expected {MAGIC.decode()!r} and a line of JSON"
        )
    if has_magic:
        log.warning("%s: the last session has lost its header; left out", path)


def is_recording(path: Path) -> bool:
    """Tell by the first bytes; what cannot be read is left to the reader to say."""
    words = MAGIC.rpartition(b" ")[0]  # of any version
    try:
        with path.open("rb") as file:
            is_gzip = file.read(2) == b"\x1f\x8b"
        opener = gzip.open if is_gzip else open
        with opener(path, "rb") as file:
            return bool(file.read(len(words)) == words)
    except (OSError, EOFError, zlib.error):
        return False


class FrameWriter(ABC):
    """What both writers have in common: frames become chunks of lines.

    Each chunk of a file whose name ends in `.gz` is a gzip member of its own, so that
    a cut costs the last one at most.
    """

    def __init__(self, path: Path) -> None:
        self._is_gzip = path.name.endswith(".gz")
        self._chunk = bytearray()
        self._chunk_records = 0
        self.counters: Counter[str] = Counter()

    def write_header(self, header: SessionHeader) -> None:
        """Start a session."""
        self.flush()
        self._append(self._packed(format_header(header)))

    def write(self, frame: Frame) -> None:
        """Add a frame; it may be held back until `flush`."""
        self._chunk += format_frame(frame)
        self._chunk_records += 1
        if len(self._chunk) >= _CHUNK_BYTES:
            self.flush()

    def flush(self) -> None:
        """Hand over what was held back."""
        if self._chunk:
            is_kept = self._append(self._packed(bytes(self._chunk)))
            self.counters["records" if is_kept else "lost_records"] += (
                self._chunk_records
            )
            self._chunk.clear()
            self._chunk_records = 0

    @abstractmethod
    def close(self) -> None:
        """Write what is left and close the file."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @abstractmethod
    def _append(self, records: bytes) -> bool:
        """Append to the file; False when the records are lost."""

    def _packed(self, lines: bytes) -> bytes:
        return gzip.compress(lines, mtime=0) if self._is_gzip else lines


class RecordingWriter(FrameWriter):
    """Writes a recording anew, once; what fails is raised.

    Raises
    ------
    OutputError
        When the file cannot be opened or written.
    """

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self._path = path
        with self._faults():
            self._file = path.open("wb")

    def close(self) -> None:
        """Write what is left and close the file."""
        with self._faults(), self._file:
            self.flush()

    def _append(self, records: bytes) -> bool:
        with self._faults():
            self._file.write(records)
        return True

    @contextmanager
    def _faults(self) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            reason = error.strerror or error
            raise OutputError(f"{self._path}: cannot be written: {reason}") from error


class LiveRecordingWriter(FrameWriter):
    """Appends to a recording that must outlive power cuts, beside the tracking.

    A torn tail is cut off at the start, and a new session begins behind it. `tick`
    syncs and rotates; a disk that fails is logged, counted and survived.

    Raises
    ------
    OutputError
        When the file cannot be opened, or another process is writing it.
    """

    def __init__(self, path: Path, limits: Limits) -> None:
        super().__init__(path)
        self._file = AppendFile(path, layout_of(path), limits)
        self.counters = self._file.counters

    @property
    def is_failing(self) -> bool:
        """Whether records wait in memory because the disk does not take them."""
        return self._file.is_failing

    def write_header(self, header: SessionHeader) -> None:
        """Start a session; a file begun by rotation starts with the same header."""
        self.flush()
        self._file.head = self._packed(format_header(header))
        super().write_header(header)

    def tick(self, now_ns: int) -> None:
        """Sync when due, try again after a failure; call it at every turn."""
        if self._file.is_due(now_ns):
            self.flush()
        self._file.tick(now_ns)

    def reopen(self) -> None:
        """Open the path anew, for SIGHUP: the file may have been moved away."""
        self.flush()
        self._file.reopen()

    def close(self) -> None:
        """Write what is left, sync and close the file."""
        self.flush()
        self._file.close()

    def _append(self, records: bytes) -> bool:
        return self._file.append(records)
