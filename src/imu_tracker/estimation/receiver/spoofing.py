"""A receiver whose place is drawn away, slowly: spoofed, or lost in reflections.

No gate sees it, for every fix fits the one before. Two things do not fit: places that
move without the velocity that the receiver itself reports, and a body that the IMU
feels standing all the time. What a newcomer gets wrong: who forges places and
velocities alike is seen by neither while the body moves. That takes a second opinion
on the speed, which an MPU-6050 cannot give: the bias of its accelerometer is as large.
"""

import math
from collections import Counter
from typing import Final

from imu_tracker.geometry.geodesy import LocalFrame
from imu_tracker.samples import GpsFix, ImuSample, Vec3

DRAWN_M: Final = 50.0
DRAWN_SIGMAS: Final = 8.0
"""Farther than this hardly a receiver wanders in the time that is looked at, and none
of those that were recorded: one that smooths its course got to 31 m. Its own word on
its noise counts when that is worse."""

FORGET_S: Final = 120.0
"""Errors of position come and go within a minute or two; so does the sum forget."""

LONGEST_STEP_S: Final = 3.0
"""Between two fixes the velocity is taken to change evenly; no longer than this."""

UNSURE_S: Final = 0.8
"""Receiver and host may differ by less about the time between two fixes; else one of
them was late, or the receiver has inserted a leap second."""

WINDOW_NS: Final = 1_000_000_000
EVERY_NS: Final = 45_000_000
"""The IMU is looked at so often: vibration shows at any rate."""

LOUDER: Final = 2.0
MOVED_MPS2: Final = 0.15
MOVED_RADPS: Final = math.radians(0.5)
"""What a start from rest cannot hide: vibration twice that of rest, a mean force or
rate that differs from that of rest."""


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
        self._quiet = _Quiet()
        self._is_told = {"position": False, "rest": False}
        self._notices: list[str] = []

    def on_imu(self, sample: ImuSample) -> None:
        """Feel whether the body goes on resting."""
        self._quiet.add(sample)

    def rest(self, is_still: bool) -> None:
        """Hear whether the tracker believes that the body stands."""
        self._quiet.learn(is_still)

    def on_fix(self, fix: GpsFix) -> None:
        """Take a fix."""
        limit_m = max(DRAWN_M, DRAWN_SIGMAS * fix.sigma_h_m)
        drawn_m = self._drawn_by_position(fix)
        self._judge(
            "position", drawn_m, limit_m, "its places move without its own velocity"
        )
        rested_m = self._drawn_at_rest(fix)
        self._judge("rest", rested_m, limit_m, "its places move, the IMU feels nothing")
        if max(drawn_m, rested_m) > limit_m:
            self.counters["suspect_fixes"] += 1

    def take_notices(self) -> list[str]:
        """Transitions since the last call."""
        notices, self._notices = self._notices, []
        return notices

    def _judge(self, kind: str, drawn_m: float, limit_m: float, why: str) -> None:
        """Tell a beginning once, and again only when it was over meanwhile."""
        if drawn_m > limit_m and not self._is_told[kind]:
            self._is_told[kind] = True
            self._notices.append(f"the receiver may be led astray (spoofed): {why}")
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
        if not self._quiet.is_resting:
            self._anchor = None
            return 0.0
        if self._anchor is None:
            self._anchor = fix
        here = LocalFrame.at(self._anchor.lat_rad, self._anchor.lon_rad)
        return math.hypot(*here.to_ne(fix.lat_rad, fix.lon_rad))


class _Quiet:
    """Rest that was once agreed on, and that the IMU has not felt to end."""

    def __init__(self) -> None:
        self.is_resting = False
        self._samples: list[ImuSample] = []
        self._due_ns = 0
        self._mean: tuple[Vec3, Vec3] | None = None  # of the last window
        self._spread = (math.inf, math.inf)
        self._rest: tuple[Vec3, Vec3] | None = None  # of the first window of rest
        self._rest_spread = (0.0, 0.0)

    def learn(self, is_still: bool) -> None:
        if is_still and not self.is_resting and self._mean is not None:
            self.is_resting = True
            self._rest, self._rest_spread = self._mean, self._spread

    def add(self, sample: ImuSample) -> None:
        if sample.t_ns < self._due_ns:
            return
        self._due_ns = sample.t_ns + EVERY_NS
        samples = self._samples
        samples.append(sample)
        if sample.t_ns - samples[0].t_ns < WINDOW_NS:
            return
        accel, accel_spread = _mean_and_spread([s.accel_mps2 for s in samples])
        gyro, gyro_spread = _mean_and_spread([s.gyro_radps for s in samples])
        self._mean, self._spread = (accel, gyro), (accel_spread, gyro_spread)
        self._samples = []
        if self._rest is not None:
            rest_accel, rest_gyro = self._rest
            self.is_resting = self.is_resting and (
                accel_spread < LOUDER * self._rest_spread[0]
                and gyro_spread < LOUDER * self._rest_spread[1]
                and math.dist(accel, rest_accel) < MOVED_MPS2
                and math.dist(gyro, rest_gyro) < MOVED_RADPS
            )


def _mean_and_spread(rows: list[Vec3]) -> tuple[Vec3, float]:
    n = len(rows)
    x, y, z = (sum(column) / n for column in zip(*rows, strict=True))
    square = sum((a - x) ** 2 + (b - y) ** 2 + (c - z) ** 2 for a, b, c in rows)
    return (x, y, z), math.sqrt(square / n)
