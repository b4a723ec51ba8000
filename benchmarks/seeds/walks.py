"""The thesis's experiments at their real size: 500 m of walking, five rounds of 200 m.

Its algorithm reads its tablet at 50 Hz, imu-tracker an uncalibrated MPU-6050 and a
receiver's sentences, through the whole program: it knows neither its heading nor its
biases when it sets out. Receiver errors are the thesis's R: white, 1 m per axis.
"""

import math
from collections.abc import Mapping
from typing import Final, NamedTuple

import numpy as np

from benchmarks.seeds import report_b, samples, thesis
from benchmarks.seeds.measure import Array, mean_distance_m
from imu_tracker.estimation.settings import TrackerSettings
from imu_tracker.geometry.geodesy import LocalFrame
from imu_tracker.pipeline import Pipeline
from imu_tracker.simulation import SCENARIOS, Scenario, simulate
from imu_tracker.simulation.motion.paths import Path, change_speed, cruise, stand
from imu_tracker.simulation.motion.trajectory import Gait, Ride
from imu_tracker.simulation.scenarios import (
    DELFT,
    END_STILL_S,
    START_STILL_S,
    THESIS_RECEIVER,
)

RATE_HZ: Final = 50.0
FIX_SIGMA_M: Final = 1.0
EVERY_S: Final = (1, 3, 5)
WARM_UP_S: Final = 30.0
"""20 s of it are the standstill before the walk; the first fix comes after 8 s."""

_WALK_MPS: Final = 1.4
_ROUNDS_M: Final = 5 * 200.0


def _walked_roundabout() -> Ride:
    curve = -2.0 * math.pi / 200.0
    begin = change_speed(0.0, _WALK_MPS, 0.8, curve)
    end = change_speed(_WALK_MPS, 0.0, 0.8, curve)
    rest_m = _ROUNDS_M - begin.length_m - end.length_m
    legs = (begin, cruise(rest_m, _WALK_MPS, curve), end)
    return Ride(Path((stand(START_STILL_S), *legs, stand(END_STILL_S))), gait=Gait())


COURSES: Final[Mapping[str, Scenario]] = {
    "straight line": SCENARIOS["walk-line"],
    "square": SCENARIOS["walk-square"],
    "roundabout, walked": Scenario(
        "walk five rounds of a roundabout of 200 m",
        "walker",
        math.ceil(START_STILL_S + _ROUNDS_M / _WALK_MPS + END_STILL_S) + 3.0,
        lambda _: _walked_roundabout(),
    ),
    "roundabout, driven": SCENARIOS["roundabout"],
}


class Walked(NamedTuple):
    """One walk by imu-tracker, from the end of the warm-up on."""

    t_s: Array  # since the start of the simulation, shape (n,)
    ne_m: Array  # shape (n, 2)
    truth_ne_m: Array
    r95_m: Array

    @property
    def error_m(self) -> Array:
        """Horizontal distance to the truth."""
        off_m = self.ne_m - self.truth_ne_m
        return np.hypot(off_m[:, 0], off_m[:, 1])


def by_imu_tracker(course: str, every_s: int, estimator: str, seed: int) -> Walked:
    """Walk with an MPU-6050, a receiver and the whole program."""
    simulated = simulate(
        COURSES[course], seed=seed, gps_every_s=every_s, receiver=THESIS_RECEIVER
    )
    pipeline = Pipeline(
        simulated.header,
        TrackerSettings(
            profile=simulated.header.profile or "free",
            estimator=estimator,
            latency_s=None if estimator == "error-state" else 0.2,
        ),
    )
    rows = [row for frame in simulated.frames for row in pipeline.feed(frame)]
    told = {round(row.utc_s * 1000): row for row in rows}
    here = LocalFrame.at(DELFT.lat_rad, DELFT.lon_rad)
    begin_s = simulated.header.start_utc_s or 0.0
    found = [
        (
            true.utc_s - begin_s,
            *here.to_ne(row.lat_rad, row.lon_rad),
            *here.to_ne(true.lat_rad, true.lon_rad),
            row.r95_m,
        )
        for true in simulated.truth
        if (row := told.get(round(true.utc_s * 1000))) is not None
        and true.utc_s - begin_s >= WARM_UP_S
    ]
    columns = np.array(found)
    return Walked(columns[:, 0], columns[:, 1:3], columns[:, 3:5], columns[:, 5])


def by_tablet(course: str, n_seeds: int) -> samples.Samples:
    """Walk with the thesis's tablet, so many times."""
    plan = COURSES[course]
    end_s = plan.duration_s - END_STILL_S
    trajectory = plan.trajectory(np.random.default_rng(0))
    return samples.walk(trajectory, START_STILL_S, end_s, n_seeds, RATE_HZ)


def by_the_thesis(
    walked: samples.Samples, every_s: int, R: float
) -> tuple[thesis.Track, Array]:
    """Run the thesis's algorithm; return its track, and the fixes that it got."""
    step = round(every_s * RATE_HZ)
    fix_at = np.arange(step, len(walked.ne_m), step, dtype=np.intp)
    fixes = samples.fixes(walked, FIX_SIGMA_M)
    return thesis.run(walked, fixes, fix_at, R), fixes[:, fix_at]


def against_gps_m(track: thesis.Track, fixes: Array) -> float:
    """Average error against GPS just after each fix, as the thesis prints it."""
    return mean_distance_m(track.at_fixes_ne_m, fixes)


def by_the_report(walked: samples.Samples) -> float:
    """Mean distance of the report's filter; it knows no fixes."""
    at, ne_m = report_b.run(walked, 0)
    return mean_distance_m(ne_m, walked.ne_m[at])
