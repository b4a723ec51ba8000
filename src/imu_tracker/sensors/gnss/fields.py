"""Fields of NMEA sentences to numbers in SI; None for what is blank or makes no sense.

pynmea2's typed properties are not used: they read a blank position as 0 N 0 E and an
unknown hemisphere as 0.
"""

from datetime import date
from functools import lru_cache
from math import cos, hypot, radians, sin, sqrt
from typing import Final

from imu_tracker.samples import FIRST_YEAR, LAST_YEAR

MPS_PER_KNOT: Final = 1852 / 3600
MAX_SPEED_MPS: Final = 600.0  # export rules switch civil receivers off at 515 m/s
STANDING_MPS: Final = 0.5  # slower than this, a blank course means rest
MIN_SIGMA_M: Final = 0.01  # the step in which receivers print GST
MAX_SIGMA_M: Final = 1e5  # of a fix that knows no more than its continent
MAX_HDOP: Final = 1000.0  # 99.99 and 9999 are how receivers say "no geometry"
HEIGHTS_M: Final = (-12_000.0, 100_000.0)  # the deepest trench; above it is space


def number_of(text: str) -> float | None:
    """Read a number; None when it is blank or none.

    float() alone would also take `nan`, `1_0` and `1e9`, which no receiver means.
    """
    if not text or text.strip("+-.0123456789"):
        return None
    try:
        return float(text)
    except ValueError:
        return None


def positive(text: str) -> float | None:
    """Read a number of which 0 means that it is not known."""
    number = number_of(text)
    return number if number is not None and number > 0 else None


def dilution(text: str) -> float | None:
    """Read a dilution of precision; an absurd one is a bad one."""
    hdop = positive(text)
    return None if hdop is None else min(hdop, MAX_HDOP)


def height_m_of(text: str) -> float | None:
    """Read a height; None when it is blank, or not of this world."""
    height_m = number_of(text)
    if height_m is None or not HEIGHTS_M[0] <= height_m <= HEIGHTS_M[1]:
        return None
    return height_m


def time_of_day(text: str) -> float | None:
    """Read hhmmss.ss; a leap second is the second before the same midnight's first."""
    seconds = number_of(text[4:])
    if seconds is None or not text[:6].isdigit():
        return None
    hours, minutes = int(text[:2]), int(text[2:4])
    if hours > 23 or minutes > 59 or seconds >= 61:
        return None
    return hours * 3600 + minutes * 60 + seconds


def utc_s_of(tod_s: float | None, year: str, month: str, day: str) -> float | None:
    """Join time of day and date to UTC."""
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


def century(year: str) -> str:
    """Complete a year of two digits: there was no GPS before 1980."""
    return ("19" if year >= "80" else "20") + year


def position(
    lat: str, lat_dir: str, lon: str, lon_dir: str
) -> tuple[float, float] | None:
    """Read a position; None when it is blank, none on earth, or 0 N 0 E exactly."""
    lat_deg = degrees_of(lat, {"N": 1, "S": -1}.get(lat_dir), 90)
    lon_deg = degrees_of(lon, {"E": 1, "W": -1}.get(lon_dir), 180)
    if lat_deg is None or lon_deg is None or lat_deg == lon_deg == 0:
        return None
    return radians(lat_deg), radians(lon_deg)


def degrees_of(text: str, sign: int | None, limit: int) -> float | None:
    """Read dddmm.mmm."""
    number = number_of(text)
    if number is None or sign is None:
        return None
    whole, minutes = divmod(number, 100)
    degrees = whole + minutes / 60
    return sign * degrees if minutes < 60 and 0 <= degrees <= limit else None


def velocity(knots: str, course: str) -> tuple[float, float] | None:
    """Read a velocity, north and east."""
    speed, course_deg = number_of(knots), number_of(course)
    if speed is None or not 0 <= speed * MPS_PER_KNOT <= MAX_SPEED_MPS:
        return None
    speed_mps = speed * MPS_PER_KNOT
    if course_deg is None:
        return (0.0, 0.0) if speed_mps < STANDING_MPS else None
    if not 0 <= course_deg <= 360:
        return None
    course_rad = radians(course_deg)
    return speed_mps * cos(course_rad), speed_mps * sin(course_rad)


def per_axis(north: float | None, east: float | None) -> float | None:
    """Average two standard deviations into one that serves both axes."""
    if north is None or east is None:
        return None
    return min(max(hypot(north, east) / sqrt(2), MIN_SIGMA_M), MAX_SIGMA_M)
