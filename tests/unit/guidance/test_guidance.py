"""Along a route: legs, waypoints that are passed, and when it cannot tell."""

from pathlib import Path

import pytest
from gpxpy.geo import haversine_distance

from imu_tracker.errors import InputMissingError, RouteError
from imu_tracker.guidance.guide import Guide, GuideState
from imu_tracker.guidance.route import Waypoint, bearing_deg, distance_m, read_route
from imu_tracker.storage.latlong import LogRow

MILE_M = 1852.0
ROUTE = [  # north for a mile along a meridian, then east for a mile on the equator
    Waypoint("start", -1 / 60, 0.0),
    Waypoint("corner", 0.0, 0.0),
    Waypoint("end", 0.0, 1 / 60),
]


def row(lat: float, lon: float, *, course: float = 0.0, r95: float = 4.0) -> LogRow:
    return LogRow(1e9, lat, lon, 5.0, 10.0, course, r95, "gps")


def gpx(body: str) -> str:
    return (
        '<?xml version="1.0"?><gpx version="1.1" creator="t" '
        f'xmlns="http://www.topografix.com/GPX/1/1">{body}</gpx>'
    )


def test_half_a_mile_before_the_corner_and_beside_the_leg() -> None:
    told = Guide(ROUTE, 30.0, 100.0).at(row(-0.5 / 60, 0.1 / 60))
    assert (told.state, told.waypoint.name) == (GuideState.ON_THE_WAY, "corner")
    assert (told.number, told.total) == (2, 3)
    assert told.cross_track_m == pytest.approx(0.1 * MILE_M, rel=1e-4)  # to the right
    assert told.distance_m == pytest.approx(MILE_M * 0.26**0.5, rel=1e-4)
    assert told.bearing_deg == pytest.approx(360 - 11.31, abs=0.01)
    assert told.leg_bearing_deg == pytest.approx(0.0)
    assert told.rest_m == pytest.approx(told.distance_m + MILE_M, rel=1e-6)
    towards = 10.0 * 0.5 / 0.26**0.5
    assert told.time_to_go_s == pytest.approx(told.distance_m / towards, rel=1e-3)


def test_left_of_the_leg_is_negative() -> None:
    told = Guide(ROUTE, 30.0, 100.0).at(row(-0.5 / 60, -0.1 / 60))
    assert told.cross_track_m == pytest.approx(-0.1 * MILE_M, rel=1e-4)


def test_a_waypoint_that_was_passed_beside_is_behind_us() -> None:
    guide = Guide(ROUTE, 30.0, 100.0)
    assert guide.at(row(-0.5 / 60, -0.1 / 60)).waypoint.name == "corner"
    assert guide.at(row(0.01 / 60, -0.1 / 60)).waypoint.name == "end"
    assert guide.at(row(-0.02 / 60, -0.1 / 60)).waypoint.name == "end"


def test_it_arrives_once_and_stays_there() -> None:
    guide = Guide(ROUTE, 30.0, 100.0)
    assert guide.at(row(0.0, 0.5 / 60)).state is GuideState.ON_THE_WAY
    assert guide.at(row(0.0, 1 / 60 - 0.015 / 60)).state is GuideState.ARRIVED
    assert guide.at(row(0.0, 1.5 / 60)).state is GuideState.ARRIVED


def test_with_a_large_radius_it_cannot_tell_and_stays_on_its_leg() -> None:
    guide = Guide(ROUTE, 30.0, 100.0)
    guide.at(row(-0.5 / 60, 0.0))
    told = guide.at(row(0.0, 0.9 / 60, r95=101.0))
    assert (told.state, told.waypoint.name) == (GuideState.UNSURE, "corner")
    assert guide.at(row(0.0, 0.9 / 60)).waypoint.name == "end"


def test_it_begins_on_the_nearest_leg() -> None:
    assert Guide(ROUTE, 30.0, 100.0).at(row(0.001, 0.5 / 60)).waypoint.name == "end"


def test_who_stands_or_goes_away_has_no_time_to_go() -> None:
    guide = Guide(ROUTE, 30.0, 100.0)
    assert guide.at(row(-0.5 / 60, 0.0, course=180.0)).time_to_go_s is None
    assert guide.at(row(-0.5 / 60, 0.0, course=float("nan"))).time_to_go_s is None


@pytest.mark.parametrize(
    ("one", "other"),
    [((52.0, 4.3), (52.1, 4.4)), ((0.0, 179.9), (0.1, -179.9)), ((-33, 18), (51, 0))],
)
def test_distances_are_those_of_another_library(
    one: tuple[float, float], other: tuple[float, float]
) -> None:
    ours = distance_m(Waypoint("", *one), Waypoint("", *other))
    assert ours == pytest.approx(haversine_distance(*one, *other), rel=3e-3)


def test_a_bearing_over_the_180th_meridian_goes_the_short_way() -> None:
    bearing = bearing_deg(Waypoint("", 0.0, 179.9), Waypoint("", 0.0, -179.9))
    assert bearing == pytest.approx(90.0)


def test_a_route_is_taken_before_a_track(tmp_path: Path) -> None:
    path = tmp_path / "way.gpx"
    path.write_text(
        gpx(
            '<rte><rtept lat="1" lon="2"><name>A\nB</name></rtept>'
            '<rtept lat="1" lon="2"/><rtept lat="1" lon="3"/></rte>'
            '<trk><trkseg><trkpt lat="9" lon="9"/><trkpt lat="9" lon="8"/>'
            "</trkseg></trk>"
        )
    )
    assert read_route(path) == [Waypoint("A B", 1, 2), Waypoint("2", 1, 3)]


def test_a_track_of_several_segments_is_one_way(tmp_path: Path) -> None:
    path = tmp_path / "way.gpx"
    path.write_text(
        gpx(
            '<trk><trkseg><trkpt lat="9" lon="9"/></trkseg>'
            '<trkseg><trkpt lat="9" lon="8"/></trkseg></trk>'
        )
    )
    assert [place.lon_deg for place in read_route(path)] == [9, 8]


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("nonsense", "no GPX file"),
        (gpx(""), "no route"),
        (gpx('<rte><rtept lat="1" lon="2"/></rte>'), "at least two"),
        (gpx('<rte><rtept lat="91" lon="2"/><rtept lat="1" lon="2"/></rte>'), "Earth"),
        (gpx('<rte><rtept lat="nan" lon="2"/><rtept lat="1" lon="2"/></rte>'), "way"),
        ('<!DOCTYPE gpx [<!ENTITY a "b">]>' + gpx(""), "document type"),
        ("\xff", "no GPX file"),
    ],
)
def test_a_route_that_is_none_is_refused_in_one_line(
    text: str, why: str, tmp_path: Path
) -> None:
    path = tmp_path / "way.gpx"
    path.write_text(text, encoding="latin-1")
    with pytest.raises(RouteError, match=why) as caught:
        read_route(path)
    assert "\n" not in str(caught.value)
    assert str(caught.value).startswith(f"{path}: ")


def test_a_route_that_is_not_there_is_missing(tmp_path: Path) -> None:
    with pytest.raises(InputMissingError, match=r"way\.gpx: No such file"):
        read_route(tmp_path / "way.gpx")
