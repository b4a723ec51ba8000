"""Paths as a driver makes them: legs of pedal and of steering wheel.

A path says how fast something goes and how sharply it turns, not where it gets to:
position follows by integration (`positions`). Because only one of speed and
curvature changes within a leg, distance and heading are exact polynomials, and so
is everything that an inertial sensor can feel.

Heading changes by curvature times distance, never by time: like any vehicle, a path
cannot turn on the spot.
"""

import math
from collections import deque
from collections.abc import Iterable, Iterator
from itertools import chain, repeat
from typing import Final, NamedTuple, TypeAlias

import numpy as np
from numpy.polynomial import Polynomial
from numpy.typing import NDArray

FloatArray: TypeAlias = NDArray[np.float64]

_BLEND: Final = Polynomial([0.0, 0.0, 0.0, 0.0, 35.0, -84.0, 70.0, -20.0])
"""From 0 to 1 with three derivatives zero at both ends: legs join in C3."""
_BLEND_RATE: Final = _BLEND.deriv()
_BLEND_SECOND: Final = _BLEND.deriv(2)
_BLEND_INTEGRAL: Final = _BLEND.integ()

BLEND_PEAK: Final = 35.0 / 16.0
"""Largest rate of the blend: peak acceleration is this times the mean."""

_LOOK_BACK_S: Final = 60.0


class Leg(NamedTuple):
    """A stretch of the path in which speed or curvature changes, but not both.

    Curvature is positive to the right. `is_covered`: no sky above, as in a tunnel.
    """

    duration_s: float
    speed_mps: float
    end_speed_mps: float
    curvature_per_m: float = 0.0
    end_curvature_per_m: float = 0.0
    is_covered: bool = False

    @property
    def length_m(self) -> float:
        """Distance travelled; the blend is symmetrical, so it is the mean speed's."""
        return 0.5 * (self.speed_mps + self.end_speed_mps) * self.duration_s

    @property
    def turn_rad(self) -> float:
        """Change of heading, positive to the right."""
        return 0.5 * (self.curvature_per_m + self.end_curvature_per_m) * self.length_m


_PARKED: Final = Leg(3600.0, 0.0, 0.0)


def stand(duration_s: float) -> Leg:
    """Stand still."""
    return Leg(duration_s, 0.0, 0.0)


def cruise(
    length_m: float,
    speed_mps: float,
    curvature_per_m: float = 0.0,
    *,
    is_covered: bool = False,
) -> Leg:
    """Go on at a speed and a curvature."""
    duration_s = length_m / speed_mps
    curve = curvature_per_m
    return Leg(duration_s, speed_mps, speed_mps, curve, curve, is_covered)


def change_speed(
    speed_mps: float,
    end_speed_mps: float,
    peak_mps2: float,
    curvature_per_m: float = 0.0,
    *,
    is_covered: bool = False,
) -> Leg:
    """Accelerate or brake with at most this acceleration."""
    duration_s = BLEND_PEAK * abs(end_speed_mps - speed_mps) / peak_mps2
    curve = curvature_per_m
    return Leg(duration_s, speed_mps, end_speed_mps, curve, curve, is_covered)


def turn(
    angle_rad: float,
    speed_mps: float,
    radius_m: float,
    ramp_s: float = 1.5,
    *,
    is_covered: bool = False,
) -> tuple[Leg, ...]:
    """Turn at constant speed: wheel in, hold, wheel out.

    The angle is met exactly. When it is too small for two ramps, the radius grows
    instead.
    """
    ramp_m = speed_mps * ramp_s
    curve = math.copysign(min(1.0 / radius_m, abs(angle_rad) / ramp_m), angle_rad)
    hold_m = max(0.0, angle_rad / curve - ramp_m)
    v = speed_mps
    ramp_in = Leg(ramp_s, v, v, 0.0, curve, is_covered)
    ramp_out = Leg(ramp_s, v, v, curve, 0.0, is_covered)
    return (ramp_in, cruise(hold_m, v, curve, is_covered=is_covered), ramp_out)


class Kinematics(NamedTuple):
    """How a path goes at some instants: arrays of shape (n,).

    Heading grows without wrapping; `is_covered` tells where the sky is hidden.
    """

    t_s: FloatArray
    distance_m: FloatArray
    speed_mps: FloatArray
    accel_mps2: FloatArray
    jerk_mps3: FloatArray
    heading_rad: FloatArray
    curvature_per_m: FloatArray
    curvature_rate: FloatArray  # 1/(m s)
    is_covered: NDArray[np.bool_]


class Path:
    """Legs one after the other, evaluated exactly at any instant.

    Parameters
    ----------
    legs : iterable of Leg
        May be endless: legs are drawn when they are reached and forgotten when they
        are a minute past. A path that ends, ends at rest and stays there.
    heading_rad : float
        Direction at the start.
    """

    def __init__(self, legs: Iterable[Leg], heading_rad: float = 0.0) -> None:
        self._legs: Iterator[Leg] = chain(legs, repeat(_PARKED))
        self._placed: deque[tuple[float, float, float, Leg]] = deque()
        self._end = (0.0, 0.0, heading_rad)
        self._end_speed_mps = self._end_curvature_per_m = 0.0

    def at(self, t_s: FloatArray) -> Kinematics:
        """Evaluate at growing instants; calls may go back by at most a minute."""
        self._draw_until(float(t_s[-1]))
        self._forget_before(float(t_s[0]) - _LOOK_BACK_S)
        starts = np.array([start for start, _, _, _ in self._placed])
        row = np.searchsorted(starts, t_s, side="right") - 1
        table = np.array([(*place, *leg) for *place, leg in self._placed])
        t0, s0, heading0, duration, v0, v1, c0, c1, covered = table[row].T

        u = (t_s - t0) / duration
        blend, rate = _BLEND(u), _BLEND_RATE(u) / duration
        blended_s = _BLEND_INTEGRAL(u) * duration
        travelled = v0 * (t_s - t0) + (v1 - v0) * blended_s
        return Kinematics(
            t_s,
            distance_m=s0 + travelled,
            speed_mps=v0 + (v1 - v0) * blend,
            accel_mps2=(v1 - v0) * rate,
            jerk_mps3=(v1 - v0) * _BLEND_SECOND(u) / duration**2,
            # The last term is there only when the speed is constant.
            heading_rad=heading0 + c0 * travelled + (c1 - c0) * v0 * blended_s,
            curvature_per_m=c0 + (c1 - c0) * blend,
            curvature_rate=(c1 - c0) * rate,
            is_covered=covered.astype(bool),
        )

    def _draw_until(self, t_s: float) -> None:
        while self._end[0] <= t_s:
            leg = next(self._legs)
            if leg.duration_s > 0.0:
                self._place(leg)

    def _place(self, leg: Leg) -> None:
        if not math.isclose(leg.speed_mps, self._end_speed_mps, abs_tol=1e-9):
            raise ValueError(f"{leg} does not go on at {self._end_speed_mps} m/s")
        is_moving = leg.speed_mps > 0.0
        if is_moving and not math.isclose(
            leg.curvature_per_m, self._end_curvature_per_m, abs_tol=1e-12
        ):
            raise ValueError(f"{leg} does not go on at {self._end_curvature_per_m}/m")
        if (
            leg.speed_mps != leg.end_speed_mps
            and leg.curvature_per_m != leg.end_curvature_per_m
        ):
            raise ValueError(f"{leg} changes speed and curvature at once")
        t_s, distance_m, heading_rad = self._end
        self._placed.append((t_s, distance_m, heading_rad, leg))
        self._end = (
            t_s + leg.duration_s,
            distance_m + leg.length_m,
            heading_rad + leg.turn_rad,
        )
        self._end_speed_mps = leg.end_speed_mps
        self._end_curvature_per_m = leg.end_curvature_per_m

    def _forget_before(self, t_s: float) -> None:
        while self._placed[0][0] + self._placed[0][3].duration_s < t_s:
            self._placed.popleft()
