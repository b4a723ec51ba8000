"""KML 2.2 for Google Earth and its like: tracks in time, coloured by mode.

ElementTree writes one placemark after another. simplekml would hold the whole document
in memory, and what it writes does not pass the OGC schema (numbers as ids, styles
before the name).

Source: OGC 07-147r2; Google's gx:Track, developers.google.com/kml.
"""

import math
from collections.abc import Iterable, Iterator
from typing import Final
from xml.etree import ElementTree as ET

from imu_tracker.exports.merging import Point, Run, runs
from imu_tracker.exports.palette import MODES
from imu_tracker.storage.latlong import LogRow, format_utc

_COLUMNS: Final = (
    ("alt_m", "float", "height above the sea, m"),
    ("speed_mps", "float", "speed, m/s"),
    ("course_deg", "float", "course, degrees"),
    ("r95_m", "float", "r95, m"),
    ("mode", "string", "mode"),
)

_BEGIN: Final = """\
<?xml version="1.0" encoding="UTF-8"?>
<kml xmlns="http://www.opengis.net/kml/2.2" xmlns:gx="http://www.google.com/kml/ext/2.2">
<Document>
<name>imu-tracker</name>
"""
_END: Final = "</Document>\n</kml>\n"


def kml(points: Iterable[Point]) -> Iterator[str]:
    """Yield the document piece by piece."""
    yield _BEGIN
    for mode, (colour, _) in MODES.items():
        yield _text(_style(mode, colour))
    yield _text(_schema())
    for run in runs(points):
        yield _text(_placemark(run))
    yield _END


def _text(element: ET.Element) -> str:
    return ET.tostring(element, encoding="unicode") + "\n"


def _style(name: str, colour: str) -> ET.Element:
    red, green, blue = colour[1:3], colour[3:5], colour[5:7]
    style = ET.Element("Style", id=name)
    icon = ET.SubElement(style, "IconStyle")
    ET.SubElement(icon, "scale").text = "0.5"
    line = ET.SubElement(style, "LineStyle")
    ET.SubElement(line, "color").text = f"ff{blue}{green}{red}".lower()
    ET.SubElement(line, "width").text = "4"
    return style


def _schema() -> ET.Element:
    schema = ET.Element("Schema", name="row", id="row")
    for name, kind, title in _COLUMNS:
        column = ET.SubElement(schema, "gx:SimpleArrayField", name=name, type=kind)
        ET.SubElement(column, "displayName").text = title
    return schema


def _placemark(run: Run) -> ET.Element:
    """Return the rows, and the row before them, so that the line has no hole."""
    rows = run.rows if run.before is None else [run.before, *run.rows]
    placemark = ET.Element("Placemark")
    ET.SubElement(placemark, "name").text = f"{run.track}: {MODES[run.mode][1]}"
    ET.SubElement(placemark, "styleUrl").text = f"#{run.mode}"
    track = ET.SubElement(placemark, "gx:Track")
    ET.SubElement(track, "altitudeMode").text = "clampToGround"
    for row in rows:
        ET.SubElement(track, "when").text = format_utc(row.utc_s)
    for row in rows:
        ET.SubElement(track, "gx:coord").text = _coordinates(row)
    data = ET.SubElement(track, "ExtendedData")
    table = ET.SubElement(data, "SchemaData", schemaUrl="#row")
    for name, _, _ in _COLUMNS:
        column = ET.SubElement(table, "gx:SimpleArrayData", name=name)
        for row in rows:
            ET.SubElement(column, "gx:value").text = _value(getattr(row, name))
    return placemark


def _coordinates(row: LogRow) -> str:
    height = "0" if math.isnan(row.alt_m) else f"{row.alt_m:.1f}"
    return f"{row.lon_deg:.8f} {row.lat_deg:.8f} {height}"


def _value(value: float | str) -> str:
    if isinstance(value, str):
        return value
    return "" if math.isnan(value) else str(value)
