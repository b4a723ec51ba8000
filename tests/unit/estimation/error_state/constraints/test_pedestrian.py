"""A gait that was learnt, as a constraint of a walker."""

import math

import pytest

from imu_tracker.estimation.error_state.constraints.pedestrian import Gait
from imu_tracker.estimation.tuning import GAIT_LEARNING_S, START_WALK_MPS
from support.error_state import moving


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
