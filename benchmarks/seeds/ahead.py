"""Where will it be: imu-tracker's prediction beside the report's polynomial.

The report puts a polynomial of second degree through the samples and evaluates it
ahead. It gets the rows of imu-tracker's own log here, those of the last five or ten
seconds: its own would be far off before anything was predicted.
"""

import math
from collections import deque
from collections.abc import Mapping
from typing import Final, NamedTuple, TypeAlias

import numpy as np

from benchmarks.seeds.measure import Array
from imu_tracker.estimation.settings import TrackerSettings
from imu_tracker.geometry.geodesy import LocalFrame
from imu_tracker.pipeline import Pipeline
from imu_tracker.samples import NavState
from imu_tracker.simulation import simulate
from imu_tracker.simulation.scenarios import DELFT

COURSES: Final = {"drive": "vehicle", "walk-square": "walker"}
"""Scenarios and their profiles."""

AFTER_S: Final = (1.0, 2.0, 5.0, 10.0, 30.0, 60.0)
LOOK_EVERY_S: Final = 2.0
WARM_UP_S: Final = 40.0
ROWS_HZ: Final = 4
POLYNOMIALS_S: Final = (5, 10)


Row: TypeAlias = tuple[float, ...]
"""Seconds, north, east."""


class Look(NamedTuple):
    """One prediction against the truth."""

    after_s: float
    error_m: float
    r95_m: float
    short_m: float  # error of the polynomial through 5 s
    long_m: float  # through 10 s


class Summary(NamedTuple):
    """Texts for the table."""

    error: str
    promise: str
    short: str
    long: str


def look(course: str, seed: int) -> Array:
    """Predict every two seconds; rows are those of `Look`."""
    simulated = simulate(course, seed=seed)
    header = simulated.header
    start_utc_s = header.start_utc_s or 0.0
    here = LocalFrame.at(DELFT.lat_rad, DELFT.lon_rad)
    truth = np.array(
        [
            (row.utc_s - start_utc_s, *here.to_ne(row.lat_rad, row.lon_rad))
            for row in simulated.truth
        ]
    )
    settings = TrackerSettings(
        estimator="error-state", profile=COURSES[course], latency_s=None
    )
    pipeline = Pipeline(header, settings)
    recent: deque[Row] = deque(maxlen=POLYNOMIALS_S[-1] * ROWS_HZ + 1)
    looks: list[Look] = []
    due_s = WARM_UP_S
    for frame in simulated.frames:
        for row in pipeline.feed(frame):
            recent.append(_row(row, here, start_utc_s))
            now_s = recent[-1][0] + (frame.t_ns - row.t_ns) * 1e-9
        if recent and recent[-1][0] >= due_s and len(recent) == recent.maxlen:
            due_s = recent[-1][0] + LOOK_EVERY_S
            polynomials = [_polynomial(recent, s) for s in POLYNOMIALS_S]
            for told in pipeline.predict(AFTER_S):
                then_s = now_s + told.after_s
                if then_s > truth[-1, 0]:
                    break
                there = [np.interp(then_s, truth[:, 0], truth[:, i]) for i in (1, 2)]
                told_ne = here.to_ne(told.lat_rad, told.lon_rad)
                looks.append(
                    Look(
                        told.after_s,
                        math.dist(told_ne, there),
                        told.r95_m,
                        *(math.dist(_at(p, then_s), there) for p in polynomials),
                    )
                )
    return np.array(looks)


def summarise(looks: Array) -> Mapping[float, Summary]:
    """Condense looks to texts, by how far ahead."""
    found = {}
    for after_s in AFTER_S:
        _, error_m, r95_m, short_m, long_m = looks[looks[:, 0] == after_s].T
        inside = float(np.mean(error_m <= r95_m))
        found[after_s] = Summary(
            _text(error_m),
            f"{np.median(r95_m):.1f}, {inside:.1%}",
            _text(short_m),
            _text(long_m),
        )
    return found


def _row(row: NavState, here: LocalFrame, start_utc_s: float) -> Row:
    return (row.utc_s - start_utc_s, *here.to_ne(row.lat_rad, row.lon_rad))


def _polynomial(rows: deque[Row], length_s: int) -> Array:
    """Fit seconds since the last row, shape (3, 2): the report's prediction."""
    last = np.array(rows)[-(length_s * ROWS_HZ + 1) :]
    zero_s = last[-1, 0]
    coefficients = np.polyfit(last[:, 0] - zero_s, last[:, 1:], 2)
    return np.vstack([coefficients, [[zero_s, zero_s]]])


def _at(polynomial: Array, t_s: float) -> tuple[float, float]:
    since_s = t_s - polynomial[3, 0]
    north, east = (
        np.polyval(polynomial[:3, 0], since_s),
        np.polyval(polynomial[:3, 1], since_s),
    )
    return float(north), float(east)


def _text(error_m: Array) -> str:
    return f"{np.median(error_m):.1f}, {np.percentile(error_m, 95):.1f}"
