"""What a calibration is worth: simulated drives with it and without.

    python -m benchmarks.calibration [SEEDS]

For each seed a chip is drawn from the reel, glued into a box, and calibrated as its
owner would, with `imu-tracker calibrate` on simulated recordings: half an hour still
from cold on, the six faces, and a drive of five minutes. Then the chip goes on another
drive, the receiver hidden again and again, and is tracked with none, some and all of
what was learnt. One table, in metres. No estimator is told that it is calibrated.
"""

import contextlib
import io
import logging
import math
import sys
import tempfile
from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Final

import numpy as np

from benchmarks.accuracy import FIRST_OUTAGE_S, PAUSE_S, SETTINGS, Drive
from imu_tracker.calibration.corrected import Corrections
from imu_tracker.calibration.counts import CountsModel
from imu_tracker.cli import main as imu_tracker
from imu_tracker.config import load_config
from imu_tracker.geometry.geodesy import gravity_mps2
from imu_tracker.recording.edit import Outage, Stream, hide_gps
from imu_tracker.recording.files import RecordingWriter
from imu_tracker.recording.replay import Replay
from imu_tracker.recording.scoring import Track
from imu_tracker.samples import Frame, SessionHeader, Source
from imu_tracker.simulation import Simulated, simulate
from imu_tracker.simulation.imu.errors import (
    TYPICAL_CHIP,
    ChipErrors,
    ChipTraits,
)
from imu_tracker.simulation.motion.paths import FloatArray
from imu_tracker.simulation.scenarios import DELFT
from imu_tracker.storage.calibration_file import Calibration, read_calibration

SEEDS: Final = 6
DRIVE_S: Final = 600.0
STILL_S: Final = 1800.0
MOUNT_S: Final = 300.0
OUTAGES_S: Final = (30.0, 60.0)

RATE_HZ: Final = 100.0
HOLD_S, TURN_S = 8.0, 2.0

UP: Final = ((0, 0, -1), (0, 0, 1), (1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0))
"""Which way is up in the box, one face after another."""

Scores = dict[tuple[str, str, float], list[tuple[float, float, float]]]


def main() -> None:
    seeds = int(sys.argv[1]) if len(sys.argv) > 1 else SEEDS
    scores: Scores = {}
    for seed in range(seeds):
        _drive(seed, scores)
        print(f"seed {seed} of {seeds} is done", file=sys.stderr, flush=True)
    columns = ["calibrated", "estimator"]
    columns += [f"after {length_s:.0f} s without" for length_s in OUTAGES_S]
    print("error at the end in m: rms (median r95, share of the truth inside r95)\n")
    print(f"| {' | '.join(columns)} |\n|{' --- |' * len(columns)}")
    for what in dict.fromkeys(key[0] for key in scores):
        for estimator in SETTINGS:
            cells = [_cell(scores[what, estimator, s]) for s in OUTAGES_S]
            print(f"| {what} | {estimator} | {' | '.join(cells)} |")


def six_faces(chip: ChipTraits, seed: int) -> Iterator[SessionHeader | Frame]:
    """Turn a box over all its faces, and yield what its chip says."""
    gravity = gravity_mps2(DELFT.lat_rad, DELFT.alt_m)
    up, turning = _turned()
    errors = ChipErrors(
        TYPICAL_CHIP,
        chip._replace(q_vb=(1.0, 0.0, 0.0, 0.0)),  # its own faces, not a vehicle's
        np.random.default_rng([seed, 6]),
        RATE_HZ,
        has_engine=False,
    )
    t_s = np.arange(len(up)) / RATE_HZ
    readings = errors.spoil(t_s, np.zeros(len(up)), gravity * up, turning)
    encode = CountsModel(4, 500).encode
    yield SessionHeader(4, 500, RATE_HZ)
    for i, (accel, gyro, temp) in enumerate(
        zip(*(column.tolist() for column in readings), strict=True)
    ):
        t_ns = round((1.0 + i / RATE_HZ) * 1e9)
        yield Frame(t_ns, Source.IMU, encode(tuple(accel), tuple(gyro), temp))


def _turned() -> tuple[FloatArray, FloatArray]:
    """Direction of up and rate of turn, in the box's axes, sample by sample."""
    ups, rates = [], []
    hold, turn = round(HOLD_S * RATE_HZ), round(TURN_S * RATE_HZ)
    for number, (before, after) in enumerate(zip((UP[0], *UP), UP, strict=False)):
        a, b = np.array(before, float), np.array(after, float)
        if number:
            axis = np.cross(a, b)
            axis = axis if axis.any() else np.roll(a, 1)
            angle = np.arccos(a @ b)
            for share in np.arange(turn) / turn:
                side = np.cross(axis, a)
                ups.append(np.cos(share * angle) * a + np.sin(share * angle) * side)
                rates.append(-axis * angle / TURN_S)  # what is up turns the other way
        ups += [b] * hold
        rates += [np.zeros(3)] * hold
    return np.array(ups), np.array(rates)


def _calibrations(chip: ChipTraits, seed: int) -> dict[str, Corrections | None]:
    """Calibrate as an owner would; return what is known, more and more."""
    at_home = simulate(
        "still", seed=1000 + seed, duration_s=STILL_S, gps_every_s=60.0, chip=chip
    )
    out = simulate("drive", seed=2000 + seed, duration_s=MOUNT_S, chip=chip)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "calibration.json"
        for what, stream in (
            ("gyro", _stream(at_home)),
            ("accel", six_faces(chip, seed)),
            ("mount", _stream(out)),
        ):
            recording = Path(folder) / f"{what}.rec"
            with RecordingWriter(recording) as writer:
                for item in stream:
                    if isinstance(item, Frame):
                        writer.write(item)
                    else:
                        writer.write_header(item)
            argv = ["calibrate", what, str(recording), "-q", "--output", str(path)]
            argv += ["--latitude", "52"] if what == "accel" else []
            argv += ["--temperature"] if what == "gyro" else []
            with contextlib.redirect_stdout(io.StringIO()):
                has_failed = imu_tracker(argv)
            if has_failed:
                raise SystemExit(f"seed {seed}: {what} failed")
        known = read_calibration(path)
    nothing = Calibration(chip=known.chip)

    def only(**parts: object) -> Corrections:
        return nothing.model_copy(update=parts).corrections()

    gyro, accel = known.gyro, known.accel
    assert gyro is not None
    flat = gyro.model_copy(update={"radps_per_degc": None})
    return {
        "nothing": None,
        "gyro": only(gyro=flat),
        "gyro with temperature": only(gyro=gyro),
        "accel": only(accel=accel),
        "gyro, accel": only(gyro=flat, accel=accel),
        "gyro, accel, mount": only(gyro=flat, accel=accel, mount=known.mount),
    }


def _stream(simulated: Simulated) -> Iterator[SessionHeader | Frame]:
    yield simulated.header
    yield from simulated.frames


def _drive(seed: int, scores: Scores) -> None:
    make = partial(simulate, "drive", seed=seed, duration_s=DRIVE_S)
    rows = [
        (row.utc_s, math.degrees(row.lat_rad), math.degrees(row.lon_rad))
        for row in make().truth
    ]
    truth = Track(*np.array(rows).T)
    drive = Drive(f"seed {seed}", lambda: _stream(make()), truth)
    for what, corrections in _calibrations(make().chip, seed).items():
        for estimator, settings in SETTINGS.items():
            for length_s in OUTAGES_S:
                score = _score(drive, settings, corrections, length_s)
                scores.setdefault((what, estimator, length_s), []).append(score)


def _score(
    drive: Drive,
    settings: Sequence[str],
    corrections: Corrections | None,
    length_s: float,
) -> tuple[float, float, float]:
    starts_s = np.arange(FIRST_OUTAGE_S, DRIVE_S - length_s, 2 * length_s + PAUSE_S)
    outages = [Outage(start_s, length_s) for start_s in starts_s.tolist()]
    config = load_config(None, ["filter.profile=vehicle", *settings])
    replay = Replay(config, corrections)
    stream: Stream = hide_gps(drive.stream(), outages)
    for _ in replay.rows(stream):
        pass
    score = replay.score(drive.truth, outages)
    return (
        score["outage_end_rms"],
        score["outage_end_r95_median"],
        score["outage"]["inside_r95"],
    )


def _cell(rows: Sequence[tuple[float, float, float]]) -> str:
    rms, r95, inside = np.array(rows).T
    return f"{np.sqrt(np.mean(rms**2)):.1f} ({np.mean(r95):.1f}, {np.mean(inside):.0%})"


if __name__ == "__main__":
    logging.getLogger("imu_tracker").setLevel(logging.ERROR)
    main()
