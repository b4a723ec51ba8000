"""A receiver whose position drifts away slowly: spoofed, or lost in reflections.

The innovation gate does not detect it, because each fix fits the one before. Two things
do not fit: positions that move without the velocity that the receiver itself reports,
and positions that move while the IMU shows standstill. Limit: while the body moves,
forged positions with matching velocities are not detected. That would take a second
measurement of the speed, and the bias of an MPU-6050's accelerometer is too large.
"""

import math
from collections import Counter
from typing import Final

from imu_tracker.geometry.geodesy import LocalFrame
from imu_tracker.samples import GpsFix

DRAWN_M: Final = 50.0
DRAWN_SIGMAS: Final = 8.0
"""Recorded receivers drift by up to 31 m in that time; a larger claimed sigma counts
instead."""

FORGET_S: Final = 120.0
"""Memory of the sum: errors of a receiver last for a minute or two."""

LONGEST_STEP_S: Final = 3.0
"""Longest time between two fixes over which velocity may be interpolated."""

UNSURE_S: Final = 0.8
"""Receiver and host may differ by less about the time between two fixes; else one of
them was late, or the receiver has inserted a leap second."""


FROZEN_SPEED_MPS: Final = 1.0
"""A receiver that stands still repeats its place too, but says so."""

DRAWN: Final = (
    "the receiver may be led astray (spoofed): its places move without its own "
    "velocity; compare its place with what you see, and its antenna with open sky"
)
RESTED: Final = (
    "the receiver may be led astray (spoofed), or the IMU lies loose: its places move, "
    "the IMU feels nothing"
)
FROZEN: Final = (
    "the receiver repeats one place while its speed runs on: it is frozen, and not "
    "believed until the place changes; if that lasts, restart the receiver"
)


class SpoofingMonitor:
    """Watches fixes for a drift that nothing else confirms.

    Attributes
    ----------
    counters : Counter
        `suspect_fixes`: taken all the same, for nobody knows better.
    """

    def __init__(self) -> None:
        self.counters: Counter[str] = Counter()
        self._unexplained_ne_m = (0.0, 0.0)
        self._last: GpsFix | None = None
        self._anchor: GpsFix | None = None  # where it was when rest began
        self._is_frozen = False  # the place repeats since it moved by its velocity
        self._is_told = {"position": False, "rest": False}
        self._notices: list[str] = []

    def add_fix(self, fix: GpsFix, *, is_standing: bool) -> None:
        """Take a fix; `is_standing` when the IMU shows that the body stands."""
        limit_m = max(DRAWN_M, DRAWN_SIGMAS * fix.sigma_h_m)
        drawn_m = self._drawn_by_position(fix)
        self._judge("position", drawn_m, limit_m, FROZEN if self._is_frozen else DRAWN)
        if not is_standing:
            self._anchor = None
        rested_m = self._drawn_at_rest(fix) if is_standing else 0.0
        self._judge("rest", rested_m, limit_m, RESTED)
        if max(drawn_m, rested_m) > limit_m and not self._is_frozen:
            self.counters["suspect_fixes"] += 1

    def take_notices(self) -> list[str]:
        """Transitions since the last call."""
        notices, self._notices = self._notices, []
        return notices

    def _judge(self, kind: str, drawn_m: float, limit_m: float, why: str) -> None:
        """Tell a beginning once, and again only when it was over meanwhile."""
        if drawn_m > limit_m and not self._is_told[kind]:
            self._is_told[kind] = True
            self._notices.append(why)
        elif drawn_m < 0.5 * limit_m:
            self._is_told[kind] = False

    def _drawn_by_position(self, fix: GpsFix) -> float:
        """Way of the places that the velocities do not explain, in the last minutes."""
        last, self._last = self._last, fix
        if last is None or last.vel_ne_mps is None or fix.vel_ne_mps is None:
            return math.hypot(*self._unexplained_ne_m)
        arrived_s = (fix.t_ns - last.t_ns) * 1e-9
        dt_s = (
            fix.utc_s - last.utc_s
            if fix.utc_s is not None and last.utc_s is not None
            else arrived_s
        )
        is_sure = abs(dt_s - arrived_s) < UNSURE_S
        if not (0.0 < dt_s <= LONGEST_STEP_S and is_sure):
            return math.hypot(*self._unexplained_ne_m)
        speed_mps = math.hypot(*fix.vel_ne_mps)
        is_same_place = (fix.lat_rad, fix.lon_rad) == (last.lat_rad, last.lon_rad)
        self._is_frozen = is_same_place and (
            self._is_frozen or speed_mps > FROZEN_SPEED_MPS
        )
        here = LocalFrame.at(last.lat_rad, last.lon_rad)
        moved = here.to_ne(fix.lat_rad, fix.lon_rad)
        keep = math.exp(-dt_s / FORGET_S)
        north, east = (
            keep * (sum_m + way_m - 0.5 * (old + new) * dt_s)
            for sum_m, way_m, old, new in zip(
                self._unexplained_ne_m,
                moved,
                last.vel_ne_mps,
                fix.vel_ne_mps,
                strict=True,
            )
        )
        if math.hypot(*moved) > DRAWN_M + 0.5 * dt_s * (
            math.hypot(*last.vel_ne_mps) + math.hypot(*fix.vel_ne_mps)
        ):
            north, east = 0.0, 0.0  # a leap: the gate's affair
        self._unexplained_ne_m = north, east
        return math.hypot(north, east)

    def _drawn_at_rest(self, fix: GpsFix) -> float:
        """Way from where the body came to rest, while it rests."""
        if self._anchor is None:
            self._anchor = fix
        here = LocalFrame.at(self._anchor.lat_rad, self._anchor.lon_rad)
        return math.hypot(*here.to_ne(fix.lat_rad, fix.lon_rad))
