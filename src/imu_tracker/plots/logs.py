"""Lat/long logs as the pictures want them: columns, colours, a line of summary."""

import itertools
from collections.abc import Sequence
from datetime import UTC, datetime
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from imu_tracker.exports.palette import BLUE, GREEN, ORANGE, PURPLE, SKY, VERMILION
from imu_tracker.exports.palette import MODES as MODES
from imu_tracker.plots.drawing import Array
from imu_tracker.recording.scoring import Track
from imu_tracker.storage.latlong import MAX_GAP_S as MAX_GAP_S

_COMPARED: Final = (BLUE, VERMILION, GREEN, PURPLE, ORANGE, SKY)


class LogColumns(NamedTuple):
    """A lat/long log as arrays, shape (n,), n > 0."""

    name: str
    track: Track
    speed_mps: Array
    r95_m: Array
    mode: NDArray[np.str_]


def joined(logs: Sequence[LogColumns]) -> Sequence[LogColumns]:
    """Join logs that follow one another; leave those that overlap in time alone."""
    ordered = sorted(logs, key=lambda log: log.track.utc_s[0])
    follows = all(
        before.track.utc_s[-1] < after.track.utc_s[0]
        for before, after in itertools.pairwise(ordered)
    )
    if len(logs) == 1 or not follows:
        return logs
    tracks, *columns = list(zip(*(log[1:] for log in ordered), strict=True))
    return [
        LogColumns(
            f"{ordered[0].name} to {ordered[-1].name}",
            Track(*map(np.concatenate, zip(*tracks, strict=True))),
            *map(np.concatenate, columns),
        )
    ]


def colours_of(logs: Sequence[LogColumns], alone: str) -> list[str]:
    """Return one colour for each log; `alone` when there is nothing to compare."""
    if len(logs) == 1:
        return [alone]
    return list(itertools.islice(itertools.cycle(_COMPARED), len(logs)))


def summary(log: LogColumns) -> str:
    """Say when, how long and how far."""
    begin_s, end_s = log.track.utc_s[0], log.track.utc_s[-1]
    step_s = np.diff(log.track.utc_s)
    is_joined = step_s <= MAX_GAP_S
    distance_m = float(np.sum((step_s * log.speed_mps[1:])[is_joined]))
    far = f"{distance_m:.0f} m" if distance_m < 1000 else f"{distance_m / 1000:.1f} km"
    minutes, seconds = divmod(round(end_s - begin_s), 60)
    hours, minutes = divmod(minutes, 60)
    day = datetime.fromtimestamp(begin_s, UTC).date()
    return f"{day}, {hours}:{minutes:02d}:{seconds:02d} h, {far}"
