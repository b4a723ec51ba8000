"""Where will it be: the way ahead, with a radius that grows honestly.

The body is taken to go on at its speed and to finish its turn. Easily got
wrong: after a few seconds the error is no longer the filter's but the driver's, who
may brake and turn. So the radius grows by what such bodies do.
"""

import math
from collections.abc import Iterable, Mapping
from typing import Final, NamedTuple

import numpy as np

from imu_tracker.estimation.estimate import R95_PER_SIGMA, Estimate
from imu_tracker.geometry.geodesy import LocalFrame
from imu_tracker.geometry.rotation import rotate
from imu_tracker.motion.preintegration import ImuStep
from imu_tracker.samples import Vec3

TURN_S: Final = 3.0
"""A turn goes on for so long, on average: a corner in town takes 3 to 6 s."""

SMOOTHING_S: Final = 0.5
"""Turn rates are means of so long: engines and steps shake the gyro."""

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(12)
"""For the way round a turn: exact to a millimetre in two full circles."""


class Habit(NamedTuple):
    """What bodies of a profile do of their own will, 95 % of them."""

    accel_mps2: float  # braking, setting off and turning, the next seconds
    speed_mps: float  # what the speed may become, beside the one that it has


HABITS: Final[Mapping[str, Habit]] = {
    "vehicle": Habit(2.2, 13.0),
    "walker": Habit(0.7, 1.0),
    "free": Habit(2.2, 13.0),
}
"""Found on simulated drives through a town and walks round a square, so that 95 % or
more are inside from 1 to 60 s. Two real drives: 96 to 100 %; a third, whose receiver
lags and smooths its course: 82 to 100 %."""


class Prediction(NamedTuple):
    """Where it will be, `after_s` after the newest sample."""

    after_s: float
    lat_rad: float
    lon_rad: float
    r95_m: float  # radius that holds the true horizontal position with 95 %


class Turning:
    """Mean angular rate of the last half second, body axes."""

    def __init__(self) -> None:
        self._rate_b: Vec3 = (0.0, 0.0, 0.0)

    def add_step(self, step: ImuStep, gyro_bias_radps: Vec3) -> None:
        """Take a step; nothing is known of a gap."""
        if step.is_gap:
            self._rate_b = (0.0, 0.0, 0.0)
            return
        dt = step.dt_s
        new = min(dt / SMOOTHING_S, 1.0)
        (x, y, z), (tx, ty, tz), (bx, by, bz) = (
            self._rate_b,
            step.dtheta_b_rad,
            gyro_bias_radps,
        )
        self._rate_b = (
            x + new * (tx / dt - bx - x),
            y + new * (ty / dt - by - y),
            z + new * (tz / dt - bz - z),
        )

    def about_down_radps(self, estimate: Estimate) -> float:
        """Rate of the heading, positive to the right."""
        return rotate(estimate.q_nb, self._rate_b)[2]


def predict(
    estimate: Estimate,
    speed_sigma_mps: float,
    turn_radps: float,
    profile: str,
    after_s: Iterable[float],
) -> list[Prediction]:
    """Carry an estimate ahead.

    Parameters
    ----------
    estimate : Estimate
    speed_sigma_mps : float
        Of the horizontal velocity, per axis.
    turn_radps : float
        Rate of the course, positive to the right.
    profile : str
        Whose habits; of "auto" those of "free".
    after_s : iterable of float
        How far ahead, 0 or more.

    Notes
    -----
    course(t) = course + w TURN_S (1 - exp(-t / TURN_S)), the speed stays.
    r95(t)^2 = r95^2 + (2.45 sigma_v t)^2 + m(t)^2, with m = a t^2 / 2 at first and
    (v + V) t in the end: m = a t^2 / 2 / (1 + t a / (2 (v + V))).
    """
    habit = HABITS.get(profile, HABITS["free"])
    here = LocalFrame.at(estimate.lat_rad, estimate.lon_rad)
    vn, ve, _ = estimate.v_n_mps
    speed = math.hypot(vn, ve)
    found = []
    for t in after_s:
        t_s = 0.5 * t * (1.0 + _NODES)
        turned = turn_radps * TURN_S * -np.expm1(-t_s / TURN_S)
        ahead = 0.5 * t * float(_WEIGHTS @ np.cos(turned))
        aside = 0.5 * t * float(_WEIGHTS @ np.sin(turned))
        lat_rad, lon_rad = here.to_lat_lon(
            vn * ahead - ve * aside, ve * ahead + vn * aside
        )
        free = 0.5 * habit.accel_mps2 * t * t
        most = (speed + habit.speed_mps) * t
        own = free / (1.0 + free / most) if t > 0.0 else 0.0
        r95_m = math.hypot(estimate.r95_m, R95_PER_SIGMA * speed_sigma_mps * t, own)
        found.append(Prediction(t, lat_rad, lon_rad, r95_m))
    return found
