"""A driver in a small town: random, sensible, and never finished."""

import math
from collections.abc import Iterable, Iterator
from typing import Final

import numpy as np

from imu_tracker.simulation.motion.paths import Leg, change_speed, cruise, stand, turn

_CRUISE_MPS: Final = (30 / 3.6, 50 / 3.6, 50 / 3.6, 70 / 3.6)
_TUNNEL_MPS: Final = 70 / 3.6
_QUEUE_MPS: Final = 50 / 3.6  # traffic in the tunnel
_TUNNEL_S: Final = 60.0
_FIRST_TUNNEL_S: Final = 300.0
_TUNNEL_EVERY_S: Final = 900.0
_HOME_RADIUS_M: Final = 1500.0
_CORNER_LATERAL_MPS2: Final = 2.2
_BEND_LATERAL_MPS2: Final = 1.6
_RIGHT_ANGLE_RAD: Final = math.pi / 2.0


class Driver:
    """Makes up a drive leg by leg: streets, bends, lights, junctions, a tunnel.

    Keeps to the surroundings of the start: farther away than 1.5 km he turns for
    home at each junction.

    Parameters
    ----------
    rng : Generator
        What he decides by; nobody else may draw from it.
    start_still_s : float
        How long he stands before he goes.
    """

    def __init__(self, rng: np.random.Generator, start_still_s: float) -> None:
        self._rng = rng
        self._start_still_s = start_still_s
        self._elapsed_s = self._north_m = self._east_m = 0.0
        self._heading_rad = self._speed_mps = 0.0
        self._next_tunnel_s = _FIRST_TUNNEL_S

    def legs(self, heading_rad: float) -> Iterator[Leg]:
        """Yield the legs of an endless drive that begins in this direction."""
        self._heading_rad = heading_rad
        yield from self._go((stand(self._start_still_s),))
        while True:
            if self._elapsed_s >= self._next_tunnel_s:
                self._next_tunnel_s += _TUNNEL_EVERY_S
                yield from self._go(self._tunnel())
            else:
                yield from self._go(self._street())
            yield from self._go(self._junction())

    def _go(self, legs: Iterable[Leg]) -> Iterator[Leg]:
        """Keep the log, roughly: it only serves to find home."""
        for leg in legs:
            direction = self._heading_rad + 0.5 * leg.turn_rad
            self._elapsed_s += leg.duration_s
            self._north_m += leg.length_m * math.cos(direction)
            self._east_m += leg.length_m * math.sin(direction)
            self._heading_rad += leg.turn_rad
            self._speed_mps = leg.end_speed_mps
            yield leg

    def _street(self) -> Iterator[Leg]:
        """Speed up and go on, perhaps round a double bend."""
        rng = self._rng
        speed_mps = float(rng.choice(_CRUISE_MPS))
        yield change_speed(self._speed_mps, speed_mps, rng.uniform(1.4, 2.2))
        yield cruise(rng.uniform(50.0, 250.0), speed_mps)
        speed_mps *= rng.uniform(0.8, 1.0)
        yield change_speed(self._speed_mps, speed_mps, 0.8)
        if rng.random() < 0.5:
            angle_rad = rng.choice((-1.0, 1.0)) * math.radians(rng.uniform(10.0, 30.0))
            radius_m = speed_mps**2 / _BEND_LATERAL_MPS2
            yield from turn(angle_rad, speed_mps, radius_m)
            yield cruise(rng.uniform(20.0, 100.0), speed_mps)
            yield from turn(-angle_rad, speed_mps, radius_m)
        yield cruise(rng.uniform(20.0, 150.0), speed_mps)

    def _junction(self) -> Iterator[Leg]:
        """Slow down or stop at the lights, then turn or go straight on."""
        rng = self._rng
        corner_mps = rng.uniform(4.5, 7.0)
        if rng.random() < 0.4:
            yield change_speed(self._speed_mps, 0.0, rng.uniform(1.5, 2.6))
            yield stand(rng.uniform(8.0, 40.0))
        yield change_speed(self._speed_mps, corner_mps, rng.uniform(1.4, 2.2))
        angle_rad = self._choose_turn()
        if angle_rad:
            yield from turn(angle_rad, corner_mps, corner_mps**2 / _CORNER_LATERAL_MPS2)

    def _choose_turn(self) -> float:
        choices = np.array([-_RIGHT_ANGLE_RAD, 0.0, _RIGHT_ANGLE_RAD])
        if math.hypot(self._north_m, self._east_m) < _HOME_RADIUS_M:
            angle_rad = float(self._rng.choice(choices, p=(0.4, 0.2, 0.4)))
        else:
            home_rad = math.atan2(-self._east_m, -self._north_m)
            off_course = np.cos(self._heading_rad + choices - home_rad)
            angle_rad = float(choices[np.argmax(off_course)])
        return angle_rad * self._rng.uniform(0.85, 1.1)

    def _tunnel(self) -> Iterator[Leg]:
        """Pass under a hidden sky for a minute: queue, long bend, and on."""
        rng = self._rng
        yield change_speed(self._speed_mps, _TUNNEL_MPS, 2.0)
        yield cruise(rng.uniform(50.0, 150.0), _TUNNEL_MPS)
        angle_rad = rng.choice((-1.0, 1.0)) * math.radians(rng.uniform(25.0, 50.0))
        hidden = [
            cruise(rng.uniform(150.0, 300.0), _TUNNEL_MPS, is_covered=True),
            change_speed(_TUNNEL_MPS, _QUEUE_MPS, 1.2, is_covered=True),
            *turn(angle_rad, _QUEUE_MPS, radius_m=250.0, ramp_s=3.0, is_covered=True),
            change_speed(_QUEUE_MPS, _TUNNEL_MPS, 1.2, is_covered=True),
        ]
        rest_s = _TUNNEL_S - sum(leg.duration_s for leg in hidden)
        yield from hidden
        yield cruise(rest_s * _TUNNEL_MPS, _TUNNEL_MPS, is_covered=True)
        yield cruise(rng.uniform(100.0, 200.0), _TUNNEL_MPS)
