"""The sections of receiver and IMU."""

import math
from html import escape

from imu_tracker.report.charts import Span, line_chart
from imu_tracker.report.collect import Collected, Sensors
from imu_tracker.report.sections import duration, number, table


def sensors_sections(collected: Collected) -> str:
    """Return receiver and IMU."""
    if collected.sensors is None:
        return ""
    span = Span(collected.length_s, _zero_utc_s(collected))
    return _receiver(collected.sensors, span) + _imu(collected.sensors, span)


def _zero_utc_s(collected: Collected) -> float:
    """UTC of the first frame, as well as the rows tell it."""
    track = collected.track
    if not track.rows:
        return math.nan
    return track.last_utc_s - collected.length_s


def _receiver(sensors: Sensors, span: Span) -> str:
    of, log = sensors.receiver, sensors.receiver_log
    kinds = ", ".join(f"{escape(kind)} {n}" for kind, n in of.kinds.items())
    rate_hz = 1.0 / of.interval_s if of.interval_s else math.nan
    baud = "not to be told" if of.baud is None else f"{of.baud} baud"
    rows = [
        ("sentences", kinds or "none"),
        ("fixes", f"{of.fixes} of {of.epochs} reports"),
        ("rate", number(rate_hz, "a second")),
        ("first fix after", duration(of.first_fix_s)),
        ("longest gap", duration(of.longest_gap_s)),
        ("lost for some seconds", f"{of.short_losses} times"),
        (
            "delay: 95 % within",
            f"{number(of.lateness_s, 's', 2)} of the fastest",
        ),
        ("line", f"{baud}, busy {number(100.0 * of.busy_share, '%', 0)}"),
        ("jumps", str(of.jumps)),
        ("its own error, per axis", number(of.sigma_m, "m", 2)),
        ("satellites used", number(of.satellites, "", 0)),
        ("HDOP", number(of.hdop)),
        ("signal of the best four", number(of.signal_dbhz, "dB-Hz", 0)),
    ]
    return (
        "<section><h2>The receiver</h2>"
        + table(rows)
        + line_chart("Satellites used", "", log.satellites, span)
        + line_chart("Signal of the best four", "dB-Hz", log.signal, span)
        + "</section>"
    )


def _imu(sensors: Sensors, span: Span) -> str:
    of, log = sensors.imu, sensors.imu_log
    if of is None:
        return "<section><h2>The IMU</h2><p>No samples.</p></section>"
    low, high = of.temps_degc
    rows = [
        ("chip", escape(of.chip)),
        ("rate", f"{number(of.rate_hz, 'Hz')} (nominal {number(of.nominal_hz)})"),
        ("jitter of the times", number(1000.0 * of.jitter_s, "ms", 2)),
        ("gaps", f"{of.gaps}, the longest {duration(of.longest_gap_s)}"),
        ("vibration, driving", number(of.vibration_mps2, "m/s\N{SUPERSCRIPT TWO}")),
        ("jolts, driving", number(of.rattle_dps, "\N{DEGREE SIGN}/s")),
        ("samples at the end of the range", str(of.clipped)),
        ("temperature", f"{number(low, '', 0)} to {number(high, 'C', 0)}"),
        ("stops", str(of.stops)),
        ("gravity, standing", number(of.gravity_g, "g", 3)),
        ("gyro's zero, standing", number(of.bias_dps, "\N{DEGREE SIGN}/s", 2)),
        ("gyro's noise, standing", number(of.noise_dps, "\N{DEGREE SIGN}/s", 2)),
    ]
    return (
        "<section><h2>The IMU</h2>"
        + table(rows)
        + line_chart("Vibration", "m/s\N{SUPERSCRIPT TWO}", log.vibration, span)
        + line_chart("Samples", "a second", log.rate, span)
        + line_chart("Temperature", "\N{DEGREE SIGN}C", log.temperature, span)
        + "</section>"
    )
