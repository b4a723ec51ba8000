"""Level and drive: a mounting that is known comes back, and nonsense is refused."""

import math

import numpy as np
import pytest

from imu_tracker.calibration.mounting import (
    Manoeuvre,
    level,
    manoeuvres,
    with_yaw,
)
from imu_tracker.errors import CalibrationError
from imu_tracker.geometry.rotation import from_euler, matrix

G_MPS2 = 9.81
ROLL, PITCH, YAW = math.radians(3.0), math.radians(-4.0), math.radians(-11.0)

# Body from the axes that the mount names: yaw after pitch after roll.
TO_BODY = matrix(from_euler(ROLL, PITCH, YAW))
AT_REST = TO_BODY.T @ (0.0, 0.0, -G_MPS2)


def drive(noise_mps2: float, n: int = 60, seed: int = 1) -> list[Manoeuvre]:
    """Speed up, brake and turn; feel it in a box that sits askew."""
    rng = np.random.default_rng(seed)
    made = []
    for forward, right in rng.uniform(-2.0, 2.0, (n, 2)).tolist():
        felt = TO_BODY.T @ (forward, right, -G_MPS2)
        felt += noise_mps2 * rng.standard_normal(3)
        made.append(Manoeuvre(felt, forward, right))
    return made


def test_level_takes_the_tilt_out() -> None:
    fit = level(AT_REST)
    assert fit.rotation @ AT_REST == pytest.approx((0.0, 0.0, -G_MPS2), abs=1e-9)
    assert fit.tilt_rad == pytest.approx((ROLL, PITCH), abs=1e-9)
    assert fit.yaw_rad is None


def test_a_drive_shows_the_yaw() -> None:
    fit = with_yaw(level(AT_REST), drive(0.0))
    assert fit.yaw_rad == pytest.approx(YAW, abs=1e-6)
    assert fit.rotation == pytest.approx(TO_BODY, abs=1e-6)


def test_the_uncertainty_of_yaw_covers_its_error() -> None:
    misses = []
    for seed in range(40):
        fit = with_yaw(level(AT_REST), drive(0.3, seed=seed))
        assert fit.yaw_rad is not None
        assert fit.yaw_sigma_rad is not None
        misses.append((fit.yaw_rad - YAW) / fit.yaw_sigma_rad)
    assert 0.7 < np.std(misses) < 1.4


def test_a_choice_of_axes_that_is_not_the_box_s_is_refused() -> None:
    with pytest.raises(CalibrationError, match=r"set imu\.mount first"):
        level(np.array([G_MPS2, 0.0, 0.0]))
    with pytest.raises(CalibrationError, match=r"set imu\.mount first"):
        level(np.zeros(3))


def test_a_drive_straight_on_shows_nothing() -> None:
    steady = [Manoeuvre(AT_REST, 0.0, 0.0)] * 300
    with pytest.raises(CalibrationError, match="only 0 seconds of speeding up"):
        with_yaw(level(AT_REST), steady)


def test_a_box_that_points_sideways_is_not_turned_by_the_file() -> None:
    sideways = [
        Manoeuvre(TO_BODY.T @ (m.right_mps2, -m.forward_mps2, -G_MPS2), *m[1:])
        for m in drive(0.0)
    ]
    with pytest.raises(CalibrationError, match=r"a yaw of .* not to be trusted"):
        with_yaw(level(AT_REST), sideways)


def test_manoeuvres_are_the_means_between_two_fixes() -> None:
    t_s = np.arange(0.0, 10.0, 0.01)
    accel = np.column_stack([t_s >= 3.8, np.zeros_like(t_s), np.full_like(t_s, -9.81)])
    speeds = [(2.0, 5.0), (3.0, 5.0), (4.0, 5.0), (4.5, 5.5), (5.0, 6.0), (9.5, 6.0)]
    found = manoeuvres(t_s, accel, np.full_like(t_s, 0.1), speeds, 0.2)
    # Fixes of half a second are put together, and over a hole nothing is said.
    assert [m.forward_mps2 for m in found] == [0.0, 0.0, 1.0]
    assert [m.accel_mps2[0] for m in found] == pytest.approx([0.0, 0.0, 1.0])
    assert [m.right_mps2 for m in found] == pytest.approx([0.5, 0.5, 0.55])
