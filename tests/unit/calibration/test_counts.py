"""Counts against the datasheet's own figures (PS-MPU-6000A, RM-MPU-6000A)."""

import math
from itertools import permutations, product
from struct import pack

import numpy as np
import pytest

from imu_tracker.calibration.counts import CountsModel, parse_mount
from imu_tracker.errors import ConfigError
from imu_tracker.samples import Mount

CHIP_AXES: Mount = ("+x", "+y", "+z")
G = 9.80665


def burst(
    accel: tuple[int, int, int] = (0, 0, 0),
    temp: int = 0,
    gyro: tuple[int, int, int] = (0, 0, 0),
) -> bytes:
    return pack(">7h", *accel, temp, *gyro)


@pytest.mark.parametrize(
    ("range_g", "lsb_per_g"), [(2, 16384), (4, 8192), (8, 4096), (16, 2048)]
)
def test_one_g_is_as_many_counts_as_the_datasheet_says(
    range_g: int, lsb_per_g: int
) -> None:
    sample = CountsModel(range_g, 250, CHIP_AXES).decode(5, burst((lsb_per_g, 0, 0)))
    assert sample.accel_mps2 == pytest.approx((G, 0.0, 0.0))
    assert sample.t_ns == 5


@pytest.mark.parametrize(
    ("range_dps", "lsb_per_dps"), [(250, 131), (500, 65.5), (1000, 32.8), (2000, 16.4)]
)
def test_ten_degrees_per_second_are_as_many_counts(
    range_dps: int, lsb_per_dps: float
) -> None:
    raw = burst(gyro=(0, round(10 * lsb_per_dps), 0))
    sample = CountsModel(2, range_dps, CHIP_AXES).decode(0, raw)
    assert sample.gyro_radps == pytest.approx((0.0, math.radians(10.0), 0.0))


@pytest.mark.parametrize(
    ("counts", "degc"), [(0, 36.53), (-5632, 36.53 - 5632 / 340), (340, 37.53)]
)
def test_the_temperature_is_the_register_maps(counts: int, degc: float) -> None:
    assert CountsModel(2, 250).decode(0, burst(temp=counts)).temp_degc == (
        pytest.approx(degc)
    )


def test_all_counts_come_back() -> None:
    model = CountsModel(4, 500, ("-y", "+z", "-x"))
    for count in range(-32768, 32768):
        raw = burst((count, -1 - count, count), count, (-1 - count, count, count))
        sample = model.decode(0, raw)
        again = model.encode(sample.accel_mps2, sample.gyro_radps, sample.temp_degc)
        assert again == raw


def test_values_beyond_the_range_are_clipped() -> None:
    model = CountsModel(2, 250, CHIP_AXES)
    raw = model.encode((100.0, -100.0, 0.0), (9.0, -9.0, 0.0), 36.53)
    assert raw == burst((32767, -32768, 0), 0, (32767, -32768, 0))


@pytest.mark.parametrize("axis", range(6))
@pytest.mark.parametrize("count", [32767, -32768])
def test_any_axis_at_the_end_of_its_range_is_saturated(axis: int, count: int) -> None:
    values = [1] * 6
    values[axis] = count
    raw = burst((values[0], values[1], values[2]), 7, (values[3], values[4], values[5]))
    assert CountsModel(2, 250).decode(0, raw).is_saturated
    values[axis] -= 1 if count > 0 else -1
    raw = burst((values[0], values[1], values[2]), 7, (values[3], values[4], values[5]))
    assert not CountsModel(2, 250).decode(0, raw).is_saturated


def test_a_chip_that_lies_flat_reads_gravity_upwards_by_default() -> None:
    sample = CountsModel(2, 250).decode(0, burst((0, 0, 16384)))
    assert sample.accel_mps2 == pytest.approx((0.0, 0.0, -G))


def test_every_right_handed_mount_is_accepted_and_no_other() -> None:
    accepted = 0
    for order in permutations("xyz"):
        for signs in product("+-", repeat=3):
            x, y, z = (s + a for s, a in zip(signs, order, strict=True))
            mount = (x, y, z)
            C_bs = np.zeros((3, 3))
            for row, (s, a) in enumerate(zip(signs, order, strict=True)):
                C_bs[row, "xyz".index(a)] = 1.0 if s == "+" else -1.0
            if np.linalg.det(C_bs) < 0:
                with pytest.raises(ConfigError, match="mirror image"):
                    parse_mount(mount)
                continue
            accepted += 1
            sample = CountsModel(2, 250, mount).decode(0, burst((100, 200, 300)))
            expected = C_bs @ [100, 200, 300] * G / 16384
            assert sample.accel_mps2 == pytest.approx(expected.tolist())
    assert accepted == 24  # the rotations of a cube


@pytest.mark.parametrize(
    "mount",
    [("+x", "+x", "+z"), ("x", "+y", "+z"), ("+x", "+y", "*z"), ("+x", "+y", "")],
)
def test_a_mount_that_is_no_rotation_is_refused(mount: Mount) -> None:
    with pytest.raises(ConfigError, match="mount"):
        parse_mount(mount)


def test_ranges_that_the_chip_has_not_are_refused() -> None:
    with pytest.raises(ConfigError, match="accel range 3 g"):
        CountsModel(3, 500)
    with pytest.raises(ConfigError, match="gyro range 600"):
        CountsModel(4, 600)
