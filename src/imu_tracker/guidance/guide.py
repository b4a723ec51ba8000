"""Which leg of a route we are on, and what is left of it.

What a newcomer gets wrong: a waypoint need not be hit. It is behind us as soon as we
have passed the line across its leg, else the guide would send us back to it.
"""

import itertools
import math
from collections.abc import Sequence
from enum import StrEnum
from typing import Any, Final, NamedTuple

from imu_tracker.guidance.route import (
    EARTH_RADIUS_M,
    Waypoint,
    bearing_deg,
    distance_m,
)
from imu_tracker.storage.latlong import LogRow

MIN_SPEED_MPS: Final = 0.5
"""Slower than this there is no time to go."""


class GuideState(StrEnum):
    """Whether there is something to say."""

    ON_THE_WAY = "on the way"
    ARRIVED = "arrived"
    UNSURE = "cannot tell"  # r95 is too large


class Guidance(NamedTuple):
    """What a row means on the route.

    `waypoint` is the next one, the `number`th of `total`; `cross_track_m` is positive
    to the right of the leg, which begins at `leg_bearing_deg`; `rest_m` is the way
    along the route to its end, and `time_to_go_s` what it takes to the next waypoint at
    the speed made good towards it.
    """

    state: GuideState
    waypoint: Waypoint
    origin: Waypoint
    number: int
    total: int
    distance_m: float
    bearing_deg: float
    leg_bearing_deg: float
    cross_track_m: float
    rest_m: float
    time_to_go_s: float | None

    def summary(self) -> dict[str, Any]:
        """Return it in the precision that a person wants."""
        return {
            "state": str(self.state),
            "waypoint": self.waypoint.name,
            "number": self.number,
            "total": self.total,
            "distance_m": round(self.distance_m, 1),
            "bearing_deg": round(self.bearing_deg, 1),
            "cross_track_m": round(self.cross_track_m, 1),
            "rest_m": round(self.rest_m, 1),
            "time_to_go_s": self.time_to_go_s and round(self.time_to_go_s),
        }


class Guide:
    """Follows a route, row by row.

    Parameters
    ----------
    route : sequence of Waypoint
        At least two.
    arrival_m : float
        A waypoint is reached within so much.
    limit_m : float
        With a larger r95 it says that it cannot tell, and stays where it was.
    """

    def __init__(
        self, route: Sequence[Waypoint], arrival_m: float, limit_m: float
    ) -> None:
        self._route, self._arrival_m, self._limit_m = route, arrival_m, limit_m
        legs = list(itertools.pairwise(route))
        self._rest_m = [0.0] * len(route)
        for i in range(len(legs) - 1, -1, -1):
            self._rest_m[i] = self._rest_m[i + 1] + distance_m(*legs[i])
        self._leg, self._is_lost = 0, True
        self._is_arrived = False

    def at(self, row: LogRow) -> Guidance:
        """Return what the row means."""
        here = Waypoint("", row.lat_deg, row.lon_deg)
        is_sure = row.r95_m <= self._limit_m
        leg = self._leg
        if is_sure and self._is_lost:  # at the start, and after an outage
            self._leg = leg = self._nearest_leg(here, self._leg)
        self._is_lost = not is_sure
        while is_sure and not self._is_arrived and self._is_passed(leg, here):
            if leg == len(self._route) - 2:
                self._is_arrived = True
            else:
                self._leg = leg = leg + 1
        return self._guidance(leg, here, row, is_sure=is_sure)

    def _guidance(
        self, leg: int, here: Waypoint, row: LogRow, *, is_sure: bool
    ) -> Guidance:
        origin, waypoint = self._route[leg : leg + 2]
        _, cross_m = _along_and_across(origin, waypoint, here)
        to_go_m, bearing = distance_m(here, waypoint), bearing_deg(here, waypoint)
        course = 0.0 if math.isnan(row.course_deg) else row.course_deg
        towards_mps = row.speed_mps * math.cos(math.radians(course - bearing))
        state = GuideState.ARRIVED if self._is_arrived else GuideState.ON_THE_WAY
        return Guidance(
            state=state if is_sure else GuideState.UNSURE,
            waypoint=waypoint,
            origin=origin,
            number=leg + 2,
            total=len(self._route),
            distance_m=to_go_m,
            bearing_deg=bearing,
            leg_bearing_deg=bearing_deg(origin, waypoint),
            cross_track_m=cross_m,
            rest_m=to_go_m + self._rest_m[leg + 1],
            time_to_go_s=to_go_m / towards_mps
            if towards_mps >= MIN_SPEED_MPS and not math.isnan(row.course_deg)
            else None,
        )

    def _is_passed(self, leg: int, here: Waypoint) -> bool:
        origin, waypoint = self._route[leg : leg + 2]
        if distance_m(here, waypoint) <= self._arrival_m:
            return True
        along_m, _ = _along_and_across(origin, waypoint, here)
        return along_m >= distance_m(origin, waypoint)

    def _nearest_leg(self, here: Waypoint, first: int) -> int:
        """Return the nearest leg from `first` on; the later one of two as near."""
        best, least_m = first, math.inf
        for leg in range(first, len(self._route) - 1):
            origin, waypoint = self._route[leg : leg + 2]
            along_m, cross_m = _along_and_across(origin, waypoint, here)
            length_m = distance_m(origin, waypoint)
            beyond_m = max(0.0, -along_m, along_m - length_m)
            apart_m = math.hypot(beyond_m, cross_m)
            if apart_m <= least_m:
                best, least_m = leg, apart_m
        return best


def _along_and_across(
    origin: Waypoint, waypoint: Waypoint, here: Waypoint
) -> tuple[float, float]:
    """Return how far along a leg we are, and how far to the right of it, in metres.

    Notes
    -----
    sin(xt/R) = sin(d13/R) sin(b13 - b12); tan(at/R) = tan(d13/R) cos(b13 - b12).
    Source: Napier's rules for a right spherical triangle.
    """
    angle = distance_m(origin, here) / EARTH_RADIUS_M
    turn = math.radians(bearing_deg(origin, here) - bearing_deg(origin, waypoint))
    across = math.asin(max(-1.0, min(1.0, math.sin(angle) * math.sin(turn))))
    along = math.atan2(math.sin(angle) * math.cos(turn), math.cos(angle))
    return along * EARTH_RADIUS_M, across * EARTH_RADIUS_M
