"""Slope and acceleration of a road, as priors."""

import math

import pytest

from imu_tracker.estimation.error_state.constraints.road_prior import RoadPrior
from imu_tracker.estimation.tuning import (
    LEAST_FORWARD_MPS2,
    LEAST_SLOPE_RAD,
    START_SLOPE_RAD,
)
from support.error_state import moving


def test_a_level_motorway_at_a_steady_speed_is_known_to_be_one() -> None:
    road = RoadPrior()
    for _ in range(1200):
        road.learn(moving((30.0, 0.0, 0.0)), 1.0)
    assert road.slope_sigma_rad < math.radians(2.0)
    assert road.forward_sigma_mps2 < 0.4
    assert road.slope_sigma_rad >= LEAST_SLOPE_RAD
    assert road.forward_sigma_mps2 >= LEAST_FORWARD_MPS2


def test_a_pass_road_is_steeper_than_one_had_thought() -> None:
    road = RoadPrior()
    for k in range(1200):
        pitch_rad = math.radians(8.0) * (1 if k // 300 % 2 else -1)
        road.learn(moving((10.0, 0.0, 0.0), 0.0, pitch_rad), 1.0)
    assert road.slope_sigma_rad == pytest.approx(math.radians(8.0), rel=0.1)


def test_who_stands_says_nothing_of_roads() -> None:
    road = RoadPrior()
    for _ in range(1000):
        road.learn(moving((0.1, 0.0, 0.0)), 1.0)
    assert road.slope_sigma_rad == START_SLOPE_RAD
