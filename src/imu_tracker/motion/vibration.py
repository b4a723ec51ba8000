"""How much a vehicle shakes at rest and in motion, and what separates the two.

The noise of an engine that idles, and that of a smooth road, differ by ten between one
vehicle and the next. Easily got wrong: what must be separated from
rest is not the mean of all roads, but the slowest and smoothest there is.
"""

import math
from typing import Final, TypeAlias

START_GYRO_STD_RADPS: Final = math.radians(0.6)
START_ACCEL_STD_MPS2: Final = 0.15
"""Vibration below which an unknown vehicle stands. The chip's own noise at 42 Hz is
0.05 deg/s and 0.03 m/s^2 (PS-MPU-6000A sections 6.1, 6.2); consumer chips at
100 Hz show up to three times that; smooth asphalt shakes more."""

LEARNING_SHARE: Final = 0.05
"""What a fix adds to a level: some twenty fixes distinguish vehicles."""

QUIETER_SHARE: Final = 0.3
LOUDER_SHARE: Final = 0.01
"""The same where it moves more quietly, or louder, than it did: what must be separated
from rest is the slow and smooth, not the mean of all roads."""

FLOOR_FACTOR: Final = 0.25
CEILING_FACTOR: Final = 2.5
"""How far learning may move a threshold from its start value."""

_LOG_WAVERING: Final = math.log(1.25)
"""A level at rest wavers by so much. An idling engine may shake more than a smooth
road: a sensor that does not separate the two must not forbid rest; the other one
separates them."""

Levels: TypeAlias = tuple[tuple[bool, float, float], ...]
"""Vibration of gyro (rad/s) and accelerometer (m/s^2), moving (True) and at rest."""


class Vibration:
    """Learns the levels of vibration, and the thresholds between them.

    Attributes
    ----------
    gyro_threshold_radps, accel_threshold_mps2 : float
        Standard deviation of a second, all axes together, above which it moves.

    Notes
    -----
    Levels are kept for rest and for the quietest motion; the threshold lies at their
    geometric mean, within a factor of the start value.
    """

    def __init__(self) -> None:
        self._log_levels: dict[bool, tuple[float, float]] = {}
        self.gyro_threshold_radps = START_GYRO_STD_RADPS
        self.accel_threshold_mps2 = START_ACCEL_STD_MPS2

    def learn(
        self, gyro_std_radps: float, accel_std_mps2: float, *, is_moving: bool
    ) -> None:
        """Take the vibration of a second that was surely of rest, or of motion."""
        now = (
            math.log(max(gyro_std_radps, 1e-6)),
            math.log(max(accel_std_mps2, 1e-6)),
        )
        old = self._log_levels.get(is_moving, now)
        gyro, accel = (
            b + _share(is_quieter=a < b, is_moving=is_moving) * (a - b)
            for a, b in zip(now, old, strict=True)
        )
        self._log_levels[is_moving] = gyro, accel
        self._set_thresholds()

    @property
    def levels(self) -> Levels:
        """What was learnt of this vehicle's vibration."""
        return tuple(
            (is_moving, math.exp(gyro), math.exp(accel))
            for is_moving, (gyro, accel) in self._log_levels.items()
        )

    def load_prior(self, levels: Levels) -> None:
        """Begin with what an earlier run learnt; twenty fixes overrule it."""
        self._log_levels = {
            is_moving: (math.log(gyro), math.log(accel))
            for is_moving, gyro, accel in levels
        }
        self._set_thresholds()

    def _set_thresholds(self) -> None:
        """Put them between rest and motion, once both are known."""
        if len(self._log_levels) == 2:
            gyro, accel = (
                math.exp(max(0.5 * (rest + moving), rest + _LOG_WAVERING))
                for rest, moving in zip(
                    self._log_levels[False], self._log_levels[True], strict=True
                )
            )
            self.gyro_threshold_radps = _limit(gyro, START_GYRO_STD_RADPS)
            self.accel_threshold_mps2 = _limit(accel, START_ACCEL_STD_MPS2)

    def exceeds(
        self, gyro_std_radps: float, accel_std_mps2: float, factor: float = 1.0
    ) -> bool:
        """Whether it shakes more than a body at rest does, `factor` times."""
        return (
            gyro_std_radps > self.gyro_threshold_radps * factor
            or accel_std_mps2 > self.accel_threshold_mps2 * factor
        )


def _share(*, is_moving: bool, is_quieter: bool) -> float:
    if not is_moving:
        return LEARNING_SHARE
    return QUIETER_SHARE if is_quieter else LOUDER_SHARE


def _limit(value: float, start: float) -> float:
    return min(max(value, FLOOR_FACTOR * start), CEILING_FACTOR * start)
