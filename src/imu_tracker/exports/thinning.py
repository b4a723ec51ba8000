"""So many points and no more, without losing the shape of a track.

A map of a year cannot hold a hundred million rows. As long as there is room every row
is kept; when there is none, those that moved less than a step go, and the step grows
until there is. What always stays: both ends of each run of a mode, and the rows where
r95 has grown by a fifth.
"""

import math
from collections.abc import Iterable, Iterator
from typing import Final

from imu_tracker.exports.merging import Point
from imu_tracker.storage.latlong import LogRow

FIRST_STEP_M: Final = 0.5
NOTABLE_GROWTH: Final = 1.2  # of r95

_METRES_PER_DEGREE: Final = 111_195.0  # of a sphere: a step need not be exact


class Thinner:
    """Takes points one by one; keeps at most `limit` of them.

    Attributes
    ----------
    points : list of Point
        What was kept.
    taken : int
        How many came.
    step_m : float
        What a row must have moved by to stay; 0 while all do.
    """

    def __init__(self, limit: int) -> None:
        self.points: list[Point] = []
        self.taken, self.step_m = 0, 0.0
        self._limit = limit
        self._sieve = _Sieve(0.0)

    def add_all(self, points: Iterable[Point]) -> None:
        """Take a whole stream, with its end."""
        for point in points:
            self.add(point)
        self.points = self.with_end()

    def add(self, point: Point) -> None:
        """Take a point of a stream that has no end."""
        self.taken += 1
        self.points += self._sieve.feed(point)
        while len(self.points) > self._limit:
            self._make_room()

    def with_end(self) -> list[Point]:
        """Return what was kept, with the newest point."""
        return [*self.points, *self._sieve.end()]

    def drop_before(self, utc_s: float) -> None:
        """Forget the oldest points, a hundred or more at once."""
        if len(self.points) > 100 and self.points[100].row.utc_s < utc_s:
            del self.points[:100]

    def _make_room(self) -> None:
        """Thin what was kept to three quarters of the limit at most."""
        points = self.points
        while len(self.points) > self._limit * 3 // 4:
            if self.step_m > 1e7:  # ends of runs, nothing else: drop every other
                self.points = self.points[::2]
                continue
            self.step_m = max(FIRST_STEP_M, 2.0 * self.step_m)
            self._sieve = _Sieve(self.step_m)
            self.points = [kept for point in points for kept in self._sieve.feed(point)]


class _Sieve:
    """Passes points on that are a step apart, and the ends of runs."""

    def __init__(self, step_m: float) -> None:
        self._step_m = step_m
        self._kept: Point | None = None
        self._last: Point | None = None

    def feed(self, point: Point) -> Iterator[Point]:
        """Yield what is kept now: the end of the run before, and this point."""
        last, self._last = self._last, point
        if last is None or self._kept is None or not _is_same_run(last, point):
            if last is not None and last is not self._kept:
                yield last
        elif not self._is_notable(self._kept.row, point.row):
            return
        self._kept = point
        yield point

    def end(self) -> Iterator[Point]:
        """Yield the end of the last run, unless it was."""
        if self._last is not None and self._last is not self._kept:
            yield self._last

    def _is_notable(self, kept: LogRow, row: LogRow) -> bool:
        return (
            self._step_m == 0.0
            or _distance_m(kept, row) >= self._step_m
            or row.r95_m >= NOTABLE_GROWTH * kept.r95_m
        )


def _is_same_run(one: Point, other: Point) -> bool:
    return one.segment == other.segment and one.row.mode == other.row.mode


def _distance_m(one: LogRow, other: LogRow) -> float:
    north_deg = other.lat_deg - one.lat_deg
    east_deg = (other.lon_deg - one.lon_deg) * math.cos(math.radians(one.lat_deg))
    return math.hypot(north_deg, east_deg) * _METRES_PER_DEGREE
