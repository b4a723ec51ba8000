"""Which rows are worth sending. No clock, no file: a row comes, rows to send go.

What a newcomer gets wrong: a row is chosen by what was sent before and by nothing else,
so that whoever goes on from any row that was sent chooses the same rows again.
"""

import math
from typing import Final, NamedTuple

from imu_tracker.storage.latlong import LogRow
from imu_tracker.storage.log_tail import TailPosition

LINE_M: Final = 10.0
"""A row may lie so far beside the line that is sent, or its r95, which is more."""

MAX_APART: Final = 400
"""Rows of one line that are compared with it; then the line ends."""

_METRES_PER_DEGREE: Final = 111_195.0  # of a sphere: the tolerance is no measurement
_STILL: Final = "still"


class Placed(NamedTuple):
    """A row, and where a reader is that has read it."""

    row: LogRow
    position: TailPosition


class Rules(NamedTuple):
    """When a row is due.

    Attributes
    ----------
    moving_s, still_s : float
        After so long, moving and at rest; 0: every row.
    turn_deg : float
        When the course has turned by more.
    """

    moving_s: float = 10.0
    still_s: float = 300.0
    turn_deg: float = 15.0


class Thinner:
    """Chooses the rows whose polyline follows the log.

    Parameters
    ----------
    rules : Rules
    last : LogRow, optional
        The row that was sent last, to go on from.

    Notes
    -----
    Each row of the log lies within the larger of its r95 and 10 m of the polyline of
    the chosen rows: the row before the one that would break this is sent.
    """

    def __init__(self, rules: Rules, last: LogRow | None = None) -> None:
        self._rules, self._last = rules, last
        self._before: Placed | None = None
        self._apart: list[tuple[float, float, float]] = []  # east, north, tolerance

    def feed(self, placed: Placed) -> list[Placed]:
        """Return what is due by this row: nothing, it, the one before it, or both."""
        due: list[Placed] = []
        if self._last is not None and self._is_off_line(self._last, placed.row):
            assert self._before is not None
            due.append(self._before)
            self._begin(self._before.row)
        if self._last is None or is_due(self._rules, self._last, placed.row):
            due.append(placed)
            self._begin(placed.row)
            self._before = None
            return due
        self._note(self._last, placed.row)
        self._before = placed
        return due

    def _begin(self, row: LogRow) -> None:
        self._last = row
        self._apart.clear()

    def _note(self, last: LogRow, row: LogRow) -> None:
        """Remember a row that the line may miss; near its begin it cannot."""
        east_m, north_m = _offset_m(last, row)
        tolerance_m = max(row.r95_m, LINE_M)
        if math.hypot(east_m, north_m) > tolerance_m:
            self._apart.append((east_m, north_m, tolerance_m))

    def _is_off_line(self, last: LogRow, row: LogRow) -> bool:
        """Whether a line from the last row to this one misses a row between them."""
        if not self._apart:
            return False
        if len(self._apart) >= MAX_APART:
            return True
        east_m, north_m = _offset_m(last, row)
        square = east_m * east_m + north_m * north_m
        for x_m, y_m, tolerance_m in self._apart:
            share = (x_m * east_m + y_m * north_m) / square if square else 0.0
            share = min(1.0, max(0.0, share))
            if math.hypot(x_m - share * east_m, y_m - share * north_m) > tolerance_m:
                return True
        return False


def is_due(rules: Rules, last: LogRow, row: LogRow) -> bool:
    """Tell whether time, mode, course or r95 ask for a row after the last one."""
    if row.mode != last.mode:
        return True
    waits_s = rules.still_s if _is_at_rest(last, row) else rules.moving_s
    # Rows lie on a grid of milliseconds; their times as floats do not.
    if not row.utc_s - last.utc_s < waits_s - 1e-3:
        return True
    turned_deg = abs((row.course_deg - last.course_deg + 180.0) % 360.0 - 180.0)
    if turned_deg > rules.turn_deg:  # never, when one of them has no course
        return True
    return not 0.5 * last.r95_m <= row.r95_m <= 2.0 * last.r95_m


def _is_at_rest(last: LogRow, row: LogRow) -> bool:
    """Whether it stands, or creeps within its r95: without an IMU no row is `still`."""
    if row.mode == _STILL:
        return True
    return math.isnan(row.course_deg) and math.hypot(*_offset_m(last, row)) <= max(
        row.r95_m, LINE_M
    )


def _offset_m(one: LogRow, other: LogRow) -> tuple[float, float]:
    """Return how far another row lies to the east and to the north [m]."""
    north_deg = other.lat_deg - one.lat_deg
    east_deg = (other.lon_deg - one.lon_deg + 180.0) % 360.0 - 180.0
    scale = math.cos(math.radians(one.lat_deg)) * _METRES_PER_DEGREE
    return east_deg * scale, north_deg * _METRES_PER_DEGREE
