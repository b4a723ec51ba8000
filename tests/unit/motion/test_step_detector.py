"""Steps of a walker, and what only shakes alike."""

import math
from collections.abc import Callable

import pytest

from imu_tracker.motion.preintegration import ImuStep
from imu_tracker.motion.step_detector import StepDetector

DT_S = 0.04
ZERO = (0.0, 0.0, 0.0)


def seconds_of(force_mps2: Callable[[float], float]) -> StepDetector:
    step_detector = StepDetector()
    for k in range(round(20.0 / DT_S)):
        dv_b = (0.0, 0.0, -force_mps2(k * DT_S) * DT_S)
        step = ImuStep(
            *(k * 40_000_000, DT_S, ZERO, dv_b, 4, ZERO, ZERO, 0.0, 0.0, 25.0),
            is_saturated=False,
            is_gap=False,
        )
        step_detector.add_step(step)
    return step_detector


def shaking(amplitude_mps2: float, hz: float) -> Callable[[float], float]:
    return lambda t_s: 9.81 + amplitude_mps2 * math.sin(2.0 * math.pi * hz * t_s)


def test_the_steps_of_a_walker_are_seen() -> None:
    assert seconds_of(shaking(3.0, 1.8)).is_stepping
    assert seconds_of(shaking(6.0, 2.8)).is_stepping  # a runner


@pytest.mark.parametrize(
    ("amplitude_mps2", "hz"), [(3.0, 9.0), (3.0, 0.25), (0.5, 1.8), (0.0, 1.0)]
)
def test_cobbles_waves_and_springs_are_no_steps(
    amplitude_mps2: float, hz: float
) -> None:
    assert not seconds_of(shaking(amplitude_mps2, hz)).is_stepping
