"""Rotated files: `NAME-<first UTC>.csv.gz` beside the file `NAME.csv`.

A file is rotated by a rename and compressed afterwards, a block at a time, so that
neither a power cut nor a slow card hurts: what a cut leaves uncompressed, the next
start compresses. Names carry UTC as the file's own first record tells it, because a
Pi without network does not know the time at boot; a file that holds none is
`undated`.
"""

import gzip
import itertools
import logging
import os
import re
from collections.abc import Callable, Generator
from pathlib import Path

FILE_MODE = 0o640
DIRECTORY_MODE = 0o750

_UNDATED = "undated"
_BLOCK_BYTES = 1 << 16

log = logging.getLogger(__name__)


def sync_directory(directory: Path) -> None:
    """Make a creation, renaming or deletion in it survive a power cut."""
    fd = os.open(directory, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(fd)
    finally:
        os.close(fd)


class RotatedFiles:
    """The rotated files of one path.

    Parameters
    ----------
    path : Path
        The file that is written now; one that ends in `.gz` is compressed already.
    first_utc : Callable[[Path], str or None]
        UTC of a file's first record, as `20261122T120000Z`.
    """

    def __init__(self, path: Path, first_utc: Callable[[Path], str | None]) -> None:
        self._path, self._first_utc = path, first_utc
        plain = Path(path.name.removesuffix(".gz"))
        self._stem, self._suffix = plain.stem, plain.suffix
        self._is_packed = path.name.endswith(".gz")
        self._pattern = re.compile(
            rf"{re.escape(self._stem)}-(?:(\d{{8}}T\d{{6}}Z)|{_UNDATED})(?:-(\d+))?"
            rf"{re.escape(self._suffix)}(?:\.gz)?"
        )
        self._unpacked: list[Path] = []
        self._work = self._pack_all()

    def find(self) -> list[Path]:
        """List the rotated files, oldest first; undated ones count as oldest."""
        found = [
            (match[1] or "", int(match[2] or 1), path)
            for path in self._path.parent.iterdir()
            if (match := self._pattern.fullmatch(path.name))
        ]
        return [path for *_, path in sorted(found)]

    def resume(self) -> None:
        """Put what a crash left uncompressed in the queue again."""
        if not self._is_packed:
            self._unpacked = [path for path in self.find() if path.suffix != ".gz"]

    def rotate(self) -> Path:
        """Rename the file that is written now; the caller opens a new one."""
        target = self._free_name()
        self._path.rename(target)
        sync_directory(target.parent)
        if not self._is_packed:
            self._unpacked.append(target)
        return target

    def _free_name(self) -> Path:
        stamp = self._first_utc(self._path) or _UNDATED
        for number in itertools.count(1):
            again = f"-{number}" if number > 1 else ""
            name = f"{self._stem}-{stamp}{again}{self._suffix}"
            plain, packed = (self._path.with_name(name + end) for end in ("", ".gz"))
            if not plain.exists() and not packed.exists():
                break
        return packed if self._is_packed else plain

    def pack_a_little(self) -> None:
        """Compress the next 64 kB of what waits for it, if anything does."""
        next(self._work)

    def _pack_all(self) -> Generator[None, None, None]:
        while True:
            while self._unpacked:
                try:
                    yield from _pack(self._unpacked[0])
                except OSError as error:
                    log.warning(
                        "%s: not compressed before the next start: %s",
                        self._unpacked[0],
                        error.strerror,
                    )
                del self._unpacked[0]
            yield

    def make_room(self, min_free_bytes: float) -> None:
        """Delete the oldest file when the disk has less than so much left."""
        disk = os.statvfs(self._path.parent)
        if disk.f_bavail * disk.f_frsize >= min_free_bytes:
            return
        for oldest in self.find():
            if oldest not in self._unpacked:
                oldest.unlink()
                log.warning(
                    "%s: deleted, the disk has less than %.0f MB left",
                    oldest,
                    min_free_bytes / 1e6,
                )
                return

    def close(self) -> None:
        """Give up a compression that is under way; the next start repeats it."""
        self._work.close()


def _pack(source: Path) -> Generator[None, None, None]:
    """Compress a file in steps.

    The compressed file appears whole, under its name, before the plain one goes: cut
    in between, the next start makes the same file again.
    """
    target = source.with_name(source.name + ".gz")
    unfinished = source.with_name(source.name + ".gz.tmp")
    flags = os.O_WRONLY | os.O_CREAT | os.O_TRUNC
    try:
        with (
            source.open("rb") as plain,
            os.fdopen(os.open(unfinished, flags, FILE_MODE), "wb") as raw,
        ):
            with gzip.GzipFile("", "wb", fileobj=raw, mtime=0) as packed:
                while block := plain.read(_BLOCK_BYTES):
                    packed.write(block)
                    yield
            raw.flush()
            os.fsync(raw.fileno())
        unfinished.rename(target)
        sync_directory(target.parent)
        source.unlink()
    finally:
        unfinished.unlink(missing_ok=True)
