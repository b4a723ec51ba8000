"""`imu-tracker characterise`: what a sensor is like while it lies still."""

import argparse
import contextlib
import json
import logging
import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

from imu_tracker.commands.common import (
    Subparsers,
    add_command,
    add_config,
    config_of,
    new_file,
    positive,
    progress,
    refuse_to_overwrite,
    write,
)
from imu_tracker.errors import CalibrationError, UsageError

if TYPE_CHECKING:
    from imu_tracker.calibration.allan import Coefficient
    from imu_tracker.calibration.measures import AxisMeasures
    from imu_tracker.config import Config
    from imu_tracker.recording.capture import Capture
    from imu_tracker.recording.sensor_report import Report

log = logging.getLogger(__name__)

_DESCRIPTION = """\
Measure a chip that lies still: bias, noise, spread, Allan deviation, temperature, the
rate of its samples, and a verdict against the datasheet of the MPU-6050. A minute is
enough for noise and bias; what a bias does over minutes takes an hour or two. It ends
with lines for the configuration.

Of a recording that moves only the stretches without motion are used. Stop the daemon
before measuring the live chip."""

_EXAMPLES = """\
  imu-tracker characterise --live 120 --config /etc/imu-tracker/imu-tracker.toml
  imu-tracker record --output still.rec.gz --duration 7200
  imu-tracker characterise still.rec.gz --plot still.png
  imu-tracker characterise still.rec.gz --json"""


def add_characterise(subparsers: Subparsers) -> None:
    """Add the command."""
    parser = add_command(
        subparsers,
        "characterise",
        "noise, bias and Allan deviation of a still sensor",
        _DESCRIPTION,
        _EXAMPLES,
    )
    parser.add_argument(
        "recording", nargs="?", type=Path, metavar="REC", help="a recording"
    )
    parser.add_argument(
        "--live",
        type=positive,
        metavar="S",
        help="measure the chip itself for so many seconds",
    )
    parser.add_argument(
        "--plot",
        type=new_file,
        metavar="PNG",
        help="draw histograms, Allan deviation, temperature; .svg and .pdf work, too",
    )
    parser.add_argument(
        "--json", action="store_true", help="print the figures as one JSON object"
    )
    add_config(parser)
    parser.set_defaults(run=run_characterise)


def run_characterise(args: argparse.Namespace) -> int:
    """Measure and tell."""
    if (args.recording is None) == (args.live is None):
        raise UsageError("give either a recording or --live SECONDS")
    config = config_of(args)
    refuse_to_overwrite([args.plot], [args.recording])

    from imu_tracker.recording.sensor_report import report_of

    try:
        taken = _captured(args, config)
        report = report_of(taken)
    except CalibrationError as error:
        where = f"{args.recording}: " if args.recording is not None else ""
        raise CalibrationError(f"{where}{error}") from error
    if report.still_s < report.length_s - 1.0:
        log.warning(
            "it moves: only the %.0f s without motion are used, of %.0f s",
            report.still_s,
            report.length_s,
        )
    if args.plot is not None:
        from imu_tracker.plots.noise import plot_noise

        name = "live" if args.recording is None else args.recording.name
        plot_noise(report, name.replace("$", r"\$"), args.plot)
        log.info("%s: written", args.plot)
    if args.json:
        write(json.dumps(_json(report)) + "\n")
        return 0
    write("".join(f"{line}\n" for line in _lines(report)))
    write("".join(f"{line}\n" for line in _configuration(report, config)))
    return 0


def _captured(args: argparse.Namespace, config: "Config") -> "Capture":
    from imu_tracker.recording.capture import capture

    if args.recording is not None:
        from imu_tracker.recording.files import read_recording

        return capture(progress(read_recording(args.recording), args, " records"))
    from imu_tracker.sensors.clock import MonotonicClock
    from imu_tracker.sources.polled import for_seconds, live_frames

    log.info("lay it down and do not touch it for %.0f s", args.live)
    total = round(args.live * config.imu.rate_hz)
    with contextlib.closing(live_frames(config, MonotonicClock())) as live:
        return capture(progress(for_seconds(live, args.live), args, " samples", total))


def _unit(axis: "AxisMeasures") -> float:
    """From SI to what people read: gyro in degrees."""
    return math.degrees(1.0) if axis.name.startswith("gyro") else 1.0


def _lines(report: "Report") -> list[str]:
    """Return the tables for people."""
    low, high = report.temps_degc
    several = "stretch" if report.stretches == 1 else "stretches"
    lines = [
        f"{report.chip}: {report.still_s:.0f} s still in {report.stretches} {several}, "
        f"{low:.1f} to {high:.1f} deg C",
        f"sample rate {report.rate_hz:.3f} Hz ({report.rate_error:+.2%} of nominal), "
        f"jitter {report.jitter_s * 1e6:.0f} us rms, {report.missing} samples missing",
        "",
        f"{'':8} {'mean':>10} {'std':>9} {'variance':>10} {'kurtosis':>9} "
        f"{'clipped':>8}  verdict",
    ]
    for axis in report.axes:
        k = _unit(axis)
        reason = f": {axis.reason}" if axis.reason else ""
        lines.append(
            f"{axis.name:8} {axis.mean * k:+10.5f} {axis.std * k:9.5f} "
            f"{axis.variance * k * k:10.3e} {axis.excess_kurtosis:+9.2f} "
            f"{axis.clipped:8.2%}  {axis.verdict}{reason}"
        )
    lines += [
        "accel in m/s^2, gyro in deg/s; kurtosis: 0 is Gaussian",
        "",
        "from the Allan deviation, with 95 % intervals:",
        f"{'':8} {'random walk':>28} {'bias instability':>28} {'rate random walk':>28} "
        f"{'lowest':>9} {'at':>7}",
    ]
    for axis in report.axes:
        k = _unit(axis)
        if axis.noise is None:
            lines.append(f"{axis.name:8} too short, or always the same")
            continue
        cells = " ".join(f"{_interval(c, k):>28}" for c in axis.noise[:3])
        lines.append(
            f"{axis.name:8} {cells} {axis.noise.lowest * k:9.3g} "
            f"{axis.noise.lowest_tau_s:5.0f} s"
        )
    lines += [
        "accel: m/s/sqrt(s), m/s^2, m/s^2/sqrt(s); gyro: deg/sqrt(s), deg/s, "
        "deg/s/sqrt(s)",
        "",
        *_temperature(report),
    ]
    return lines


def _interval(coefficient: "Coefficient", k: float) -> str:
    value, low, high = (x * k for x in coefficient)
    if low == 0.0:
        return f"below {high:.3g}"
    return f"{value:.3g} [{low:.3g}, {high:.3g}]"


def _temperature(report: "Report") -> list[str]:
    slopes = [axis for axis in report.axes if axis.slope is not None]
    if not slopes:
        low, high = report.temps_degc
        return [
            f"temperature slope: not to be told from {high - low:.1f} deg C of change"
        ]
    return ["temperature slope, per deg C, +- 95 %:"] + [
        f"{axis.name:8} {axis.slope * _unit(axis):+.5f} +- "
        f"{1.96 * axis.slope_sigma * _unit(axis):.5f}"
        for axis in slopes
        if axis.slope is not None and axis.slope_sigma is not None
    ]


def _configuration(report: "Report", config: "Config") -> list[str]:
    """Return lines that can be pasted into the configuration."""
    lines = ["", "# for the configuration:", "[imu]"]
    nominal_hz = 1000.0 / max(1, min(125, round(1000.0 / report.rate_hz)))
    lines.append(f"rate_hz = {nominal_hz:.6g}")
    accel_g, gyro_dps = report.accel_range_g, report.gyro_range_dps
    wider = any(axis.clipped > 0 for axis in report.axes[:3])
    faster = any(axis.clipped > 0 for axis in report.axes[3:])
    accel_g = min(16, accel_g * 2) if wider else accel_g
    gyro_dps = min(2000, gyro_dps * 2) if faster else gyro_dps
    lines.append(f"accel_range_g = {accel_g}" + ("  # it was clipped" if wider else ""))
    lines.append(
        f"gyro_range_dps = {gyro_dps}" + ("  # it was clipped" if faster else "")
    )
    mount = ", ".join(f'"{axis}"' for axis in report.mount)
    lines.append(f"mount = [{mount}]{report.mount_comment}")
    if config.imu.calibration is not None:
        path = json.dumps(str(config.imu.calibration))
        lines.append(f"calibration = {path}  # made by: imu-tracker calibrate gyro")
    return lines


def _json(report: "Report") -> dict[str, Any]:
    return {
        "chip": report.chip,
        "length_s": report.length_s,
        "still_s": report.still_s,
        "stretches": report.stretches,
        "temps_degc": list(report.temps_degc),
        "rate_hz": report.rate_hz,
        "rate_error": report.rate_error,
        "jitter_s": report.jitter_s,
        "missing_samples": report.missing,
        "mount": list(report.mount),
        "axes": {axis.name: _axis_json(axis) for axis in report.axes},
    }


def _axis_json(axis: "AxisMeasures") -> dict[str, Any]:
    """Return one axis in SI units, gyro in rad/s."""
    noise = None
    if axis.noise is not None:
        noise = {
            name: dict(zip(("value", "low95", "high95"), coefficient, strict=True))
            for name, coefficient in (
                ("random_walk", axis.noise.random_walk),
                ("bias_instability", axis.noise.bias_instability),
                ("rate_random_walk", axis.noise.rate_random_walk),
            )
        }
        noise["lowest"] = {
            "deviation": axis.noise.lowest,
            "tau_s": axis.noise.lowest_tau_s,
        }
    return {
        "mean": axis.mean,
        "std": axis.std,
        "variance": axis.variance,
        "excess_kurtosis": axis.excess_kurtosis,
        "clipped": axis.clipped,
        "per_degc": axis.slope,
        "per_degc_sigma": axis.slope_sigma,
        "allan": {
            "tau_s": axis.curve.tau_s.tolist(),
            "deviation": axis.curve.deviation.tolist(),
        },
        "noise": noise,
        "verdict": axis.verdict,
        "reason": axis.reason,
    }
