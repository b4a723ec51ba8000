"""A row of the lat/long log as text, and its time, to the millisecond, and back."""

from datetime import UTC, datetime, timedelta
from functools import lru_cache
from math import atan2, ceil, degrees, hypot
from typing import Final

from imu_tracker.samples import NavState

MIN_COURSE_SPEED_MPS: Final = 0.3
"""Below it the course is noise, and left empty."""

_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)


def format_utc(utc_s: float) -> str:
    """Return a time as the log has it, to the millisecond."""
    minute, ms = divmod(utc_ms_of(utc_s), 60_000)
    return f"{_minute_text(minute)}{ms // 1000:02d}.{ms % 1000:03d}Z"


def utc_ms_of(utc_s: float) -> int:
    """Return a time in whole milliseconds, as it is written."""
    return round(utc_s * 1000.0)


def utc_s_of(text: bytes) -> float:
    """Read a time without its Z; ValueError when there is no such date."""
    return _minute_utc_s(text[:16]) + float(text[17:])


@lru_cache(maxsize=2)
def _minute_text(minute: int) -> str:
    """Everything of a time but its seconds: formatting a date is slow."""
    return f"{_EPOCH + timedelta(minutes=minute):%Y-%m-%dT%H:%M:}"


@lru_cache(maxsize=2)
def _minute_utc_s(text: bytes) -> float:
    return datetime.fromisoformat(f"{text.decode()}Z").timestamp()


def format_row(state: NavState) -> str:
    """Format one row of the log, without newline.

    Notes
    -----
    Rows lie on a grid whose instants are whole milliseconds. The speed that is printed
    decides whether there is a course, so that a row never contradicts itself.
    """
    lat_deg = degrees(state.lat_rad)
    lon_deg = degrees(state.lon_rad)
    if not -179.999999 < lon_deg < 179.999999:
        lon_deg = 180.0 - (180.0 - round(lon_deg, 8)) % 360.0
    alt = "" if state.alt_m is None else f"{state.alt_m:z.1f}"
    v_north, v_east, _ = state.v_n_mps
    speed_mps = round(hypot(v_north, v_east), 2)
    course = ""
    if speed_mps >= MIN_COURSE_SPEED_MPS:
        course = f"{round(degrees(atan2(v_east, v_north)) % 360.0, 1) % 360.0:.1f}"
    r95_m = ceil(state.r95_m * 100.0 - 1e-7) / 100.0  # 3.94 is not 3.95
    return (
        f"{format_utc(state.utc_s)},"
        f"{lat_deg:z.8f},{lon_deg:z.8f},{alt},{speed_mps:.2f},{course},"
        f"{r95_m:.2f},{state.mode}"
    )
