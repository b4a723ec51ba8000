"""The sections of the page: what the owner of a tracker asks, in this order."""

import itertools
import math
from collections.abc import Iterable
from html import escape
from typing import Any, Final

from imu_tracker.report.charts import Span, bar_chart, line_chart
from imu_tracker.report.collect import Collected
from imu_tracker.report.measures.track_log import Outage, TrackLog
from imu_tracker.samples import Mode
from imu_tracker.storage.latlong import format_utc

MOST_OUTAGES: Final = 30
NOWHERE: Final = "\N{EN DASH}"


def number(value: float, unit: str = "", digits: int = 1) -> str:
    """Write a number for people; a dash for what was not measured."""
    if math.isnan(value):
        return NOWHERE
    return f"{value:.{digits}f}{'&nbsp;' if unit else ''}{unit}"


def length(metres: float) -> str:
    """Write a distance."""
    if math.isnan(metres):
        return NOWHERE
    if metres >= 10_000.0:
        return number(metres / 1000.0, "km")
    return number(metres, "m", 0 if metres >= 100.0 else 1)


def duration(seconds: float) -> str:
    """Write a stretch of time."""
    if math.isnan(seconds):
        return NOWHERE
    if seconds < 120.0:
        return number(seconds, "s", 0)
    minutes = round(seconds / 60.0)
    if minutes < 120:
        return f"{minutes}&nbsp;min"
    return f"{minutes // 60}&nbsp;h&nbsp;{minutes % 60:02d}"


def table(rows: Iterable[tuple[str, str]]) -> str:
    """Lay out names and values; the values are HTML already."""
    cells = (f"<tr><th>{escape(n)}</th><td>{v}</td></tr>" for n, v in rows)
    return f'<table class="facts">{"".join(cells)}</table>'


def summary_section(collected: Collected) -> str:
    """Return the tiles at the top."""
    track = collected.track
    total_s = sum(track.modes_s.values())
    gps_s = track.modes_s[Mode.GPS] + track.modes_s[Mode.GPSONLY]
    r95 = [one.mean for one in track.r95.bins()]
    longest_s = max((o.length_s for o in track.outages), default=0.0)
    tiles = [
        ("long", duration(collected.length_s)),
        ("driven", length(track.way_m)),
        ("with GPS", _share(gps_s, total_s)),
        ("standing", _share(track.modes_s[Mode.STILL], total_s)),
        ("dead reckoning", _share(track.modes_s[Mode.DR], total_s)),
        ("outages", str(len(track.outages))),
        ("longest outage", duration(longest_s) if track.outages else NOWHERE),
        ("usual radius r95", length(sorted(r95)[len(r95) // 2]) if r95 else NOWHERE),
    ]
    cells = (f"<div><dd>{value}</dd><dt>{name}</dt></div>" for name, value in tiles)
    return f'<dl class="tiles">{"".join(cells)}</dl>'


def time_section(collected: Collected) -> str:
    """Return speed and radius over time."""
    track, span = collected.track, _span(collected.track)
    shades = _shades(track)
    return line_chart("Speed", "m/s", track.speed, span, shades=shades) + line_chart(
        "Radius r95: the true place is inside with 95 %",
        "m",
        track.r95,
        span,
        shades=shades,
        is_log=True,
    )


def outages_section(collected: Collected) -> str:
    """Return where the receiver was blind, and how far off the track was then."""
    outages = collected.track.outages
    if not collected.track.rows:
        return "<p>There was no fix at all.</p>"
    if not outages:
        return "<p>The receiver was never without a fix for more than 5 s.</p>"
    shown = sorted(outages, key=lambda o: -o.length_s)[:MOST_OUTAGES]
    rows = "".join(map(_outage, sorted(shown, key=lambda o: o.begin_utc_s)))
    more = ""
    if len(outages) > len(shown):
        more = f"<p>The {len(shown)} longest of {len(outages)}.</p>"
    return (
        '<div class="wide"><table><thead><tr><th>began (UTC)</th><th>lasted</th>'
        "<th>driven</th><th>ended at</th><th>off by</th><th>r95 said</th><th></th></tr>"
        f"</thead><tbody>{rows}</tbody></table></div>{more}<p>Off by: how far the "
        "first fix after it lay from where the track was by then. The fix has an error "
        "of its own: it fits when it lies within the radius and that error together."
        "</p>"
    )


def _outage(outage: Outage) -> str:
    is_back = not math.isnan(outage.miss_m)
    verdict = "" if not is_back else "fits" if outage.is_true else "<b>outside</b>"
    time = format_utc(outage.begin_utc_s)[11:19]
    return (
        f"<tr><td>{time}</td><td>{duration(outage.length_s)}</td>"
        f"<td>{length(outage.way_m)}</td>"
        f"<td>{outage.lat_deg:.5f}, {outage.lon_deg:.5f}</td>"
        f"<td>{length(outage.miss_m)}</td><td>{length(outage.r95_m)}</td>"
        f"<td>{verdict}</td></tr>"
    )


def trust_section(collected: Collected) -> str:
    """Return how true the radius was, by the receiver's own fixes."""
    track, overall = collected.track, collected.track.overall()
    if overall is None:
        return "<p>There are no fixes to compare the track with.</p>"
    span, periods = _span(track), track.periods()
    wide_s = 60.0
    if len(periods) > 1:
        wide_s = min(
            b.begin_utc_s - a.begin_utc_s for a, b in itertools.pairwise(periods)
        )
    begins = [period.begin_utc_s - track.first_utc_s for period in periods]
    inside = [
        (begin, 100.0 * period.inside)
        for begin, period in zip(begins, periods, strict=True)
    ]
    nis = [(begin, p.nis) for begin, p in zip(begins, periods, strict=True)]
    each = {60.0: "minute", 600.0: "ten minutes", 3600.0: "hour"}.get(wide_s, "hour")
    places = "".join(
        f"<tr><td>{p.lat_deg:.4f}, {p.lon_deg:.4f}</td><td>{p.fixes}</td>"
        f"<td>{length(p.miss_m)}</td></tr>"
        for p in track.places()[:5]
    )
    return (
        "<p>Before each fix is used, it is compared with where the track says that "
        f"the vehicle is. <b>{overall.inside:.0%}</b> of {overall.fixes} fixes lay "
        "within the radius and the receiver's own error together; 95 % should, and "
        "with a good receiver nearly all do. They lay "
        f"{length(overall.miss_m)} from it (rms), and the mean radius was "
        f"{length(overall.r95_m)}.</p>"
        + bar_chart(
            f"Fixes inside, each {each}", "%", inside, wide_s, span, high=100, wanted=95
        )
        + bar_chart(
            f"Squared error over its expectation (NIS), each {each}; 2 is as expected, "
            "less is cautious",
            "",
            nis,
            wide_s,
            span,
            high=max(4.0, math.ceil(max(value for _, value in nis))),
            wanted=2.0,
        )
        + line_chart("Fix against track", "m", track.miss, span, is_log=True)
        + "<h3>Where the receiver is noisiest</h3><table><thead><tr><th>place (200 m "
        "around)</th><th>fixes</th><th>off (rms)</th></tr></thead>"
        f"<tbody>{places}</tbody></table>"
    )


_LEARNT: Final = {
    "profile": "kind of motion",
    "mounting_deg": "box against vehicle: roll, pitch, yaw (deg)",
    "gyro_bias_dps": "gyro's zero (deg/s)",
    "accel_bias_mps2": "accelerometer's zero (m/s^2)",
    "delay_s": "receiver later than configured (s)",
    "velocity_delay_s": "its velocity later (s)",
    "velocity_sigma_mps": "noise of its velocity (m/s)",
    "fix_noise_level": "noise of its position, against its own word",
    "fix_period_s": "from fix to fix (s)",
    "axle_m": "from the box to the axle (m)",
    "still_gyro_threshold_dps": "it stands below (deg/s)",
    "still_accel_threshold_mps2": "and below (m/s^2)",
}


def learnt_section(collected: Collected) -> str:
    """Return what the estimator found out."""
    if collected.sensors is None:
        return "<p>A log does not say what was learnt.</p>"
    if not collected.track.rows:
        return "<p>Nothing: there was no fix to learn from.</p>"
    learnt = collected.sensors.result["learnt"]
    rows = [
        (words, _value(learnt[key]))
        for key, words in _LEARNT.items()
        if learnt.get(key) is not None
    ]
    wheels = learnt.get("wheels") or {}
    if circumference_m := wheels.get("circumference_m"):
        rows.append(("circumference of the wheels (m)", f"{circumference_m:.3f}"))
    notices = "".join(
        f"<li>{duration(notice.t_s)}: {escape(notice.text)}</li>"
        for notice in collected.sensors.notices[:40]
    )
    return (
        table(rows)
        + f"<details><summary>What the tracker told on the way</summary><ul>{notices}"
        "</ul></details>"
    )


def _value(value: Any) -> str:
    match value:
        case float():
            return f"{value:.3g}"
        case list() | tuple():
            return ", ".join(map(_value, value))
        case _:
            return escape(str(value))


def _share(part_s: float, total_s: float) -> str:
    return f"{part_s / total_s:.0%}" if total_s > 0.0 else NOWHERE


def _span(track: TrackLog) -> Span:
    if not track.rows:
        return Span(1.0, math.nan)
    return Span(max(track.last_utc_s - track.first_utc_s, 1.0), track.first_utc_s)


def _shades(track: TrackLog) -> list[tuple[float, float]]:
    """Outages in seconds since the first row."""
    return [
        (
            o.begin_utc_s - track.first_utc_s,
            o.begin_utc_s - track.first_utc_s + o.length_s,
        )
        for o in track.outages
    ]
