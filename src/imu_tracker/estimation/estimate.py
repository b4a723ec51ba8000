"""What the tracker asks of an estimator, and what it gets.

Estimators do not handle arrival, latency or rows: they receive steps and fixes in the
order of the instants that these describe. `rewind` restores a snapshot of six-state
when a fix comes late; arrays in a snapshot are never changed in place, so that a
snapshot is a few references. Error-state needs no snapshots.
"""

import math
from typing import Final, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from imu_tracker.estimation.receiver.gate import FixOutcome
from imu_tracker.estimation.report import EstimatorReport
from imu_tracker.motion.preintegration import ImuStep
from imu_tracker.motion.standstill import Rest
from imu_tracker.samples import GpsFix, Quat, Vec3

R95_PER_SIGMA: Final = math.sqrt(-2.0 * math.log(0.05))
"""Radius of 95 % of a circular normal distribution, in standard deviations: 2.448."""


class Estimate(NamedTuple):
    """The antenna's position and the body's motion at the end of the last step."""

    lat_rad: float
    lon_rad: float
    alt_m: float | None
    v_n_mps: Vec3
    q_nb: Quat
    r95_m: float


class Estimator(Protocol):
    """A way from steps and fixes to a position with its uncertainty."""

    def start(self, lat_rad: float, lon_rad: float, sigma_m: float) -> None:
        """Begin at a place known to `sigma_m` per axis, at any speed."""

    def propagate(self, step: ImuStep, rest: Rest | None) -> None:
        """Move on by a step; `rest` when the body stands still."""

    def update(self, fix: GpsFix, ahead_s: float) -> FixOutcome:
        """Correct by a fix that describes the instant `ahead_s` after the last step.

        `ahead_s` is about half a step at most, of either sign.
        """

    def estimate(self) -> Estimate:
        """The estimate at the end of the last step."""

    def speed(self) -> tuple[float, float]:
        """Horizontal speed in m/s and its standard deviation."""

    def gyro_bias(self) -> tuple[Vec3, float]:
        """Gyro bias in rad/s, body axes, and its standard deviation per axis."""

    def snapshot(self) -> object:
        """All that changes with time, to return to."""

    def restore(self, saved: object) -> None:
        """Return to a snapshot of this estimator."""

    def report(self) -> EstimatorReport:
        """What was learnt, for people."""


def r95_of(cov_m2: NDArray[np.float64]) -> float:
    """Radius of the circle that holds 95 % of a horizontal normal distribution.

    Parameters
    ----------
    cov_m2 : ndarray, shape (2, 2), m^2

    Notes
    -----
    R95 = K(C) s1 with s1 >= s2 the principal standard deviations, C = s2 / s1;
    K grows from 1.96 (a line) to 2.45 (a circle). The cubic is true to 1 %.
    Source: Leick, Rapoport, Tatarnikov 2015, GPS Satellite Surveying, section 2.7.
    """
    (a, b), (_, c) = cov_m2.tolist()
    mean, spread = 0.5 * (a + c), math.hypot(0.5 * (a - c), b)
    largest = mean + spread
    if largest <= 0.0:
        return 0.0
    ratio = math.sqrt(max(mean - spread, 0.0) / largest)
    factor = 1.960790 + ratio * (0.004071 + ratio * (0.114276 + ratio * 0.371625))
    return factor * math.sqrt(largest)
