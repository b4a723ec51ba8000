"""How far a destination is: one small file, replaced as a whole and on the disk.

What a newcomer gets wrong: the cursor stands behind the last row that the other side
has said it has, not behind the last one that was read or sent.
"""

import json
import logging
import math
import os
from pathlib import Path
from typing import Any, Final, Self

from imu_tracker.errors import OutputError
from imu_tracker.publish.thinning import Placed
from imu_tracker.storage.atomic import lock_path, make_directories, replace_file
from imu_tracker.storage.latlong import LogRow
from imu_tracker.storage.log_tail import TailPosition

SAVE_NS: Final = 4_000_000_000
"""So much is sent again after a power cut, and the rows of a window; more often would
wear out a card."""

VERSION: Final = 1
_MAX_BYTES: Final = 10_000

log = logging.getLogger(__name__)


class Cursor:
    """The cursor of one destination; nobody else may have it meanwhile.

    Parameters
    ----------
    directory : Path
        Made when it does not exist.
    name : str
        Of the destination.

    Attributes
    ----------
    placed : Placed or None
        The last row that the other side has; None before there is one.
    rows : int
        How many it has, since the cursor began.

    Raises
    ------
    OutputError
        When the directory cannot be used, or another process has the cursor.
    """

    def __init__(self, directory: Path, name: str) -> None:
        self._path = directory / f"cursor-{name}.json"
        self.placed: Placed | None = None
        self.rows = 0
        self._saved_ns: int | None = None
        self._is_saved, self._is_failing = True, False
        try:
            make_directories(directory)
            self._lock = lock_path(self._path)
        except OutputError as error:
            raise OutputError(
                f"{self._path}: another imu-tracker publish has it; end that one, or "
                "give this destination another name"
            ) from error
        except OSError as error:
            raise OutputError(
                f"{directory}: the cursor of {name} cannot be kept there: "
                f"{error.strerror or error}"
            ) from error
        self._load()

    def move(self, placed: Placed) -> None:
        """Note that the other side has this row, and all before it."""
        self.placed = placed
        self.rows += 1
        self._is_saved = False

    def save_if_due(self, now_ns: int) -> None:
        """Save what was noted, at most once in four seconds."""
        if self._saved_ns is None or now_ns - self._saved_ns >= SAVE_NS:
            self.save()
            self._saved_ns = now_ns

    def save(self) -> None:
        """Save what was noted; a disk that refuses is told once, and tried again."""
        if self._is_saved or self.placed is None:
            return
        row, position = self.placed
        found = {
            "version": VERSION,
            "position": position._asdict(),
            "row": [None if value != value else value for value in row],
            "rows": self.rows,
        }
        try:
            replace_file(self._path, f"{json.dumps(found)}\n".encode())
        except OSError as error:
            if not self._is_failing:
                log.warning(
                    "%s: cannot be written: %s; after a restart rows are sent again",
                    self._path,
                    error.strerror or error,
                )
            self._is_failing = True
            return
        self._is_saved, self._is_failing = True, False

    def close(self) -> None:
        """Save, and let another process have it."""
        self.save()
        os.close(self._lock)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _load(self) -> None:
        try:
            with self._path.open("rb") as file:
                found = json.loads(file.read(_MAX_BYTES))
            self.placed = _placed(found)
            self.rows = int(found["rows"])
        except FileNotFoundError:
            return
        except OSError as error:
            os.close(self._lock)
            raise OutputError(f"{self._path}: {error.strerror or error}") from error
        except (ValueError, KeyError, TypeError, OverflowError, RecursionError):
            log.warning("%s: is no cursor: begins with the oldest row", self._path)


def _placed(found: dict[str, Any]) -> Placed:
    if found["version"] != VERSION:
        raise ValueError
    position = TailPosition(**found["position"])
    *texts, mode = found["row"]
    numbers = (math.nan if number is None else float(number) for number in texts)
    row = LogRow._make([*numbers, str(mode)])
    whole = (position.inode, position.offset)
    if not math.isfinite(row.utc_s) or not all(type(n) is int for n in whole):
        raise ValueError
    return Placed(row, position._replace(utc_s=float(position.utc_s)))
