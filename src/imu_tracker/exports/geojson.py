"""GeoJSON: a point for each row with all of its columns, and lines by mode.

The json module is all it takes; the library geojson is a thin layer over it that holds
the whole collection. The height is a property and not a third coordinate: that one is
above the ellipsoid, and ours is above the sea.

Source: RFC 7946, sections 3.1.1, 3.1.9 and 3.3.
"""

import json
import math
from collections.abc import Iterable, Iterator
from typing import Any

from imu_tracker.exports.merging import Point, Run, runs
from imu_tracker.storage.latlong import LogRow, format_utc


def geojson(points: Iterable[Point]) -> Iterator[str]:
    """Yield the document piece by piece, a feature a line."""
    yield '{"type": "FeatureCollection", "features": ['
    separator = "\n"
    for run in runs(points):
        for feature in _features(run):
            yield separator + json.dumps(feature, allow_nan=False)
            separator = ",\n"
    yield "\n]}\n"


def _features(run: Run) -> Iterator[dict[str, Any]]:
    for row in run.rows:
        properties = {
            "track": run.track,
            "time_utc": format_utc(row.utc_s),
            "alt_m": _known(row.alt_m),
            "speed_mps": row.speed_mps,
            "course_deg": _known(row.course_deg),
            "r95_m": row.r95_m,
            "mode": row.mode,
        }
        yield _feature("Point", _position(row), properties)
    line = run.rows if run.before is None else [run.before, *run.rows]
    if len(line) > 1:
        yield _feature(
            "LineString",
            [_position(row) for row in line],
            {
                "track": run.track,
                "begin_utc": format_utc(line[0].utc_s),
                "end_utc": format_utc(line[-1].utc_s),
                "r95_max_m": max(row.r95_m for row in run.rows),
                "mode": run.mode,
            },
        )


def _feature(kind: str, coordinates: Any, properties: dict[str, Any]) -> dict[str, Any]:
    geometry = {"type": kind, "coordinates": coordinates}
    return {"type": "Feature", "geometry": geometry, "properties": properties}


def _position(row: LogRow) -> list[float]:
    return [row.lon_deg, row.lat_deg]


def _known(value: float) -> float | None:
    return None if math.isnan(value) else value
