"""`imu-tracker calibrate`: learn what one chip is like, and keep it in a file."""

import argparse
import contextlib
import logging
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from imu_tracker.commands.common import (
    Subparsers,
    add_command,
    add_config,
    config_of,
    new_file,
    positive,
)
from imu_tracker.errors import CalibrationError, ConfigError, InputMissingError

if TYPE_CHECKING:
    from imu_tracker.samples import SessionHeader
    from imu_tracker.storage.calibration_file import (
        AccelPart,
        Calibration,
        GyroPart,
        MountPart,
    )

log = logging.getLogger(__name__)

_DESCRIPTION = """\
Learn the errors of this chip. All of it is optional, takes ten minutes, and is
kept in one file, imu.calibration, that the daemon reads when it starts.

  gyro    lay it down and leave it: the bias of the gyroscope
  accel   lay the box on each of its six faces, 7 s each, in any order: bias, scale
          and cross-axis sensitivity of the accelerometer
  mount   park on level ground: the small tilt that imu.mount leaves; with a drive
          (--drive, or a recording that goes on with one) the yaw, too

Stop the daemon before. With REC, a recording is taken instead of the live chip; a gyro
recording that runs from cold to warm also tells how the bias follows temperature, and
with --temperature that is kept."""

_EXAMPLES = """\
  imu-tracker calibrate gyro --config /etc/imu-tracker/imu-tracker.toml
  imu-tracker calibrate accel --latitude 52
  imu-tracker calibrate mount drive.rec.gz --output calibration.json
  imu-tracker replay drive.rec.gz --set imu.calibration=calibration.json"""


def add_calibrate(subparsers: Subparsers) -> None:
    """Add the command."""
    parser = add_command(
        subparsers,
        "calibrate",
        "learn the errors of this chip",
        _DESCRIPTION,
        _EXAMPLES,
    )
    parser.add_argument("what", choices=("gyro", "accel", "mount"), help="see above")
    parser.add_argument(
        "recording",
        nargs="?",
        type=Path,
        metavar="REC",
        help="a recording; default: the live chip",
    )
    parser.add_argument(
        "--output",
        type=new_file,
        metavar="FILE",
        help="the calibration file, whose other parts are kept; default: "
        "imu.calibration",
    )
    parser.add_argument(
        "--seconds",
        type=positive,
        metavar="S",
        help="how long to measure: gyro 30, mount 10; accel: how long to wait for all "
        "faces, 600",
    )
    parser.add_argument(
        "--latitude",
        type=_latitude,
        metavar="DEG",
        help="accel: where you are, for the gravity there; default: from a fix in the "
        "recording, else 9.80665 m/s^2, which may be wrong by 0.3 %%",
    )
    parser.add_argument(
        "--temperature",
        action="store_true",
        help="gyro: keep how the bias follows temperature, and use it; worth it only "
        "for long drives without a stop",
    )
    parser.add_argument(
        "--drive",
        type=positive,
        metavar="S",
        help="mount: when it says so, drive about for so many seconds, with GPS",
    )
    add_config(parser)
    parser.set_defaults(run=run_calibrate)


def _latitude(text: str) -> float:
    with contextlib.suppress(ValueError):
        if abs(float(text)) <= 90:
            return float(text)
    raise argparse.ArgumentTypeError(f"{text!r}: must be a latitude, -90 to 90")


def run_calibrate(args: argparse.Namespace) -> int:
    """Measure one part, and replace it in the file."""
    from imu_tracker.commands.sensor.calibrate_mount import measure_mount
    from imu_tracker.commands.sensor.calibrate_parts import measure_accel, measure_gyro
    from imu_tracker.storage.calibration_file import write_calibration

    config = config_of(args)
    path = args.output or config.imu.calibration
    if path is None:
        raise ConfigError('imu.calibration = "": must name a file; or use --output')
    if args.recording is not None and path.resolve() == args.recording.resolve():
        raise ConfigError(f"{path}: is the recording; choose another --output")
    measured: tuple[SessionHeader, GyroPart | AccelPart | MountPart]
    try:
        if args.what == "gyro":
            measured = measure_gyro(args, config)
        elif args.what == "accel":
            measured = measure_accel(args, config)
        else:
            measured = measure_mount(args, config, partial(_known, path))
    except CalibrationError as error:
        where = f"{args.recording}: " if args.recording is not None else ""
        raise CalibrationError(f"{where}{error}") from error
    header, part = measured
    known = _known(path, header.chip)
    if args.what == "accel" and known.mount is not None:
        log.warning("the mounting was measured with the old values: calibrate it again")
    write_calibration(path, known.model_copy(update={args.what: part}))
    log.info("%s: written", path)
    if args.recording is None:
        log.info("restart the daemon: it reads the file when it starts")
    return 0


def _known(path: Path, chip: str) -> "Calibration":
    """Return what the file holds of this chip already."""
    from imu_tracker.storage.calibration_file import Calibration, read_calibration

    new = Calibration(chip=chip)
    try:
        known = read_calibration(path)
    except InputMissingError as error:
        if path.exists():
            log.warning("%s; begun anew", error)
        return new
    except CalibrationError as error:
        log.warning("%s; begun anew", error)
        return new
    if known.chip != chip:
        log.warning("%s: was of a chip %s, begun anew for %s", path, known.chip, chip)
        return new
    return known
