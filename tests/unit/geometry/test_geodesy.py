"""The Earth against figures of others: ECEF, tabulated arcs, gravity of WGS-84."""

import math

import numpy as np
import pytest

from imu_tracker.geometry.geodesy import LocalFrame, gravity_mps2, radii_m

EQUATOR, POLE = 0.0, 0.5 * math.pi
FLATTENING = 1.0 / 298.257223563


def ecef_m(lat_rad: float, lon_rad: float) -> np.ndarray:
    """Textbook ECEF of a point on the ellipsoid, from a and f alone."""
    a = 6378137.0
    e_sq = FLATTENING * (2.0 - FLATTENING)
    n = a / math.sqrt(1.0 - e_sq * math.sin(lat_rad) ** 2)
    return np.array(
        [
            n * math.cos(lat_rad) * math.cos(lon_rad),
            n * math.cos(lat_rad) * math.sin(lon_rad),
            n * (1.0 - e_sq) * math.sin(lat_rad),
        ]
    )


@pytest.mark.parametrize(
    ("lat_deg", "lat_degree_m", "lon_degree_m"),
    # Length of a degree on WGS-84, as tabulated (Snyder; Wikipedia, "Latitude").
    [
        (0, 110574, 111320),
        (15, 110649, 107550),
        (45, 111132, 78847),
        (75, 111618, 28902),
    ],
)
def test_a_degree_is_as_long_as_the_tables_say(
    lat_deg: float, lat_degree_m: float, lon_degree_m: float
) -> None:
    frame = LocalFrame.at(math.radians(lat_deg), 0.0)
    half = math.radians(0.5)
    assert frame.north_m_per_rad * 2 * half == pytest.approx(lat_degree_m, abs=1.0)
    assert frame.east_m_per_rad * 2 * half == pytest.approx(lon_degree_m, abs=1.0)


def test_the_radii_at_the_equator_and_the_poles_are_those_of_the_ellipsoid() -> None:
    a, b = 6378137.0, 6356752.314245
    assert radii_m(EQUATOR) == pytest.approx((b * b / a, a), abs=1e-3)
    assert radii_m(POLE) == pytest.approx((a * a / b, a * a / b), abs=1e-3)


def test_gravity_is_that_of_wgs_84() -> None:
    assert gravity_mps2(EQUATOR) == pytest.approx(9.7803253359, abs=1e-10)
    assert gravity_mps2(POLE) == pytest.approx(9.8321849379, abs=1e-9)
    assert gravity_mps2(-POLE) == gravity_mps2(POLE)
    assert gravity_mps2(math.radians(45.0)) == pytest.approx(9.80620, abs=1e-5)


def test_gravity_falls_by_three_micro_g_per_metre() -> None:
    fall = gravity_mps2(0.8) - gravity_mps2(0.8, 1000.0)
    assert fall == pytest.approx(3.086e-3, rel=0.01)


@pytest.mark.parametrize("lat_deg", [0.0, 52.0, -33.9, 78.2])
def test_a_local_frame_keeps_lengths_within_its_radius(lat_deg: float) -> None:
    frame = LocalFrame.at(math.radians(lat_deg), math.radians(4.37))
    origin = ecef_m(frame.lat_rad, frame.lon_rad)
    for north, east in [(1000.0, 0.0), (0.0, 1000.0), (-600.0, 800.0)]:
        chord = np.linalg.norm(ecef_m(*frame.to_lat_lon(north, east)) - origin)
        assert chord == pytest.approx(1000.0, rel=1e-3)


def test_there_and_back_is_exact() -> None:
    frame = LocalFrame.at(0.9, -1.3)
    lat, lon = frame.to_lat_lon(123.0, -456.0)
    assert frame.to_ne(lat, lon) == pytest.approx((123.0, -456.0), abs=1e-6)


def test_the_antimeridian_is_crossed_the_short_way() -> None:
    frame = LocalFrame.at(0.0, math.radians(179.9999))
    lat, lon = frame.to_lat_lon(0.0, 100.0)
    assert math.degrees(lon) == pytest.approx(-179.9992, abs=1e-4)
    assert frame.to_ne(lat, lon) == pytest.approx((0.0, 100.0), abs=1e-6)


def test_a_pole_keeps_the_arithmetic_finite() -> None:
    frame = LocalFrame.at(POLE, 0.3)
    lat, lon = frame.to_lat_lon(10.0, 1.0)
    assert lat == POLE  # nothing lies north of it
    assert -math.pi <= lon < math.pi
    assert all(map(math.isfinite, frame.to_ne(POLE - 1e-6, -2.0)))


def test_height_above_the_ellipsoid_stretches_the_frame() -> None:
    low, high = LocalFrame.at(0.5, 0.0), LocalFrame.at(0.5, 0.0, alt_m=6378.137)
    ratio = high.east_m_per_rad / low.east_m_per_rad
    assert ratio == pytest.approx(1.001, abs=1e-5)
