"""Rows of the tracker in, the same rows smoothed out, some minutes later.

The filters keep their history (`History`); once enough of it has come together, a pass
goes back through it and the older part is given out and let go. What comes more than
`OVERLAP_S` of fixes later says nothing new of a place, so that memory stays bounded by
the pieces, not by the drive.

The fact that a newcomer gets wrong: rows are on the receiver's time scale. A row of the
instant t is the place of the filter at t + delay, and the delay, too, is smoothed.
"""

import math
from bisect import bisect_right
from collections import deque
from collections.abc import Sequence
from typing import Final

from imu_tracker.estimation.error_state.smoothing.backward import Point, points
from imu_tracker.estimation.error_state.smoothing.history import History
from imu_tracker.estimation.error_state.smoothing.receiver import AloneTrack
from imu_tracker.geometry.geodesy import LocalFrame
from imu_tracker.samples import NavState, Vec3

PIECE_S: Final = 600.0
OVERLAP_S: Final = 200.0
"""A pass is made each time that so much has come together, and its newest part is left
to the next one: so many seconds with fixes, in which a filter has learnt all it can."""

LONGEST_S: Final = 3600.0
"""After so long without fixes rows are given out all the same: what is kept of an hour
takes some 100 MB."""


class Smoother:
    """Turns the rows of one session into smoothed ones.

    Parameters
    ----------
    history : History
        Of the filters that the rows come from.
    lever_arm_m : Vec3, body axes
    """

    def __init__(self, history: History, lever_arm_m: Vec3) -> None:
        self._history, self._lever_arm_m = history, lever_arm_m
        self._rows: deque[NavState] = deque()
        self._due_ns: int | None = None

    def add(self, rows: Sequence[NavState]) -> list[NavState]:
        """Take rows in their order; return those that are finished."""
        if not rows:
            return []
        self._rows.extend(rows)
        now_ns = rows[-1].t_ns
        if self._due_ns is None:
            self._due_ns = now_ns + round(PIECE_S * 1e9)
        if now_ns < self._due_ns:
            return []
        self._due_ns = now_ns + round((PIECE_S - OVERLAP_S) * 1e9)
        found = points(self._history.newest, self._lever_arm_m)
        until_ns = _settled_ns(found)
        done = self._smooth(found, until_ns)
        if done:
            before = [p.filter_ns for p in found if p.t_ns <= done[-1].t_ns]
            self._history.let_go(before[-2] if len(before) > 1 else 0)
        return done

    def finish(self) -> list[NavState]:
        """Return all that is left."""
        found = points(self._history.newest, self._lever_arm_m)
        return self._smooth(found, math.inf)

    def _smooth(self, found: list[Point], until_ns: float) -> list[NavState]:
        """Take out the rows up to an instant, smoothed."""
        times = [point.t_ns for point in found]
        alone = None
        if not all(point.is_imu_right for point in found):
            alone = AloneTrack(self._history.fixes)
        done = []
        while self._rows and self._rows[0].t_ns <= until_ns:
            row = self._rows.popleft()
            i = bisect_right(times, row.t_ns)
            if 0 < i < len(found):
                before, after = found[i - 1], found[i]
                row = _between(before, after, row)
                if alone is not None and not (
                    before.is_imu_right and after.is_imu_right
                ):
                    row = _by_receiver(alone, before, row)
            done.append(row)
        return done


def _settled_ns(found: list[Point]) -> float:
    """Up to which instant nothing that is still to come will change a place."""
    if not found:
        return -math.inf
    newest_ns, lit_s = found[-1].t_ns, 0.0
    for older, newer in zip(reversed(found[:-1]), reversed(found), strict=False):
        step_s = (newer.t_ns - older.t_ns) * 1e-9
        if newer.outage_s < 2.0:
            lit_s += step_s
        if lit_s > OVERLAP_S or (newest_ns - older.t_ns) * 1e-9 > LONGEST_S:
            return older.t_ns
    return -math.inf


def _between(before: Point, after: Point, row: NavState) -> NavState:
    """Return the row with the place between two points, by a cubic.

    Notes
    -----
    Hermite: p(s) = h00 p0 + h10 dt v0 + h01 p1 + h11 dt v1, s in 0 to 1.
    """
    dt_s = max((after.t_ns - before.t_ns) * 1e-9, 1e-9)
    s = min(max((row.t_ns - before.t_ns) * 1e-9 / dt_s, 0.0), 1.0)
    here = LocalFrame.at(before.lat_rad, before.lon_rad)
    north, east = here.to_ne(after.lat_rad, after.lon_rad)
    h01 = s * s * (3.0 - 2.0 * s)
    h10, h11 = dt_s * s * (1.0 - s) ** 2, dt_s * s * s * (s - 1.0)
    (n0, e0, d0), (n1, e1, d1) = before.v_n, after.v_n
    lat, lon = here.to_lat_lon(
        h01 * north + h10 * n0 + h11 * n1, h01 * east + h10 * e0 + h11 * e1
    )
    alt_m = row.alt_m
    if before.alt_m is not None and after.alt_m is not None:
        alt_m = before.alt_m + h01 * (after.alt_m - before.alt_m)
    nearest = before if s < 0.5 else after
    return row._replace(
        lat_rad=lat,
        lon_rad=lon,
        alt_m=alt_m,
        v_n_mps=(n0 + s * (n1 - n0), e0 + s * (e1 - e0), d0 + s * (d1 - d0)),
        q_nb=nearest.q_nb,
        r95_m=before.r95_m + s * (after.r95_m - before.r95_m),
    )


def _by_receiver(alone: AloneTrack, before: Point, row: NavState) -> NavState:
    """Return the row with the place of the receiver alone; height is the filter's."""
    place = alone.at(before.filter_ns + row.t_ns - before.t_ns)
    if place is None:
        return row
    v_n = (*place.v_ne_mps, row.v_n_mps[2])
    return row._replace(
        lat_rad=place.lat_rad, lon_rad=place.lon_rad, v_n_mps=v_n, r95_m=place.r95_m
    )
