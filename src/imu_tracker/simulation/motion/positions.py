"""Where a trajectory gets to: velocity integrated on the WGS-84 ellipsoid.

Heights are above mean sea level and the ellipsoid is taken to lie there: the 43 m
between the two near Delft change a length by 7e-6.
"""

from collections.abc import Iterable, Iterator
from itertools import count
from typing import Final, NamedTuple

import numpy as np

from imu_tracker.geometry.geodesy import radii_m
from imu_tracker.samples import Vec3
from imu_tracker.simulation.motion.paths import FloatArray
from imu_tracker.simulation.motion.trajectory import Motion, Trajectory

TICKS_PER_S: Final = 20
"""Positions are known at these instants: a common grid of 1, 2, 4, 5 and 10 Hz."""

_TICKS_PER_CHUNK: Final = 10 * TICKS_PER_S

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(3)
"""Three points per tick: exact to 1e-9 m for anything that walks or drives."""


class Place(NamedTuple):
    """Start of a trajectory."""

    lat_rad: float
    lon_rad: float
    alt_m: float


class Whereabouts(NamedTuple):
    """A stretch of the ticks: the motion and the places, arrays of shape (n,)."""

    motion: Motion
    lat_rad: FloatArray
    lon_rad: FloatArray
    alt_m: FloatArray


def whereabouts(trajectory: Trajectory, start: Place) -> Iterator[Whereabouts]:
    """Yield all ticks from the start on, ten seconds at a time, without end.

    Notes
    -----
    lat' = v_N / (M + h), lon' = v_E / ((N + h) cos lat), h' = -v_D.
    Source: Groves 2013, equation 2.111.
    """
    place = start
    tick_s = 1.0 / TICKS_PER_S
    for chunk in count():
        ticks = chunk * _TICKS_PER_CHUNK + np.arange(_TICKS_PER_CHUNK + 1)
        t_s = ticks / TICKS_PER_S
        motion = trajectory.at(t_s[:-1])
        nodes_s = t_s[:-1, None] + 0.5 * tick_s * (1.0 + _NODES)
        v_n = trajectory.at(nodes_s.ravel()).v_n.reshape(-1, len(_NODES), 3)
        steps = 0.5 * tick_s * np.einsum("j,kji->ki", _WEIGHTS, v_n)

        moved = np.vstack([np.zeros(3), np.cumsum(steps, axis=0)])
        alt_m = place.alt_m - moved[:, 2]
        middle = len(ticks) // 2
        meridian_m, _ = radii_m(place.lat_rad)
        half_way = place.lat_rad + moved[middle, 0] / (meridian_m + place.alt_m)
        # Radii change by 3e-7 in a chunk: those of its middle serve all of it.
        meridian_m, prime_vertical_m = radii_m(half_way)
        lat_rad = place.lat_rad + moved[:, 0] / (meridian_m + alt_m[middle])
        mid_lat_rad = 0.5 * (lat_rad[1:] + lat_rad[:-1])
        east_m_per_rad = (prime_vertical_m + alt_m[middle]) * np.cos(mid_lat_rad)
        east_rad = np.cumsum(steps[:, 1] / east_m_per_rad)
        lon_rad = place.lon_rad + np.concatenate([[0.0], east_rad])

        yield Whereabouts(motion, lat_rad[:-1], lon_rad[:-1], alt_m[:-1])
        place = Place(float(lat_rad[-1]), float(lon_rad[-1]), float(alt_m[-1]))


def at_antenna(ticks: Iterable[Whereabouts], lever_m: Vec3) -> Iterator[Whereabouts]:
    """Yield where an antenna is and how it moves, `lever_m` (body axes) from the chip.

    Notes
    -----
    p_antenna = p + C_nb l; its velocity adds the time derivative of C_nb l.
    """
    x, y, z = lever_m
    for motion, lat_rad, lon_rad, alt_m in ticks:
        roll, pitch, yaw = motion.rpy_rad.T
        cr, sr, cp, sp = np.cos(roll), np.sin(roll), np.cos(pitch), np.sin(pitch)
        cy, sy = np.cos(yaw), np.sin(yaw)
        arm_n = np.column_stack(
            [
                cp * cy * x
                + (sr * sp * cy - cr * sy) * y
                + (cr * sp * cy + sr * sy) * z,
                cp * sy * x
                + (sr * sp * sy + cr * cy) * y
                + (cr * sp * sy - sr * cy) * z,
                -sp * x + sr * cp * y + cr * cp * z,
            ]
        )
        swing_n = np.gradient(arm_n, motion.t_s, axis=0)
        north_m, east_m = radii_m(float(lat_rad[len(lat_rad) // 2]))
        yield Whereabouts(
            motion._replace(v_n=motion.v_n + swing_n),
            lat_rad + arm_n[:, 0] / (north_m + alt_m),
            lon_rad + arm_n[:, 1] / ((east_m + alt_m) * np.cos(lat_rad)),
            alt_m - arm_n[:, 2],
        )
