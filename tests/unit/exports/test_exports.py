"""The exported formats, read back by their schemas and by other people's libraries."""

import itertools
import json
import math
import random
import shutil
import subprocess
import tracemalloc
from collections.abc import Callable, Iterable, Iterator, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import fastkml
import gpxpy
import pynmea2
import pytest
from lxml import etree

from imu_tracker.errors import UsageError
from imu_tracker.exports.geojson import geojson
from imu_tracker.exports.gpx import gpx
from imu_tracker.exports.kml import kml
from imu_tracker.exports.merging import MAX_RUN, Point, merged, runs, spaced
from imu_tracker.exports.nmea import nmea
from imu_tracker.exports.page import html
from imu_tracker.exports.thinning import Thinner
from imu_tracker.storage.latlong import HEADER, LogRow

NOON_S = datetime(2026, 11, 22, 12, tzinfo=UTC).timestamp()
NAN = math.nan
GPX = "{http://www.topografix.com/GPX/1/1}"
GARMIN = "{http://www.garmin.com/xmlschemas/TrackPointExtension/v2}"
OWN = "{urn:imu-tracker:latlong:1}"

Write = Callable[[Iterable[Point]], Iterator[str]]


def a_row(second: float, **fields: Any) -> LogRow:
    row = LogRow(NOON_S + second, 51.99000012, 4.37000034, 5.2, 1.38, 40.1, 3.94, "gps")
    return row._replace(**fields)


DRIVE = [
    a_row(1.25),
    a_row(1.5, alt_m=NAN, course_deg=NAN, speed_mps=0.0, mode="still", r95_m=4.0),
    a_row(1.75, lat_deg=-0.00000001, lon_deg=-179.99999999, alt_m=-3.5),
    a_row(60.0, lat_deg=-89.9, lon_deg=180.0, mode="dr", r95_m=12345.67),
    a_row(60.25, lat_deg=-89.9, lon_deg=179.5, mode="gpsonly"),
]
"""Empty fields, a leap over the 180th meridian, a gap, all modes, ends of ranges."""


def line_of(row: LogRow) -> str:
    """A row as the contract has it, written without the code under test."""
    time = datetime.fromtimestamp(row.utc_s, UTC).isoformat(timespec="milliseconds")
    alt = "" if math.isnan(row.alt_m) else f"{row.alt_m:.1f}"
    course = "" if math.isnan(row.course_deg) else f"{row.course_deg:.1f}"
    return (
        f"{time.replace('+00:00', 'Z')},{row.lat_deg:.8f},{row.lon_deg:.8f},{alt},"
        f"{row.speed_mps:.2f},{course},{row.r95_m:.2f},{row.mode}"
    )


def a_log(path: Path, rows: Iterable[LogRow]) -> Path:
    path.write_text("\n".join([HEADER, *map(line_of, rows), ""]))
    return path


def points_of(rows: Sequence[LogRow], tmp_path: Path) -> list[Point]:
    return list(merged([a_log(tmp_path / "drive.csv", rows)]))


# ------------------------------------------------------------------------ merging


def test_logs_that_follow_one_another_are_one_track_in_whatever_order(
    tmp_path: Path,
) -> None:
    late = a_log(tmp_path / "late.csv", [a_row(2.0), a_row(2.25)])
    early = a_log(tmp_path / "early.csv", [a_row(1.0), a_row(1.25)])
    points = list(merged([late, early]))
    assert {(point.track, point.segment) for point in points} == {("early.csv", 0)}
    assert [point.row.utc_s - NOON_S for point in points] == [1.0, 1.25, 2.0, 2.25]


def test_a_gap_begins_a_segment(tmp_path: Path) -> None:
    rows = [a_row(1.0), a_row(3.5), a_row(6.25)]
    assert [point.segment for point in points_of(rows, tmp_path)] == [0, 0, 1]


def test_the_180th_meridian_begins_a_segment_and_greenwich_does_not(
    tmp_path: Path,
) -> None:
    degrees = (-0.01, 0.01, 179.99, 180.0, -179.99)
    rows = [a_row(i / 4, lon_deg=lon) for i, lon in enumerate(degrees)]
    assert [point.segment for point in points_of(rows, tmp_path)] == [0, 0, 0, 0, 1]


def test_logs_of_the_same_time_are_tracks_of_their_own(tmp_path: Path) -> None:
    (tmp_path / "other").mkdir()
    rows = [a_row(1.0), a_row(1.25)]
    logs = [a_log(tmp_path / name, rows) for name in ("a.csv", "other/a.csv")]
    points = list(merged(logs))
    assert [point.track for point in points] == ["a.csv"] * 2 + ["a.csv (2)"] * 2
    assert [point.segment for point in points] == [0, 0, 1, 1]


def test_logs_without_rows_are_left_out(tmp_path: Path) -> None:
    empty, full = a_log(tmp_path / "a.csv", []), a_log(tmp_path / "b.csv", DRIVE[:1])
    assert [point.track for point in merged([empty, full])] == ["b.csv"]
    assert list(merged([empty])) == []


def test_thinning_in_time_keeps_each_change_of_mode(tmp_path: Path) -> None:
    modes = ["gps"] * 5 + ["dr"] * 5
    rows = [a_row(i / 4, mode=mode) for i, mode in enumerate(modes)]
    kept = [point.row for point in spaced(points_of(rows, tmp_path), 1.0)]
    assert [row.utc_s - NOON_S for row in kept] == [0.0, 1.0, 1.25, 2.25]


def test_runs_hold_every_row_once_and_know_where_their_lines_begin(
    tmp_path: Path,
) -> None:
    rows = [a_row(i / 4, mode="gps" if i < MAX_RUN + 5 else "dr") for i in range(10010)]
    found = list(runs(points_of(rows, tmp_path)))
    assert [len(run.rows) for run in found] == [MAX_RUN, 5, 5]
    assert [run.mode for run in found] == ["gps", "gps", "dr"]
    assert found[0].before is None
    assert found[1].before == found[0].rows[-1]
    assert found[2].before == found[1].rows[-1]


# ---------------------------------------------------------------------------- GPX


def test_gpx_has_the_elements_of_the_schema_in_its_order(tmp_path: Path) -> None:
    root = ET.fromstring("".join(gpx(points_of(DRIVE, tmp_path))))
    assert root.tag == f"{GPX}gpx"
    assert root.attrib["version"] == "1.1"
    assert root.attrib["creator"] == "imu-tracker"
    assert [track.tag for track in root] == [f"{GPX}trk"]
    assert [part.tag for part in root[0]] == [f"{GPX}name"] + [f"{GPX}trkseg"] * 3
    order = [f"{GPX}{name}" for name in ("ele", "time", "extensions")]
    for point in root.iter(f"{GPX}trkpt"):
        assert set(point.attrib) == {"lat", "lon"}
        assert -90 <= float(point.attrib["lat"]) <= 90
        assert -180 <= float(point.attrib["lon"]) < 180  # longitudeType
        assert "e" not in point.attrib["lat"]  # xsd:decimal
        tags = [child.tag for child in point]
        assert tags == [tag for tag in order if tag in tags]
        assert tags[-2:] == order[-2:]


def test_gpx_carries_every_column(tmp_path: Path) -> None:
    text = "".join(gpx(points_of(DRIVE, tmp_path)))
    (track,) = gpxpy.parse(text).tracks
    assert track.name == "drive.csv"
    found = [point for segment in track.segments for point in segment.points]
    assert [len(segment.points) for segment in track.segments] == [2, 1, 2]
    for row, point in zip(DRIVE, found, strict=True):
        assert point.time is not None
        assert point.time.timestamp() == row.utc_s
        assert point.latitude == row.lat_deg
        assert point.longitude == (-180 if row.lon_deg == 180 else row.lon_deg)
        assert point.elevation == (None if math.isnan(row.alt_m) else row.alt_m)
        garmin, r95, mode = point.extensions
        speed, *course = garmin
        assert (speed.tag, float(speed.text)) == (f"{GARMIN}speed", row.speed_mps)
        known = [] if math.isnan(row.course_deg) else [row.course_deg]
        assert [float(element.text) for element in course] == known
        assert (r95.tag, float(r95.text)) == (f"{OWN}r95_m", row.r95_m)
        assert (mode.tag, mode.text) == (f"{OWN}mode", row.mode)


def test_names_of_files_do_no_harm_to_xml(tmp_path: Path) -> None:
    log = a_log(tmp_path / "a <b> & \x01\udcff.csv", DRIVE[:1])
    root = ET.fromstring("".join(gpx(merged([log]))))
    assert root[0][0].text == "a <b> & \ufffd\ufffd.csv"
    assert "a &lt;b&gt; &amp; \ufffd" in "".join(kml(merged([log])))


# ---------------------------------------------------------------------------- KML


@pytest.fixture(scope="module")
def kml_schema() -> etree.XMLSchema:
    """OGC's schema of KML 2.2 with Google's extensions."""
    (package,) = fastkml.__path__
    return etree.XMLSchema(file=Path(package) / "schema" / "kml22gx.xsd")


@pytest.mark.parametrize("rows", [[], DRIVE[:1], DRIVE], ids=len)
def test_kml_is_valid_by_its_schema(
    rows: list[LogRow], kml_schema: etree.XMLSchema, tmp_path: Path
) -> None:
    text = "".join(kml(points_of(rows, tmp_path)))
    kml_schema.assertValid(etree.fromstring(text.encode()))


def test_kml_carries_every_column(tmp_path: Path) -> None:
    root = ET.fromstring("".join(kml(points_of(DRIVE, tmp_path))))
    of = {"k": "http://www.opengis.net/kml/2.2"}
    of["gx"] = "http://www.google.com/kml/ext/2.2"
    rows: dict[str, tuple[str | None, ...]] = {}
    for track in root.iterfind(".//gx:Track", of):
        columns = [[when.text for when in track.iterfind("k:when", of)]]
        columns += [[coord.text for coord in track.iterfind("gx:coord", of)]]
        for array in track.iterfind(".//gx:SimpleArrayData", of):
            columns += [[value.text or "" for value in array]]
        for time, *values in zip(*columns, strict=True):
            assert time is not None
            assert rows.setdefault(time, tuple(values)) == tuple(values)
    assert rows["2026-11-22T12:00:01.250Z"] == (
        *("4.37000034 51.99000012 5.2", "5.2", "1.38", "40.1", "3.94", "gps"),
    )
    assert rows["2026-11-22T12:00:01.500Z"] == (
        *("4.37000034 51.99000012 0", "", "0.0", "", "4.0", "still"),
    )
    assert rows["2026-11-22T12:01:00.000Z"][4] == "12345.67"
    assert len(rows) == len(DRIVE)


# ------------------------------------------------------------------------ GeoJSON


def test_geojson_obeys_rfc_7946(tmp_path: Path) -> None:
    text = "".join(geojson(points_of(DRIVE, tmp_path)))
    document = json.loads(text, parse_constant=pytest.fail)
    assert set(document) == {"type", "features"}
    assert document["type"] == "FeatureCollection"
    for feature in document["features"]:
        assert set(feature) == {"type", "geometry", "properties"}
        assert feature["type"] == "Feature"
        geometry = feature["geometry"]
        assert set(geometry) == {"type", "coordinates"}
        positions = geometry["coordinates"]
        if geometry["type"] == "Point":
            positions = [positions]
        else:
            assert geometry["type"] == "LineString"
            assert len(positions) >= 2  # section 3.1.4
        for lon_deg, lat_deg in positions:  # section 3.1.1: longitude first
            assert -180 <= lon_deg <= 180
            assert -90 <= lat_deg <= 90
        for (west, _), (east, _) in itertools.pairwise(positions):
            assert abs(east - west) <= 180  # section 3.1.9: cut at the meridian


def test_geojson_carries_every_column(tmp_path: Path) -> None:
    document = json.loads("".join(geojson(points_of(DRIVE, tmp_path))))
    points = [f for f in document["features"] if f["geometry"]["type"] == "Point"]
    assert points[1] == {
        "type": "Feature",
        "geometry": {"type": "Point", "coordinates": [4.37000034, 51.99000012]},
        "properties": {
            "track": "drive.csv",
            "time_utc": "2026-11-22T12:00:01.500Z",
            "alt_m": None,
            "speed_mps": 0.0,
            "course_deg": None,
            "r95_m": 4.0,
            "mode": "still",
        },
    }
    assert len(points) == len(DRIVE)
    lines = [f for f in document["features"] if f["geometry"]["type"] != "Point"]
    assert [line["properties"]["mode"] for line in lines] == ["still", "gpsonly"]
    assert lines[0]["properties"]["r95_max_m"] == 4.0


# --------------------------------------------------------------------------- NMEA


def sentences(rows: Sequence[LogRow], tmp_path: Path) -> list[Any]:
    text = "".join(nmea(points_of(rows, tmp_path)))
    assert all(len(line) <= 80 for line in text.split("\r\n"))  # 82 with CR LF
    return [pynmea2.parse(line, check=True) for line in text.splitlines()]


def test_nmea_says_what_the_log_says(tmp_path: Path) -> None:
    found = sentences(DRIVE, tmp_path)
    assert [s.sentence_type for s in found] == ["RMC", "GGA", "GST"] * len(DRIVE)
    rmc, gga, gst = found[:3]
    assert rmc.datetime.timestamp() == NOON_S + 1.25
    assert (rmc.status, rmc.mode_indicator, gga.gps_qual) == ("A", "A", 1)
    assert rmc.spd_over_grnd * 1852 / 3600 == pytest.approx(1.38, abs=0.001)
    assert rmc.true_course == 40.1
    assert (gga.altitude, gga.altitude_units) == (5.2, "M")
    for row, rmc, gga in zip(DRIVE, found[::3], found[1::3], strict=True):
        for sentence in (rmc, gga):  # a millionth of a minute is 2 mm
            assert sentence.latitude == pytest.approx(row.lat_deg, abs=1e-8)
            assert sentence.longitude == pytest.approx(row.lon_deg, abs=1e-8)
    # 95 % of a circular normal error: chi-square with two degrees of freedom, 5.991.
    assert gst.std_dev_latitude == pytest.approx(3.94 / math.sqrt(5.991), abs=1e-3)
    assert gst.std_dev_longitude == gst.std_dev_latitude


def test_nmea_leaves_empty_what_is_not_known(tmp_path: Path) -> None:
    _, _, _, rmc, gga, _ = sentences(DRIVE[:2], tmp_path)
    assert rmc.true_course is None
    assert gga.altitude is None
    assert gga.horizontal_dil == ""


@pytest.mark.skipif(shutil.which("gpsdecode") is None, reason="no gpsdecode here")
@pytest.mark.parametrize(("alt_m", "fix_mode"), [(5.2, 3), (NAN, 2)])
def test_gpsd_understands_every_row(
    alt_m: float, fix_mode: int, tmp_path: Path
) -> None:
    """Debian 12: `sudo apt install gpsd-clients`; 13: `gpsd-tools`."""
    modes = ["gps", "dr", "still", "gpsonly"]
    rows = [a_row(i / 4, mode=modes[i % 4], alt_m=alt_m) for i in range(20)]
    text = "".join(nmea(points_of(rows, tmp_path)))
    told = subprocess.run(
        ["gpsdecode"], input=text, capture_output=True, text=True, check=True
    )
    reports = [json.loads(line) for line in told.stdout.splitlines()]
    fixes = {report["time"]: report for report in reports if report["class"] == "TPV"}
    for row in rows[1:-1]:  # gpsd needs two to know where an epoch ends
        time = datetime.fromtimestamp(row.utc_s, UTC).isoformat(timespec="milliseconds")
        fix = fixes[time.replace("+00:00", "Z")]
        assert fix["mode"] == fix_mode
        assert fix.get("status") == (5 if row.mode in ("dr", "still") else None)
        assert fix["lat"] == pytest.approx(row.lat_deg, abs=1e-7)
        assert fix["lon"] == pytest.approx(row.lon_deg, abs=1e-7)
        assert fix["speed"] == pytest.approx(1.38, abs=0.001)
        assert fix["track"] == 40.1
    errors = [report for report in reports if report["class"] == "GST"]
    assert {error["lat"] for error in errors} == {1.61}


@pytest.mark.parametrize(
    ("mode", "indicator", "quality"),
    [("gps", "A", 1), ("gpsonly", "A", 1), ("dr", "E", 6), ("still", "E", 6)],
)
def test_nmea_calls_reckoning_an_estimate(
    mode: str, indicator: str, quality: int, tmp_path: Path
) -> None:
    rmc, gga, _ = sentences([a_row(0.0, mode=mode)], tmp_path)
    assert (rmc.mode_indicator, gga.gps_qual) == (indicator, quality)


def test_nmea_of_logs_of_the_same_time_is_refused(tmp_path: Path) -> None:
    logs = [a_log(tmp_path / f"{name}.csv", DRIVE[:2]) for name in "ab"]
    with pytest.raises(UsageError, match=r"b\.csv goes back in time"):
        list(nmea(merged(logs)))


# --------------------------------------------------------------- how much memory


def endless(rows: int) -> Iterator[Point]:
    """A drive that wanders, with an outage of a minute in every ten."""
    dice = random.Random(7)
    lat_deg = 52.0
    for i in range(rows):
        lat_deg += dice.uniform(-1e-5, 1e-5)
        mode = "dr" if i % 2400 < 240 else "gps"
        yield Point("a.csv", 0, a_row(i / 4, lat_deg=lat_deg, mode=mode))


@pytest.mark.parametrize("write", [gpx, kml, geojson, nmea])
def test_a_long_log_takes_no_more_memory_than_a_short_one(write: Write) -> None:
    peaks = []
    for rows in (3_000, 9_000):
        tracemalloc.start()
        for _ in write(endless(rows)):
            pass
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert peaks[1] < 1.1 * peaks[0] + 100_000


def test_a_map_keeps_so_many_points_and_the_ends_of_each_outage() -> None:
    thinner = Thinner(1000)
    thinner.add_all(endless(20_000))
    kept = [point.row for point in thinner.points]
    assert thinner.taken == 20_000
    assert len(kept) <= 1000
    seconds = {round((row.utc_s - NOON_S) * 4) for row in kept}
    starts = set(range(0, 20_000, 2400))
    assert starts | {start + 239 for start in starts} <= seconds
    assert 19_999 in seconds
    assert thinner.step_m > 0


def test_what_stands_still_takes_two_points_when_room_is_scarce() -> None:
    thinner = Thinner(100)
    thinner.add_all(Point("a", 0, a_row(i / 4, mode="still")) for i in range(10_000))
    assert len(thinner.points) <= 2 + 1
    assert thinner.points[-1].row.utc_s == NOON_S + 9_999 / 4


def test_a_growing_radius_stays_on_the_map_when_nothing_moves() -> None:
    thinner = Thinner(100)
    thinner.add_all(
        Point("a", 0, a_row(i / 4, mode="dr", r95_m=4.0 + i / 10)) for i in range(1000)
    )
    radii = [point.row.r95_m for point in thinner.points]
    assert max(b / a for a, b in itertools.pairwise(radii)) < 1.5


def test_more_runs_than_points_still_end() -> None:
    thinner = Thinner(100)
    modes = itertools.cycle(["gps", "dr"])
    thinner.add_all(Point("a", 0, a_row(i / 4, mode=next(modes))) for i in range(1000))
    assert 50 <= len(thinner.points) <= 101


def test_a_map_asks_nothing_of_the_net_and_names_cannot_end_its_script(
    tmp_path: Path,
) -> None:
    log = a_log(tmp_path / "a <script>alert(1)<", DRIVE)
    page = "".join(html(merged([log])))
    assert "http:" not in page
    assert "https:" not in page
    assert "src=" not in page
    assert page.count("<script") == page.count("</script>") == 2
