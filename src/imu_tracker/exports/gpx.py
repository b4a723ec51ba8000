"""GPX 1.1: tracks for nearly every program that knows maps.

gpxpy writes each point; a whole document of its objects would cost 0.7 kB a row. GPX
has no place for speed, course and error: speed and course go where Garmin's extension
of track points has them, r95 and mode into one of our own. `hdop` stays empty, because
it is no number of metres, and so does `fix`: a row does not say which satellites there
were.

Source: GPX 1.1 schema, topografix.com; TrackPointExtension v2, garmin.com.
"""

import itertools
import math
from collections.abc import Iterable, Iterator
from datetime import UTC, datetime
from typing import Final
from xml.etree import ElementTree as ET
from xml.sax.saxutils import escape

from gpxpy.gpx import GPX, GPXTrackPoint
from gpxpy.gpxfield import gpx_fields_to_xml

from imu_tracker.exports.merging import Point
from imu_tracker.storage.latlong import LogRow

OWN: Final = "urn:imu-tracker:latlong:1"
GARMIN: Final = "http://www.garmin.com/xmlschemas/TrackPointExtension/v2"

_NAMESPACES: Final = {"imu": OWN, "gpxtpx": GARMIN}
_END: Final = "</gpx>"


def gpx(points: Iterable[Point]) -> Iterator[str]:
    """Yield the document piece by piece."""
    document = GPX()
    document.creator = "imu-tracker"
    document.nsmap = dict(_NAMESPACES)
    yield document.to_xml(version="1.1").removesuffix(_END)
    for name, track in itertools.groupby(points, lambda point: point.track):
        yield f"  <trk>\n    <name>{escape(name)}</name>\n"
        for _, segment in itertools.groupby(track, lambda point: point.segment):
            yield "    <trkseg>"
            for point in segment:
                yield _track_point(point.row)
            yield "\n    </trkseg>\n"
        yield "  </trk>\n"
    yield f"{_END}\n"


def _track_point(row: LogRow) -> str:
    point = GPXTrackPoint(
        row.lat_deg,
        -180.0 if row.lon_deg == 180.0 else row.lon_deg,  # longitudeType: below 180
        None if math.isnan(row.alt_m) else row.alt_m,
        datetime.fromtimestamp(round(row.utc_s, 3), UTC),
    )
    garmin = ET.Element(f"{{{GARMIN}}}TrackPointExtension")
    ET.SubElement(garmin, f"{{{GARMIN}}}speed").text = f"{row.speed_mps:.2f}"
    if not math.isnan(row.course_deg):
        ET.SubElement(garmin, f"{{{GARMIN}}}course").text = f"{row.course_deg:.1f}"
    r95, mode = ET.Element(f"{{{OWN}}}r95_m"), ET.Element(f"{{{OWN}}}mode")
    r95.text, mode.text = f"{row.r95_m:.2f}", row.mode
    point.extensions = [garmin, r95, mode]
    xml: str = gpx_fields_to_xml(
        point, "trkpt", "1.1", nsmap=_NAMESPACES, prettyprint=False
    )
    return xml
