"""What users of other programs reported of receivers, each as the kind of sentence.

The name of a case is the public report; the sentences are our own, of the same form.
"""

from datetime import UTC, datetime

import pytest

from imu_tracker.samples import GpsFix, Source
from imu_tracker.sensors.gnss.calendar import Calendar
from imu_tracker.sensors.gnss.epoch_reader import EpochReader
from imu_tracker.simulation import simulate
from support.nmea_text import gga, rmc, sentence

S = 1_000_000_000


def fixes(*lines: bytes) -> list[GpsFix]:
    reader = EpochReader()
    found = [out for i, line in enumerate(lines) for out in reader.feed(i * S, line)]
    found += reader.advance(len(lines) * S)
    return [position for position in found if isinstance(position, GpsFix)]


PLACE = "5159.4000,N,00422.2000,E"


USED = {
    "Knio/pynmea2#162 nav status V": sentence(
        f"GNRMC,120000.00,A,{PLACE},0.057,,231126,,,A,V"
    ),
    "adrianmo/go-nmea#107 nav status C": sentence(
        f"YDRMC,120000.00,A,{PLACE},0.2,181.3,231126,4.3,E,A,C"
    ),
    "mikalhart/TinyGPSPlus#80 prefix": b"+GPSRD:" + gga(),
    "DotSpatial/DotSpatial#376 blanks": rmc(place="5159.4000, N,00422.2000, E"),
    "LK8000/LK8000#929 lower case sum": gga()[:-2] + gga()[-2:].lower(),
}
REFUSED = {
    "SlashDevin/NeoGPS#38 cut, sum right": sentence("GPGGA,201019.00,5159.4,N,1,-25,M"),
    "Drivetech/node-nmea#7 status L": rmc(status="L"),
    "wellenvogel/esp32-nmea2000#38 null island": rmc(place="0.000,N,0.000,E", mode="E"),
    "mikalhart/TinyGPSPlus#2 V with a place": rmc(status="V"),
    "107-systems/107-Arduino-NMEA-Parser#10 blank": sentence("GPRMC,,V,,,,,,,,,,N"),
    "DotSpatial/DotSpatial#376 no sum": rmc()[:-2],
    "SignalK/nmea0183-signalk#140 zeros": rmc(
        status="V", place="0000.0000,N,00000.0000,E"
    ),
}


@pytest.mark.parametrize("line", USED.values(), ids=USED)
def test_a_sentence_of_odd_form_with_a_fix_is_used(line: bytes) -> None:
    assert len(fixes(line)) == 1


@pytest.mark.parametrize("line", REFUSED.values(), ids=REFUSED)
def test_a_sentence_that_proves_no_fix_is_refused(line: bytes) -> None:
    assert fixes(line) == []


def test_a_checksum_of_zero_is_a_checksum() -> None:
    """Reported as ckgt/NemaTode#3."""
    body = b"GPRMC,"
    total = 0
    for byte in body:
        total ^= byte
    reader = EpochReader()
    reader.feed(0, b"$" + body + bytes([total]) + b"*00")
    assert reader.counters["bad_checksums"] == 0


def test_a_date_that_no_month_has_is_no_date() -> None:
    """Reported as opengeos/GeoLibre#1624."""
    (fix,) = fixes(rmc(day="310226"))
    assert fix.utc_s is None


def utc(*ymd: int) -> float:
    return datetime(*ymd, 12, tzinfo=UTC).timestamp()  # type: ignore[misc, arg-type]


RELEASE = utc(2020, 1, 1)


@pytest.mark.parametrize(
    ("sent", "true"),
    [
        pytest.param((2000, 10, 14), (2020, 5, 30), id="mikalhart/TinyGPSPlus#75"),
        pytest.param((2003, 5, 7), (2022, 12, 21), id="XCSoar/XCSoar#1087"),
    ],
)
def test_dates_of_the_last_era_come_into_this_one(
    sent: tuple[int, int, int], true: tuple[int, int, int]
) -> None:
    calendar = Calendar(earliest_utc_s=RELEASE)
    calendar.learn(0, utc(*sent), is_sure=True)
    assert calendar.utc_s(0, 43_200.0) == utc(*true)


def test_a_date_of_manufacture_without_a_fix_is_not_believed() -> None:
    """Reported as mstrens/oXs_on_RP2040#71: 2013 until the first fix."""
    calendar = Calendar(earliest_utc_s=RELEASE)
    calendar.learn(0, utc(2013, 9, 1), is_sure=False)
    assert not calendar.is_known


def test_a_simulated_receiver_at_10_hz_fits_the_line_that_it_is_given() -> None:
    def lines(baud: int) -> int:
        frames = simulate("still", duration_s=30, gps_every_s=0.1, baud=baud).frames
        return sum(frame.source is Source.GPS for frame in frames)

    assert lines(115_200) > lines(9600)
