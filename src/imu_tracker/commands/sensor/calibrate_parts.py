"""The measurements of `imu-tracker calibrate gyro` and `calibrate accel`.

Each takes the live chip or a recording, tells what it found, and returns the header of
the chip and its part of the calibration file.
"""

import argparse
import logging
import math
from typing import TYPE_CHECKING, Final

from imu_tracker.commands.common import write
from imu_tracker.commands.sensor.calibrate_sources import (
    captured,
    live_stream,
    live_windows,
    plain,
    refuse_motion,
)
from imu_tracker.errors import CalibrationError

if TYPE_CHECKING:
    from imu_tracker.calibration.faces import FaceGuide, FacesFit, Note
    from imu_tracker.config import Config
    from imu_tracker.samples import SessionHeader
    from imu_tracker.storage.calibration_file import AccelPart, GyroPart

log = logging.getLogger(__name__)

GYRO_S: Final = 30.0
FACES_S: Final = 600.0

_MG: Final = 1e3 / 9.80665


def measure_gyro(
    args: argparse.Namespace, config: "Config"
) -> "tuple[SessionHeader, GyroPart]":
    """Find the bias of the gyroscope while nothing moves."""
    import numpy as np

    from imu_tracker.calibration.bias import fit_gyro
    from imu_tracker.calibration.readings import windows
    from imu_tracker.calibration.still import still_stretches
    from imu_tracker.storage.calibration_file import GyroPart, utc_text

    seconds = args.seconds or GYRO_S
    if args.recording is None:
        log.info("lay it down and do not touch it for %.0f s", seconds)
    taken = captured(args, config, seconds)
    seen = windows(taken.readings)
    stretches = still_stretches(seen, taken.speeds)
    still_s = sum(stretch.length_s for stretch in stretches)
    if args.recording is None:
        refuse_motion(seen)
    if 0 < still_s < len(seen):
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
        bias_radps=plain(fit.bias_radps),
        covariance=plain(fit.covariance),
        temp_degc=fit.temp_degc,
        temps_degc=fit.temps_degc,
        radps_per_degc=plain(fit.per_degc) if is_kept else None,
        still_s=fit.length_s,
        utc=utc_text(taken.start_utc_s),
    )


def measure_accel(
    args: argparse.Namespace, config: "Config"
) -> "tuple[SessionHeader, AccelPart]":
    """Find bias, scale and cross-axis of the accelerometer, face by face."""
    from imu_tracker.calibration.faces import FaceGuide, fit_faces
    from imu_tracker.calibration.readings import windows
    from imu_tracker.storage.calibration_file import AccelPart, utc_text

    guide = FaceGuide()
    start_utc_s = None
    if args.recording is None:
        header = _guided(args, config, guide)
        gravity_mps2 = _gravity(args.latitude, None)
    else:
        taken = captured(args, config, 0.0)
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
        bias_mps2=plain(fit.bias_mps2),
        gain=plain(fit.gain),
        covariance=plain(fit.covariance),
        residuals_mps2=plain(fit.residuals_mps2),
        gravity_mps2=gravity_mps2,
        temp_degc=fit.temp_degc,
        utc=utc_text(start_utc_s),
    )


def _tell_faces(fit: "FacesFit") -> None:
    from imu_tracker.calibration.faces import FACES, grade

    grades = grade(fit)
    write(
        f"{'':4} {'bias, mg':>9} {'scale, %':>9}   cross-axis to x, y, z, %   grade\n"
    )
    for axis in range(3):
        error = 100 * (fit.gain[axis] - [axis == 0, axis == 1, axis == 2])
        cross = " ".join(
            "    --" if other == axis else f"{error[other]:+6.2f}" for other in range(3)
        )
        write(
            f"{'xyz'[axis]:4} {_MG * fit.bias_mps2[axis]:+9.1f} {error[axis]:+9.2f}   "
            f"{cross}     {grades[axis]}\n"
        )
    if set(grades) != {"good"}:
        write(
            "Calibrated it serves, but such a chip drifts more with temperature: "
            "calibrate it where it works, and again when the seasons change.\n"
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
    from imu_tracker.sources.polled import for_seconds

    seconds = args.seconds or FACES_S
    log.info("lay the box on a level table, on any face, and let go")
    with live_stream(config) as (header, frames):
        for window, _ in live_windows(header, for_seconds(frames, seconds)):
            if (note := guide.feed(window)) is not None:
                _told(note, is_recorded=False)
            if not guide.missing:
                break
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
    if is_recorded and note.kind not in (Kind.MOVED, Kind.HELD):
        raise CalibrationError(text)
    log.warning("%s", text)
    return text


def _gravity(latitude_deg: float | None, place: tuple[float, float] | None) -> float:
    from imu_tracker.calibration.counts import STANDARD_GRAVITY_MPS2
    from imu_tracker.geometry.geodesy import gravity_mps2

    if latitude_deg is not None:
        return gravity_mps2(math.radians(latitude_deg))
    return STANDARD_GRAVITY_MPS2 if place is None else gravity_mps2(*place)
