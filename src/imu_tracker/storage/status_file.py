"""The status file as others read it: whether a daemon is there, and what it says."""

import json
import operator
import os
import time
from pathlib import Path
from typing import Any, Final

from imu_tracker.errors import NotRunningError

STALE_S: Final = 5.0
"""The daemon writes each second; after this long it hangs, or is gone."""

_MAX_CHARACTERS: Final = 1_000_000
"""A hundred times what the daemon writes."""


def read_status(path: Path) -> tuple[str, dict[str, Any]]:
    """Read what the daemon wrote just now, as text and as an object.

    Raises
    ------
    NotRunningError
        When there is no daemon, or it stopped writing.
    PermissionError
        When this user may not read it.
    """
    try:
        with path.open(encoding="utf-8") as file:
            text = file.read(_MAX_CHARACTERS)
        status = json.loads(text)
        age_s = (time.monotonic_ns() - operator.index(status["t_ns"])) / 1e9
    except FileNotFoundError as error:
        raise NotRunningError(f"imu-tracker is not running: no {path}") from error
    except PermissionError:
        raise
    except OSError as error:
        raise NotRunningError(f"{path}: {error.strerror or error}") from error
    except (ValueError, KeyError, TypeError, OverflowError, RecursionError) as error:
        raise NotRunningError(f"{path}: not a status of imu-tracker") from error
    if age_s < 0:  # CLOCK_MONOTONIC began anew
        raise NotRunningError(
            f"imu-tracker is not running: {path} is of before the last start of "
            "this computer"
        )
    pid = status.get("pid")
    if not _is_alive(pid):
        raise NotRunningError(
            f"imu-tracker is not running: {path} was left by process {pid}, which was "
            f"killed; it is {age_s:.0f} s old"
        )
    if age_s > STALE_S:
        raise NotRunningError(
            f"imu-tracker hangs (process {pid}): {path} is {age_s:.0f} s old"
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
