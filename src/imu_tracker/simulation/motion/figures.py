"""Figures of unit size that a body slides along without turning.

The bachelor thesis that this program starts from tries its algorithm on a square, a
circle and a Lissajous figure of a thousand points, travelled in 2 pi seconds by a
tablet that points the same way all the time. Here a figure is a curve, and a `Path`
says how far along it the body is: so speed and acceleration have no jumps, and the
body begins and ends at rest. What a newcomer gets wrong: nothing can go round a sharp
corner but by stopping in it, so that on the square each side is from rest to rest.
"""

import math
from collections.abc import Callable
from typing import Final, NamedTuple, TypeAlias

import numpy as np

from imu_tracker.simulation.motion.paths import (
    BLEND_PEAK,
    FloatArray,
    Leg,
    Path,
    change_speed,
    cruise,
    stand,
)
from imu_tracker.simulation.motion.trajectory import Motion

ROUND_S: Final = 2.0 * math.pi
"""Time of one round, and the period of the curves: (cos t, sin t) in seconds."""

POINTS: Final = 1000
"""Samples of one round."""

RATE_HZ: Final = POINTS / ROUND_S

RUN_UP_S: Final = 2.0
"""For speeding up before the round, and for slowing down after it."""

_SIDE_S: Final = ROUND_S / 4.0


class Place(NamedTuple):
    """A curve at some phases: north and east with two derivatives, shape (n, 2)."""

    ne_m: FloatArray
    rate: FloatArray
    bend: FloatArray


Curve: TypeAlias = Callable[[FloatArray], Place]


def circle(phase: FloatArray) -> Place:
    """Unit circle, phase in radians."""
    ne_m = np.column_stack([np.cos(phase), np.sin(phase)])
    return Place(ne_m, np.column_stack([-ne_m[:, 1], ne_m[:, 0]]), -ne_m)


def lissajous(phase: FloatArray) -> Place:
    """(cos 3t, sin 2t)."""
    cos_3, sin_3 = np.cos(3.0 * phase), np.sin(3.0 * phase)
    cos_2, sin_2 = np.cos(2.0 * phase), np.sin(2.0 * phase)
    return Place(
        np.column_stack([cos_3, sin_2]),
        np.column_stack([-3.0 * sin_3, 2.0 * cos_2]),
        np.column_stack([-9.0 * cos_3, -4.0 * sin_2]),
    )


def square(phase: FloatArray) -> Place:
    """Unit square, phase in sides from the first corner on."""
    corners = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0], [0.0, 0.0]])
    side = np.clip(phase.astype(int), 0, 3)
    along = np.diff(corners, axis=0)[side]
    ne_m = corners[side] + (phase - side)[:, None] * along
    return Place(ne_m, along, np.zeros_like(along))


class Figure:
    """A body that slides along a curve and always points north; a `Trajectory`.

    Parameters
    ----------
    curve : Curve
    path : Path
        How far along it the body is: its distance is the phase, but for
        `start_phase`.
    start_phase : float
        Where it stands at the beginning.
    """

    def __init__(self, curve: Curve, path: Path, start_phase: float = 0.0) -> None:
        self._curve, self._path, self._start_phase = curve, path, start_phase

    def at(self, t_s: FloatArray) -> Motion:
        """Evaluate at growing instants; calls may go back by at most a minute."""
        k = self._path.at(t_s)
        _, rate, bend = self._curve(self._start_phase + k.distance_m)
        speed, accel = k.speed_mps[:, None], k.accel_mps2[:, None]
        level = np.zeros((len(t_s), 3))
        v_n, a_n = level.copy(), level.copy()
        v_n[:, :2] = rate * speed
        a_n[:, :2] = bend * speed**2 + rate * accel
        return Motion(k.t_s, v_n, a_n, level.copy(), level, k.is_covered)

    def ne_m(self, t_s: FloatArray) -> FloatArray:
        """North and east on the curve itself, shape (n, 2)."""
        return self._curve(self._start_phase + self._path.at(t_s).distance_m).ne_m


def going_round(curve: Curve, still_s: float) -> Figure:
    """Go once round a closed curve at one radian a second, with a run-up and -out."""
    legs = (
        stand(still_s),
        change_speed(0.0, 1.0, BLEND_PEAK / RUN_UP_S),
        cruise(ROUND_S, 1.0),
        change_speed(1.0, 0.0, BLEND_PEAK / RUN_UP_S),
    )
    return Figure(curve, Path(legs), start_phase=-0.5 * RUN_UP_S)


def side_by_side(still_s: float) -> Figure:
    """Go round the square, each side from rest to rest."""
    half_s = 0.5 * _SIDE_S
    peak = 1.0 / half_s  # sides per second amid a side: the mean is half of it
    side = (Leg(half_s, 0.0, peak), Leg(half_s, peak, 0.0))
    return Figure(square, Path((stand(still_s), *side * 4)))
