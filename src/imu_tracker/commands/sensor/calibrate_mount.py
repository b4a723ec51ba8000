"""`imu-tracker calibrate mount`: level, then optionally drive.

With the live chip both are guided: the level is known, or refused, before anybody
drives off. A recording stands somewhere first, and may go on with a drive.
"""

import argparse
import logging
import math
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Final, NamedTuple

from imu_tracker.commands.common import progress, write
from imu_tracker.commands.sensor.calibrate_sources import (
    captured,
    live_stream,
    live_windows,
    plain,
)
from imu_tracker.errors import CalibrationError

if TYPE_CHECKING:
    from imu_tracker.calibration.corrected import Corrections
    from imu_tracker.calibration.mounting import MountFit
    from imu_tracker.calibration.readings import Array, Readings, Window
    from imu_tracker.config import Config
    from imu_tracker.recording.capture import Capture
    from imu_tracker.samples import Frame, Mount, SessionHeader
    from imu_tracker.storage.calibration_file import Calibration, MountPart

log = logging.getLogger(__name__)

LEVEL_S: Final = 10.0
PATIENCE_S: Final = 120.0  # for somebody to park and to let go
LATENCY_S: Final = 0.2  # of a receiver, where gps.latency_s is "auto"


class _Axes(NamedTuple):
    """How readings are seen: corrected, in the axes that `imu.mount` names."""

    mount: "Mount"
    corrections: "Corrections"

    def seen(self, readings: "Readings") -> "tuple[Array, Array]":
        """Return specific force and angular rate, shape (n, 3) each."""
        from imu_tracker.calibration.corrected import corrected_arrays, mount_matrix

        to_named = mount_matrix(self.mount).T
        known = corrected_arrays(readings, self.corrections)
        return known.accel_mps2 @ to_named, known.gyro_radps @ to_named

    def level(self, standing: "Readings") -> "MountFit":
        """Find roll and pitch; refuse a gravity that does not point down."""
        from imu_tracker.calibration.mounting import level

        return level(self.seen(standing)[0].mean(axis=0))


def measure_mount(
    args: argparse.Namespace,
    config: "Config",
    known_of: "Callable[[str], Calibration]",
) -> "tuple[SessionHeader, MountPart]":
    """Find how the chip sits in its vehicle; `known_of` returns what is known of it."""
    from imu_tracker.storage.calibration_file import MountPart, utc_text

    def axes_of(header: "SessionHeader") -> _Axes:
        known = known_of(header.chip).model_copy(update={"mount": None})
        mount = config.imu.mount
        if args.recording is not None and "mount" not in config.imu.model_fields_set:
            mount = header.mount or mount
        return _Axes(mount, known.corrections())

    if args.recording is None:
        taken, standing, axes = _guided(args, config, axes_of)
    else:
        taken = captured(args, config, 0.0)
        standing, axes = _first_standing(taken), axes_of(taken.header)
    fit = axes.level(standing)
    fit = _with_yaw(args, config, fit, axes, taken, standing)
    _tell(fit)
    sigma_rad = fit.yaw_sigma_rad
    return taken.header, MountPart(
        mount=axes.mount,
        rotation=plain(fit.rotation),
        yaw_sigma_deg=None if sigma_rad is None else math.degrees(sigma_rad),
        temp_degc=float(standing.temp_degc.mean()),
        utc=utc_text(taken.start_utc_s),
    )


def _guided(
    args: argparse.Namespace,
    config: "Config",
    axes_of: "Callable[[SessionHeader], _Axes]",
) -> "tuple[Capture, Readings, _Axes]":
    """Wait until the vehicle stands, find its level, and let it be driven."""
    from imu_tracker.recording.capture import capture
    from imu_tracker.samples import Source
    from imu_tracker.sources.polled import for_seconds

    level_s = args.seconds or LEVEL_S
    log.info("park on level ground, engine off, hands off, for %.0f s", level_s)
    kept: list[Frame] = []
    with live_stream(config, with_gps=args.drive is not None) as (header, frames):
        live = _keeping(frames, kept)
        stood = _stand(
            live_windows(header, for_seconds(live, level_s + PATIENCE_S)), level_s
        )
        standing, axes = capture([header, *stood]).readings, axes_of(header)
        fit = axes.level(standing)
        if args.drive is not None:
            _tell_level(fit)
            if not any(frame.source is Source.GPS for frame in kept):
                log.warning("nothing is heard of the receiver: yaw needs its speed")
            log.info(
                "the level is known. Now drive about for %.0f s: set off, brake, turn",
                args.drive,
            )
            total = round(args.drive * config.imu.rate_hz)
            for _ in progress(for_seconds(live, args.drive), args, " samples", total):
                pass
    return capture([header, *kept]), standing, axes


def _keeping(frames: "Iterator[Frame]", kept: "list[Frame]") -> "Iterator[Frame]":
    for frame in frames:
        kept.append(frame)
        yield frame


def _stand(
    seconds: "Iterator[tuple[Window, list[Frame]]]", level_s: float
) -> "list[Frame]":
    """Return the samples of the first stillness that lasts long enough."""
    from imu_tracker.calibration.readings import WINDOW_S
    from imu_tracker.calibration.still import is_quiet, is_steady

    run: list[Window] = []
    samples: list[Frame] = []
    is_told = False
    for window, frames in seconds:
        is_still = is_quiet(window) and (not run or is_steady(window, run[0]))
        if not is_still:
            if run or not is_told:
                log.warning("it moves: waiting for %.0f s without motion", level_s)
                is_told = True
            run, samples = [], []
            continue
        run.append(window)
        samples += frames
        if len(run) * WINDOW_S >= level_s:
            return samples
    raise CalibrationError(
        f"it never stood still for {level_s:.0f} s: engine off, hands off, and try "
        "again"
    )


def _first_standing(taken: "Capture") -> "Readings":
    from imu_tracker.calibration.readings import windows
    from imu_tracker.calibration.still import still_stretches

    stretches = still_stretches(windows(taken.readings), taken.speeds)
    if not stretches:
        raise CalibrationError("never stands still: begin on level ground, for 10 s")
    first = stretches[0]
    start_s = first.windows[0].t_s
    log.info(
        "level where it stands from second %.0f to %.0f",
        start_s,
        start_s + first.length_s,
    )
    return taken.readings.part(first.start, first.stop)


def _with_yaw(
    args: argparse.Namespace,
    config: "Config",
    fit: "MountFit",
    axes: _Axes,
    taken: "Capture",
    standing: "Readings",
) -> "MountFit":
    """Add yaw if there was a drive; without --drive nobody insists on it."""
    from imu_tracker.calibration.mounting import manoeuvres, with_yaw

    latency_s = config.gps.latency_s
    accel_mps2, gyro_radps = axes.seen(taken.readings)
    bias_radps = axes.seen(standing)[1].mean(axis=0)
    drive = manoeuvres(
        taken.readings.t_s,
        accel_mps2,
        (gyro_radps - bias_radps)[:, 2],
        taken.speeds,
        LATENCY_S if latency_s == "auto" else latency_s,
    )
    if not drive and args.drive is None:
        return fit
    try:
        return with_yaw(fit, drive)
    except CalibrationError as error:
        if args.drive is not None:
            raise
        log.warning("yaw is not measured: %s", error)
        return fit


def _tell(fit: "MountFit") -> None:
    roll, pitch = (math.degrees(angle) for angle in fit.tilt_rad)
    write(f"roll  {roll:+7.2f} deg\npitch {pitch:+7.2f} deg\n")
    if fit.yaw_rad is None or fit.yaw_sigma_rad is None:
        write("yaw   not measured: that takes a drive\n")
    else:
        write(
            f"yaw   {math.degrees(fit.yaw_rad):+7.2f} deg, "
            f"+- {1.96 * math.degrees(fit.yaw_sigma_rad):.2f} (95 %)\n"
        )


def _tell_level(fit: "MountFit") -> None:
    roll, pitch = (math.degrees(angle) for angle in fit.tilt_rad)
    log.info("roll %+.2f deg, pitch %+.2f deg", roll, pitch)
