"""A GPS receiver: late, correlated in its errors, blind in tunnels.

The fact that a newcomer gets wrong: sixty fixes of one minute are not sixty
independent measurements. Most of the error of a receiver hardly changes from one fix
to the next, and no averaging removes it.
"""

import math
from collections.abc import Iterator
from typing import Final, NamedTuple

import numpy as np

from imu_tracker.estimation.geodesy import LocalFrame
from imu_tracker.simulation.noise import GaussMarkov
from imu_tracker.simulation.paths import FloatArray
from imu_tracker.simulation.positions import TICKS_PER_S, Whereabouts
from imu_tracker.simulation.sentences import (
    Report,
    Resolution,
    Solution,
    gga,
    gst,
    rmc,
)

_BITS_PER_CHARACTER: Final = 10
_CR_LF: Final = 2
_LEAST_LATENCY_S: Final = 0.05


class ReceiverErrors(NamedTuple):
    """How good a receiver is; standard deviations are per axis.

    The defaults are a small patch antenna under a fairly open sky.
    """

    slow_sigma_m: float = 1.8  # atmosphere, orbits, slow multipath
    slow_tau_s: float = 60.0
    white_sigma_m: float = 0.5
    height_factor: float = 1.8  # vertical errors over horizontal ones
    velocity_slow_sigma_mps: float = 0.06
    velocity_slow_tau_s: float = 5.0
    velocity_white_sigma_mps: float = 0.04
    hdop: float = 0.9

    latency_s: float = 0.2  # from the instant described to the first byte
    latency_sigma_s: float = 0.02
    time_after_s: float = 3.0  # cold start: first the time,
    fix_after_s: float = 8.0  # then the place
    reacquire_s: float = 3.0  # after a tunnel

    baud: int = 9600
    sends_gst: bool = False
    resolution: Resolution = Resolution()


TYPICAL_RECEIVER: Final = ReceiverErrors()

IDEAL_RECEIVER: Final = ReceiverErrors(
    slow_sigma_m=0.0,
    white_sigma_m=0.0,
    velocity_slow_sigma_mps=0.0,
    velocity_white_sigma_mps=0.0,
    latency_sigma_s=0.0,
    time_after_s=0.0,
    fix_after_s=0.0,
    reacquire_s=0.0,
    resolution=Resolution(minute_decimals=8, knot_decimals=5, course_decimals=5),
)
"""No error but its latency, and blind in tunnels all the same."""


class Line(NamedTuple):
    """A line of the receiver, and when its first byte arrived."""

    t_s: float
    data: bytes


class Receiver:
    """Writes down where it believes to be, epoch after epoch.

    Parameters
    ----------
    errors : ReceiverErrors
        How good it is.
    rng : Generator
        Source of all its noise.
    every_s : float
        Time between epochs, a multiple of 0.05 s.
    start_utc_s : float
        UTC at time zero.
    """

    def __init__(
        self,
        errors: ReceiverErrors,
        rng: np.random.Generator,
        every_s: float,
        start_utc_s: float,
    ) -> None:
        self._every_ticks = round(every_s * TICKS_PER_S)
        if self._every_ticks < 1 or not math.isclose(
            self._every_ticks, every_s * TICKS_PER_S, rel_tol=1e-9
        ):
            raise ValueError(f"{every_s} s between fixes: must be a multiple of 0.05 s")
        self._errors, self._start_utc_s = errors, start_utc_s
        self._rng, slow_rng, velocity_rng = (rng, *rng.spawn(2))
        axes_m = (errors.slow_sigma_m,) * 2 + (
            errors.slow_sigma_m * errors.height_factor,
        )
        self._slow = GaussMarkov(slow_rng, axes_m, errors.slow_tau_s)
        axes_mps = (errors.velocity_slow_sigma_mps,) * 2
        self._velocity = GaussMarkov(velocity_rng, axes_mps, errors.velocity_slow_tau_s)
        self._has_sky_from_s = errors.fix_after_s
        self._port_free_s = 0.0

    def lines(self, ticks: Iterator[Whereabouts]) -> Iterator[Line]:
        """Yield the lines of all epochs in order of arrival."""
        first_tick = 0
        for stretch in ticks:
            t_s = stretch.motion.t_s
            skip = -first_tick % self._every_ticks
            epochs = range(skip, len(t_s), self._every_ticks)
            seen = 0
            for epoch in epochs:
                self._look_up(stretch, seen, epoch + 1)
                seen = epoch + 1
                yield from self._send(float(t_s[epoch]), self._report(stretch, epoch))
            self._look_up(stretch, seen, len(t_s))
            first_tick += len(t_s)

    def _look_up(self, stretch: Whereabouts, start: int, end: int) -> None:
        """Lose the satellites where the sky is hidden; they come back later."""
        hidden = stretch.motion.t_s[start:end][stretch.motion.is_covered[start:end]]
        if len(hidden):
            back_s = float(hidden[-1]) + 1.0 / TICKS_PER_S + self._errors.reacquire_s
            self._has_sky_from_s = max(self._has_sky_from_s, back_s)

    def _report(self, stretch: Whereabouts, i: int) -> Report:
        t_s = stretch.motion.t_s[i]
        # Drawn also when there is no fix: the errors of a fix do not depend on it.
        error_m, error_mps = self._draw_errors(stretch.motion.t_s[i : i + 1])
        utc_s = self._start_utc_s + float(t_s)
        if t_s < self._errors.time_after_s:
            return Report(None, None)
        if t_s < self._has_sky_from_s:
            return Report(utc_s, None)
        frame = LocalFrame.at(float(stretch.lat_rad[i]), float(stretch.lon_rad[i]))
        lat_rad, lon_rad = frame.to_lat_lon(float(error_m[0]), float(error_m[1]))
        north, east = (stretch.motion.v_n[i, :2] + error_mps).tolist()
        sigma_m = math.hypot(self._errors.slow_sigma_m, self._errors.white_sigma_m)
        solution = Solution(
            lat_rad,
            lon_rad,
            float(stretch.alt_m[i] + error_m[2]),
            (north, east),
            sigma_m,
            sigma_m * self._errors.height_factor,
            self._errors.hdop,
        )
        return Report(utc_s, solution)

    def _draw_errors(self, t_s: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Errors of position (north, east, up) and of velocity (north, east)."""
        errors = self._errors
        white = self._rng.standard_normal(5)
        position_m = self._slow.at(t_s)[0] + errors.white_sigma_m * white[:3] * (
            1.0,
            1.0,
            errors.height_factor,
        )
        velocity_mps = (
            self._velocity.at(t_s)[0] + errors.velocity_white_sigma_mps * white[3:]
        )
        return position_m, velocity_mps

    def _send(self, t_s: float, report: Report) -> Iterator[Line]:
        """Put the sentences of an epoch on the wire, one after the other."""
        errors = self._errors
        late_s = errors.latency_s + errors.latency_sigma_s * float(
            np.clip(self._rng.standard_normal(), -3.0, 3.0)
        )
        start_s = max(t_s + max(late_s, _LEAST_LATENCY_S), self._port_free_s)
        sentences = [rmc(report, errors.resolution), gga(report, errors.resolution)]
        if errors.sends_gst:
            sentences.append(gst(report))
        for data in sentences:
            yield Line(start_s, data)
            characters = len(data) + _CR_LF
            start_s += characters * _BITS_PER_CHARACTER / errors.baud
        self._port_free_s = start_s
