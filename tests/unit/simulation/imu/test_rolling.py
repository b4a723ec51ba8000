"""The turning parts of a simulated car: lines where a formula puts them."""

import numpy as np
import pytest

from imu_tracker.simulation import simulate
from imu_tracker.simulation.imu.rolling import Rolling

RATE_HZ = 100.0
SPEED_MPS = 20.0


def stretch(
    rolling: Rolling, first: int, n: int, yaw_radps: float = 0.0
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    t_s = np.arange(first, first + n) / RATE_HZ
    return rolling.at(t_s, np.full(n, SPEED_MPS), np.full(n, yaw_radps))


def loudest_hz(values: np.ndarray) -> float:
    power = np.abs(np.fft.rfft(values - values.mean())) ** 2
    return float(np.argmax(power)) * RATE_HZ / len(values)


def with_lines(seed: int) -> Rolling:
    """Take a car that begins on a surface with lines."""
    for more in range(20):
        probe, rolling = (
            Rolling(np.random.default_rng([seed, more]), RATE_HZ) for _ in range(2)
        )
        if stretch(probe, 0, 900)[0].all(axis=1).mean() > 0.9:
            return rolling
    raise AssertionError("no surface has lines")


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_wheel_makes_its_line_at_the_speed_over_its_circumference(seed: int) -> None:
    rolling = with_lines(seed)
    wheels, _, _ = stretch(rolling, 0, 800)
    expected_hz = SPEED_MPS / rolling.circumference_m
    assert loudest_hz(wheels[:, 2]) == pytest.approx(expected_hz, abs=0.2)


def test_in_a_bend_the_wheels_of_both_sides_part() -> None:
    # At 0.4 rad/s they turn 1.5 % faster and slower: 0.15 Hz of 10, nothing between.
    rolling = with_lines(5)
    wheels, _, _ = stretch(rolling, 0, 900, 0.4)
    middle_hz = SPEED_MPS / rolling.circumference_m
    apart_hz = abs(loudest_hz(wheels[:, 2]) - middle_hz)
    assert apart_hz == pytest.approx(0.015 * middle_hz, abs=0.08)


def test_stretches_join_without_a_jump() -> None:
    whole, parts = with_lines(4), with_lines(4)
    once = stretch(whole, 0, 600)[0]
    joined = np.vstack([stretch(parts, k, 200)[0] for k in (0, 200, 400)])
    assert once == pytest.approx(joined, abs=1e-9)


def test_wheels_off_is_another_vibration_and_the_same_drive() -> None:
    on, off = (
        simulate("drive", seed=5, duration_s=60.0, wheels=wheels)
        for wheels in (True, False)
    )
    assert list(on.truth) == list(off.truth)
    assert list(on.frames) != list(off.frames)
