"""Sentences of a live row, read by pynmea2."""

import pynmea2
import pytest

from imu_tracker.guidance.guide import Guide
from imu_tracker.guidance.route import Waypoint
from imu_tracker.serve.nmea_sentences import sentences
from imu_tracker.serve.view import Shown
from imu_tracker.storage.latlong import LogRow

ROW = LogRow(1795348801.25, 51.99, 4.37, 5.2, 10.0, 0.0, 3.8, "gps")
ROUTE = [Waypoint("start", 51.98, 4.37), Waypoint("A, B*", 52.0, 4.37)]


def parsed(shown: Shown, limit_m: float = 100.0) -> dict[str, pynmea2.NMEASentence]:
    lines = sentences(shown, limit_m).decode("ascii").split("\r\n")
    assert lines.pop() == ""
    told = [pynmea2.parse(line, check=True) for line in lines]
    return {sentence.sentence_type: sentence for sentence in told}


def test_a_parked_car_with_gps_is_measured() -> None:
    told = parsed(Shown(ROW._replace(mode="still"), has_fix=True, guidance=None))
    assert told["RMC"].status == "A"
    assert told["RMC"].mode_indicator == "A"
    assert told["GGA"].gps_qual == 1
    assert told["VTG"].faa_mode == "A"


def test_without_a_fix_it_is_estimated_and_beyond_the_limit_not_valid() -> None:
    told = parsed(Shown(ROW._replace(mode="dr"), has_fix=False, guidance=None))
    assert (told["RMC"].status, told["RMC"].mode_indicator) == ("A", "E")
    assert told["GGA"].gps_qual == 6
    far = ROW._replace(mode="dr", r95_m=100.1)
    told = parsed(Shown(far, has_fix=False, guidance=None))
    assert (told["RMC"].status, told["GGA"].gps_qual) == ("V", 0)


def test_hdop_is_such_that_gpsd_finds_r95() -> None:
    told = parsed(Shown(ROW, has_fix=True, guidance=None))
    assert float(told["GSA"].hdop) * 19.0 == pytest.approx(3.8)
    assert told["GSA"].mode_fix_type == "3"
    assert told["RMC"].timestamp.isoformat() == "12:00:01.250000+00:00"


def test_a_route_is_told_to_an_autopilot() -> None:
    row = ROW._replace(lon_deg=4.371)
    told = parsed(Shown(row, has_fix=True, guidance=Guide(ROUTE, 30, 100).at(row)))
    assert told["RMB"].dest_waypoint_id == "A B"
    assert told["RMB"].cross_track_error == "0.037"  # 69 m to the right: steer left
    assert told["RMB"].cte_correction_dir == "L"
    assert float(told["RMB"].dest_range) == pytest.approx(0.601, abs=0.002)
    assert told["APB"].data[:5] == ["A", "A", "0.037", "L", "N"]
    assert told["XTE"].data[:5] == ["A", "A", "0.037", "L", "N"]
    assert told["BWC"].data[9:12] == ["0.601", "N", "A B"]


def test_where_it_cannot_tell_the_autopilot_is_told_so() -> None:
    row = ROW._replace(r95_m=60.0)
    told = parsed(Shown(row, has_fix=True, guidance=Guide(ROUTE, 30, 50).at(row)))
    assert told["RMC"].status == "A"
    assert told["RMB"].data[0] == "V"
    assert told["XTE"].data[:2] == ["V", "V"]
