"""Rows against the fixes that come after them: outages, and how true the radius was.

A fix is compared with the rows that were written before it arrived: what the tracker
said without knowing it. What a newcomer gets wrong: the fix has an error of its own,
so the difference may be as large as both together.
"""

import math
from collections import Counter, deque
from typing import Final, NamedTuple

from imu_tracker.estimation.estimate import R95_PER_SIGMA
from imu_tracker.exports.merging import Point
from imu_tracker.exports.page import MAX_POINTS
from imu_tracker.exports.thinning import Thinner
from imu_tracker.geometry.geodesy import LocalFrame
from imu_tracker.report.measures.series import Series
from imu_tracker.samples import GpsFix, Mode
from imu_tracker.storage.latlong import MAX_GAP_S, LogRow

SHORTEST_OUTAGE_S: Final = 5.0
OUTAGE_PERIODS: Final = 4.0
"""No fix for so long, and for so many of the receiver's periods, is an outage."""

NEAR_ROW_S: Final = 1.5
"""A row answers for a fix that is no further away."""

MAX_OUTAGES: Final = 10_000
CELL_DEG: Final = 0.002
"""Some 200 m: the receiver's noise by place."""

WALKING_MPS: Final = 0.5


class Outage(NamedTuple):
    """The receiver had no fix, and then one; `miss_m` NaN when it never came back."""

    begin_utc_s: float
    length_s: float
    way_m: float
    lat_deg: float
    lon_deg: float
    miss_m: float
    r95_m: float
    limit_m: float  # of the miss: r95 and the fix's own error together

    @property
    def is_true(self) -> bool:
        """Whether the fix lay where the radius said, as well as it knows."""
        return self.miss_m <= self.limit_m


class Period(NamedTuple):
    """Fixes of a stretch of time against the rows before them."""

    begin_utc_s: float
    fixes: int
    inside: float  # share within the radius, widened by the fix's own error
    miss_m: float  # rms
    r95_m: float  # mean
    nis: float  # 2 when all is as it says


class Place(NamedTuple):
    """A cell of the ground, and how well the receiver does there."""

    lat_deg: float
    lon_deg: float
    fixes: int
    miss_m: float  # rms


class _Sum:
    """Adds up the fixes of a stretch or a place."""

    def __init__(self) -> None:
        self.n = self.inside = 0
        self.miss2 = self.r95 = self.nis = 0.0
        self.lat_deg = self.lon_deg = 0.0

    def add(self, fix: GpsFix, miss_m: float, r95_m: float, var_m2: float) -> None:
        self.n += 1
        self.inside += miss_m <= R95_PER_SIGMA * math.sqrt(var_m2)
        self.miss2 += miss_m**2
        self.r95 += r95_m
        self.nis += miss_m**2 / var_m2
        self.lat_deg += math.degrees(fix.lat_rad)
        self.lon_deg += math.degrees(fix.lon_rad)


class TrackLog:
    """Takes rows and fixes in the order in which they came to be.

    Attributes
    ----------
    thinner : Thinner
        The points of the map.
    speed, r95 : Series
        Over seconds since the first row.
    modes_s : Counter
        Seconds by mode.
    outages : list of Outage
    """

    def __init__(self, track: str) -> None:
        self._track, self._segment = track, 0
        self.thinner = Thinner(MAX_POINTS)
        self.speed, self.r95, self.miss = Series(), Series(), Series()
        self.modes_s: Counter[str] = Counter()
        self.outages: list[Outage] = []
        self.rows = self.fixes = 0
        self.way_m = 0.0
        self.first_utc_s = self.last_utc_s = math.nan
        self._recent: deque[LogRow] = deque(maxlen=40)
        self._last_fix: GpsFix | None = None
        self._fix_way_m = 0.0
        self._period_s = 1.0
        self._by_minute: dict[int, _Sum] = {}
        self._by_place: dict[tuple[int, int], _Sum] = {}
        self._all = _Sum()
        self._dark: tuple[LogRow, float] | None = None  # first row, way before it

    def add_row(self, row: LogRow, *, is_new_segment: bool = False) -> None:
        """Take a row of the log."""
        if not self.rows:
            self.first_utc_s = row.utc_s
        last = self._recent[-1] if self._recent else None
        if last is not None:
            step_s = row.utc_s - last.utc_s
            is_off = not 0.0 < step_s <= MAX_GAP_S or is_new_segment
            is_off = is_off or abs(row.lon_deg - last.lon_deg) > 180.0
            if is_off:
                self._segment += 1
            else:
                self.modes_s[row.mode] += step_s  # type: ignore[assignment]
                if row.speed_mps >= WALKING_MPS:
                    self.way_m += row.speed_mps * step_s
        self.rows += 1
        self._recent.append(row)
        self.last_utc_s = row.utc_s
        since_s = max(row.utc_s - self.first_utc_s, 0.0)
        self.speed.add(since_s, row.speed_mps)
        self.r95.add(since_s, row.r95_m)
        self.thinner.add(Point(self._track, self._segment, row))

    def add_fix(self, fix: GpsFix) -> None:
        """Take a fix before the rows know it."""
        self.fixes += 1
        last, self._last_fix = self._last_fix, fix
        way_m, self._fix_way_m = self.way_m - self._fix_way_m, self.way_m
        predicted = self._predicted(fix)
        gap_s = math.nan
        if last is not None and last.utc_s is not None and fix.utc_s is not None:
            gap_s = fix.utc_s - last.utc_s
            if 0.0 < gap_s < SHORTEST_OUTAGE_S:
                self._period_s += 0.05 * (gap_s - self._period_s)
        if predicted is None or fix.utc_s is None:
            return
        miss_m, r95_m = predicted
        var_m2 = (r95_m / R95_PER_SIGMA) ** 2 + fix.sigma_h_m**2
        if gap_s > max(SHORTEST_OUTAGE_S, OUTAGE_PERIODS * self._period_s):
            limit_m = R95_PER_SIGMA * math.sqrt(var_m2)
            self._add_outage(
                fix.utc_s - gap_s, gap_s, way_m, fix, miss_m, r95_m, limit_m
            )
        minute = int(fix.utc_s // 60)
        cell = (
            math.floor(math.degrees(fix.lat_rad) / CELL_DEG),
            math.floor(math.degrees(fix.lon_rad) / CELL_DEG),
        )
        for total in (
            self._all,
            self._by_minute.setdefault(minute, _Sum()),
            self._by_place.setdefault(cell, _Sum()),
        ):
            total.add(fix, miss_m, r95_m, var_m2)
        self.miss.add(max(fix.utc_s - self.first_utc_s, 0.0), miss_m)

    def add_mode(self, row: LogRow) -> None:
        """Tell outages by the mode, where there are rows alone and no fixes."""
        if row.mode == Mode.DR:
            self._dark = self._dark or (row, self.way_m)
            return
        begin, way_m = self._dark or (row, 0.0)
        self._dark = None
        if row.utc_s - begin.utc_s > SHORTEST_OUTAGE_S:
            self.outages.append(
                Outage(
                    begin.utc_s,
                    row.utc_s - begin.utc_s,
                    self.way_m - way_m,
                    row.lat_deg,
                    row.lon_deg,
                    math.nan,
                    math.nan,
                    math.nan,
                )
            )

    def end(self) -> None:
        """Close an outage that lasts to the end of the recording."""
        last, row = self._last_fix, self._recent[-1] if self._recent else None
        self.thinner.points = self.thinner.with_end()
        if last is None or last.utc_s is None or row is None:
            return
        gap_s = row.utc_s - last.utc_s
        if gap_s > max(SHORTEST_OUTAGE_S, OUTAGE_PERIODS * self._period_s):
            way_m = self.way_m - self._fix_way_m
            self._add_outage(
                last.utc_s, gap_s, way_m, last, math.nan, row.r95_m, math.nan
            )

    def periods(self) -> list[Period]:
        """Return the fixes by hour; by less where the recording is short."""
        length_s = self.last_utc_s - self.first_utc_s
        minutes = 60 if length_s > 3 * 3600 else 10 if length_s > 1800 else 1
        sums: dict[int, list[_Sum]] = {}
        for minute, total in sorted(self._by_minute.items()):
            sums.setdefault(minute // minutes * minutes, []).append(total)
        return [_period(60.0 * begin, parts) for begin, parts in sums.items()]

    def overall(self) -> Period | None:
        """Return the same of all fixes."""
        return _period(self.first_utc_s, [self._all]) if self._all.n else None

    def places(self, least_fixes: int = 5) -> list[Place]:
        """Return the cells, the noisiest first."""
        places = [
            Place(s.lat_deg / s.n, s.lon_deg / s.n, s.n, math.sqrt(s.miss2 / s.n))
            for s in self._by_place.values()
            if s.n >= least_fixes
        ]
        return sorted(places, key=lambda place: -place.miss_m)

    def _add_outage(
        self,
        begin_utc_s: float,
        length_s: float,
        way_m: float,
        fix: GpsFix,
        *misses_m: float,
    ) -> None:
        if len(self.outages) < MAX_OUTAGES:
            place = math.degrees(fix.lat_rad), math.degrees(fix.lon_rad)
            outage = Outage(begin_utc_s, length_s, way_m, *place, *misses_m)
            self.outages.append(outage)

    def _predicted(self, fix: GpsFix) -> tuple[float, float] | None:
        """Distance of the fix from where the rows put it, and their radius."""
        if fix.utc_s is None or not self._recent:
            return None
        at_s = fix.utc_s
        row = min(self._recent, key=lambda row: abs(row.utc_s - at_s))
        ahead_s = at_s - row.utc_s
        if abs(ahead_s) > NEAR_ROW_S:
            return None
        here = LocalFrame.at(math.radians(row.lat_deg), math.radians(row.lon_deg))
        north_m, east_m = here.to_ne(fix.lat_rad, fix.lon_rad)
        if not math.isnan(row.course_deg):
            course_rad = math.radians(row.course_deg)
            north_m -= ahead_s * row.speed_mps * math.cos(course_rad)
            east_m -= ahead_s * row.speed_mps * math.sin(course_rad)
        return math.hypot(north_m, east_m), row.r95_m


def _period(begin_utc_s: float, parts: list[_Sum]) -> Period:
    n = sum(part.n for part in parts)
    return Period(
        begin_utc_s,
        n,
        sum(part.inside for part in parts) / n,
        math.sqrt(sum(part.miss2 for part in parts) / n),
        sum(part.r95 for part in parts) / n,
        sum(part.nis for part in parts) / n,
    )
