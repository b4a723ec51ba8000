"""Whether the radius keeps its promise, over many simulated drives.

    python -m benchmarks.consistency --drives 100

Each seed is another drive about town with another chip from the reel, glued in askew,
and another receiver's errors. The receiver is hidden four times, beside the tunnel of
each drive. Rows are compared with the exact path of the simulator, by default settings.
Prints three tables: how far off after an outage, against its distance; how often the
truth lies inside r95; and the innovations.
"""

import argparse
import math
import os
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from itertools import pairwise
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from imu_tracker.config import load_config
from imu_tracker.recording.edit import Outage, Stream, hide_gps
from imu_tracker.recording.replay import Replay
from imu_tracker.recording.scoring import WARM_UP_S, Track, answer, metres_per_degree
from imu_tracker.samples import Frame, Source
from imu_tracker.simulation import simulate
from imu_tracker.simulation.imu.errors import TYPICAL_CHIP
from imu_tracker.simulation.scenarios import SCENARIOS, Scenario
from imu_tracker.simulation.simulator import START_NS, START_UTC_S

Array = NDArray[np.float64]

FIRST_SEED: Final = 1000
"""Drives that nobody looked at while the estimator was made."""

DURATION_S: Final = 780.0
OUTAGES: Final = tuple(
    Outage(*each)
    for each in ((130.0, 30.0), (220.0, 60.0), (460.0, 60.0), (580.0, 120.0))
)

ASKEW: Final = TYPICAL_CHIP._replace(
    mounting_sigma_rad=(math.radians(3.0), math.radians(5.0), math.radians(5.0))
)
"""A chip of the datasheet in a box that is fixed by eye, roll, pitch and yaw."""

DRIVE: Final = SCENARIOS["drive"]._replace(errors=ASKEW)

SILENT_S: Final = 2.5
"""Longer between two fixes is an outage; a lost line is none."""

NEES_PER_SQUARE: Final = -2.0 * math.log(0.05)
"""r95 of a round covariance is the root of this, 5.99, times sigma."""

TUNNEL: Final = "its tunnel"


class Dark(NamedTuple):
    """An outage, told at the last row before the first fix after it."""

    name: str
    distance_m: float
    error_m: float
    r95_m: float


class Drive(NamedTuple):
    """What came of one drive.

    Attributes
    ----------
    error_m, r95_m, is_dark : ndarray, shape (n,)
        Row for row of the truth after the warm-up that the log answers.
    answered : float
        Share of the truth after the warm-up.
    resting : float
        Share of the rows with GPS in which it really stood.
    profile : str
        What it was taken for at the end.
    """

    seed: int
    error_m: Array
    r95_m: Array
    is_dark: NDArray[np.bool_]
    answered: float
    resting: float
    outages: tuple[Dark, ...]
    nis_mean: float
    n_fixes: int
    profile: str


def run(
    seed: int,
    duration_s: float = DURATION_S,
    scenario: Scenario = DRIVE,
    settings: Sequence[str] = (),
) -> Drive:
    """Simulate a drive, track it with the defaults but for `settings`, and compare."""

    def stream() -> Stream:
        made = simulate(scenario, seed=seed, duration_s=duration_s)
        yield made.header
        yield from made.frames

    hidden = list(_hidden(stream(), duration_s))
    replay = Replay(load_config(None, settings))
    rows = list(replay.rows(hide_gps(stream(), hidden)))
    log = np.array([(row.utc_s, row.lat_rad, row.lon_rad, row.r95_m) for row in rows]).T
    told = Track(log[0], np.degrees(log[1]), np.degrees(log[2]))
    path = list(simulate(scenario, seed=seed, duration_s=duration_s).truth)
    utc_s, lat, lon = np.array([row[:3] for row in path]).T
    truth = Track(utc_s, np.degrees(lat), np.degrees(lon))
    answers = answer(told, log[3], truth)

    since_s = utc_s - START_UTC_S
    distance_m = _distance_m(truth)
    is_dark = np.zeros(len(since_s), bool)
    ends = []
    for gap in _gaps(hide_gps(stream(), hidden)):
        in_gap = (since_s >= gap.start_s) & (since_s <= gap.start_s + gap.length_s)
        is_dark |= in_gap
        first, *_, last = np.flatnonzero(in_gap).tolist()
        ends.append(
            Dark(
                _name(gap, hidden),
                float(distance_m[last] - distance_m[first]),
                float(answers.error_m[last]),
                float(answers.r95_m[last]),
            )
        )
    is_due = since_s >= since_s[0] + WARM_UP_S
    chosen = is_due & answers.is_answered
    is_still = np.array([math.hypot(*row.v_n_mps) < 0.01 for row in path])
    result = replay.result()
    return Drive(
        seed,
        answers.error_m[chosen],
        answers.r95_m[chosen],
        is_dark[chosen],
        float(chosen.sum() / is_due.sum()),
        float(is_still[chosen & ~is_dark].mean()),
        tuple(ends),
        result["learnt"]["nis_mean"],
        result["counters"]["fixes"],
        result["learnt"]["profile"],
    )


def pooled(drives: Sequence[Drive], *, is_dark: bool) -> tuple[Array, Array]:
    """Return error and r95 of all rows of all drives, with GPS or without."""
    chosen = [drive.is_dark == is_dark for drive in drives]
    return (
        np.concatenate([d.error_m[c] for d, c in zip(drives, chosen, strict=True)]),
        np.concatenate([d.r95_m[c] for d, c in zip(drives, chosen, strict=True)]),
    )


def nees(error_m: Array, r95_m: Array) -> float:
    """Mean square of the error over what r95 says of it.

    2 when the covariance is true and round, 1.56 when it is true and a line: along a
    line r95 is 1.96 sigma.
    """
    return NEES_PER_SQUARE * float(np.mean((error_m / r95_m) ** 2))


def tables(drives: Sequence[Drive]) -> Iterator[str]:
    """Yield the lines of the tables."""
    yield (
        "| without GPS | outages | distance, median | error at the end, rms | median |"
        " of the distance: median | 8 of 10 below | r95, median | inside |"
    )
    yield f"|{' --- |' * 9}"
    outages = [outage for drive in drives for outage in drive.outages]
    names = dict.fromkeys(outage.name for outage in outages)
    for name in sorted(names, key=lambda name: (name == TUNNEL, len(name), name)):
        yield _outage_line(name, [each for each in outages if each.name == name])
    yield ""
    yield "| rows | inside r95 | worst drive | NEES | error, rms | r95, median |"
    yield f"|{' --- |' * 6}"
    for title, is_dark in (("with GPS", False), ("in the dark", True)):
        error_m, r95_m = pooled(drives, is_dark=is_dark)
        shares = [_inside(*pooled([drive], is_dark=is_dark)) for drive in drives]
        yield (
            f"| {title} | {_inside(error_m, r95_m):.1%} | {min(shares):.0%} |"
            f" {nees(error_m, r95_m):.2f} | {_rms(error_m):.1f} m |"
            f" {np.median(r95_m):.1f} m |"
        )
    nis = [drive.nis_mean for drive in drives]
    worst = max(drives, key=lambda drive: np.max(drive.error_m / drive.r95_m))
    yield ""
    yield (
        f"NIS {np.mean(nis):.2f}, by drive {min(nis):.2f} to {max(nis):.2f}; it stands"
        f" in {np.mean([drive.resting for drive in drives]):.0%} of the rows with GPS;"
        f" at worst {np.max(worst.error_m / worst.r95_m):.2f} r95 off"
        f" (seed {worst.seed}); answered {min(d.answered for d in drives):.1%} or more"
    )


def _outage_line(name: str, outages: Sequence[Dark]) -> str:
    distance_m, error_m, r95_m = np.array([outage[1:] for outage in outages]).T
    # Who hardly moved has no share of a distance that says anything.
    share = error_m[distance_m > 50.0] / distance_m[distance_m > 50.0]
    return (
        f"| {name} | {len(outages)} | {np.median(distance_m):.0f} m |"
        f" {_rms(error_m):.1f} m | {np.median(error_m):.1f} m |"
        f" {np.median(share):.1%} | {np.percentile(share, 80):.1%} |"
        f" {np.median(r95_m):.1f} m | {_inside(error_m, r95_m):.0%} |"
    )


def _hidden(stream: Stream, duration_s: float) -> Iterator[Outage]:
    """Yield the outages that end in time and do not meet the tunnel of this drive."""
    tunnels = list(_gaps(stream))
    for outage in OUTAGES:
        around = Outage(outage.start_s - WARM_UP_S, outage.length_s + 2.0 * WARM_UP_S)
        if around.start_s + around.length_s <= duration_s and not any(
            _meet(around, tunnel) for tunnel in tunnels
        ):
            yield outage


def _gaps(stream: Stream) -> Iterator[Outage]:
    """Yield where fixes stay away, from the arrival of the last to that of the next."""
    arrivals_s = [
        (item.t_ns - START_NS) * 1e-9
        for item in stream
        if isinstance(item, Frame)
        and item.source is Source.GPS
        and b"RMC" in item.data
        and b",A," in item.data
    ]
    for before_s, after_s in pairwise(arrivals_s):
        if after_s - before_s > SILENT_S:
            yield Outage(before_s, after_s - before_s)


def _meet(a: Outage, b: Outage) -> bool:
    return a.start_s < b.start_s + b.length_s and b.start_s < a.start_s + a.length_s


def _name(gap: Outage, hidden: Sequence[Outage]) -> str:
    for outage in hidden:
        if _meet(gap, outage):
            return f"{outage.length_s:.0f} s"
    return TUNNEL


def _distance_m(truth: Track) -> Array:
    north_m, east_m = metres_per_degree(truth.lat_deg)
    steps_m = np.hypot(
        np.diff(truth.lat_deg) * north_m[1:], np.diff(truth.lon_deg) * east_m[1:]
    )
    return np.concatenate([[0.0], np.cumsum(steps_m)])


def _inside(error_m: Array, r95_m: Array) -> float:
    return float(np.mean(error_m <= r95_m))


def _rms(error_m: Array) -> float:
    return float(np.sqrt(np.mean(error_m**2)))


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.consistency")
    parser.add_argument("--drives", type=int, default=100)
    parser.add_argument("--first-seed", type=int, default=FIRST_SEED)
    parser.add_argument("--duration", type=float, default=DURATION_S, metavar="S")
    args = parser.parse_args()
    seeds = range(args.first_seed, args.first_seed + args.drives)
    with ProcessPoolExecutor(os.cpu_count()) as pool:
        drives = list(pool.map(partial(run, duration_s=args.duration), seeds))
    print("\n".join(tables(drives)))


if __name__ == "__main__":
    main()
