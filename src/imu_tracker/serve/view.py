"""What is known now: rows as they come, how the daemon is, where the route goes.

The only module of the room that reads log and status. What a newcomer gets wrong: a
`still` row does not say whether it had GPS; the status does, and a parked car with a
perfect sky is not "estimated".
"""

import logging
from collections.abc import Iterator
from itertools import islice
from typing import Any, Final, NamedTuple

from imu_tracker.config import Config
from imu_tracker.errors import NotRunningError, TrackerError
from imu_tracker.guidance.guide import Guidance, Guide
from imu_tracker.guidance.route import Waypoint, read_route
from imu_tracker.samples import Mode
from imu_tracker.serve.history import History
from imu_tracker.storage.latlong import LogRow
from imu_tracker.storage.log_tail import LogTail, TailPosition, newest_utc_s
from imu_tracker.storage.status_file import read_status

BATCH: Final = 500
"""Rows that are taken at once: a flood of them keeps nobody from being served."""

FIX_S: Final = 2
"""So old a fix may be for a position that counts as measured."""

_SHOWN: Final = (
    *("source", "state", "uptime_s", "fix_age_s", "imu_rate_hz", "disk_free_mb"),
    *("prediction", "imu", "gps", "faults", "learnt"),
)
"""What the page tells of the status; no paths, no process."""

log = logging.getLogger(__name__)


class Shown(NamedTuple):
    """A row, whether a fix stands behind it, and what it means on the route."""

    row: LogRow
    has_fix: bool
    guidance: Guidance | None


class View:
    """Reads the log and the status whenever it is asked to.

    Attributes
    ----------
    last : Shown or None
        The newest row; None before there is one.
    away : str
        Why there is no daemon; "" while there is one.
    history : History
        The track of the last hours.
    route : list of Waypoint
        Empty without one, or with a bad one.
    """

    def __init__(self, config: Config) -> None:
        self._status_path = config.status.path
        newest_s = newest_utc_s(config.log.path)
        start_s = newest_s - 3600.0 * config.serve.history_h
        self._tail = LogTail(config.log.path, TailPosition(start_s))
        self.history = History(config.serve.history_h)
        self.route = _route_of(config)
        self._guide = (
            Guide(self.route, config.guide.arrival_m, config.guide.limit_m)
            if self.route
            else None
        )
        self.last: Shown | None = None
        self.away, self._status = "imu-tracker is not running", dict[str, Any]()
        self._waiting: Iterator[LogRow] = iter(())

    def read_status(self) -> bool:
        """Read the status anew; return whether the daemon has gone or come."""
        before = self.away
        try:
            _, self._status = read_status(self._status_path)
            self.away = ""
        except NotRunningError as error:
            self._status, self.away = {}, _without_path(str(error))
        except PermissionError:
            self._status, self.away = {}, "the status of imu-tracker may not be read"
        return bool(self.away) is not bool(before)

    def take_rows(self) -> tuple[list[Shown], bool]:
        """Return the rows that came, and whether more are waiting."""
        rows = list(islice(self._waiting, BATCH))
        if len(rows) < BATCH:
            self._waiting = self._tail.rows()
            rows += islice(self._waiting, BATCH - len(rows))
        shown = [self._show(row) for row in rows]
        for row in rows:
            self.history.add(row)
        if shown:
            self.last = shown[-1]
        return shown, len(rows) == BATCH

    def _show(self, row: LogRow) -> Shown:
        guidance = None if self._guide is None else self._guide.at(row)
        return Shown(row, self._has_fix(row.mode), guidance)

    def _has_fix(self, mode: str) -> bool:
        if mode in (Mode.GPS, Mode.DR):
            return mode == Mode.GPS
        age_s = self._status.get("fix_age_s")
        return isinstance(age_s, int | float) and age_s <= FIX_S

    def status(self) -> dict[str, Any]:
        """Return what the page tells of the daemon."""
        told = {key: self._status.get(key) for key in _SHOWN}
        log_part = self._status.get("log")
        is_failing = isinstance(log_part, dict) and bool(log_part.get("is_failing"))
        return {"away": self.away, "log_is_failing": is_failing, **told}

    def close(self) -> None:
        """Let the log go."""
        self._tail.close()


def _without_path(text: str) -> str:
    """Leave the names of files to those who may log in."""
    if "hangs" in text:
        return "imu-tracker hangs"
    return "imu-tracker is not running"


def _route_of(config: Config) -> list[Waypoint]:
    """Read the route; one that is missing or bad is told and guides nowhere."""
    if config.guide.route is None:
        return []
    try:
        return read_route(config.guide.route)
    except TrackerError as error:
        log.warning("no guidance: %s", error)
        return []
