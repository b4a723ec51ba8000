"""A map in one HTML file: opens anywhere, asks nothing of the net.

The page draws itself, by some two hundred lines of script of our own in `map.js`:
a library for maps is twenty times that and shines with tiles, which we have not. This
module fills in the points, as columns of whole numbers to keep the file small.
"""

import json
import math
from collections.abc import Iterable, Iterator
from importlib import resources
from itertools import groupby
from typing import Any, Final

from imu_tracker.exports.merging import Point
from imu_tracker.exports.palette import MODES
from imu_tracker.exports.thinning import Thinner
from imu_tracker.storage.latlong import LogRow

MAX_POINTS: Final = 50_000
"""Three and a half hours at four rows a second; a telephone still draws it smoothly."""

_MARK: Final = "{{data}}"


def html(points: Iterable[Point]) -> Iterator[str]:
    """Yield the page; the points are thinned when there are too many."""
    thinner = Thinner(MAX_POINTS)
    thinner.add_all(points)
    page = asset("page.html").replace("{{style}}", asset("map.css"))
    begin, _, end = page.replace("{{script}}", asset("map.js")).partition(_MARK)
    yield begin
    text = json.dumps(
        map_data(thinner.points, thinner), separators=(",", ":"), allow_nan=False
    )
    yield text.replace("<", "\\u003c")  # a name must not end the script
    yield end


def asset(name: str) -> str:
    """Return a file of this room: the map's script and style, which others show too."""
    return resources.files("imu_tracker.exports").joinpath(name).read_text("utf-8")


def map_data(points: list[Point], thinner: Thinner) -> dict[str, Any]:
    """Return points as the script of the map reads them."""
    names = [name for name, _ in groupby(points, lambda point: point.track)]
    return {
        "rows": thinner.taken,
        "step_m": thinner.step_m,
        "modes": [[mode, *MODES[mode]] for mode in MODES],
        "tracks": names,
        "segments": [
            _columns(list(segment), names)
            for _, segment in groupby(points, lambda point: point.segment)
        ],
    }


def _columns(points: list[Point], names: list[str]) -> dict[str, Any]:
    """Return the rows of a segment; times and degrees as steps from row to row."""
    rows = [point.row for point in points]
    modes = list(MODES)
    return {
        "track": names.index(points[0].track),
        "t_ms": _steps(round(row.utc_s * 1000.0) for row in rows),
        "lat_e7": _steps(round(row.lat_deg * 1e7) for row in rows),
        "lon_e7": _steps(round(row.lon_deg * 1e7) for row in rows),
        "alt_dm": [_whole(row.alt_m, 10) for row in rows],
        "speed_cmps": [_whole(row.speed_mps, 100) for row in rows],
        "course_ddeg": [_whole(row.course_deg, 10) for row in rows],
        "r95_cm": [_whole(row.r95_m, 100) for row in rows],
        "mode": [_place(row, modes) for row in rows],
    }


def _steps(values: Iterable[int]) -> list[int]:
    steps, last = [], 0
    for value in values:
        steps.append(value - last)
        last = value
    return steps


def _whole(value: float, scale: int) -> int | None:
    return None if math.isnan(value) else round(value * scale)


def _place(row: LogRow, modes: list[Any]) -> int:
    return modes.index(row.mode)
