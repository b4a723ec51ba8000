"""Routes and tracks of GPX files, as waypoints in order."""

import math
from pathlib import Path
from typing import Any, Final, NamedTuple

from imu_tracker.errors import InputMissingError, RouteError, shown

MAX_FILE_BYTES: Final = 20_000_000
MAX_POINTS: Final = 100_000
_MAX_NAME: Final = 40

EARTH_RADIUS_M: Final = 1852.0 * 60.0 * 180.0 / math.pi
"""Of the sphere on which a minute of arc is a nautical mile."""


class Waypoint(NamedTuple):
    """A place to pass."""

    name: str
    lat_deg: float
    lon_deg: float


def read_route(path: Path) -> list[Waypoint]:
    """Read the first route of a GPX file, or its first track when it has none.

    Raises
    ------
    InputMissingError
        When there is no such file, or it may not be read.
    RouteError
        When it is no GPX, or holds no two places that differ.
    """
    try:
        with path.open("rb") as file:
            data = file.read(MAX_FILE_BYTES + 1)
    except (FileNotFoundError, PermissionError) as error:
        raise InputMissingError(f"{path}: {error.strerror}") from error
    except OSError as error:
        raise RouteError(f"{path}: {error.strerror or error}") from error
    if len(data) > MAX_FILE_BYTES:
        raise RouteError(f"{path}: longer than {MAX_FILE_BYTES} bytes")
    return _waypoints(path, data)


def _waypoints(path: Path, data: bytes) -> list[Waypoint]:
    if b"<!DOCTYPE" in data or b"<!ENTITY" in data:  # entities that grow without end
        raise RouteError(f"{path}: a document type is not allowed in a GPX file")
    import gpxpy
    from gpxpy.gpx import GPXException

    try:
        gpx = gpxpy.parse(data.decode("utf-8-sig"))
    except (GPXException, ValueError, TypeError, RecursionError) as error:
        reason = shown(" ".join(str(error).split()))
        raise RouteError(f"{path}: no GPX file: {reason}") from error
    lines: list[list[Any]] = [list(route.points) for route in gpx.routes]
    lines += [[p for s in track.segments for p in s.points] for track in gpx.tracks]
    places: list[Waypoint] = []
    for point in next((line for line in lines if line), []):
        lat, lon = float(point.latitude), float(point.longitude)
        if not (abs(lat) <= 90.0 and abs(lon) <= 180.0):  # nan, too
            raise RouteError(f"{path}: {lat}, {lon}: no place on Earth")
        if places and places[-1][1:] == (lat, lon):
            continue
        name = _printable(point.name or "") or str(len(places) + 1)
        places.append(Waypoint(name, lat, lon))
    if len(places) < 2:
        raise RouteError(f"{path}: no route and no track of at least two places")
    if len(places) > MAX_POINTS:
        raise RouteError(f"{path}: more than {MAX_POINTS} places")
    return places


def _printable(name: str) -> str:
    return "".join(c for c in " ".join(name.split()) if c.isprintable())[:_MAX_NAME]


def distance_m(one: Waypoint, other: Waypoint) -> float:
    """Return the length of the great circle between two places.

    Notes
    -----
    Haversine, on the sphere on which a minute of arc is a nautical mile: within 0.5 %
    of the ellipsoid, and what the instruments that show it reckon with.
    """
    lat1, lat2 = math.radians(one.lat_deg), math.radians(other.lat_deg)
    lon = math.radians(other.lon_deg - one.lon_deg)
    a = (
        math.sin((lat2 - lat1) / 2.0) ** 2
        + math.cos(lat1) * math.cos(lat2) * math.sin(lon / 2.0) ** 2
    )
    return 2.0 * EARTH_RADIUS_M * math.asin(min(1.0, math.sqrt(a)))


def bearing_deg(one: Waypoint, other: Waypoint) -> float:
    """Return the initial true bearing from one place to another, from 0 to 360."""
    lat1, lat2 = math.radians(one.lat_deg), math.radians(other.lat_deg)
    lon = math.radians(other.lon_deg - one.lon_deg)
    east = math.sin(lon) * math.cos(lat2)
    north = math.cos(lat1) * math.sin(lat2) - math.sin(lat1) * math.cos(
        lat2
    ) * math.cos(lon)
    return math.degrees(math.atan2(east, north)) % 360.0
