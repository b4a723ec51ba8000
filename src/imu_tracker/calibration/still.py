"""When did the chip lie still? Seen afterwards, from whole recordings.

`estimation.standstill` decides the same while it happens, and learns a vehicle; here
limits are fixed, so that a hand that holds the box is told from a table. What a
newcomer gets wrong: an engine may idle. Where a receiver says that the vehicle stands,
more vibration is let pass; where it says that it moves, no stillness is believed.
"""

import math
from collections.abc import Iterable, Sequence
from typing import Final, NamedTuple

import numpy as np

from imu_tracker.calibration.readings import WINDOW_S, Array, Window

QUIET_GYRO_RADPS: Final = math.radians(0.7)
QUIET_ACCEL_MPS2: Final = 0.2
"""Standard deviation over a second of a chip that lies on a table. Its own noise is
0.1 deg/s and 0.08 m/s^2 at the most (PS-MPU-6000A sections 6.1, 6.2, at 256 Hz);
twice that for a poor one. A hand shakes by 1 deg/s and more."""

STANDING_GYRO_RADPS: Final = math.radians(4.0)
STANDING_ACCEL_MPS2: Final = 0.3
"""The same where a receiver says that the vehicle stands: an idling engine."""

STEADY_GYRO_RADPS: Final = math.radians(0.6)
STEADY_ACCEL_MPS2: Final = 0.12
"""How far the means of two seconds may lie apart: 0.7 deg of tilt."""

STANDING_MPS: Final = 0.3
MOVING_MPS: Final = 1.0
NEAR_S: Final = 2.0
"""What a receiver says of a speed holds for so long around."""

SHORTEST_S: Final = 5.0


class Stretch(NamedTuple):
    """Samples from `start` to before `stop`, during all of which nothing moved."""

    start: int
    stop: int
    windows: tuple[Window, ...]

    @property
    def length_s(self) -> float:
        """How long, to the second."""
        return WINDOW_S * len(self.windows)


def is_quiet(window: Window) -> bool:
    """Tell whether a chip lies on something firm."""
    return _is_below(window, QUIET_GYRO_RADPS, QUIET_ACCEL_MPS2)


def is_steady(window: Window, before: Window) -> bool:
    """Tell whether two seconds look alike: no turn and no other pose between them."""
    turned = np.abs(window.gyro_radps - before.gyro_radps).max()
    tilted = np.abs(window.accel_mps2 - before.accel_mps2).max()
    return bool(turned <= STEADY_GYRO_RADPS and tilted <= STEADY_ACCEL_MPS2)


def still_stretches(
    windows: Iterable[Window],
    speeds: Sequence[tuple[float, float]] = (),
    shortest_s: float = SHORTEST_S,
) -> list[Stretch]:
    """Find where nothing moved, in order.

    Parameters
    ----------
    windows : iterable of Window
        Seconds of readings.
    speeds : sequence of (t_s, mps)
        What a receiver said of the speed, if there is one.
    shortest_s : float
        Shorter stretches are left out.
    """
    times, values = np.array(speeds).reshape(-1, 2).T
    found: list[Stretch] = []
    run: list[Window] = []
    for window in windows:
        follows = bool(run) and window.start == run[-1].stop
        if follows and not (is_steady(window, run[-1]) and is_steady(window, run[0])):
            follows = False
        if run and not follows:
            _keep(run, found, shortest_s)
            run = []
        if _is_still(window, _near(window, times, values)):
            run.append(window)
        elif run:
            _keep(run, found, shortest_s)
            run = []
    if run:
        _keep(run, found, shortest_s)
    return found


def _keep(run: Sequence[Window], found: list[Stretch], shortest_s: float) -> None:
    if len(run) * WINDOW_S >= shortest_s:
        found.append(Stretch(run[0].start, run[-1].stop, tuple(run)))


def _is_below(window: Window, gyro_radps: float, accel_mps2: float) -> bool:
    return bool(
        window.gyro_std_radps.max() < gyro_radps
        and window.accel_std_mps2.max() < accel_mps2
    )


def _is_still(window: Window, speeds_mps: Array) -> bool:
    if not len(speeds_mps):
        return is_quiet(window)
    if speeds_mps.max() > MOVING_MPS:
        return False
    is_standing = speeds_mps.max() < STANDING_MPS
    return is_quiet(window) or (
        is_standing and _is_below(window, STANDING_GYRO_RADPS, STANDING_ACCEL_MPS2)
    )


def _near(window: Window, times_s: Array, speeds_mps: Array) -> Array:
    first, last = np.searchsorted(
        times_s, [window.t_s - NEAR_S, window.t_s + WINDOW_S + NEAR_S]
    )
    near: Array = speeds_mps[first:last]
    return near
