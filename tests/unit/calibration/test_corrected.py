"""The corrected model gives back the truth that a known chip was shown."""

import math
from struct import pack

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from imu_tracker.calibration.corrected import (
    CorrectedModel,
    Corrections,
    Matrix,
    corrected_arrays,
)
from imu_tracker.calibration.counts import CountsModel
from imu_tracker.calibration.readings import decode
from imu_tracker.errors import CalibrationError
from imu_tracker.samples import DEFAULT_MOUNT, SessionHeader, Vec3

HEADER = SessionHeader(4, 500, 100.0)
counts = st.integers(-30000, 30000)
G_MPS2 = 9.80665


def burst(accel_mps2: np.ndarray, gyro_radps: np.ndarray, temp_degc: float) -> bytes:
    """Count as the chip does, by the datasheet."""
    values = [*accel_mps2 / G_MPS2 * 8192, (temp_degc - 36.53) * 340]
    values += [*np.degrees(gyro_radps) * 65.5]
    return pack(">7h", *(round(float(v)) for v in values))


def rows(matrix: np.ndarray) -> Matrix:
    a, b, c = ((float(x), float(y), float(z)) for x, y, z in matrix)
    return a, b, c


@given(st.tuples(*[counts] * 7))
def test_corrections_that_correct_nothing_change_nothing(
    values: tuple[int, ...],
) -> None:
    raw = pack(">7h", *values)
    plain = CountsModel(4, 500, DEFAULT_MOUNT).decode(7, raw)
    same = CorrectedModel(HEADER, DEFAULT_MOUNT, Corrections()).decode(7, raw)
    assert same.accel_mps2 == pytest.approx(plain.accel_mps2, abs=1e-12)
    assert same.gyro_radps == pytest.approx(plain.gyro_radps, abs=1e-12)
    assert (same.t_ns, same.temp_degc) == (plain.t_ns, plain.temp_degc)


@pytest.mark.parametrize("value", [32767, -32768])
def test_a_clipped_axis_is_told(value: int) -> None:
    model = CorrectedModel(HEADER, DEFAULT_MOUNT, Corrections())
    assert model.decode(0, pack(">7h", 0, value, 0, 0, 0, 0, 0)).is_saturated


def test_the_truth_comes_back_in_body_axes() -> None:
    gain = np.array([[1.03, 0.02, -0.01], [0.02, 0.97, 0.015], [-0.01, 0.015, 1.02]])
    bias, gyro_bias = np.array([0.3, -0.4, 0.5]), np.array([0.02, -0.03, 0.04])
    angle = math.radians(7.0)
    to_body = np.array(
        [
            [math.cos(angle), -math.sin(angle), 0],
            [math.sin(angle), math.cos(angle), 0],
            [0, 0, 1],
        ]
    )
    mount = np.diag([1.0, -1.0, -1.0])
    force_b, rate_b = np.array([1.0, -2.0, -9.5]), np.array([0.1, 0.2, -0.3])
    force_s = mount.T @ to_body.T @ force_b
    rate_s = mount.T @ to_body.T @ rate_b
    raw = burst(gain @ force_s + bias, rate_s + gyro_bias, 30.0)
    known = Corrections(
        accel_bias_mps2=(0.3, -0.4, 0.5),
        accel_gain=rows(gain),
        gyro_bias_radps=(0.02, -0.03, 0.04),
        mount=DEFAULT_MOUNT,
        rotation=rows(to_body),
    )
    sample = CorrectedModel(HEADER, DEFAULT_MOUNT, known).decode(5, raw)
    # A symmetric gain holds no rotation: the gyroscope is only turned with the box.
    assert sample.accel_mps2 == pytest.approx(tuple(force_b), abs=2e-3)
    assert sample.gyro_radps == pytest.approx(tuple(rate_b), abs=3e-4)


def test_a_chip_that_lies_askew_in_its_box_is_turned_as_a_whole() -> None:
    angle = math.radians(3.0)
    askew = np.array(
        [
            [math.cos(angle), math.sin(angle), 0],
            [-math.sin(angle), math.cos(angle), 0],
            [0, 0, 1],
        ]
    )
    force, rate = np.array([3.0, 4.0, 9.0]), np.array([1.0, 2.0, 0.0])
    known = Corrections(accel_gain=rows(askew))
    sample = CorrectedModel(HEADER, ("+x", "+y", "+z"), known).decode(
        0, burst(askew @ force, askew @ rate, 25.0)
    )
    assert sample.accel_mps2 == pytest.approx(tuple(force), abs=2e-3)
    assert sample.gyro_radps == pytest.approx(tuple(rate), abs=3e-4)


@pytest.mark.parametrize(
    ("temp_degc", "used_degc"),
    [(25.0, 25.0), (29.0, 29.0), (45.0, 30.0), (-10.0, 20.0)],
)
def test_the_bias_follows_temperature_as_far_as_it_was_seen(
    temp_degc: float, used_degc: float
) -> None:
    known = Corrections(
        gyro_bias_radps=(0.01, 0.0, 0.0),
        gyro_temp_degc=25.0,
        gyro_radps_per_degc=(0.001, 0.0, 0.0),
        gyro_temps_degc=(20.0, 30.0),
    )
    model = CorrectedModel(HEADER, ("+x", "+y", "+z"), known)
    sample = model.decode(0, burst(np.zeros(3), np.zeros(3), temp_degc))
    expected = -0.01 - 0.001 * (used_degc - 25.0)
    assert sample.gyro_radps[0] == pytest.approx(expected, abs=1e-5)


def test_many_at_once_are_corrected_as_one_by_one() -> None:
    rng = np.random.default_rng(3)
    gain = np.eye(3) + 0.02 * rng.standard_normal((3, 3))
    known = Corrections(
        accel_bias_mps2=(0.1, 0.2, 0.3),
        accel_gain=rows(gain),
        gyro_bias_radps=(0.01, 0.02, 0.03),
        gyro_radps_per_degc=(0.001, 0.002, 0.003),
        gyro_temps_degc=(24.0, 26.0),
    )
    raws = [pack(">7h", *rng.integers(-9000, 9000, 7).tolist()) for _ in range(50)]
    axes: tuple[str, str, str] = ("+x", "+y", "+z")
    model = CorrectedModel(HEADER, axes, known)
    single = [model.decode(0, raw) for raw in raws]
    many = corrected_arrays(decode(range(50), raws, 4, 500), known)
    expected: list[Vec3] = [sample.accel_mps2 for sample in single]
    assert many.accel_mps2 == pytest.approx(np.array(expected), abs=1e-9)
    expected = [sample.gyro_radps for sample in single]
    assert many.gyro_radps == pytest.approx(np.array(expected), abs=1e-9)


def test_the_corrections_of_another_chip_are_refused() -> None:
    with pytest.raises(CalibrationError, match=r"chip MPU-6500, this one is MPU-6050"):
        CorrectedModel(HEADER, DEFAULT_MOUNT, Corrections(chip="MPU-6500"))


def test_the_corrections_of_another_mounting_are_refused() -> None:
    known = Corrections(mount=("+y", "+x", "-z"))
    with pytest.raises(CalibrationError, match=r"calibrate mount` again"):
        CorrectedModel(HEADER, DEFAULT_MOUNT, known)
