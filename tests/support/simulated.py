"""Simulated sessions as the tests want them: edited, tracked, scored."""

import math
from collections.abc import Iterable, Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from imu_tracker.estimation.settings import TrackerSettings
from imu_tracker.pipeline import Pipeline
from imu_tracker.samples import Frame, NavState, SessionHeader, Source
from imu_tracker.simulation import TruthRow
from imu_tracker.simulation.simulator import START_NS

SECOND_NS = 1_000_000_000
METRES_PER_RAD = 6.37e6


class Figures(NamedTuple):
    """Horizontal errors against the truth, and the promise."""

    utc_s: NDArray[np.float64]
    error_m: NDArray[np.float64]
    r95_m: NDArray[np.float64]

    @property
    def rms(self) -> float:
        return float(np.sqrt(np.mean(self.error_m**2)))

    @property
    def inside(self) -> float:
        return float(np.mean(self.error_m <= self.r95_m))

    def between(self, start_s: float, end_s: float) -> "Figures":
        """Those of some seconds since the beginning of the truth."""
        since = self.utc_s - self.utc_s[0]
        chosen = (since >= start_s) & (since < end_s)
        return Figures(*(column[chosen] for column in self))


def run(
    header: SessionHeader,
    frames: Iterable[Frame],
    settings: TrackerSettings | None = None,
) -> tuple[list[NavState], Pipeline]:
    """Track a session to its end."""
    profile = header.profile or "free"
    pipeline = Pipeline(header, settings or TrackerSettings(profile=profile))
    rows = [row for frame in frames for row in pipeline.feed(frame)]
    return rows, pipeline


def is_between(frame: Frame, start_s: float, end_s: float) -> bool:
    return start_s <= (frame.t_ns - START_NS) / SECOND_NS < end_s


def without(
    frames: Iterable[Frame], source: Source, start_s: float, end_s: float
) -> Iterator[Frame]:
    """Leave out what a source says in some seconds."""
    for frame in frames:
        if frame.source is not source or not is_between(frame, start_s, end_s):
            yield frame


def compare(
    rows: Sequence[NavState], truth: Iterable[TruthRow], warm_up_s: float = 30.0
) -> Figures:
    """Compare rows with the truth of the same instants, metre by metre.

    An oracle of its own: a sphere is good enough for differences of metres.
    """
    told = {round(row.utc_s * 1000): row for row in rows}
    found = []
    first_s = None
    for true in truth:
        first_s = true.utc_s if first_s is None else first_s
        row = told.get(round(true.utc_s * 1000))
        if row is None or true.utc_s - first_s < warm_up_s:
            continue
        north = (row.lat_rad - true.lat_rad) * METRES_PER_RAD
        east = (row.lon_rad - true.lon_rad) * METRES_PER_RAD * math.cos(true.lat_rad)
        found.append((true.utc_s, math.hypot(north, east), row.r95_m))
    return Figures(*np.array(found).T)
