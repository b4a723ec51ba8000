"""States for tests of the log: only what the test is about must be said."""

from math import radians

from imu_tracker.samples import Mode, NavState

START_UTC_S = 1_795_348_800.0  # 2026-11-22T12:00:00Z
SECOND_NS = 1_000_000_000


def state(
    second: float = 0.0,
    *,
    lat_deg: float = 51.99,
    lon_deg: float = 4.37,
    alt_m: float | None = 5.2,
    v_ne_mps: tuple[float, float] = (1.0, 0.0),
    r95_m: float = 3.9,
    mode: Mode = Mode.GPS,
) -> NavState:
    """Return the estimate so many seconds after 2026-11-22T12:00:00Z."""
    return NavState(
        int(second * SECOND_NS),
        START_UTC_S + second,
        radians(lat_deg),
        radians(lon_deg),
        alt_m,
        (*v_ne_mps, 0.0),
        (1.0, 0.0, 0.0, 0.0),
        r95_m,
        mode,
    )
