"""The innovation gate: rejects outliers, and cannot lock the receiver out.

A fix must fit the filter's own prediction. One that does not is rejected and
remembered; when the rejected ones agree with one another for long enough, it is the
filter that is wrong, and it starts again from them.
"""

import math
from enum import StrEnum
from typing import Final

from imu_tracker.geometry.geodesy import LocalFrame
from imu_tracker.samples import GpsFix


class FixOutcome(StrEnum):
    """What became of a fix. Expected in service, so never an exception."""

    INITIALISED = "initialised"
    ACCEPTED = "accepted"
    OUTLIER = "outlier"
    REACQUIRED = "reacquired"
    FROZEN = "frozen"
    TOO_LATE = "too_late"
    UNDATED = "undated"


POSITION_RESET: Final = (
    "position reset to the receiver's, which disagreed for too long: rows just before "
    "may be wrong; if this repeats, run imu-tracker report on a recording"
)
"""What is told of a fix that was REACQUIRED."""

NIS_LIMIT: Final = 25.0
"""Squared distance in standard deviations, two degrees of freedom. Chi-square
would pass 99.9996 %; receivers have heavier tails than that, and a wrong rejection
costs more than a poor fix that weighs little."""

AGREEING_FIXES: Final = 8
AGREEING_S: Final = 10.0
"""A receiver that is right is ignored no longer than this, whichever comes first."""

MIN_AGREEING_FIXES: Final = 3
"""Yet a slow receiver needs so many: two agree by chance, or by one reflection."""

MAX_SPEED_MPS: Final = {"vehicle": 90.0, "walker": 12.0, "free": 350.0}
"""Between two fixes that agree: a sports car, a sprinter, an airliner."""

LEFT_M: Final = 15.0
"""A receiver that holds its place while it brakes to a stop is at most so far off."""

_AGREEING_SIGMAS: Final = 4.0  # of a receiver that may be too sure of itself
_AGREEING_ACCEL_MPS2: Final = 3.0  # brisk driving
_FROZEN_SPEED_MPS: Final = 1.0  # a parked receiver reports less


class Gate:
    """Remembers the run of rejected fixes, and the last fix of all."""

    def __init__(self, profile: str) -> None:
        self._max_speed_mps = MAX_SPEED_MPS[profile]
        self._streak: list[GpsFix] = []
        self._last: GpsFix | None = None
        self._missed_m = 0.0  # way by the speed while the place was repeated

    @property
    def n_agreeing(self) -> int:
        """Length of the present run of rejected fixes that agree."""
        return len(self._streak)

    def is_frozen(self, fix: GpsFix, speed_mps: float) -> bool:
        """Whether the receiver repeats a position while it moves.

        A place that it was surely driven away from stays frozen at the next stop, until
        the digits change.

        Parameters
        ----------
        fix : GpsFix
        speed_mps : float
            The fix's own speed where it has one, else the filter's.
        """
        last, self._last = self._last, fix
        if last is None or (last.lat_rad, last.lon_rad) != (fix.lat_rad, fix.lon_rad):
            self._missed_m = 0.0
            return False
        self._missed_m += speed_mps * max((fix.t_ns - last.t_ns) * 1e-9, 0.0)
        is_left = self._missed_m > max(LEFT_M, _AGREEING_SIGMAS * fix.sigma_h_m)
        return is_left or speed_mps > _FROZEN_SPEED_MPS

    def passes(self, nis: float) -> bool:
        """Whether an innovation fits; a fit ends the run of rejections."""
        if nis <= NIS_LIMIT:
            self._streak.clear()
            return True
        return False

    def reject(self, fix: GpsFix) -> bool:
        """Remember a rejected fix; True when the filter must start again from it.

        A fix agrees with the one before it when its position follows from that
        one's velocity, as well as both are known, or, without velocities, when the
        way between them can be travelled.
        """
        if self._streak and not self._agree(self._streak[-1], fix):
            self._streak.clear()
        self._streak.append(fix)
        n = len(self._streak)
        age_s = (fix.t_ns - self._streak[0].t_ns) * 1e-9
        if n >= AGREEING_FIXES or (n >= MIN_AGREEING_FIXES and age_s >= AGREEING_S):
            self._streak.clear()
            return True
        return False

    def _agree(self, old: GpsFix, fix: GpsFix) -> bool:
        dt_s = max((fix.t_ns - old.t_ns) * 1e-9, 0.0)
        here = LocalFrame.at(old.lat_rad, old.lon_rad)
        d_north_m, d_east_m = here.to_ne(fix.lat_rad, fix.lon_rad)
        noise_m = _AGREEING_SIGMAS * math.hypot(old.sigma_h_m, fix.sigma_h_m)
        if old.vel_ne_mps is None or fix.vel_ne_mps is None:
            reach_m = self._max_speed_mps * dt_s + noise_m
            return math.hypot(d_north_m, d_east_m) <= reach_m
        (vn0, ve0), (vn1, ve1) = old.vel_ne_mps, fix.vel_ne_mps
        miss_m = math.hypot(
            d_north_m - 0.5 * (vn0 + vn1) * dt_s, d_east_m - 0.5 * (ve0 + ve1) * dt_s
        )
        return miss_m <= noise_m + 0.5 * _AGREEING_ACCEL_MPS2 * dt_s**2
