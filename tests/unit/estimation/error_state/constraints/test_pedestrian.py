"""What is known of a body in the dark: gait and road."""

import math

import pytest

from imu_tracker.estimation.error_state.constraints.pedestrian import Gait
from imu_tracker.estimation.error_state.constraints.road_prior import RoadPrior
from imu_tracker.estimation.error_state.filter import Eskf
from imu_tracker.estimation.error_state.mechanisation import Nominal
from imu_tracker.estimation.error_state.states import NoiseLevel
from imu_tracker.estimation.tuning import (
    GAIT_LEARNING_S,
    LEAST_FORWARD_MPS2,
    LEAST_SLOPE_RAD,
    START_SLOPE_RAD,
    START_WALK_MPS,
)
from imu_tracker.geometry.rotation import from_euler
from imu_tracker.samples import Vec3

NOISE = NoiseLevel(gyro_share=0.1, accel_share=0.1)


def moving(v_n: Vec3, yaw_rad: float = 0.0, pitch_rad: float = 0.0) -> Eskf:
    eskf = Eskf(NOISE, is_vehicle=True)
    q_nb = from_euler(0.0, pitch_rad, yaw_rad)
    eskf.nominal = Nominal(0, (0.0, 0.0, 0.0), v_n, q_nb)
    return eskf


# -------------------------------------------------------------------------- gait


def walked(v_ne: tuple[float, float], seconds: int, turned_rad: float = 0.0) -> Gait:
    gait = Gait()
    for _ in range(seconds):
        gait.learn(v_ne, turned_rad, 1.0, is_stepping=True)
    return gait


def test_a_walker_goes_on_where_the_box_has_turned_to() -> None:
    # North at 1.4 m/s, after any turns before; then he turns right.
    for before_rad in (0.0, 2.0, -7.0):
        gait = walked((1.4, 0.0), 120, before_rad)
        after_rad = before_rad + 0.5 * math.pi
        onward = gait.continued_velocity(moving((0.0, 0.0, 0.0)), after_rad, 10.0, 1.0)
        assert onward is not None
        assert onward.z == pytest.approx([0.0, 1.4], abs=0.02)


def test_what_the_gyro_may_have_drifted_is_doubted_across_alone() -> None:
    gait = walked((1.4, 0.0), 120)
    early = gait.continued_velocity(moving((1.4, 0.0, 0.0)), 0.0, 1.0, 1.0)
    late = gait.continued_velocity(moving((1.4, 0.0, 0.0)), 0.0, 300.0, 1.0)
    assert early is not None
    assert late is not None
    assert late.R[0, 0] == pytest.approx(early.R[0, 0])
    assert late.R[1, 1] > 2.0 * early.R[1, 1]


def test_how_somebody_walks_is_not_known_at_once() -> None:
    gait = walked((1.4, 0.0), int(GAIT_LEARNING_S) - 1)
    for _ in range(100):  # standing about, and rolling along, teach nothing of it
        gait.learn((0.1, 0.0), 0.0, 1.0, is_stepping=True)
        gait.learn((0.0, 1.4), 0.0, 1.0, is_stepping=False)
    assert gait.continued_velocity(moving((1.4, 0.0, 0.0)), 0.0, 1.0, 1.0) is None


def test_the_speed_on_foot_is_bounded_by_what_was_seen() -> None:
    stroller, runner = walked((0.8, 0.0), 300), walked((0.0, 4.0), 300)
    lost = moving((10.0, 0.0, 0.0))
    slow, fast, unknown = (g.speed_bound(lost, 1.0) for g in (stroller, runner, Gait()))
    assert slow.z == pytest.approx([-10.0, 0.0])
    assert slow.R[0, 0] < unknown.R[0, 0] < fast.R[0, 0]
    # Two axes share the square of the speed; 30 s of it count as one.
    assert unknown.R[0, 0] == pytest.approx(30.0 * START_WALK_MPS**2 / 2.0)


# -------------------------------------------------------------------------- road


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
