"""The Earth: WGS-84, a local frame in metres, normal gravity.

The one place where latitude and longitude become metres, and where height (up)
becomes down. The local frame scales the differences of latitude and longitude by
the radii of curvature at its origin, so that north, east and level stay true
everywhere in it; whoever travels moves the origin along (`FRAME_RADIUS_M`).
"""

import math
from typing import Final, NamedTuple

from imu_tracker.geometry.rotation import wrap_pi

SEMI_MAJOR_M: Final = 6378137.0
ECCENTRICITY_SQ: Final = 6.69437999014e-3  # NIMA TR8350.2, table 3.3

FRAME_RADIUS_M: Final = 1000.0
"""How far from its origin a local frame is used; lengths there are true to 1e-3."""

_COS_FLOOR: Final = 1e-6
"""Within metres of a pole longitude means nothing; keep the arithmetic finite."""


def radii_m(lat_rad: float) -> tuple[float, float]:
    """Radii of curvature: meridian (north-south) and prime vertical (east-west).

    Notes
    -----
    M = a (1 - e^2) / (1 - e^2 sin^2 lat)^1.5, N = a / sqrt(1 - e^2 sin^2 lat).
    Source: Groves 2013, equations 2.105 and 2.106.
    """
    denominator = 1.0 - ECCENTRICITY_SQ * math.sin(lat_rad) ** 2
    root = math.sqrt(denominator)
    meridian = SEMI_MAJOR_M * (1.0 - ECCENTRICITY_SQ) / (denominator * root)
    return meridian, SEMI_MAJOR_M / root


def gravity_mps2(lat_rad: float, alt_m: float = 0.0) -> float:
    """Normal gravity at a height above the ellipsoid.

    Notes
    -----
    Somigliana's formula with the free-air correction.
    Source: NIMA TR8350.2, equations 4-1 and 4-3.
    """
    sin_sq = math.sin(lat_rad) ** 2
    surface = (
        9.7803253359
        * (1.0 + 0.00193185265241 * sin_sq)
        / math.sqrt(1.0 - ECCENTRICITY_SQ * sin_sq)
    )
    return surface * (1.0 - 2.0 * alt_m / SEMI_MAJOR_M)


class LocalFrame(NamedTuple):
    """Metres north and east of an origin.

    There and back is exact.
    """

    lat_rad: float
    lon_rad: float
    north_m_per_rad: float
    east_m_per_rad: float

    @classmethod
    def at(cls, lat_rad: float, lon_rad: float, alt_m: float = 0.0) -> "LocalFrame":
        """Frame with its origin at this place."""
        meridian, prime_vertical = radii_m(lat_rad)
        cosine = max(math.cos(lat_rad), _COS_FLOOR)
        return cls(
            lat_rad, lon_rad, meridian + alt_m, (prime_vertical + alt_m) * cosine
        )

    def to_ne(self, lat_rad: float, lon_rad: float) -> tuple[float, float]:
        """Metres north and east of the origin, the short way round the Earth."""
        return (
            (lat_rad - self.lat_rad) * self.north_m_per_rad,
            wrap_pi(lon_rad - self.lon_rad) * self.east_m_per_rad,
        )

    def to_lat_lon(self, north_m: float, east_m: float) -> tuple[float, float]:
        """Latitude and longitude in radians of a point in metres."""
        lat_rad = self.lat_rad + north_m / self.north_m_per_rad
        lat_rad = min(max(lat_rad, -0.5 * math.pi), 0.5 * math.pi)
        return lat_rad, wrap_pi(self.lon_rad + east_m / self.east_m_per_rad)
