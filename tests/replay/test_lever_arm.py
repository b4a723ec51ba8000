"""An antenna away from the chip: simulated exactly, and true when it is not configured.

Reported as xsens driver #56, fusioncore #105 and septentrio driver #131.
"""

import math
from itertools import pairwise

import pytest

from imu_tracker.config import load_config
from imu_tracker.recording.replay import Replay
from imu_tracker.simulation import Simulated, simulate

METRES_PER_DEG = 111_200.0


def drive(lever_m: float, seconds: float = 150.0, seed: int = 3) -> Simulated:
    lever_arm_m = (lever_m, 0.0, -1.0) if lever_m else (0.0, 0.0, 0.0)
    return simulate("drive", seed=seed, duration_s=seconds, lever_arm_m=lever_arm_m)


def test_the_antenna_is_ahead_by_the_lever_arm_wherever_the_body_points() -> None:
    chip, antenna = drive(0.0).truth, drive(9.0).truth
    for here, there in zip(chip, antenna, strict=True):
        north_m = math.degrees(there.lat_rad - here.lat_rad) * METRES_PER_DEG
        east_m = math.degrees(there.lon_rad - here.lon_rad) * METRES_PER_DEG
        east_m *= math.cos(here.lat_rad)
        assert math.hypot(north_m, east_m) == pytest.approx(9.0, abs=0.5)


def test_the_velocity_of_the_antenna_is_that_of_its_places() -> None:
    rows = list(drive(9.0).truth)
    for before, after in pairwise(rows[40:-40]):
        moved_m = math.degrees(after.lat_rad - before.lat_rad) * METRES_PER_DEG
        mean_mps = 0.5 * (before.v_n_mps[0] + after.v_n_mps[0])
        assert moved_m / (after.utc_s - before.utc_s) == pytest.approx(
            mean_mps, abs=0.3
        )


@pytest.mark.parametrize(
    ("lever_m", "is_configured"), [(9.0, False), (3.0, False), (9.0, True)]
)
def test_r95_is_true_whether_the_lever_arm_is_configured_or_not(
    lever_m: float, is_configured: bool
) -> None:
    lever = f"gps.lever_arm_m=[{lever_m},0,-1]"
    inside = []
    for seed in (3, 4):  # a receiver's lasting error is one draw a drive
        simulated = drive(lever_m, 300.0, seed)
        replay = Replay(load_config(None, [lever] if is_configured else []))
        rows = list(replay.rows([simulated.header, *simulated.frames]))
        truth = {round(row.utc_s * 1000): row for row in simulated.truth}
        for row in rows[120:]:
            true = truth[round(row.utc_s * 1000)]
            north_m = math.degrees(row.lat_rad - true.lat_rad) * METRES_PER_DEG
            east_m = math.degrees(row.lon_rad - true.lon_rad) * METRES_PER_DEG
            east_m *= math.cos(true.lat_rad)
            inside.append(math.hypot(north_m, east_m) <= row.r95_m)
    assert sum(inside) / len(inside) > 0.95
