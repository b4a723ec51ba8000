"""Fixes on a meridian, at a receiver that lags."""

from imu_tracker.samples import GpsFix

S = 1_000_000_000
METRES_PER_RAD = 6.37e6


def fix(
    t_s: float,
    *,
    lag_s: float = 0.2,
    north_m: float = 0.0,
    v_north_mps: float | None = 0.0,
) -> GpsFix:
    """Return a fix that describes `t_s` and arrives so much later."""
    return GpsFix(
        t_ns=round((t_s + lag_s) * S),
        utc_s=1.8e9 + t_s,
        lat_rad=0.9 + north_m / METRES_PER_RAD,
        lon_rad=0.07,
        alt_m=None,
        vel_ne_mps=None if v_north_mps is None else (v_north_mps, 0.0),
        sigma_h_m=2.0,
        quality=1,
    )
