"""The measurements of `imu-tracker calibrate`: gyro, accel, mount.

Each takes the live chip or a recording, tells what it found, and returns the header of
the chip and its part of the calibration file.
"""

import argparse
import contextlib
import logging
import math
from collections.abc import Callable, Iterable, Iterator
from typing import TYPE_CHECKING, Any, Final

from imu_tracker.commands.common import progress, write
from imu_tracker.errors import CalibrationError

if TYPE_CHECKING:
    from imu_tracker.calibration.faces import FaceGuide, FacesFit, Note
    from imu_tracker.calibration.readings import Window
    from imu_tracker.calibration_file import AccelPart, Calibration, GyroPart, MountPart
    from imu_tracker.captures import Capture
    from imu_tracker.config import Config
    from imu_tracker.samples import Frame, SessionHeader

log = logging.getLogger(__name__)

GYRO_S: Final = 30.0
LEVEL_S: Final = 10.0
FACES_S: Final = 600.0
LATENCY_S: Final = 0.2  # of a receiver, where gps.latency_s is "auto"

_MG: Final = 1e3 / 9.80665


def measure_gyro(
    args: argparse.Namespace, config: "Config"
) -> "tuple[SessionHeader, GyroPart]":
    """Find the bias of the gyroscope while nothing moves."""
    import numpy as np

    from imu_tracker.calibration.bias import fit_gyro
    from imu_tracker.calibration.readings import windows
    from imu_tracker.calibration.still import still_stretches
    from imu_tracker.calibration_file import GyroPart, utc_text

    seconds = args.seconds or GYRO_S
    if args.recording is None:
        log.info("lay it down and do not touch it for %.0f s", seconds)
    taken = _captured(args, config, seconds)
    seen = windows(taken.readings)
    stretches = still_stretches(seen, taken.speeds)
    still_s = sum(stretch.length_s for stretch in stretches)
    if args.recording is None:
        _refuse_motion(seen)
    if still_s < len(seen):
        log.info(
            "it moves: %.0f s of stillness in %d stretches are used",
            still_s,
            len(stretches),
        )
    fit = fit_gyro(stretches)
    sigma = np.degrees(np.sqrt(np.diag(fit.covariance)))
    write(f"{'':4} {'bias, deg/s':>12} {'+-':>8} {'per deg C':>10}\n")
    for axis in range(3):
        slope = "unknown"
        if fit.per_degc is not None:
            slope = f"{math.degrees(fit.per_degc[axis]):+.5f}"
        write(
            f"{'xyz'[axis]:4} {math.degrees(fit.bias_radps[axis]):+12.4f} "
            f"{1.96 * sigma[axis]:8.4f} {slope:>10}\n"
        )
    low, high = fit.temps_degc
    write(f"{fit.length_s:.0f} s at {low:.1f} to {high:.1f} deg C; +- is 95 %\n")
    is_kept = args.temperature and fit.per_degc is not None
    if args.temperature and not is_kept:
        log.warning("the temperature told no slope: it must change by some degrees")
    return taken.header, GyroPart(
        bias_radps=_plain(fit.bias_radps),
        covariance=_plain(fit.covariance),
        temp_degc=fit.temp_degc,
        temps_degc=fit.temps_degc,
        radps_per_degc=_plain(fit.per_degc) if is_kept else None,
        still_s=fit.length_s,
        utc=utc_text(taken.start_utc_s),
    )


def measure_accel(
    args: argparse.Namespace, config: "Config"
) -> "tuple[SessionHeader, AccelPart]":
    """Find bias, scale and cross-axis of the accelerometer, face by face."""
    from imu_tracker.calibration.faces import FaceGuide, fit_faces
    from imu_tracker.calibration.readings import windows
    from imu_tracker.calibration_file import AccelPart, utc_text

    guide = FaceGuide()
    start_utc_s = None
    if args.recording is None:
        header = _guided(args, config, guide)
        gravity_mps2 = _gravity(args.latitude, None)
    else:
        taken = _captured(args, config, 0.0)
        header, start_utc_s = taken.header, taken.start_utc_s
        refused = ""
        for window in windows(taken.readings):
            note = guide.feed(window)
            if note is not None:
                refused = _told(note, is_recorded=True) or refused
        if guide.missing and refused:
            missing = ", ".join(map(str, guide.missing))
            raise CalibrationError(f"not measured: {missing}; {refused}")
        place = next(((f.lat_rad, f.alt_m or 0.0) for _, f in taken.fixes), None)
        gravity_mps2 = _gravity(args.latitude, place)
    fit = fit_faces(guide.measured, gravity_mps2)
    _tell_faces(fit)
    return header, AccelPart(
        bias_mps2=_plain(fit.bias_mps2),
        gain=_plain(fit.gain),
        covariance=_plain(fit.covariance),
        residuals_mps2=_plain(fit.residuals_mps2),
        gravity_mps2=gravity_mps2,
        temp_degc=fit.temp_degc,
        utc=utc_text(start_utc_s),
    )


def _tell_faces(fit: "FacesFit") -> None:
    from imu_tracker.calibration.faces import FACES

    write(f"{'':4} {'bias, mg':>9} {'scale, %':>9}   cross-axis to x, y, z, %\n")
    for axis in range(3):
        error = 100 * (fit.gain[axis] - [axis == 0, axis == 1, axis == 2])
        cross = " ".join(
            "    --" if other == axis else f"{error[other]:+6.2f}" for other in range(3)
        )
        write(
            f"{'xyz'[axis]:4} {_MG * fit.bias_mps2[axis]:+9.1f} {error[axis]:+9.2f}   "
            f"{cross}\n"
        )
    write("residuals x, y, z in mg:\n")
    for face, residual in zip(FACES, fit.residuals_mps2, strict=True):
        write(f"  {face!s:6} " + " ".join(f"{_MG * r:+6.1f}" for r in residual) + "\n")
    bias, scale = (math.sqrt(fit.covariance[i, i]) for i in (0, 1))
    write(
        f"+- {1.96 * _MG * bias:.1f} mg and {196 * scale:.2f} % (95 %), "
        f"{fit.temp_degc:.1f} deg C, gravity {fit.gravity_mps2:.4f} m/s^2\n"
    )


def _guided(
    args: argparse.Namespace, config: "Config", guide: "FaceGuide"
) -> "SessionHeader":
    """Watch the box being turned until all faces are measured, or time is over."""
    from imu_tracker.calibration.readings import WINDOW_S, decode, windows
    from imu_tracker.live_imu import for_seconds
    from imu_tracker.samples import Frame

    seconds = args.seconds or FACES_S
    log.info("lay the box on a level table, on any face, and let go")
    t_s: list[float] = []
    bursts: list[bytes] = []
    header: SessionHeader | None = None
    with _stream(args, config) as stream:
        for item in for_seconds(iter(stream), seconds):
            if not isinstance(item, Frame):
                header = item
                continue
            t_s.append(item.t_ns / 1e9)
            bursts.append(item.data)
            if header is None or len(t_s) < round(WINDOW_S * header.imu_rate_hz):
                continue
            ranges = header.accel_range_g, header.gyro_range_dps
            for window in windows(decode(t_s, bursts, *ranges)):
                if (note := guide.feed(window)) is not None:
                    _told(note, is_recorded=False)
            t_s.clear()
            bursts.clear()
            if not guide.missing:
                break
    if header is None:
        raise CalibrationError("no samples of the IMU")
    return header


def _told(note: "Note", *, is_recorded: bool) -> str:
    """Tell what the guide says; return it when it was a refusal.

    Nobody can act on what is said of a recording: a face seen twice ends it.
    """
    from imu_tracker.calibration.faces import Kind

    text = f"at {note.t_s:.0f} s: {note.text}" if is_recorded else note.text
    if note.kind is Kind.MEASURED:
        log.info("%s", text)
        return ""
    if is_recorded and note.kind is not Kind.MOVED:
        raise CalibrationError(text)
    log.warning("%s", text)
    return text


def _gravity(latitude_deg: float | None, place: tuple[float, float] | None) -> float:
    from imu_tracker.calibration.counts import STANDARD_GRAVITY_MPS2
    from imu_tracker.estimation.geodesy import gravity_mps2

    if latitude_deg is not None:
        return gravity_mps2(math.radians(latitude_deg))
    return STANDARD_GRAVITY_MPS2 if place is None else gravity_mps2(*place)


def measure_mount(
    args: argparse.Namespace,
    config: "Config",
    known_of: "Callable[[str], Calibration]",
) -> "tuple[SessionHeader, MountPart]":
    """Find how the chip sits in its vehicle; `known_of` returns what is known of it."""
    from imu_tracker.calibration.corrected import (
        corrected_arrays,
        mount_matrix,
    )
    from imu_tracker.calibration.mounting import level, manoeuvres, with_yaw
    from imu_tracker.calibration.readings import windows
    from imu_tracker.calibration.still import still_stretches
    from imu_tracker.calibration_file import MountPart, utc_text
    from imu_tracker.samples import DEFAULT_MOUNT

    level_s = args.seconds or LEVEL_S
    if args.recording is None:
        then = f", then drive for {args.drive:.0f} s" if args.drive else ""
        log.info("park on level ground for %.0f s%s", level_s, then)
    taken = _captured(
        args, config, level_s + (args.drive or 0.0), with_gps=args.drive is not None
    )
    mount = config.imu.mount
    if args.recording is not None and "mount" not in config.imu.model_fields_set:
        mount = taken.header.mount or DEFAULT_MOUNT
    seen = windows(taken.readings)
    if args.recording is None and args.drive is None:
        _refuse_motion(seen)
    stretches = still_stretches(seen, taken.speeds)
    if not stretches:
        raise CalibrationError("never stands still: begin on level ground, for 10 s")
    chip_only = known_of(taken.header.chip).model_copy(update={"mount": None})
    readings = corrected_arrays(taken.readings, chip_only.corrections())
    axes = mount_matrix(mount)
    first = readings.part(stretches[0].start, stretches[0].stop)
    fit = level(axes @ first.accel_mps2.mean(axis=0))
    latency_s = config.gps.latency_s
    drive = manoeuvres(
        readings.t_s,
        readings.accel_mps2 @ axes.T,
        (readings.gyro_radps @ axes.T - axes @ first.gyro_radps.mean(axis=0))[:, 2],
        taken.speeds,
        LATENCY_S if latency_s == "auto" else latency_s,
    )
    if drive or args.drive is not None:
        try:
            fit = with_yaw(fit, drive)
        except CalibrationError as error:
            if args.drive is not None:
                raise
            log.warning("yaw is not measured: %s", error)
    roll, pitch = fit.tilt_rad
    write(
        f"roll  {math.degrees(roll):+7.2f} deg\npitch {math.degrees(pitch):+7.2f} deg\n"
    )
    if fit.yaw_rad is None or fit.yaw_sigma_rad is None:
        write("yaw   not measured: that takes a drive\n")
        yaw_sigma_deg = None
    else:
        yaw_sigma_deg = math.degrees(fit.yaw_sigma_rad)
        write(
            f"yaw   {math.degrees(fit.yaw_rad):+7.2f} deg, "
            f"+- {1.96 * yaw_sigma_deg:.2f} (95 %)\n"
        )
    return taken.header, MountPart(
        mount=mount,
        rotation=_plain(fit.rotation),
        yaw_sigma_deg=yaw_sigma_deg,
        temp_degc=float(first.temp_degc.mean()),
        utc=utc_text(taken.start_utc_s),
    )


@contextlib.contextmanager
def _stream(
    args: argparse.Namespace, config: "Config", *, with_gps: bool = False
) -> Iterator["Iterable[SessionHeader | Frame]"]:
    """Open the recording, or the chip."""
    if args.recording is not None:
        from imu_tracker.recording import read_recording

        yield read_recording(args.recording)
        return
    from imu_tracker.live_imu import live_frames
    from imu_tracker.sensors.clock import MonotonicClock

    live = live_frames(config, MonotonicClock(), with_gps=with_gps)
    with contextlib.closing(live):
        yield live


def _captured(
    args: argparse.Namespace, config: "Config", live_s: float, *, with_gps: bool = False
) -> "Capture":
    from imu_tracker.captures import capture
    from imu_tracker.live_imu import for_seconds

    with _stream(args, config, with_gps=with_gps) as stream:
        if args.recording is None:
            total = round(live_s * config.imu.rate_hz)
            stream = progress(
                for_seconds(iter(stream), live_s), args, " samples", total
            )
        return capture(stream)


def _refuse_motion(seen: "list[Window]") -> None:
    from imu_tracker.calibration.still import is_quiet, is_steady

    if not all(is_quiet(window) and is_steady(window, seen[0]) for window in seen):
        raise CalibrationError(
            "it moved: lay it on something firm, do not touch it, and try again"
        )


def _plain(array: Any) -> Any:
    """Turn an array into nested lists, which is what the file holds."""
    return array.tolist()
