"""A GPS receiver: late, correlated in its errors, blind in tunnels.

The fact that a newcomer gets wrong: sixty fixes of one minute are not sixty
independent measurements. Most of the error of a receiver hardly changes from one fix
to the next, and no averaging removes it.
"""

import math
from collections.abc import Iterable, Iterator
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from imu_tracker.geometry.geodesy import LocalFrame
from imu_tracker.geometry.rotation import from_euler, matrix
from imu_tracker.samples import Vec3
from imu_tracker.simulation.imu.noise import GaussMarkov
from imu_tracker.simulation.motion.paths import FloatArray
from imu_tracker.simulation.motion.positions import TICKS_PER_S, Whereabouts
from imu_tracker.simulation.motion.trajectory import Motion
from imu_tracker.simulation.receiver.sentences import (
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
    lever_arm_m: Vec3 = (0.0, 0.0, 0.0)  # from the chip to the antenna, vehicle axes

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
        self._slow = GaussMarkov(
            slow_rng, errors.slow_sigma_m * self._north_east_up, errors.slow_tau_s
        )
        self._velocity = GaussMarkov(
            velocity_rng,
            (errors.velocity_slow_sigma_mps,) * 2,
            errors.velocity_slow_tau_s,
        )
        self._last_hidden_s = -math.inf
        self._port_free_s = 0.0

    @property
    def _north_east_up(self) -> FloatArray:
        """How large errors of position are along each axis, relative to north."""
        return np.array([1.0, 1.0, self._errors.height_factor])

    def lines(self, ticks: Iterable[Whereabouts]) -> Iterator[Line]:
        """Yield the lines of all epochs in order of arrival."""
        first_tick = 0
        for motion, lat_rad, lon_rad, alt_m in ticks:
            epochs = slice(-first_tick % self._every_ticks, None, self._every_ticks)
            first_tick += len(motion.t_s)
            t_s = motion.t_s[epochs]
            if not len(t_s):
                continue
            has_fix = self._has_sky(motion)[epochs] & (t_s >= self._errors.fix_after_s)
            error_m, error_mps = self._draw_errors(t_s)
            if any(self._errors.lever_arm_m):
                away_m, away_mps = self._antenna(motion)
                error_m = error_m + away_m[epochs] * (1.0, 1.0, -1.0)
                error_mps = error_mps + away_mps[epochs, :2]
            for row in zip(
                t_s.tolist(),
                has_fix.tolist(),
                lat_rad[epochs].tolist(),
                lon_rad[epochs].tolist(),
                (alt_m[epochs] + error_m[:, 2]).tolist(),
                error_m[:, :2].tolist(),
                (motion.v_n[epochs, :2] + error_mps).tolist(),
                strict=True,
            ):
                yield from self._send(row[0], self._report(*row))

    def _has_sky(self, motion: Motion) -> NDArray[np.bool_]:
        """Whether satellites are in sight at each tick, and have been for a while."""
        hidden_s = np.where(motion.is_covered, motion.t_s, -np.inf)
        hidden_s[0] = max(hidden_s[0], self._last_hidden_s)
        hidden_s = np.maximum.accumulate(hidden_s)
        self._last_hidden_s = hidden_s[-1]
        return np.asarray(motion.t_s > hidden_s + self._errors.reacquire_s)

    def _antenna(self, motion: Motion) -> tuple[FloatArray, FloatArray]:
        """Place and velocity of the antenna against the chip, NED."""
        attitudes = [matrix(from_euler(*rpy)) for rpy in motion.rpy_rad.tolist()]
        away_m = np.array(attitudes) @ np.array(self._errors.lever_arm_m)
        if len(away_m) < 2:
            return away_m, np.zeros_like(away_m)
        return away_m, np.gradient(away_m, motion.t_s, axis=0)

    def _draw_errors(self, t_s: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Errors of position (north, east, up) and of velocity (north, east)."""
        errors = self._errors
        white = self._rng.standard_normal((len(t_s), 5))
        white_m = errors.white_sigma_m * self._north_east_up * white[:, :3]
        white_mps = errors.velocity_white_sigma_mps * white[:, 3:]
        return self._slow.at(t_s) + white_m, self._velocity.at(t_s) + white_mps

    def _report(
        self,
        t_s: float,
        has_fix: bool,
        lat_rad: float,
        lon_rad: float,
        alt_m: float,
        error_m: list[float],
        vel_ne_mps: list[float],
    ) -> Report:
        errors = self._errors
        if t_s < errors.time_after_s:
            return Report(None, None)
        utc_s = self._start_utc_s + t_s
        if not has_fix:
            return Report(utc_s, None)
        sigma_m = math.hypot(errors.slow_sigma_m, errors.white_sigma_m)
        north, east = vel_ne_mps
        solution = Solution(
            *LocalFrame.at(lat_rad, lon_rad).to_lat_lon(*error_m),
            alt_m,
            (north, east),
            sigma_m,
            sigma_m * errors.height_factor,
            errors.hdop,
        )
        return Report(utc_s, solution)

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
