"""NMEA sentences as a common receiver writes them.

Written from the standard's field order and by no code that reads sentences: reader
and writer check each other. The empty sentences are those of a u-blox receiver.
"""

import math
from datetime import UTC, datetime, timedelta
from functools import reduce
from operator import xor
from typing import Final, NamedTuple

_MPS_PER_KNOT: Final = 1852.0 / 3600.0
_EPOCH: Final = datetime(1970, 1, 1, tzinfo=UTC)
_GEOID_M: Final = 43.0  # above the ellipsoid, near Delft


class Solution(NamedTuple):
    """A receiver's idea of where it is and how it moves."""

    lat_rad: float
    lon_rad: float
    alt_m: float  # above mean sea level
    vel_ne_mps: tuple[float, float]
    sigma_h_m: float
    sigma_alt_m: float
    hdop: float


class Report(NamedTuple):
    """What a receiver knows at an epoch; None: it does not know."""

    utc_s: float | None
    solution: Solution | None


class Resolution(NamedTuple):
    """How finely a receiver writes; the defaults are a cheap one's."""

    minute_decimals: int = 5  # 0.00001' is 2 cm
    knot_decimals: int = 2
    course_decimals: int = 1
    blank_course_below_mps: float = 0.3


def rmc(report: Report, resolution: Resolution) -> bytes:
    """Recommended minimum: time, status, position, speed, course, date."""
    time, date = _time_and_date(report.utc_s)
    solution = report.solution
    if solution is None:
        return _sentence(f"GNRMC,{time},V,,,,,,,{date},,,N")
    north, east = solution.vel_ne_mps
    speed_mps = math.hypot(north, east)
    course = ""
    if speed_mps >= resolution.blank_course_below_mps:
        # The remainder is taken after rounding: 359.97 is 0.0, never 360.0.
        decimals = resolution.course_decimals
        course_deg = round(math.degrees(math.atan2(east, north)), decimals) % 360.0
        course = f"{course_deg:.{decimals}f}"
    knots = f"{speed_mps / _MPS_PER_KNOT:.{resolution.knot_decimals}f}"
    position = _position(solution, resolution.minute_decimals)
    return _sentence(f"GNRMC,{time},A,{position},{knots},{course},{date},,,A")


def gga(report: Report, resolution: Resolution) -> bytes:
    """Fix data: time, position, quality, satellites, HDOP, height."""
    time, _ = _time_and_date(report.utc_s)
    solution = report.solution
    if solution is None:
        return _sentence(f"GNGGA,{time},,,,,0,00,99.99,,,,,,")
    position = _position(solution, resolution.minute_decimals)
    height = f"{solution.alt_m:.1f},M,{_GEOID_M:.1f},M"
    return _sentence(f"GNGGA,{time},{position},1,09,{solution.hdop:.2f},{height},,")


def gst(report: Report) -> bytes:
    """Error statistics: standard deviations in metres."""
    time, _ = _time_and_date(report.utc_s)
    solution = report.solution
    if solution is None:
        return _sentence(f"GNGST,{time},,,,,,,")
    sigma, sigma_alt = f"{solution.sigma_h_m:.1f}", f"{solution.sigma_alt_m:.1f}"
    return _sentence(f"GNGST,{time},{sigma},,,,{sigma},{sigma},{sigma_alt}")


def _sentence(body: str) -> bytes:
    checksum = reduce(xor, body.encode("ascii"))
    return f"${body}*{checksum:02X}".encode("ascii")


def _time_and_date(utc_s: float | None) -> tuple[str, str]:
    if utc_s is None:
        return "", ""
    centiseconds = round(utc_s * 100.0)
    utc = _EPOCH + timedelta(milliseconds=10 * centiseconds)
    return f"{utc:%H%M%S}.{centiseconds % 100:02d}", f"{utc:%d%m%y}"


def _position(solution: Solution, decimals: int) -> str:
    lat = _degrees_minutes(solution.lat_rad, 2, decimals)
    lon = _degrees_minutes(solution.lon_rad, 3, decimals)
    north_south = "N" if solution.lat_rad >= 0.0 else "S"
    east_west = "E" if solution.lon_rad >= 0.0 else "W"
    return f"{lat},{north_south},{lon},{east_west}"


def _degrees_minutes(angle_rad: float, width: int, decimals: int) -> str:
    """Format as dddmm.mmmm; rounding is done first, so that minutes stay below 60."""
    units_per_minute = 10**decimals
    units = round(math.degrees(abs(angle_rad)) * 60.0 * units_per_minute)
    degrees, rest = divmod(units, 60 * units_per_minute)
    minutes, fraction = divmod(rest, units_per_minute)
    return f"{degrees:0{width}d}{minutes:02d}.{fraction:0{decimals}d}"
