"""How far off the track is, with GPS and at the ends of outages, by each estimator.

    python -m benchmarks.accuracy

Replays the drives in the folder that `IMU_TRACKER_RECORDINGS` names (`NAME.rec.gz`
beside `NAME.truth.csv.gz`), or simulated ones where it names none, each whole and with
the receiver hidden again and again, and prints one table in metres. `scoring` says how
errors are counted; profile `vehicle`, else the defaults. A simulated drive has a tunnel
of a minute of its own, which counts as time with GPS.
"""

import math
import os
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np

from benchmarks.drives import FOLDER_VARIABLE
from imu_tracker.config import load_config
from imu_tracker.recording.edit import Outage, Stream, hide_gps
from imu_tracker.recording.files import read_recording
from imu_tracker.recording.replay import Replay
from imu_tracker.recording.scoring import Track, read_truth
from imu_tracker.simulation import simulate

OUTAGES_S: Final = (15.0, 30.0, 60.0)
FIRST_OUTAGE_S: Final = 120.0
PAUSE_S: Final = 30.0  # and as long as the outage: time to find the way again
SIMULATED_SEEDS: Final = (0, 1, 2)
SIMULATED_S: Final = 600.0

SETTINGS: Final = {
    "six-state": ["filter.estimator=six-state"],
    "error-state": ["filter.estimator=error-state", "gps.latency_s=auto"],
}


class Drive(NamedTuple):
    """A stream that can be read again, and its truth."""

    name: str
    stream: Callable[[], Stream]
    truth: Track


def main() -> None:
    print("horizontal error in m: rms (median r95, share of the truth inside r95)\n")
    columns = ["drive", "estimator", "with GPS"]
    columns += [f"after {length:.0f} s without" for length in OUTAGES_S]
    print(f"| {' | '.join(columns)} |\n|{' --- |' * len(columns)}")
    for drive in _drives():
        for estimator, settings in SETTINGS.items():
            cells = [_cell(_score(drive, settings, []))]
            for length_s in OUTAGES_S:
                outages = _outages(drive.truth, length_s)
                cells.append(_cell(_score(drive, settings, outages)) if outages else "")
            print(f"| {drive.name} | {estimator} | {' | '.join(cells)} |", flush=True)


def _drives() -> Iterator[Drive]:
    folder = os.environ.get(FOLDER_VARIABLE)
    if folder is None:
        yield from map(_simulated, SIMULATED_SEEDS)
        return
    for path in sorted(Path(folder).glob("*.rec.gz")):
        name = path.name.removesuffix(".rec.gz")
        truth = read_truth(path.with_name(f"{name}.truth.csv.gz"))
        yield Drive(name, partial(read_recording, path), truth)


def _simulated(seed: int) -> Drive:
    make = partial(simulate, "drive", seed=seed, duration_s=SIMULATED_S)

    def stream() -> Stream:
        drive = make()
        yield drive.header
        yield from drive.frames

    rows = [
        (row.utc_s, math.degrees(row.lat_rad), math.degrees(row.lon_rad))
        for row in make().truth
    ]
    return Drive(f"simulated, seed {seed}", stream, Track(*np.array(rows).T))


def _outages(truth: Track, length_s: float) -> list[Outage]:
    last_s = truth.utc_s[-1] - truth.utc_s[0] - length_s
    starts = np.arange(FIRST_OUTAGE_S, last_s, 2.0 * length_s + PAUSE_S)
    return [Outage(float(start_s), length_s) for start_s in starts]


def _score(
    drive: Drive, settings: Sequence[str], outages: Sequence[Outage]
) -> dict[str, Any]:
    replay = Replay(load_config(None, ["filter.profile=vehicle", *settings]))
    for _ in replay.rows(hide_gps(drive.stream(), outages)):
        pass
    return replay.score(drive.truth, outages)


def _cell(score: dict[str, Any]) -> str:
    if "outage_end_rms" not in score:
        part = score["with_gps"]
        return _text(part["rms"], part["r95_median"], part["inside_r95"])
    return _text(
        score["outage_end_rms"],
        score["outage_end_r95_median"],
        score["outage"]["inside_r95"],
    )


def _text(rms_m: float, r95_m: float, inside: float) -> str:
    digits = 2 if rms_m < 1.0 else 1 if rms_m < 100.0 else 0
    return f"{rms_m:.{digits}f} ({r95_m:.{digits}f}, {inside:.0%})"


if __name__ == "__main__":
    main()
