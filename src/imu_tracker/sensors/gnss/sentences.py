"""What one NMEA sentence says, in SI, with the validity decided here.

pynmea2 splits the sentence and knows the order of its fields; its typed properties
are not used: they read a blank position as 0 N 0 E and an unknown hemisphere as 0,
and call a good u-blox fix invalid. What a newcomer gets wrong: a receiver repeats
its last position while it has no fix, so the status counts, not the coordinates.
"""

from collections.abc import Callable
from datetime import date
from functools import lru_cache
from math import cos, hypot, radians, sin, sqrt
from operator import itemgetter
from typing import Final, NamedTuple, TypeAlias

import pynmea2

from imu_tracker.errors import NmeaError
from imu_tracker.samples import FIRST_YEAR, LAST_YEAR
from imu_tracker.sensors.gnss.lines import checked_text
from imu_tracker.sensors.gnss.verdicts import (
    NOT_MEASURED,
    NOT_MEASURED_QUALITY,
    QUALITY_OF_MODE,
    has_fix_by_status,
    quality_by_status,
)

MPS_PER_KNOT: Final = 1852 / 3600
MAX_SPEED_MPS: Final = 600.0  # export rules switch civil receivers off at 515 m/s
STANDING_MPS: Final = 0.5  # slower than this, a blank course means rest
MIN_SIGMA_M: Final = 0.01  # the step in which receivers print GST
MAX_SIGMA_M: Final = 1e5  # of a fix that knows no more than its continent
MAX_HDOP: Final = 1000.0  # 99.99 and 9999 are how receivers say "no geometry"
HEIGHTS_M: Final = (-12_000.0, 100_000.0)  # the deepest trench; above it is space


class Report(NamedTuple):
    """What one sentence says; None where it is silent.

    `has_fix` is the sentence's verdict on its epoch; `sent_utc_s` is there when both
    date and time are, as the receiver believes; `sigma_m` is per axis.
    """

    kind: str
    tod_s: float | None = None
    sent_utc_s: float | None = None
    has_fix: bool | None = None
    lat_lon_rad: tuple[float, float] | None = None
    alt_m: float | None = None
    vel_ne_mps: tuple[float, float] | None = None
    quality: int | None = None
    hdop: float | None = None
    sigma_m: float | None = None


def read_sentence(line: bytes) -> Report | None:
    """Read one line; None for an intact sentence of a kind that is not used here.

    Raises
    ------
    NmeaError
        The line is damaged. A field that makes no sense counts as blank.
    """
    text = checked_text(line)
    if text[2:6] not in _READERS or text[0] == "P":  # $PGRMC is no RMC
        return None
    try:
        sentence = pynmea2.NMEASentence.parse(text)
    except pynmea2.ParseError as error:
        raise NmeaError("unparsable_lines", line) from error
    pick, read = _READERS[text[2:6]]
    fields = sentence.data
    if " " in text:  # some loggers pad the fields
        fields = [field.strip() for field in fields]
    return read(*pick(fields + _BLANKS))


_Reader: TypeAlias = Callable[..., Report]
_READERS: Final[dict[str, tuple[Callable[[list[str]], tuple[str, ...]], _Reader]]] = {}
_BLANKS: Final = [""] * 16  # for the fields that older layouts do not have


def _reads(
    sentence: type[pynmea2.TalkerSentence], fields: str
) -> Callable[[_Reader], _Reader]:
    """Register what reads a sentence, and its fields by the names that pynmea2 has."""
    pick = itemgetter(*(sentence.name_to_idx[name] for name in fields.split()))

    def register(read: _Reader) -> _Reader:
        _READERS[f"{sentence.__name__},"] = pick, read
        return read

    return register


@_reads(
    pynmea2.RMC,
    "timestamp status lat lat_dir lon lon_dir mode_indicator "
    "spd_over_grnd true_course datestamp",
)
def _read_rmc(tod: str, status: str, *rest: str) -> Report:
    *place, mode, knots, course, day = rest
    tod_s = _time_of_day(tod)
    return Report(
        "RMC",
        tod_s=tod_s,
        sent_utc_s=_utc_s(tod_s, _century(day[4:6]), day[2:4], day[:2]),
        has_fix=has_fix_by_status(status, mode),
        lat_lon_rad=_position(*place),
        vel_ne_mps=_velocity(knots, course),
        quality=quality_by_status(status, mode),
    )


@_reads(
    pynmea2.GGA,
    "timestamp gps_qual num_sats lat lat_dir lon lon_dir altitude horizontal_dil",
)
def _read_gga(tod: str, quality: str, satellites: str, *rest: str) -> Report:
    *place, altitude, hdop = rest
    has_fix = quality not in NOT_MEASURED_QUALITY if quality.isdigit() else None
    if has_fix and _number(satellites) == 0:
        has_fix = None  # a fix by no satellite at all needs another witness
    return Report(
        "GGA",
        tod_s=_time_of_day(tod),
        has_fix=has_fix,
        lat_lon_rad=_position(*place),
        alt_m=_height(altitude),
        quality=int(quality) if quality.isdigit() else None,
        hdop=_dilution(hdop),
    )


@_reads(
    pynmea2.GNS,
    "timestamp mode_indicator lat lat_dir lon lon_dir altitude hdop",
)
def _read_gns(tod: str, modes: str, *rest: str) -> Report:
    *place, altitude, hdop = rest
    return Report(
        "GNS",
        tod_s=_time_of_day(tod),
        has_fix=not NOT_MEASURED.issuperset(modes) if modes else None,
        lat_lon_rad=_position(*place),
        alt_m=_height(altitude),
        quality=next((q for mode, q in QUALITY_OF_MODE.items() if mode in modes), None),
        hdop=_dilution(hdop),
    )


@_reads(pynmea2.GLL, "timestamp status lat lat_dir lon lon_dir faa_mode")
def _read_gll(tod: str, status: str, *rest: str) -> Report:
    *place, mode = rest
    return Report(
        "GLL",
        tod_s=_time_of_day(tod),
        has_fix=has_fix_by_status(status, mode),  # NMEA 1.5 had no status
        lat_lon_rad=_position(*place),
        quality=quality_by_status(status, mode),
    )


@_reads(pynmea2.VTG, "true_track spd_over_grnd_kts spd_over_grnd_kts_sym faa_mode")
def _read_vtg(course: str, knots: str, unit: str, mode: str) -> Report:
    if unit != "N" or mode in NOT_MEASURED:  # the oldest layout has no units
        return Report("VTG")
    return Report("VTG", vel_ne_mps=_velocity(knots, course))


@_reads(
    pynmea2.GST,
    "timestamp std_dev_latitude std_dev_longitude std_dev_major std_dev_minor",
)
def _read_gst(tod: str, *sigmas: str) -> Report:
    north, east, major, minor = map(_positive, sigmas)
    sigma_m = _per_axis(north, east) or _per_axis(major, minor)
    return Report("GST", tod_s=_time_of_day(tod), sigma_m=sigma_m)


@_reads(pynmea2.GBS, "timestamp lat_err lon_err")
def _read_gbs(tod: str, *sigmas: str) -> Report:
    """Read 1 sigma; gpsd, for binary receivers, puts 95 % there: never too sure."""
    sigma_m = _per_axis(*map(_positive, sigmas))
    return Report("GBS", tod_s=_time_of_day(tod), sigma_m=sigma_m)


@_reads(pynmea2.ZDA, "timestamp year month day")
def _read_zda(tod: str, *day: str) -> Report:
    tod_s = _time_of_day(tod)
    return Report("ZDA", tod_s=tod_s, sent_utc_s=_utc_s(tod_s, *day))


def _number(text: str) -> float | None:
    """Read a number; None when it is blank or none.

    float() alone would also take `nan`, `1_0` and `1e9`, which no receiver means.
    """
    if not text or text.strip("+-.0123456789"):
        return None
    try:
        return float(text)
    except ValueError:
        return None


def _positive(text: str) -> float | None:
    """Read a number of which 0 means that it is not known."""
    number = _number(text)
    return number if number is not None and number > 0 else None


def _dilution(text: str) -> float | None:
    """Read a dilution of precision; an absurd one is a bad one."""
    hdop = _positive(text)
    return None if hdop is None else min(hdop, MAX_HDOP)


def _height(text: str) -> float | None:
    """Read a height; None when it is blank, or not of this world."""
    height_m = _number(text)
    if height_m is None or not HEIGHTS_M[0] <= height_m <= HEIGHTS_M[1]:
        return None
    return height_m


def _time_of_day(text: str) -> float | None:
    """Read hhmmss.ss; a leap second is the second before the same midnight's first."""
    seconds = _number(text[4:])
    if seconds is None or not text[:6].isdigit():
        return None
    hours, minutes = int(text[:2]), int(text[2:4])
    if hours > 23 or minutes > 59 or seconds >= 61:
        return None
    return hours * 3600 + minutes * 60 + seconds


def _utc_s(tod_s: float | None, year: str, month: str, day: str) -> float | None:
    midnight_s = _midnight_s(year, month, day)
    return None if midnight_s is None or tod_s is None else midnight_s + tod_s


@lru_cache(maxsize=4)  # a date stays for a day, and costs as much as a position
def _midnight_s(year: str, month: str, day: str) -> float | None:
    """Return the UTC at which a day begins; None when it is blank or none."""
    try:
        whole = date(int(year), int(month), int(day))
    except (ValueError, OverflowError):
        return None
    if not FIRST_YEAR <= whole.year <= LAST_YEAR:
        return None
    return (whole.toordinal() - date(1970, 1, 1).toordinal()) * 86400.0


def _century(year: str) -> str:
    """Complete a year of two digits: there was no GPS before 1980."""
    return ("19" if year >= "80" else "20") + year


def _position(
    lat: str, lat_dir: str, lon: str, lon_dir: str
) -> tuple[float, float] | None:
    """Read a position; None when it is blank, none on earth, or 0 N 0 E exactly."""
    lat_deg = _degrees(lat, {"N": 1, "S": -1}.get(lat_dir), 90)
    lon_deg = _degrees(lon, {"E": 1, "W": -1}.get(lon_dir), 180)
    if lat_deg is None or lon_deg is None or lat_deg == lon_deg == 0:
        return None
    return radians(lat_deg), radians(lon_deg)


def _degrees(text: str, sign: int | None, limit: int) -> float | None:
    """Read dddmm.mmm."""
    number = _number(text)
    if number is None or sign is None:
        return None
    whole, minutes = divmod(number, 100)
    degrees = whole + minutes / 60
    return sign * degrees if minutes < 60 and 0 <= degrees <= limit else None


def _velocity(knots: str, course: str) -> tuple[float, float] | None:
    """Read a velocity, north and east."""
    speed, course_deg = _number(knots), _number(course)
    if speed is None or not 0 <= speed * MPS_PER_KNOT <= MAX_SPEED_MPS:
        return None
    speed_mps = speed * MPS_PER_KNOT
    if course_deg is None:
        return (0.0, 0.0) if speed_mps < STANDING_MPS else None
    if not 0 <= course_deg <= 360:
        return None
    course_rad = radians(course_deg)
    return speed_mps * cos(course_rad), speed_mps * sin(course_rad)


def _per_axis(north: float | None, east: float | None) -> float | None:
    """Average two standard deviations into one that serves both axes."""
    if north is None or east is None:
        return None
    return min(max(hypot(north, east) / sqrt(2), MIN_SIGMA_M), MAX_SIGMA_M)
