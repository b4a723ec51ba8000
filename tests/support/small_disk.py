"""A disk that fills up and fails as told, under everything that `os` writes."""

import errno
import os
from pathlib import Path

import pytest


class SmallDisk:
    """Takes the place of `os.write` and `os.fsync`; everything else is the real disk.

    A write that does not fit is cut short, as POSIX allows, and the next one fails.
    """

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.free_bytes = 1_000_000_000
        self.fails = False
        self.refused_writes = 0
        self.synced: list[Path] = []
        self._write, self._fsync = os.write, os.fsync
        monkeypatch.setattr(os, "write", self.write)
        monkeypatch.setattr(os, "fsync", self.fsync)

    def write(self, fd: int, data: bytes, /) -> int:
        fitting = min(len(data), self.free_bytes)
        if self.fails or (data and not fitting):
            self.refused_writes += 1
            code = errno.EIO if self.fails else errno.ENOSPC
            raise OSError(code, os.strerror(code))
        self.free_bytes -= fitting
        return self._write(fd, data[:fitting])

    def fsync(self, fd: int, /) -> None:
        if self.fails:
            raise OSError(errno.EIO, os.strerror(errno.EIO))
        self._fsync(fd)
        self.synced.append(Path(f"/proc/self/fd/{fd}").readlink())
