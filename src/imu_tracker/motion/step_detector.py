"""Whether somebody walks: the force comes and goes as steps do.

Easily got wrong: strength alone is no evidence. Cobbles, propellers
and waves shake as much as a walker does, but faster or slower.
"""

import math
from typing import Final

from imu_tracker.motion.preintegration import ImuStep

STEPPING_MPS2: Final = 1.0
"""Scatter of the force of a walker, from a pocket to a hand: 1.5 to 5 m/s^2."""

PACES_HZ: Final = (0.8, 3.5)
"""From each second step of a stroller to every step of a sprinter."""

MEMORY_S: Final = 3.0
"""Five paces."""

_HYSTERESIS: Final = 0.5  # of the scatter: what rattles on top of a pace is none


class StepDetector:
    """Follows strength and frequency of the force's coming and going."""

    def __init__(self) -> None:
        self._mean_mps2, self._var = 9.81, 0.0
        self._is_high = False
        self._pace_hz = 0.0

    @property
    def is_stepping(self) -> bool:
        """Whether it looks like steps now."""
        slowest_hz, fastest_hz = PACES_HZ
        is_strong = self._var > STEPPING_MPS2**2
        return is_strong and slowest_hz < self._pace_hz < fastest_hz

    def add_step(self, step: ImuStep) -> None:
        """Take the mean force of a step of the filters."""
        if step.is_gap:
            return
        off_mps2 = math.hypot(*step.dv_b_mps) / step.dt_s - self._mean_mps2
        share = min(step.dt_s / MEMORY_S, 1.0)
        self._mean_mps2 += share * off_mps2
        self._var += share * (off_mps2 * off_mps2 - self._var)
        self._pace_hz -= share * self._pace_hz
        edge_mps2 = _HYSTERESIS * math.sqrt(self._var)
        if self._is_high:
            self._is_high = off_mps2 > -edge_mps2
        elif off_mps2 > edge_mps2:
            self._is_high = True
            self._pace_hz += 1.0 / MEMORY_S
