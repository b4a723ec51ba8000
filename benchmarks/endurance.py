"""An hour of driving: what a sample costs by its end, and how much memory it takes.

A process of its own, so that its peak memory is that of the tracker alone:
`python -m benchmarks.endurance RECORDING [--trace]` prints one JSON object.
"""

import json
import re
import subprocess
import sys
import time
import tracemalloc
from collections.abc import Iterator
from pathlib import Path
from statistics import fmean, median
from typing import Final, NamedTuple

import numpy as np

from benchmarks.yardstick import yardstick_s
from imu_tracker.config import load_config
from imu_tracker.recording.files import read_recording
from imu_tracker.recording.replay import Replay
from imu_tracker.samples import Frame, NavState, SessionHeader
from imu_tracker.storage.latlong import LatLongLog

SLICE_S: Final = 300


class Slice(NamedTuple):
    """Some minutes of the drive."""

    samples: int
    cpu_s: float
    yardstick_s: float  # mean of before and after
    peak_rss_mb: float  # of the process, so far
    traced_kb: float  # what Python's allocator holds at its end; 0 untraced
    traced_peak_kb: float


class Endurance(NamedTuple):
    """What an hour costs."""

    us_per_sample: list[float]  # by slice, median of the runs
    quiet_us_per_sample: list[float]  # the same, with the fastest yardstick of all
    slope_us_per_h: float
    slope_sigma_us_per_h: float
    imported_rss_mb: float  # of the process when the first sample comes
    peak_rss_mb: list[float]
    traced_kb: list[float]
    traced_peak_kb: float


def measure(recording: Path, runs: int) -> Endurance:
    """Replay a long recording some times, and once more under `tracemalloc`."""
    untraced = [_in_child(recording) for _ in range(runs)]
    _, traced = _in_child(recording, "--trace")
    by_slice = list(zip(*(slices for _, slices in untraced), strict=True))
    best_s = min(part.yardstick_s for parts in by_slice for part in parts)
    quiet = [
        median(_us_per_sample(part) * best_s / part.yardstick_s for part in parts)
        for parts in by_slice
    ]
    hours = (np.arange(len(quiet)) + 0.5) * SLICE_S / 3600.0
    (slope, _), covariance = np.polyfit(hours, quiet, 1, cov=True)
    imported_rss_mb, slices = untraced[0]
    return Endurance(
        [median(map(_us_per_sample, parts)) for parts in by_slice],
        quiet,
        float(slope),
        float(np.sqrt(covariance[0, 0])),
        imported_rss_mb,
        [part.peak_rss_mb for part in slices],
        [part.traced_kb for part in traced],
        max(part.traced_peak_kb for part in traced),
    )


def _us_per_sample(part: Slice) -> float:
    return 1e6 * part.cpu_s / part.samples


def _in_child(recording: Path, *options: str) -> tuple[float, list[Slice]]:
    command = [sys.executable, "-m", "benchmarks.endurance", str(recording), *options]
    done = subprocess.run(command, check=True, capture_output=True)
    answer = json.loads(done.stdout)
    return answer["imported_rss_mb"], [Slice(*part) for part in answer["slices"]]


def _slices(recording: Path, log: LatLongLog) -> Iterator[Slice]:
    """Track a recording into a log, and tell of every slice of it."""
    n_frames = 0

    def counted() -> Iterator[SessionHeader | Frame]:
        nonlocal n_frames
        for item in read_recording(recording):
            n_frames += 1
            yield item

    n_done, end_ns, yardstick_before_s = 0, None, yardstick_s()
    since_s = time.process_time()
    vehicle = load_config(None, ["filter.profile=vehicle"])
    state: NavState
    for state in Replay(vehicle).rows(counted()):
        log.write(state)
        end_ns = end_ns or state.t_ns + SLICE_S * 1_000_000_000
        if state.t_ns >= end_ns:
            cpu_s = time.process_time() - since_s
            yardstick_after_s = yardstick_s()
            traced, traced_peak = tracemalloc.get_traced_memory()
            yield Slice(
                n_frames - n_done,
                cpu_s,
                fmean([yardstick_before_s, yardstick_after_s]),
                _peak_rss_mb(),
                traced / 1e3,
                traced_peak / 1e3,
            )
            n_done, yardstick_before_s = n_frames, yardstick_after_s
            since_s = time.process_time()
            end_ns += SLICE_S * 1_000_000_000


def _peak_rss_mb() -> float:
    """Read what Linux says; `getrusage` would count the parent's, from before exec."""
    status = Path("/proc/self/status").read_text(encoding="ascii")
    (peak_kib,) = re.findall(r"^VmHWM:\s+(\d+) kB$", status, re.MULTILINE)
    return int(peak_kib) * 1.024e-3


def _main() -> None:
    recording = Path(sys.argv[1])
    imported_rss_mb = _peak_rss_mb()
    if "--trace" in sys.argv:
        tracemalloc.start()
    path = recording.with_name("endurance.csv")
    path.unlink(missing_ok=True)  # a log takes no row that is earlier than its last
    log = LatLongLog(path)
    slices = list(_slices(recording, log))
    log.close()
    print(json.dumps({"imported_rss_mb": imported_rss_mb, "slices": slices}))


if __name__ == "__main__":
    _main()
