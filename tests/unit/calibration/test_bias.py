"""The gyroscope's bias and its slope, from stretches without motion alone."""

import math

import numpy as np
import pytest

from imu_tracker.calibration.bias import GyroFit, fit_gyro, slope_of
from imu_tracker.calibration.readings import windows
from imu_tracker.calibration.still import still_stretches
from imu_tracker.errors import CalibrationError
from imu_tracker.recording.capture import capture
from imu_tracker.simulation import simulate
from support.turned_box import X_UP, Z_UP, Box

BIAS_DPS = (1.5, -2.0, 0.25)


def fitted(box: Box) -> GyroFit:
    return fit_gyro(still_stretches(windows(capture(box.stream).readings)))


def test_the_bias_lies_in_its_own_interval() -> None:
    misses = []
    for seed in range(12):
        fit = fitted(Box(gyro_bias_dps=BIAS_DPS, seed=seed).lie(Z_UP, 30.0))
        sigma = np.sqrt(np.diag(fit.covariance))
        misses.append((fit.bias_radps - np.radians(BIAS_DPS)) / sigma)
        assert np.degrees(sigma).max() < 0.003  # 0.05 deg/s over 1500 samples: 0.0013
    assert 0.5 < np.std(misses) < 1.6


def test_only_what_is_still_counts() -> None:
    box = Box(gyro_bias_dps=BIAS_DPS).lie(Z_UP, 12.0).be_held(Z_UP, 5.0)
    box.be_turned(Z_UP, X_UP).lie(X_UP, 12.0)
    fit = fitted(box)
    assert np.degrees(fit.bias_radps) == pytest.approx(BIAS_DPS, abs=0.01)
    assert fit.length_s <= 24


@pytest.mark.parametrize("seconds", [3.0, 9.0])
def test_a_moment_is_too_short(seconds: float) -> None:
    with pytest.raises(CalibrationError, match="hold it still for 10 s"):
        fitted(Box().lie(Z_UP, seconds))


def test_a_hand_is_no_table() -> None:
    with pytest.raises(CalibrationError, match="only 0 s without motion"):
        fitted(Box().be_held(Z_UP, 60.0))


def test_a_turntable_is_no_bias() -> None:
    box = Box().lie(Z_UP, 20.0)
    box.gyro_bias_dps = np.array([0.0, 0.0, 5.0])
    with pytest.raises(CalibrationError, match="turned slowly"):
        fitted(box.lie(Z_UP, 20.0))


def test_a_bias_that_no_good_chip_has_is_refused() -> None:
    with pytest.raises(CalibrationError, match="gyro y turns at -60 deg/s"):
        fitted(Box(gyro_bias_dps=(0.0, -60.0, 0.0)).lie(Z_UP, 20.0))


def test_the_slope_of_a_chip_that_warms_up_is_found_within_its_uncertainty() -> None:
    made = simulate("still", seed=4, duration_s=1200.0, rate_hz=10.0)
    fit = fit_gyro(
        still_stretches(windows(capture([made.header, *made.frames]).readings))
    )
    assert fit.per_degc is not None
    assert fit.per_degc_sigma is not None
    truth = made.chip.gyro_radps_per_degc * (1.0, -1.0, -1.0)  # box to chip
    assert (np.abs(fit.per_degc - truth) < 3.0 * fit.per_degc_sigma).all()
    assert np.degrees(fit.per_degc_sigma).max() < 0.002


def test_at_one_temperature_there_is_no_slope() -> None:
    assert fitted(Box().lie(Z_UP, 30.0)).per_degc is None


def test_a_temperature_that_never_changes_makes_a_file() -> None:
    box = Box()
    box.temp_degc = 26.1
    fit = fitted(box.lie(Z_UP, 55.0))
    low, high = fit.temps_degc
    assert low <= fit.temp_degc <= high


def test_a_drift_that_is_not_the_temperatures_is_no_slope() -> None:
    found = 0
    for seed in range(20):
        rng = np.random.default_rng(seed)
        walk = np.cumsum(rng.standard_normal((600, 3)), axis=0) * math.radians(1e-4)
        temp_degc = 25.0 + 4.0 * np.sin(np.arange(600) / 30.0)
        found += slope_of(temp_degc, walk) is not None
    assert found <= 2
