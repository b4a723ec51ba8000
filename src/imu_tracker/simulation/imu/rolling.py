"""What a car's own turning parts shake a box with: wheels, engine, and the surface.

Strengths are those of lines in recordings of real cars: the first order of a wheel
stands 1 to 3 times above the road's noise within a quarter of a hertz, the second and
third less, and every axis differently. The fact that a newcomer gets wrong: an engine
in gear follows the speed as well, until the gear changes.
"""

import math
from typing import Final, NamedTuple

import numpy as np

from imu_tracker.simulation.motion.paths import FloatArray

ORDER_SHARES: Final = (0.4, 0.2, 0.12, 0.08)
"""Amplitude of a wheel's orders 1 to 4 over the road's shaking, before it is drawn."""

CARS_SPREAD: Final = 0.35
AXES_SPREAD: Final = 0.5
"""Of the logarithm of an amplitude, from car to car and from axis to axis."""

WARM_SHARE: Final = 0.004
WARM_S: Final = 300.0
"""A tyre is so much larger when it is warm, after some minutes."""

HALF_TRACK_M: Final = 0.75

GEARS: Final = ((4.0, 0.16), (8.0, 0.29), (12.0, 0.43), (17.0, 0.58), (math.inf, 0.75))
"""Up to a speed in m/s: metres per turn of the engine, which shakes at that rate and at
half of it."""
IDLE_HZ: Final = 13.0
ENGINE_SHARE: Final = 0.4  # of what the box is shaken with while the engine idles

BODY_HZ: Final = (12.0, 3.5)
PASSED_SHARE: Final = 0.03
"""A body resonates about 12 Hz, and passes the lines on as it does the road's noise;
beyond, next to nothing."""

NO_LINES_SHARE: Final = 0.1
STRETCH_M: Final = (200.0, 900.0)
SURFACE_SPREAD: Final = 0.2
"""A road's surface changes after so far; some have no lines of the wheels, as cobbles;
the logarithm of their noise differs by so much."""


class _Surface(NamedTuple):
    end_m: float
    noise: float
    lines: float  # 0: none


class Rolling:
    """Shaking by the parts that turn, stretch after stretch.

    Parameters
    ----------
    rng : Generator
        Its own: nobody else may draw from it.
    rate_hz : float
        Nominal sample rate: nothing is made above its half.
    """

    def __init__(self, rng: np.random.Generator, rate_hz: float) -> None:
        self._rng, self._nyquist_hz = rng, 0.5 * rate_hz
        self._circumference_m = float(rng.uniform(1.75, 2.2))
        n_orders = len(ORDER_SHARES)
        drawn = np.exp(AXES_SPREAD * rng.standard_normal((n_orders, 6)))
        drawn *= math.exp(CARS_SPREAD * float(rng.standard_normal()))
        self._shares = np.array(ORDER_SHARES)[:, None] * drawn
        self._phases = rng.uniform(0.0, 2.0 * math.pi, (2, n_orders, 6))
        self._engine_phases = rng.uniform(0.0, 2.0 * math.pi, (2, 6))
        self._turns = np.zeros(2)  # of the left and the right wheels
        self._engine_turns = self._way_m = 0.0
        self._last_s = 0.0
        self._surface = _Surface(0.0, 1.0, 1.0)

    @property
    def circumference_m(self) -> float:
        """Of the cold wheels."""
        return self._circumference_m

    def at(
        self, t_s: FloatArray, speed_mps: FloatArray, yaw_radps: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Shaking at growing instants.

        Returns
        -------
        wheels : ndarray, shape (n, 6)
            In units of the road's shaking at that speed.
        engine : ndarray, shape (n, 6)
            In units of the shaking while the engine idles.
        noise : ndarray, shape (n, 1)
            Factor of the road's noise.
        """
        dt_s = np.diff(t_s, prepend=self._last_s)
        self._last_s = float(t_s[-1])
        way_m = self._way_m + np.cumsum(speed_mps * dt_s)
        self._way_m = float(way_m[-1])
        noise, lines = self._surfaces(way_m)
        wheels = lines * self._wheels(t_s, dt_s, speed_mps, yaw_radps)
        return wheels, self._engine(dt_s, speed_mps), noise

    def _wheels(
        self,
        t_s: FloatArray,
        dt_s: FloatArray,
        speed_mps: FloatArray,
        yaw_radps: FloatArray,
    ) -> FloatArray:
        """Lines of both sides, that turn at rates of their own in a bend."""
        warm = 1.0 + WARM_SHARE * (1.0 - np.exp(-t_s / WARM_S))
        total = np.zeros((len(t_s), 6))
        for i, side in enumerate((1.0, -1.0)):
            over_mps = speed_mps + side * HALF_TRACK_M * yaw_radps
            rate_hz = over_mps / (self._circumference_m * warm)
            turns = self._turns[i] + np.cumsum(rate_hz * dt_s)
            self._turns[i] = turns[-1] % 1.0
            for k, shares in enumerate(self._shares):
                order = k + 1
                angle = 2.0 * math.pi * order * turns[:, None]
                gain = self._gain(order * rate_hz)[:, None]
                total += 0.5 * gain * shares * np.cos(angle + self._phases[i, k])
        return total

    def _gain(self, f_hz: FloatArray) -> FloatArray:
        """How the body passes a frequency on; nothing near Nyquist's."""
        centre_hz, width_hz = BODY_HZ
        gain = np.exp(-0.5 * ((f_hz - centre_hz) / width_hz) ** 2) + PASSED_SHARE
        return np.where(np.abs(f_hz) < 0.9 * self._nyquist_hz, gain, 0.0)

    def _engine(self, dt_s: FloatArray, speed_mps: FloatArray) -> FloatArray:
        limits_mps, metres = np.array(GEARS).T
        gear = np.searchsorted(limits_mps, speed_mps)
        rate_hz = np.maximum(speed_mps / metres[gear], IDLE_HZ)
        turns = self._engine_turns + np.cumsum(rate_hz * dt_s)
        self._engine_turns = float(turns[-1] % 2.0)
        total = np.zeros((len(dt_s), 6))
        for order, phases in zip((0.5, 1.0), self._engine_phases, strict=True):
            passes = order * rate_hz < 0.9 * self._nyquist_hz
            angle = 2.0 * math.pi * order * turns[:, None] + phases
            total += ENGINE_SHARE * passes[:, None] * np.cos(angle)
        return total

    def _surfaces(self, way_m: FloatArray) -> tuple[FloatArray, FloatArray]:
        noise, lines = np.empty((len(way_m), 1)), np.empty((len(way_m), 1))
        begin = 0
        while begin < len(way_m):
            if way_m[begin] >= self._surface.end_m:
                self._surface = _Surface(
                    self._surface.end_m + float(self._rng.uniform(*STRETCH_M)),
                    math.exp(SURFACE_SPREAD * float(self._rng.standard_normal())),
                    float(self._rng.random() >= NO_LINES_SHARE),
                )
                continue
            end = int(np.searchsorted(way_m, self._surface.end_m))
            noise[begin:end], lines[begin:end] = self._surface[1:]
            begin = end
        return noise, lines
