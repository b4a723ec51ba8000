"""Laws of the simulator, whatever the numbers."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from imu_tracker.simulation.motion.paths import Path, change_speed, cruise, turn
from imu_tracker.simulation.receiver.sentences import (
    Report,
    Resolution,
    Solution,
    gga,
    rmc,
)

speeds = st.floats(0.5, 40.0)
angles = st.floats(-3.0, 3.0).filter(lambda angle: abs(angle) > 1e-3)


@given(speed=speeds, angle=angles, radius=st.floats(1.0, 500.0), ramp=st.floats(0.5, 5))
def test_a_turn_meets_its_angle_and_never_its_curvature_exceeds(
    speed: float, angle: float, radius: float, ramp: float
) -> None:
    legs = turn(angle, speed, radius, ramp)

    assert sum(leg.turn_rad for leg in legs) == pytest.approx(angle, abs=1e-9)
    assert all(leg.duration_s >= 0.0 for leg in legs)
    assert max(abs(leg.end_curvature_per_m) for leg in legs) <= 1.0 / radius + 1e-12


@given(speed=speeds, peak=st.floats(0.3, 5.0), length=st.floats(1.0, 1000.0))
def test_a_path_gets_as_far_as_its_legs_are_long(
    speed: float, peak: float, length: float
) -> None:
    legs = (
        change_speed(0.0, speed, peak),
        cruise(length, speed),
        change_speed(speed, 0.0, peak),
    )
    end_s = sum(leg.duration_s for leg in legs)
    k = Path(legs).at(np.linspace(0.0, end_s + 1.0, 200))

    assert k.distance_m[-1] == pytest.approx(sum(leg.length_m for leg in legs))
    assert np.diff(k.distance_m).min() >= -1e-9
    assert np.abs(k.accel_mps2).max() <= peak + 1e-9


@given(
    lat_deg=st.floats(-90.0, 90.0),
    lon_deg=st.floats(-180.0, 180.0),
    north=st.floats(-60.0, 60.0),
    east=st.floats(-60.0, 60.0),
    decimals=st.integers(2, 7),
)
def test_what_is_written_reads_back_to_half_a_digit(
    lat_deg: float, lon_deg: float, north: float, east: float, decimals: int
) -> None:
    solution = Solution(
        math.radians(lat_deg), math.radians(lon_deg), 1.0, (north, east), 1.0, 2.0, 1.0
    )
    resolution = Resolution(minute_decimals=decimals)
    report = Report(1795348800.0, solution)
    fields = rmc(report, resolution).decode().split(",")
    assert gga(report, resolution).decode().split(",")[2:6] == fields[3:7]

    for text, side, width, truth_deg in (
        (fields[3], fields[4], 2, lat_deg),
        (fields[5], fields[6], 3, lon_deg),
    ):
        minutes = float(text[width:])
        assert minutes < 60.0
        found_deg = int(text[:width]) + minutes / 60.0
        sign = -1.0 if side in "SW" else 1.0
        half_a_digit = 0.5 * 10.0**-decimals / 60.0
        assert sign * found_deg == pytest.approx(truth_deg, abs=half_a_digit + 1e-11)
    speed_mps = float(fields[7]) * 1852.0 / 3600.0
    assert speed_mps == pytest.approx(math.hypot(north, east), abs=0.003)
    if fields[8]:
        assert 0.0 <= float(fields[8]) < 360.0
        off = math.radians(float(fields[8])) - math.atan2(east, north)
        assert abs(math.remainder(off, 2.0 * math.pi)) <= math.radians(0.0501)
