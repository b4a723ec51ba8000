"""A file of whole records that is only ever appended to, and never lies.

It survives what happens on a Pi: power cuts (a torn tail is cut off at the start), a
full or failing disk (records wait in memory, in order), files that are moved or
deleted under it, a second daemon (refused). It has no clock: `tick` brings the time.
"""

import contextlib
import errno
import logging
import os
import stat
from collections import Counter, deque
from collections.abc import Callable
from pathlib import Path
from typing import BinaryIO, NamedTuple

from imu_tracker.errors import OutputError
from imu_tracker.storage.atomic import lock_path, make_directories
from imu_tracker.storage.rotated_files import (
    FILE_MODE,
    RotatedFiles,
    sync_directory,
)

MAX_WAITING_BYTES = 4_000_000
"""Kept while the disk fails: three hours of log, a quarter of an hour of raw data."""

_PACK_EVERY_NS = 100_000_000  # 64 kB each: a third of the slowest Pi for half a minute

FOREIGN = "imu-tracker did not write this file; move it away or choose another path"

log = logging.getLogger(__name__)


class Limits(NamedTuple):
    """When a file is forced to the disk, rotated and, rotated, deleted."""

    sync_s: float = 5.0
    max_mb: float = 16.0  # of 10^6 bytes
    min_free_mb: float = 500.0


class Layout(NamedTuple):
    """What the file must know of its content.

    `whole_size` tells the size to cut an open file to, None when it is of another
    format; `is_our_format` whether it is ours all the same, of another version or
    damaged; `first_utc` the time of a file's first record, for its rotated name.
    """

    whole_size: Callable[[BinaryIO], int | None]
    is_our_format: Callable[[BinaryIO], bool]
    first_utc: Callable[[Path], str | None]


class AppendFile:
    """One file of whole records, open for appending.

    Parameters
    ----------
    path : Path
        Made, with its directories, when it does not exist.
    layout : Layout
        What a whole record looks like.
    limits : Limits
        For syncing and rotation.
    head : bytes
        What every new file begins with; may be set later.

    Raises
    ------
    OutputError
        When the file cannot be opened, is somebody else's, or another process is
        writing it. Nothing is raised later: `counters` and the journal tell.

    Notes
    -----
    The lock is on a hidden file beside it: that one is never renamed, and the lock
    goes with the process that held it, however that ended.
    """

    def __init__(
        self, path: Path, layout: Layout, limits: Limits, head: bytes = b""
    ) -> None:
        self.path, self.head = path, head
        self.rotated = RotatedFiles(path, layout.first_utc)
        self.counters: Counter[str] = Counter()
        self._layout = layout
        self._sync_ns = int(limits.sync_s * 1e9)
        self._max_bytes = limits.max_mb * 1e6
        self._min_free_bytes = limits.min_free_mb * 1e6
        self._waiting: deque[bytes] = deque()
        self._waiting_bytes = 0
        self._is_failing = False
        self._fd: int | None = None
        self._inode = (0, 0)  # device and number of the file that is open
        self._size = 0
        self._rotate_at_bytes = 0.0
        self._is_synced = True
        self._due_ns = self._pack_due_ns = 0
        try:
            make_directories(path.parent)
            self._lock = lock_path(path)
            try:
                self._open()
                self.rotated.resume()
            except OSError:
                self._close_file()
                os.close(self._lock)
                raise
        except OutputError:
            raise
        except OSError as error:
            raise OutputError(f"{path}: cannot be opened: {error.strerror}") from error

    @property
    def is_failing(self) -> bool:
        """Whether records wait in memory because the disk does not take them."""
        return self._is_failing

    def append(self, records: bytes) -> bool:
        """Append whole records at once; False when they are lost, memory being full."""
        if self._fd is None:
            return self._keep(records)
        try:
            self._write(self._fd, records)
        except OSError as error:
            self._fail(error)
            return self._keep(records)
        if self._size >= self._rotate_at_bytes:
            self._rotate(self._fd)
        return True

    def put_aside(self) -> bool:
        """Rotate the file now, whatever its size; False when the disk refuses."""
        if self._fd is None:
            return False
        if self._size <= len(self.head):
            return True  # nothing stands in it yet
        inode = self._inode
        self._rotate(self._fd)
        return self._inode != inode

    def _keep(self, records: bytes) -> bool:
        """Keep records in memory; what is there already comes first."""
        if self._waiting_bytes + len(records) > MAX_WAITING_BYTES:
            return False
        self._waiting.append(records)
        self._waiting_bytes += len(records)
        return True

    def is_due(self, now_ns: int) -> bool:
        """Whether the next `tick` syncs: time to append what was held back."""
        return now_ns >= self._due_ns

    def tick(self, now_ns: int) -> None:
        """Sync or try again when due, and do some of the work of rotation."""
        if now_ns >= self._pack_due_ns:
            self._pack_due_ns = now_ns + _PACK_EVERY_NS
            self.rotated.pack_a_little()
        if self.is_due(now_ns):
            self._due_ns = now_ns + self._sync_ns
            self.sync()

    def sync(self) -> None:
        """Force what was appended to the disk; open the file again if it must be."""
        if not self._is_in_place():
            if self._fd is not None:
                log.warning("%s: was moved or deleted, begun anew", self.path)
            self.reopen()
        elif self._fd is not None and not self._is_synced:
            try:
                os.fsync(self._fd)
                self._is_synced = True
            except OSError as error:
                self._fail(error)
        with contextlib.suppress(OSError):  # no room, but appending tells that better
            self.rotated.make_room(self._min_free_bytes)

    def reopen(self) -> None:
        """Open the path anew: somebody may have moved the file away."""
        self._close_file()
        try:
            make_directories(self.path.parent)
            self._open()
        except OSError as error:
            self._fail(error)
            return
        if self._is_failing:
            self._is_failing = False
            log.warning("%s: is written again", self.path)

    def close(self) -> None:
        """Write and sync what is left, and release the lock."""
        if self._fd is None:
            self.reopen()
        self._close_file()
        self.rotated.close()
        os.close(self._lock)
        if self._waiting:
            log.warning("%s: %d bytes are lost", self.path, self._waiting_bytes)

    def _open(self) -> None:
        """Open the path for appending, and append what has waited."""
        flags = os.O_RDWR | os.O_APPEND | os.O_CREAT | os.O_NONBLOCK
        fd = os.open(self.path, flags, FILE_MODE)
        try:
            found = os.fstat(fd)
            if not stat.S_ISREG(found.st_mode):
                raise OutputError(f"{self.path}: must be a regular file")
            inode = (found.st_dev, found.st_ino)
            if self._is_failing and inode == self._inode:
                # Part of a write: perhaps whole lines, but all of it waits in memory.
                os.ftruncate(fd, min(self._size, found.st_size))
            with os.fdopen(fd, "rb", closefd=False) as file:
                size = self._layout.whole_size(file)
                if size is None and not self._layout.is_our_format(file):
                    raise OutputError(f"{self.path}: {FOREIGN}")
            if size is not None:
                self._cut(fd, size)
                self._inode, self._size = inode, size
                if not size and self.head:
                    self._write(fd, self.head)
                while self._waiting:
                    self._write(fd, self._waiting[0])
                    self._waiting_bytes -= len(self._waiting.popleft())
                os.fsync(fd)
                sync_directory(self.path.parent)
        except BaseException:
            os.close(fd)
            raise
        if size is None:
            os.close(fd)
            moved = self.rotated.rotate()
            log.warning("%s: had another format, moved to %s", self.path, moved)
            self._open()
            return
        self._fd, self._is_synced = fd, True
        self._rotate_at_bytes = self._max_bytes

    def _cut(self, fd: int, size: int) -> None:
        surplus = os.fstat(fd).st_size - size
        if surplus:
            log.warning("%s: cut off a torn tail of %d bytes", self.path, surplus)
            os.ftruncate(fd, size)

    def _write(self, fd: int, data: bytes) -> None:
        """Write all or raise; of a part that was written nothing stays."""
        written = os.write(fd, data)
        if written != len(data):
            with contextlib.suppress(OSError):  # then it is cut off before the next
                os.ftruncate(fd, self._size)
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        self._size += written
        self._is_synced = False

    def _rotate(self, fd: int) -> None:
        try:
            os.fsync(fd)
            self.rotated.rotate()
        except OSError as error:
            log.warning("%s: cannot be rotated: %s", self.path, error.strerror)
            self._rotate_at_bytes = self._size + self._max_bytes / 16
            return
        self.reopen()

    def _is_in_place(self) -> bool:
        if self._fd is None:
            return False
        try:
            found = self.path.stat()
        except OSError:
            return False
        return (found.st_dev, found.st_ino) == self._inode

    def _fail(self, error: OSError) -> None:
        self._close_file()
        self.counters["write_failures"] += 1
        if not self._is_failing:
            self._is_failing = True
            log.warning(
                "%s: cannot be written: %s; waiting in memory until it can",
                self.path,
                error.strerror or error,
            )

    def _close_file(self) -> None:
        if self._fd is not None:
            fd, self._fd = self._fd, None
            with contextlib.suppress(OSError):
                os.fsync(fd)
            os.close(fd)


def is_foreign(path: Path, layout: Layout) -> bool:
    """Whether a file is there that would be refused as somebody else's."""
    with path.open("rb") as file:
        return layout.whole_size(file) is None and not layout.is_our_format(file)
