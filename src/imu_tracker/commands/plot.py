"""`imu-tracker plot`: a picture of a log or of a recording."""

import argparse
import logging
import math
import os
from pathlib import Path
from typing import TYPE_CHECKING

from imu_tracker.commands.common import (
    Subparsers,
    add_command,
    new_file,
    refuse_to_overwrite,
)
from imu_tracker.errors import LogError, RecordingError, UsageError

if TYPE_CHECKING:
    from imu_tracker.plots.orders import OrderColumns
    from imu_tracker.plots.recording import RecordingColumns
    from imu_tracker.plots.tracks import LogColumns

log = logging.getLogger(__name__)

_DESCRIPTION = """\
Draw lat/long logs: the track with its circles of error, and below it speed and r95 over
time. Logs that follow one another, as rotated ones do, make one track; logs of the
same time are compared. With --truth, the true track and the true error, too.

Or draw a recording: the chip's raw axes, its temperature, and the receiver's fixes.
With --orders, the spectrum of its vibration, and the lines of the wheels in it."""

_EXAMPLES = """\
  imu-tracker plot drive.csv --output drive.png
  imu-tracker plot drive.csv --truth truth.csv --output drive.png
  imu-tracker plot latlong-*.csv.gz latlong.csv --output week.png
  imu-tracker plot vehicle.csv free.csv --output compared.png
  imu-tracker plot drive.rec --output raw.png
  imu-tracker plot drive.rec --orders --output wheels.png"""


def add_plot(subparsers: Subparsers) -> None:
    """Add the command."""
    parser = add_command(
        subparsers, "plot", "draw a log or a recording", _DESCRIPTION, _EXAMPLES
    )
    parser.add_argument(
        "files",
        nargs="+",
        type=Path,
        metavar="FILE",
        help="lat/long logs, or one recording; plain or gzip",
    )
    parser.add_argument(
        "--truth",
        type=Path,
        metavar="CSV",
        help="a table with the columns time_utc,lat_deg,lon_deg",
    )
    parser.add_argument(
        "--orders",
        action="store_true",
        help="of a recording in a vehicle: the lines that its wheels make",
    )
    parser.add_argument(
        "--output",
        type=new_file,
        required=True,
        metavar="PNG",
        help="the picture; .svg and .pdf work, too",
    )
    parser.set_defaults(run=run_plot)


def run_plot(args: argparse.Namespace) -> int:
    """Draw."""
    refuse_to_overwrite([args.output], [*args.files, args.truth])
    from imu_tracker.recording.files import is_recording

    if any(map(is_recording, args.files)):
        if len(args.files) > 1 or args.truth is not None:
            raise UsageError("a recording is drawn alone, and without --truth")
    elif args.orders:
        raise UsageError("--orders needs a recording, not a log")
    if args.orders:
        from imu_tracker.plots.orders import plot_orders

        plot_orders(_orders(args.files[0]), args.output)
    elif any(map(is_recording, args.files)):
        from imu_tracker.plots.recording import plot_recording

        plot_recording(_recording(args.files[0]), args.output)
    else:
        from imu_tracker.plots.tracks import plot_tracks
        from imu_tracker.recording.scoring import read_truth

        truth = None if args.truth is None else read_truth(args.truth)
        plot_tracks([_log(path) for path in args.files], args.output, truth)
    log.info("%s: written", args.output)
    return 0


def _label(path: Path) -> str:
    """Return a file's name as matplotlib draws it: any bytes, and no mathematics."""
    name = os.fsencode(path.name).decode("utf-8", "replace")
    return name.replace("$", r"\$")


def _log(path: Path) -> "LogColumns":
    from imu_tracker.plots.tracks import LogColumns
    from imu_tracker.recording.scoring import Track
    from imu_tracker.storage.latlong import read_log

    columns = read_log(path)
    if not len(columns.utc_s):
        raise LogError(f"{path}: no rows to draw")
    track = Track(columns.utc_s, columns.lat_deg, columns.lon_deg)
    return LogColumns(
        _label(path), track, columns.speed_mps, columns.r95_m, columns.mode
    )


def _orders(path: Path) -> "OrderColumns":
    """Track a recording as in a vehicle; of several sessions, the first."""
    import numpy as np

    from imu_tracker.calibration.counts import CountsModel
    from imu_tracker.config import load_config
    from imu_tracker.pipeline import Pipeline
    from imu_tracker.plots.orders import OrderColumns
    from imu_tracker.recording.files import read_recording
    from imu_tracker.samples import Frame, Mode, SessionHeader, Source

    stream = read_recording(path)
    header = next(stream)
    if not isinstance(header, SessionHeader):
        raise TypeError("a recording begins with a header")
    as_printed = ("+x", "+y", "+z")
    counts = CountsModel(header.accel_range_g, header.gyro_range_dps, as_printed)
    config = load_config(None, ["filter.profile=vehicle"])
    pipeline = Pipeline(header, config.tracker_settings(header))
    imu, rows = [], []
    for frame in stream:
        if not isinstance(frame, Frame):
            break
        if frame.source is Source.IMU:
            sample = counts.decode(frame.t_ns, frame.data)
            imu.append((frame.t_ns, *sample.accel_mps2, *sample.gyro_radps))
        rows += [
            (row.t_ns, math.hypot(*row.v_n_mps[:2]), row.mode is not Mode.DR)
            for row in pipeline.feed(frame)
        ]
    if len(imu) < 2 or not rows:
        raise RecordingError(f"{path}: the wheels need samples and fixes")
    t_ns, *values = np.array(imu).T
    row_ns, speed_mps, has_gps = np.array(rows).T
    wheels = pipeline.report().get("wheels")
    return OrderColumns(
        *(_label(path), (t_ns - t_ns[0]) * 1e-9, np.column_stack(values)),
        *((row_ns - t_ns[0]) * 1e-9, speed_mps, has_gps > 0.0),
        state="not heard" if wheels is None else wheels["state"],
        circumference_m=wheels and wheels["circumference_m"],
        circumference_sigma_m=wheels and wheels["circumference_sigma_m"],
    )


def _recording(path: Path) -> "RecordingColumns":
    """Decode a recording in the chip's own axes."""
    import numpy as np

    from imu_tracker.calibration.counts import CountsModel
    from imu_tracker.plots.recording import RecordingColumns
    from imu_tracker.recording.edit import Stopwatch
    from imu_tracker.recording.files import read_recording
    from imu_tracker.samples import GpsFix, SessionHeader, Source
    from imu_tracker.sensors.gnss.epoch_reader import EpochReader

    stopwatch = Stopwatch()
    epochs = EpochReader()
    imu, fixes, no_fixes = [], [], []
    last_epochs = 0
    for item in read_recording(path):
        elapsed_s = stopwatch.read(item)
        if isinstance(item, SessionHeader):
            as_printed = ("+x", "+y", "+z")
            counts = CountsModel(item.accel_range_g, item.gyro_range_dps, as_printed)
        elif item.source is Source.IMU:
            sample = counts.decode(item.t_ns, item.data)
            imu.append(
                (elapsed_s, *sample.accel_mps2, *sample.gyro_radps, sample.temp_degc)
            )
        elif item.source is Source.GPS:
            positions = epochs.feed(item.t_ns, item.data)
            fixes += [
                (elapsed_s, position.sigma_h_m)
                for position in positions
                if isinstance(position, GpsFix)
            ]
            without = epochs.counters["epochs_without_fix"]
            if without > last_epochs:
                no_fixes.append(elapsed_s)
                last_epochs = without
    t_s, ax, ay, az, gx, gy, gz, temp_degc = np.array(imu).reshape(-1, 8).T
    fix_s, sigma_m = np.array(fixes).reshape(-1, 2).T
    return RecordingColumns(
        _label(path),
        t_s,
        np.column_stack([ax, ay, az]),
        np.column_stack([gx, gy, gz]),
        temp_degc,
        fix_s,
        sigma_m,
        np.array(no_fixes),
    )
