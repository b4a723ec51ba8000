"""The circumference of the wheels and the strength of their lines, learnt with GPS.

Engine, alternator and road make lines too; those do not follow the speed, and what does
not follow it averages to 1. So it is known whether the wheels make lines at all.
"""

import math
from typing import Final, NamedTuple

import numpy as np

from imu_tracker.wheels.windows import CHANNELS, ORDERS, Array, Spectrum

CIRCUMFERENCES_M: Final = np.geomspace(1.6, 2.35, 193)
"""Of cars, in steps of 0.2 %: a small car's tyre to an off-roader's."""

LEARNING_S: Final = 180.0
"""How long a window counts: load, road and the place of the box stay for minutes."""

LEAST_S: Final = 40.0
"""Of driving with GPS before anything is believed."""

ALIKE_POWERS: Final = 2.5
CLEAR_SIGMAS: Final = 5.0
"""The best circumference must stand out by so many standard deviations of noise. One
power has the variance 1, and windows that overlap and channels that are alike make so
many of them one: 1.4 after 40 s, 1.2 in the long run. Five cars in which lines were
found have 1.3 to 1.9, cobbles 1.09."""


N_STRENGTHS: Final = len(ORDERS) * CHANNELS


class Wheels(NamedTuple):
    """What was learnt."""

    circumference_m: float
    clarity: float  # mean power at this circumference over that at the median one
    strength: Array  # shape (orders, channels): mean power of a line over 1


class KeptWheels(NamedTuple):
    """What outlasts a run."""

    circumference_m: float
    circumference_sigma_m: float
    strength: tuple[float, ...]  # orders by channels


class OrderLearner:
    """Mean power at each order of each circumference.

    Attributes
    ----------
    prior : Wheels or None
        Of an earlier run: taken until these ones stand out, or have had their time.
    """

    def __init__(self) -> None:
        self._sum = np.zeros((len(CIRCUMFERENCES_M), len(ORDERS), CHANNELS))
        self._weight = self.learnt_s = 0.0
        self.prior: Wheels | None = None
        self._best: Wheels | None = None

    def learn(self, found: Spectrum, speed_mps: float, period_s: float) -> None:
        """Take a window whose speed at the end is known."""
        kept = math.exp(-period_s / LEARNING_S)
        self._sum = kept * self._sum + found.at(speed_mps / CIRCUMFERENCES_M)
        self._weight = kept * self._weight + 1.0
        self.learnt_s += period_s
        self._best = None

    @property
    def wheels(self) -> Wheels | None:
        """What is known by now; None: no lines stand out."""
        best = self.best
        if best is not None and best.clarity >= self.needed_clarity:
            return best
        return self.prior if self.learnt_s < LEARNING_S else None

    @property
    def needed_clarity(self) -> float:
        """From where on the best circumference is not one of noise."""
        n_powers = len(ORDERS) * CHANNELS * max(self._weight, 1.0)
        return 1.0 + CLEAR_SIGMAS * math.sqrt(ALIKE_POWERS / n_powers)

    @property
    def best(self) -> Wheels | None:
        """The best circumference, clear or not; None: too little was learnt."""
        if self.learnt_s < LEAST_S:
            return None
        if self._best is None:
            self._best = self._at(int(np.argmax(self._total())))
        return self._best

    def at(self, circumference_m: float) -> Wheels:
        """What was learnt of another circumference."""
        apart = np.abs(CIRCUMFERENCES_M - circumference_m)
        return self._at(int(np.argmin(apart)))

    def _total(self) -> Array:
        total: Array = self._sum.sum(axis=(1, 2)) / max(self._weight, 1e-9)
        return total

    def _at(self, index: int) -> Wheels:
        total = self._total()
        strength = np.maximum(self._sum[index] / max(self._weight, 1e-9) - 1.0, 0.0)
        clarity = float(total[index] / max(float(np.median(total)), 1e-9))
        return Wheels(float(CIRCUMFERENCES_M[index]), clarity, strength)


def loaded(kept: KeptWheels) -> Wheels:
    """Take an earlier run's wheels for found, and no clearer than that needs."""
    strength = np.array(kept.strength).reshape(len(ORDERS), CHANNELS)
    return Wheels(kept.circumference_m, 1.0 + float(strength.mean()), strength)
