"""The report as one HTML file: opens anywhere, asks nothing of any network."""

import json
import math
import re
from collections.abc import Iterable
from html import escape
from importlib import resources
from typing import Final

from imu_tracker import __version__
from imu_tracker.exports.page import asset, map_data
from imu_tracker.report.collect import Collected
from imu_tracker.report.finding import Finding, Weight
from imu_tracker.report.sections import (
    learnt_section,
    outages_section,
    summary_section,
    time_section,
    trust_section,
)
from imu_tracker.report.sensor_sections import sensors_sections
from imu_tracker.storage.latlong import format_utc

PLACES: Final = 5
"""The noisiest places that are marked on the map."""

_WEIGHTS: Final = {Weight.BAD: "bad", Weight.POOR: "poor", Weight.NOTE: "note"}
_SAID: Final = {Weight.BAD: "mend it", Weight.POOR: "improve it", Weight.NOTE: "note"}


def html(collected: Collected, findings: list[Finding]) -> str:
    """Return the page."""
    track = collected.track
    data = map_data(track.thinner.points, track.thinner)
    data["places"] = [
        [place.lat_deg, place.lon_deg, round(place.miss_m, 1)]
        for place in track.places()[:PLACES]
        if collected.sensors is not None and place.miss_m > 5.0
    ]
    parts = {
        "title": escape(_title(collected)),
        "head": _head(collected),
        "findings": _findings(findings, has_sensors=collected.sensors is not None),
        "summary": summary_section(collected),
        "time": time_section(collected),
        "outages": outages_section(collected),
        "trust": trust_section(collected),
        "learnt": learnt_section(collected),
        "sensors": sensors_sections(collected),
        "version": __version__,
        "style": asset("map.css") + _own("report.css"),
        "script": asset("map.js"),
        "own_script": _own("report.js"),
        "data": json.dumps(data, separators=(",", ":")).replace("<", "\\u003c"),
    }
    return re.sub(r"\{\{(\w+)\}\}", lambda mark: parts[mark[1]], _own("report.html"))


def _own(name: str) -> str:
    return resources.files("imu_tracker.report").joinpath(name).read_text("utf-8")


def _title(collected: Collected) -> str:
    names = collected.names
    return names[0] if len(names) == 1 else f"{names[0]} and {len(names) - 1} more"


def _head(collected: Collected) -> str:
    track = collected.track
    if not track.rows or math.isnan(track.first_utc_s):
        return "no track"
    begin, end = format_utc(track.first_utc_s), format_utc(track.last_utc_s)
    is_same_day = begin[:10] == end[:10]
    return (
        f"{begin[:10]} {begin[11:16]} to {end[11:16] if is_same_day else end[:16]} UTC"
    )


def _findings(findings: Iterable[Finding], *, has_sensors: bool) -> str:
    items = [
        f'<li class="{_WEIGHTS[one.weight]}" data-kind="{one.kind}">'
        f"<b>{escape(one.what)}</b> <i>{_SAID[one.weight]}</i>"
        + (f"<p>{escape(one.how_it_shows)}</p>" if one.how_it_shows else "")
        + f'<p class="do">{escape(one.what_to_do)}</p></li>'
        for one in findings
    ]
    if items:
        return f'<ul class="findings">{"".join(items)}</ul>'
    if has_sensors:
        return '<p class="fine">Nothing is wrong with this installation.</p>'
    return (
        '<p class="fine">A log says nothing of the sensors: for advice make the report '
        "from a recording (record.path keeps one).</p>"
    )
