"""The circumference of the wheels and the strength of their lines, learnt with GPS.

Engine, alternator and road make lines too; those do not follow the speed, and what does
not follow it averages to 1. So it is known whether there is anything to hear.
"""

import math
from typing import Final, NamedTuple

import numpy as np

from imu_tracker.wheels.windows import CHANNELS, ORDERS, Array, Spectrum

CIRCUMFERENCES_M: Final = np.geomspace(1.6, 2.35, 193)
"""Of cars, in steps of 0.2 %: a small car's tyre to an off-roader's."""

LEARNING_S: Final = 180.0
"""How long a window counts: tyres warm up within ten minutes, by 0.5 %."""

LEAST_S: Final = 40.0
"""Of driving with GPS before anything is believed."""

HEARD: Final = 1.2
"""Power at the best circumference over that at the median one: 1.34 to 2.2 in four
cars in which wheels were heard, 1.07 on cobbles, 1.0 for noise."""


class Wheels(NamedTuple):
    """What was learnt."""

    circumference_m: float
    clarity: float  # of the best circumference over the median one
    strength: Array  # shape (orders, channels): mean power of a line over 1


class OrderLearner:
    """Mean power at each order of each circumference."""

    def __init__(self) -> None:
        self._sum = np.zeros((len(CIRCUMFERENCES_M), len(ORDERS), CHANNELS))
        self._weight = self.learnt_s = 0.0
        self._wheels: Wheels | None = None

    def learn(self, heard: Spectrum, speed_mps: float, period_s: float) -> None:
        """Take a window whose speed at the end is known."""
        kept = math.exp(-period_s / LEARNING_S)
        self._sum = kept * self._sum + heard.at(speed_mps / CIRCUMFERENCES_M)
        self._weight = kept * self._weight + 1.0
        self.learnt_s += period_s
        self._wheels = None

    @property
    def wheels(self) -> Wheels | None:
        """What is known by now; None: nothing is heard."""
        if self.learnt_s < LEAST_S:
            return None
        if self._wheels is None:
            self._wheels = self._decide()
        return self._wheels if self._wheels.clarity >= HEARD else None

    def _decide(self) -> Wheels:
        mean = self._sum / self._weight
        total = mean.sum(axis=(1, 2))
        best = int(np.argmax(total))
        strength = np.maximum(mean[best] - 1.0, 0.0)
        clarity = float(total[best] / np.median(total))
        return Wheels(float(CIRCUMFERENCES_M[best]), clarity, strength)
