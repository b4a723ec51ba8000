"""Files that are replaced as a whole, and written by one process at a time.

Easily got wrong: a rename alone is not enough. Without the two syncs a power cut may
leave the new name on an empty file.
"""

import contextlib
import errno
import fcntl
import os
from pathlib import Path

from imu_tracker.errors import OutputError
from imu_tracker.storage.rotated_files import DIRECTORY_MODE, FILE_MODE, sync_directory


def replace_file(path: Path, data: bytes) -> None:
    """Put data where a file is, or will be: all of it or nothing, and on the disk.

    The new content is written beside it as `.NAME.new`, forced to the disk, renamed,
    and the directory forced to the disk. Files are made 0640.

    Raises
    ------
    OSError
        When the disk refuses; what stood there before still stands.
    """
    new = path.with_name(f".{path.name}.new")
    flags = os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_NOFOLLOW
    try:
        with os.fdopen(os.open(new, flags, FILE_MODE), "wb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        new.replace(path)
    except OSError:
        with contextlib.suppress(OSError):
            new.unlink(missing_ok=True)
        raise
    sync_directory(path.parent)


def lock_path(path: Path) -> int:
    """Take the exclusive lock of a path, or raise OutputError."""
    lock = path.with_name(f".{path.name}.lock")
    fd = os.open(lock, os.O_RDWR | os.O_CREAT, FILE_MODE)
    try:
        fcntl.flock(fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        os.close(fd)
        if error.errno != errno.EWOULDBLOCK:
            raise
        raise OutputError(
            f"{path}: another process is writing it; end that or choose another path"
        ) from error
    return fd


def make_directories(directory: Path) -> None:
    """Make a directory and its parents for the owner and the group only."""
    if not directory.exists():
        make_directories(directory.parent)
        directory.mkdir(DIRECTORY_MODE, exist_ok=True)
