"""Samples per second from the recording to the log, beside others, in one process.

The contestants take turns, so that a busy minute hits all of them, and a yardstick
frames each turn. Times are those of the processor: on an idle machine nothing else.
"""

import gc
import math
import time
from collections.abc import Callable, Mapping
from statistics import fmean, median
from typing import Final, NamedTuple

from benchmarks.drives import Drive
from benchmarks.peers import run_plain_filterpy, run_pyins
from benchmarks.yardstick import yardstick_s
from imu_tracker.config import load_config
from imu_tracker.estimation.settings import TrackerSettings
from imu_tracker.estimation.tracker import Tracker
from imu_tracker.geometry.geodesy import LocalFrame
from imu_tracker.recording.files import read_recording
from imu_tracker.recording.replay import Replay
from imu_tracker.samples import GpsFix, NavState
from imu_tracker.storage.latlong import LatLongLog

WARM_UP_SAMPLES: Final = 3000


class Turn(NamedTuple):
    """One contestant, once through the drive."""

    cpu_s: float
    wall_s: float
    yardstick_s: float  # mean of before and after


class Result(NamedTuple):
    """What came of a contestant."""

    turns: list[Turn]
    n_samples: int
    end_m: float  # from the last fix to its last position

    @property
    def best_per_s(self) -> float:
        """Samples per second in its best turn."""
        return self.n_samples / min(turn.cpu_s for turn in self.turns)

    @property
    def median_per_s(self) -> float:
        """Samples per second in its median turn."""
        return self.n_samples / median(turn.cpu_s for turn in self.turns)

    @property
    def quiet_per_s(self) -> float:
        """Estimate of the same for when the yardstick is as fast as at its best."""
        best_s = min(turn.yardstick_s for turn in self.turns)
        return self.n_samples / median(
            turn.cpu_s * best_s / turn.yardstick_s for turn in self.turns
        )


def run_imu_tracker(drive: Drive) -> tuple[float, float]:
    """Everything: read and decode the recording, estimate, write the log."""
    path = drive.scratch / "latlong.csv"
    path.unlink(missing_ok=True)
    log = LatLongLog(path)
    replay = Replay(load_config(None, ["filter.profile=vehicle"]))
    for state in replay.rows(read_recording(drive.path)):
        log.write(state)
    log.close()
    return state.lat_rad, state.lon_rad


def run_tracker_alone(drive: Drive) -> tuple[float, float]:
    """What the peers do: from decoded samples and fixes to positions."""
    tracker = Tracker(TrackerSettings(profile="vehicle"))
    rows: list[NavState] = []
    for event in drive.events():
        if isinstance(event, GpsFix):
            rows = tracker.advance(event.t_ns) or rows
            tracker.on_fix(event)
        else:
            rows = tracker.on_imu(event) or rows
    return rows[-1].lat_rad, rows[-1].lon_rad


CONTESTANTS: Final[Mapping[str, Callable[[Drive], tuple[float, float]]]] = {
    "imu-tracker": run_imu_tracker,
    "its tracker alone": run_tracker_alone,
    "plain filterpy": run_plain_filterpy,
    "pyins": run_pyins,
}


def compete(drive: Drive, names: list[str], rounds: int) -> dict[str, Result]:
    """Let the contestants take turns.

    Before it counts, each has run on the beginning of the drive: to import, and in
    the case of pyins to compile.
    """
    for name in names:
        CONTESTANTS[name](drive.beginning(WARM_UP_SAMPLES))
    turns: dict[str, list[Turn]] = {name: [] for name in names}
    ends_m: dict[str, float] = {}
    last_fix = drive.fixes[-1]
    here = LocalFrame.at(last_fix.lat_rad, last_fix.lon_rad)
    for _ in range(rounds):
        for name in names:
            turn, place = _take_turn(CONTESTANTS[name], drive)
            turns[name].append(turn)
            ends_m[name] = math.hypot(*here.to_ne(*place))
    return {
        name: Result(turns[name], len(drive.samples), ends_m[name]) for name in names
    }


def _take_turn(
    run: Callable[[Drive], tuple[float, float]], drive: Drive
) -> tuple[Turn, tuple[float, float]]:
    gc.collect()
    before_s = yardstick_s()
    cpu_s, wall_s = time.process_time(), time.perf_counter()
    place = run(drive)
    cpu_s, wall_s = time.process_time() - cpu_s, time.perf_counter() - wall_s
    return Turn(cpu_s, wall_s, fmean([before_s, yardstick_s()])), place
