"""The status file: replaced as a whole, and read as a sign of life."""

import json
import logging
import math
import operator
import os
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any, Final

from imu_tracker.errors import NotRunningError
from imu_tracker.storage.atomic import make_directories
from imu_tracker.storage.rotated_files import FILE_MODE

STALE_S: Final = 5.0
"""The daemon writes each second; after this long it hangs, or is gone."""

_MAX_CHARACTERS: Final = 1_000_000
"""A hundred times what the daemon writes."""

PREFIX: Final = "imu_tracker_"
"""Of metrics, lines of text for the textfile collector of the node exporter.

Source: Prometheus' text exposition format, version 0.0.4; its names and base units.
"""

log = logging.getLogger(__name__)


def read_status(path: Path, program: str = "imu-tracker") -> tuple[str, dict[str, Any]]:
    """Read what a program wrote just now, as text and as an object.

    Raises
    ------
    NotRunningError
        When it does not run, or stopped writing.
    PermissionError
        When this user may not read it.
    """
    try:
        with path.open(encoding="utf-8") as file:
            text = file.read(_MAX_CHARACTERS)
        status = json.loads(text)
        age_s = (time.monotonic_ns() - operator.index(status["t_ns"])) / 1e9
    except FileNotFoundError as error:
        raise NotRunningError(f"{program} is not running: no {path}") from error
    except PermissionError:
        raise
    except OSError as error:
        raise NotRunningError(f"{path}: {error.strerror or error}") from error
    except (ValueError, KeyError, TypeError, OverflowError, RecursionError) as error:
        raise NotRunningError(f"{path}: not a status of imu-tracker") from error
    if age_s < 0:  # CLOCK_MONOTONIC began anew
        raise NotRunningError(
            f"{program} is not running: {path} is of before the last start of "
            "this computer"
        )
    pid = status.get("pid")
    if not _is_alive(pid):
        raise NotRunningError(
            f"{program} is not running: {path} was left by process {pid}, which was "
            f"killed; it is {age_s:.0f} s old"
        )
    if age_s > STALE_S:
        raise NotRunningError(
            f"{program} hangs (process {pid}): {path} is {age_s:.0f} s old"
        )
    return text, status


def _is_alive(pid: object) -> bool:
    """Whether the process is there, also one of another user."""
    if not isinstance(pid, int) or pid <= 0:
        return False
    try:
        os.kill(pid, 0)
    except PermissionError:
        return True
    except (ProcessLookupError, OverflowError):
        return False
    return True


def as_json(status: Mapping[str, Any]) -> str:
    """Return the object as a line."""
    return f"{json.dumps(_plain(status), allow_nan=False)}\n"


class StatusFile:
    """A file that tells the status; one that cannot be written is no fault.

    Parameters
    ----------
    path : Path
        Replaced as a whole each time, and removed at the end.
    render : callable
        What stands in it.
    """

    def __init__(
        self, path: Path, render: Callable[[Mapping[str, Any]], str] = as_json
    ) -> None:
        self._path, self._render = path, render
        self._new = path.with_name(f".{path.name}.new")
        self._is_failing = False

    def write(self, status: Mapping[str, Any]) -> None:
        """Replace what stands there."""
        text = self._render(status)
        try:
            make_directories(self._path.parent)
            flags = os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_NOFOLLOW
            with os.fdopen(
                os.open(self._new, flags, FILE_MODE), "w", encoding="utf-8"
            ) as file:
                file.write(text)
            self._new.replace(self._path)
        except OSError as error:
            if not self._is_failing:
                reason = error.strerror or error
                log.warning(
                    "%s: no status is written: %s; see [status]", self._path, reason
                )
            self._is_failing = True
        else:
            self._is_failing = False

    def remove(self) -> None:
        """Leave nothing behind that looks like a daemon."""
        for path in (self._path, self._new):
            with suppress(OSError):
                path.unlink(missing_ok=True)


def _plain(value: Any) -> Any:
    """Put null where JSON has no number."""
    match value:
        case float():
            return value if math.isfinite(value) else None
        case Mapping():
            return {key: _plain(item) for key, item in value.items()}
        case list() | tuple():
            return [_plain(item) for item in value]
        case _:
            return value


def metric(
    name: str, kind: str, text: str, samples: list[tuple[dict[str, str], float]]
) -> Iterator[str]:
    """Yield the lines of a metric, a sample for each set of labels."""
    yield f"# HELP {PREFIX}{name} {text}"
    yield f"# TYPE {PREFIX}{name} {kind}"
    for labels, value in samples:
        pairs = ",".join(f'{key}="{_escaped(text)}"' for key, text in labels.items())
        yield f"{PREFIX}{name}{f'{{{pairs}}}' if pairs else ''} {value}"


def _escaped(text: str) -> str:
    return text.replace("\\", r"\\").replace('"', r"\"").replace("\n", r"\n")
