"""`imu-tracker simulate`: make a recording of something that never happened."""

import argparse
import logging
import math
from collections.abc import Iterable
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING

from imu_tracker.commands.common import (
    Output,
    Subparsers,
    add_command,
    add_config,
    config_of,
    new_file,
    positive,
    progress,
    refuse_to_overwrite,
    whole_from,
)
from imu_tracker.errors import UsageError

if TYPE_CHECKING:
    from imu_tracker.simulation import TruthRow

log = logging.getLogger(__name__)

MOST_GPS_EVERY_S = 3600.0
"""Seconds from fix to fix: more would be no receiver any more."""

_DESCRIPTION = """\
Make a recording without any hardware: an MPU-6050 with its noise, bias and tilt, and a
receiver with its errors and delays, on a way that is known. The same seed makes the
same recording.

scenarios:
  still        lie on a table
  walk-line    walk straight on
  walk-square  walk round a square
  roundabout   drive round and round
  drive        drive about town: turns, stops, hills, a tunnel; each seed another way
  square       slide round a square of 1 m; a tablet's sensors, a fix of 1 m each second
  circle       the same on a circle of 1 m radius
  lissajous    the same on the figure (cos 3t, sin 2t)"""

_EXAMPLES = """\
  imu-tracker simulate drive --output drive.rec --truth truth.csv
  imu-tracker simulate drive --output drive.rec.gz --seed 7 --duration 3600
  imu-tracker simulate roundabout --output round.rec --gps-every 5
  imu-tracker simulate still --output still.rec --set imu.rate_hz=200"""


def add_simulate(subparsers: Subparsers) -> None:
    """Add the command."""
    parser = add_command(
        subparsers,
        "simulate",
        "make a recording of a simulated drive",
        _DESCRIPTION,
        _EXAMPLES,
    )
    parser.add_argument("scenario", metavar="SCENARIO", help="one of those above")
    parser.add_argument(
        "--output",
        type=new_file,
        required=True,
        metavar="REC",
        help="the recording to write; compressed when it ends in .gz",
    )
    parser.add_argument(
        "--truth",
        type=Path,
        metavar="CSV",
        help="write where it really was: time_utc,lat_deg,lon_deg,alt_m",
    )
    parser.add_argument(
        "--seed",
        type=whole_from(0),
        metavar="N",
        help="a whole number that decides all that is random; default: 0",
    )
    parser.add_argument(
        "--duration",
        type=positive,
        metavar="S",
        help="seconds; default: the scenario's own length",
    )
    parser.add_argument(
        "--gps-every",
        type=positive,
        default=1.0,
        metavar="S",
        help="seconds from fix to fix, a multiple of 0.05 up to 3600; default: 1",
    )
    add_config(parser)
    parser.set_defaults(run=run_simulate)


def run_simulate(args: argparse.Namespace) -> int:
    """Write the recording and its truth."""
    config = config_of(args)
    refuse_to_overwrite([args.output, args.truth], [])
    twentieths = args.gps_every * 20
    if twentieths > MOST_GPS_EVERY_S * 20 or not math.isclose(
        twentieths, round(twentieths), abs_tol=1e-6
    ):
        raise UsageError(
            f"--gps-every {args.gps_every:g}: must be a multiple of 0.05, "
            f"{MOST_GPS_EVERY_S:g} at most"
        )

    from imu_tracker.recording.files import RecordingWriter
    from imu_tracker.simulation import SCENARIOS, simulate

    if args.scenario not in SCENARIOS:
        raise UsageError(
            f"{args.scenario}: no such scenario; there are {', '.join(SCENARIOS)}"
        )
    simulated = simulate(
        args.scenario,
        seed=config.source.seed if args.seed is None else args.seed,
        duration_s=args.duration or config.source.duration_s or None,
        rate_hz=config.imu.chosen_rate_hz,
        accel_range_g=config.imu.accel_range_g,
        gyro_range_dps=config.imu.gyro_range_dps,
        mount=config.imu.mount,
        gps_every_s=args.gps_every,
        wheels=config.source.wheels == "on",
        lever_arm_m=config.gps.lever_arm_m,
        baud=None if config.gps.baud == "auto" else config.gps.baud,
    )
    with RecordingWriter(args.output) as recording:
        recording.write_header(simulated.header)
        for frame in progress(simulated.frames, args, unit=" records"):
            recording.write(frame)
    if args.truth is not None:
        _write_truth(args.truth, simulated.truth)
    log.info("%s: written", args.output)
    return 0


def _write_truth(path: Path, truth: "Iterable[TruthRow]") -> None:
    with Output(path) as file:
        file.write("time_utc,lat_deg,lon_deg,alt_m\n")
        for row in truth:
            utc = datetime.fromtimestamp(row.utc_s, UTC).isoformat(
                timespec="milliseconds"
            )
            file.write(
                f"{utc.removesuffix('+00:00')}Z,{math.degrees(row.lat_rad):.9f},"
                f"{math.degrees(row.lon_rad):.9f},{row.alt_m:.3f}\n"
            )
