"""What single sentences say, and what they must not be read to say."""

from datetime import UTC, datetime
from math import degrees

import pytest

from imu_tracker.errors import NmeaError
from imu_tracker.sensors.gnss.fields import MPS_PER_KNOT
from imu_tracker.sensors.gnss.sentences import Report, read_sentence
from support.nmea_text import gga, gll, rmc, sentence


def read(line: bytes) -> Report:
    report = read_sentence(line)
    assert report is not None
    return report


def place_deg(report: Report) -> tuple[float, float] | None:
    if report.lat_lon_rad is None:
        return None
    lat_rad, lon_rad = report.lat_lon_rad
    return degrees(lat_rad), degrees(lon_rad)


def test_rmc_tells_time_date_place_and_velocity() -> None:
    report = read(rmc("120000.25", "231126"))
    assert report.has_fix is True
    assert report.tod_s == 43200.25
    noon = datetime(2026, 11, 23, 12, tzinfo=UTC).timestamp()
    assert report.sent_utc_s == noon + 0.25
    assert place_deg(report) == pytest.approx((51.99, 4.37), abs=1e-12)
    assert report.vel_ne_mps == pytest.approx((0, 10 * MPS_PER_KNOT), abs=1e-12)


def test_gga_tells_quality_height_and_geometry() -> None:
    report = read(gga())
    assert (report.has_fix, report.quality) == (True, 1)
    assert (report.alt_m, report.hdop) == (12.5, 1.2)
    assert place_deg(report) == pytest.approx((51.99, 4.37), abs=1e-12)


def test_south_and_west_are_negative() -> None:
    report = read(gga(place="5159.4000,S,00422.2000,W"))
    assert place_deg(report) == pytest.approx((-51.99, -4.37), abs=1e-12)


@pytest.mark.parametrize("quality", ["0", "6", "7", "8"])
def test_gga_without_a_measurement_has_no_fix(quality: str) -> None:
    assert read(gga(quality=quality)).has_fix is False


@pytest.mark.parametrize("quality", ["", "A", "-1"])
def test_gga_with_a_blank_or_strange_quality_proves_nothing(quality: str) -> None:
    report = read(gga(quality=quality))
    assert (report.has_fix, report.quality) == (None, None)


def test_gga_with_a_fix_by_no_satellites_proves_nothing() -> None:
    assert read(gga(satellites="00")).has_fix is None
    assert read(gga(satellites="")).has_fix is True


@pytest.mark.parametrize("status", ["A", "D", "P", "R", "F"])
def test_rmc_and_gll_have_a_fix_by_any_letter_of_a_solution(status: str) -> None:
    assert read(rmc(status=status)).has_fix is True
    assert read(gll(status=status)).has_fix is True


@pytest.mark.parametrize("status", ["", "X"])
def test_rmc_with_a_blank_or_strange_status_proves_nothing(status: str) -> None:
    assert read(rmc(status=status)).has_fix is None


def test_rmc_with_status_v_has_no_fix() -> None:
    assert read(rmc(status="V")).has_fix is False


def test_a_status_that_names_a_solution_serves_for_a_blank_mode() -> None:
    assert read(rmc(status="D", mode="")).quality == 2
    assert read(rmc(status="D", mode="R")).quality == 4
    assert read(rmc(status="A", mode="")).quality is None


@pytest.mark.parametrize("mode", ["N", "E", "M", "S"])
def test_modes_that_measure_nothing_are_no_fix(mode: str) -> None:
    assert read(rmc(mode=mode)).has_fix is False
    assert read(gll(mode=mode)).has_fix is False
    assert read(sentence(f"GNVTG,90.0,T,,M,10.0,N,18.5,K,{mode}")).vel_ne_mps is None


@pytest.mark.parametrize(
    ("mode", "quality"), [("A", 1), ("D", 2), ("P", 3), ("R", 4), ("F", 5)]
)
def test_modes_tell_the_quality(mode: str, quality: int) -> None:
    assert read(rmc(mode=mode)).quality == quality


def test_the_navigational_status_of_ublox_is_not_the_fix() -> None:
    # the example of the ZED-F9P interface description ends so, and is a good fix
    line = sentence(
        "GPRMC,083559.00,A,4717.11437,N,00833.91522,E,0.004,77.52,091202,,,A,V"
    )
    assert read(line).has_fix is True


def test_an_rmc_of_old_without_a_mode_is_a_fix() -> None:
    line = sentence("GPRMC,005947.00,A,3715.6616,N,12157.6709,W,0.0,0.0,080710,,")
    report = read(line)
    assert (report.has_fix, report.quality) == (True, None)


def test_gll_without_a_status_proves_nothing() -> None:
    report = read(sentence("GPGLL,5159.4000,N,00422.2000,E,120000"))
    assert report.has_fix is None
    assert read(gll(status="V")).has_fix is False


@pytest.mark.parametrize(
    ("modes", "has_fix", "quality"),
    [
        ("NN", False, None),
        ("NE", False, None),
        ("AN", True, 1),
        ("NDD", True, 2),
        ("FR", True, 4),
        ("", None, None),
    ],
)
def test_gns_has_a_fix_when_any_constellation_has(
    modes: str, has_fix: bool | None, quality: int | None
) -> None:
    line = f"GNGNS,120000,5159.4000,N,00422.2000,E,{modes},11,1.3,168.9,39.5,,,V"
    report = read(sentence(line))
    assert (report.has_fix, report.quality) == (has_fix, quality)
    assert (report.alt_m, report.hdop) == (168.9, 1.3)


@pytest.mark.parametrize(
    "place",
    [
        ",,,",
        "0000.0000,N,00000.0000,E",
        "5159.4000,X,00422.2000,E",
        "5159.4000,,00422.2000,",
        "5159.4000,E,00422.2000,N",
        "5160.0000,N,00422.2000,E",
        "9000.0001,N,00422.2000,E",
        "5159.4000,N,18000.0001,E",
        "-5159.4000,N,00422.2000,E",
        "51x9.4000,N,00422.2000,E",
        "nan,N,00422.2000,E",
        "1e3,N,00422.2000,E",
        "5.1.5,N,00422.2000,E",
    ],
)
def test_a_place_that_is_none_is_no_place(place: str) -> None:
    assert read(gga(place=place)).lat_lon_rad is None


def test_the_equator_and_greenwich_are_places() -> None:
    assert place_deg(read(gga(place="0000.0000,N,00422.2000,E"))) == pytest.approx(
        (0, 4.37)
    )
    assert place_deg(read(gga(place="5159.4000,N,00000.0000,E"))) == pytest.approx(
        (51.99, 0)
    )


@pytest.mark.parametrize(
    "tod",
    [
        "",
        "1200",
        "240000",
        "126000",
        "120061",
        "12000x",
        "120000.0.0",
        "-12000",
        "+1200.0",
    ],
)
def test_a_time_that_is_none_is_blank(tod: str) -> None:
    assert read(gga(tod)).tod_s is None


def test_a_leap_second_is_a_time() -> None:
    assert read(gga("235960")).tod_s == 86400
    assert read(gga("235960.5")).tod_s == 86400.5


@pytest.mark.parametrize("day", ["", "000000", "310226", "3102", "2x1126"])
def test_a_date_that_is_none_is_blank(day: str) -> None:
    assert read(rmc(day=day)).sent_utc_s is None


@pytest.mark.parametrize(
    ("day", "year"), [("060180", 1980), ("231199", 1999), ("231179", 2079)]
)
def test_two_digits_of_a_year_begin_with_gps_itself(day: str, year: int) -> None:
    sent_utc_s = read(rmc(day=day)).sent_utc_s
    assert sent_utc_s is not None
    assert datetime.fromtimestamp(sent_utc_s, UTC).year == year


def test_zda_tells_the_date() -> None:
    report = read(sentence("GPZDA,120000.00,23,11,2026,-01,00"))
    assert report.sent_utc_s == datetime(2026, 11, 23, 12, tzinfo=UTC).timestamp()
    assert read(sentence("GPZDA,120000.00,,,,,")).sent_utc_s is None


@pytest.mark.parametrize(
    ("speed", "course", "vel_ne_mps"),
    [
        ("0.9", "", (0, 0)),  # standing still: receivers blank the course
        ("1.1", "", None),
        ("", "90.0", None),
        ("-1.0", "90.0", None),
        ("9999", "90.0", None),
        ("1.0", "361", None),
        ("1.0", "360", (MPS_PER_KNOT, 0)),
        ("ABC", "90.0", None),
    ],
)
def test_velocity_needs_speed_and_course_or_rest(
    speed: str, course: str, vel_ne_mps: tuple[float, float] | None
) -> None:
    velocity = read(rmc(speed=speed, course=course)).vel_ne_mps
    assert velocity == (vel_ne_mps and pytest.approx(vel_ne_mps, abs=1e-9))


def test_vtg_of_the_layout_without_units_is_not_misread() -> None:
    assert read(sentence("GPVTG,230.5,229.1,5.6,10.4")).vel_ne_mps is None
    modern = read(sentence("GPVTG,0.0,T,,M,10.0,N,18.5,K")).vel_ne_mps
    assert modern == pytest.approx((10 * MPS_PER_KNOT, 0))


@pytest.mark.parametrize(
    ("sigmas", "sigma_m"),
    [
        ("9.0,2.0,1.0,45.0,3.0,4.0,5.0", 3.5355),  # of latitude and longitude
        ("9.0,2.0,2.0,45.0,,,", 2.0),  # or of the ellipse
        (",,,,0.001,0.001,", 0.01),
        (",,,,0.0,0.0,0.0", None),
        (",,,,,,", None),
    ],
)
def test_gst_tells_one_sigma_for_an_axis(sigmas: str, sigma_m: float | None) -> None:
    report = read(sentence(f"GPGST,120000,{sigmas}"))
    assert report.sigma_m == (sigma_m and pytest.approx(sigma_m, abs=1e-4))


@pytest.mark.parametrize(
    "body", ["GPGSV,1,1,00", "PGRMC,A,218.8", "GPTXT,hello", "PUBX,00"]
)
def test_kinds_that_are_of_no_use_are_passed_over(body: str) -> None:
    assert read_sentence(sentence(body)) is None


@pytest.mark.parametrize(
    "talker", ["GP", "GN", "GL", "GA", "GB", "BD", "QZ", "II", "IN"]
)
def test_any_talker_will_do(talker: str) -> None:
    assert read(gga(talker=talker)).has_fix is True


def test_what_the_tokenizer_refuses_is_unparsable() -> None:
    with pytest.raises(NmeaError) as caught:
        read_sentence(sentence("--GGA,1"))
    assert caught.value.trouble == "unparsable_lines"


def test_expected_errors_count_as_standard_deviations() -> None:
    report = read_sentence(sentence("GPGBS,120001.00,3.0,4.0,9.1,,,,"))
    assert report is not None
    assert report.sigma_m == pytest.approx(5.0 / 2**0.5)
    assert report.tod_s == 43201.0
    silent = read_sentence(sentence("GPGBS,120001.00,,,,,,,"))
    assert silent is not None
    assert silent.sigma_m is None
