"""The receiver alone: against a textbook Kalman filter, and against wild fixes."""

import math

import numpy as np
import pytest
from filterpy.kalman import KalmanFilter

from imu_tracker.estimation.error_state.hypotheses.receiver_alone import (
    RESTART_FIXES,
    SPEED_CORRELATION_S,
    FixNoise,
    ReceiverAlone,
)
from imu_tracker.geometry.geodesy import LocalFrame
from imu_tracker.samples import GpsFix

LAT, LON = math.radians(50.0), math.radians(14.0)
FRAME = LocalFrame.at(LAT, LON)
NOISE = FixNoise(position_var=1.0, velocity_var=0.04, lasting_var=9.0)
PSD = 2.5**2


def fix_at(
    t_s: float, north_m: float, east_m: float, vel: tuple[float, float] | None
) -> GpsFix:
    """Return a fix near the origin of the frame."""
    lat, lon = FRAME.to_lat_lon(north_m, east_m)
    return GpsFix(
        t_ns=round(t_s * 1e9),
        utc_s=None,
        lat_rad=lat,
        lon_rad=lon,
        alt_m=None,
        vel_ne_mps=vel,
        sigma_h_m=3.0,
        quality=1,
    )


def take(alone: ReceiverAlone, fix: GpsFix) -> float | None:
    """Let it take a fix that describes the instant of its arrival."""
    return alone.update(fix, fix.t_ns, NOISE, PSD)


def test_it_is_a_kalman_filter_of_constant_velocity() -> None:
    rng, alone = np.random.default_rng(1), ReceiverAlone(90.0)
    oracle = KalmanFilter(dim_x=4, dim_z=4)  # north, east, and their speeds
    oracle.x, oracle.P = np.zeros(4), np.diag([1.0, 1.0, 0.04, 0.04])
    oracle.R, oracle.H = np.diag([1.0, 1.0, 0.04, 0.04]), np.eye(4)
    oracle.F = np.eye(4) + np.eye(4, k=2)
    eye = np.eye(2)
    after_s = np.linspace(0.0, 1.0, 10_001)  # of a push, by the end of the second
    speed = np.exp(-after_s / SPEED_CORRELATION_S)
    way = SPEED_CORRELATION_S * (1.0 - speed)
    pp, pv, vv = (
        np.trapezoid(product, after_s) for product in (way**2, way * speed, speed**2)
    )
    oracle.Q = PSD * np.block([[eye * pp, eye * pv], [eye * pv, eye * vv]])
    oracle.x[2:] = 5.0, -3.0
    take(alone, fix_at(0.0, 0.0, 0.0, (5.0, -3.0)))
    for t in range(1, 30):
        z = np.array([5.0 * t, -3.0 * t, 5.0, -3.0]) + rng.normal(0.0, 0.3, 4)
        likelihood = take(alone, fix_at(t, z[0], z[1], (z[2], z[3])))
        oracle.predict()
        oracle.update(z)
        assert likelihood == pytest.approx(oracle.log_likelihood, abs=0.01)
    at = alone.estimate_at(29_000_000_000, PSD)
    assert FRAME.to_ne(at.lat_rad, at.lon_rad) == pytest.approx(oracle.x[:2], abs=0.01)
    assert at.v_ne_mps == pytest.approx(oracle.x[2:], abs=1e-3)
    assert at.velocity_var == pytest.approx(oracle.P[2, 2])


def test_one_wild_fix_changes_nothing_and_some_begin_anew() -> None:
    alone = ReceiverAlone(90.0)
    for t in range(10):
        take(alone, fix_at(t, 0.0, 0.0, (0.0, 0.0)))
    for k in range(RESTART_FIXES):
        at = alone.estimate_at(round((10 + k) * 1e9), PSD)
        assert abs(FRAME.to_ne(at.lat_rad, at.lon_rad)[0]) < 0.1
        assert take(alone, fix_at(10 + k, 500.0, 0.0, (0.0, 0.0))) is None
    at = alone.estimate_at(12_000_000_000, PSD)
    assert FRAME.to_ne(at.lat_rad, at.lon_rad)[0] == pytest.approx(500.0, abs=0.1)
    assert not alone.is_settled


def test_ten_minutes_of_fixes_do_not_average_the_lasting_error_away() -> None:
    alone = ReceiverAlone(90.0)
    for t in range(600):
        take(alone, fix_at(t, 0.0, 0.0, (0.0, 0.0)))
    assert alone.estimate_at(600_000_000_000, PSD).position_var_m2 >= 9.0


def test_nothing_goes_further_than_its_kind_can() -> None:
    alone = ReceiverAlone(12.0)
    take(alone, fix_at(0.0, 0.0, 0.0, (1.0, 0.0)))
    at = alone.estimate_at(600_000_000_000, PSD)
    assert math.sqrt(at.position_var_m2) < 12.0 * 600.0
    assert math.sqrt(2.0 * at.velocity_var) <= 12.0 + 1e-9
