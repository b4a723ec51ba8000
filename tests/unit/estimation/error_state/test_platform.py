"""The platform: what it hears of a body, and what it must not take for a turn."""

import math

from imu_tracker.estimation.error_state.filter import Eskf
from imu_tracker.estimation.error_state.mechanisation import Nominal
from imu_tracker.estimation.error_state.platform import Platform
from imu_tracker.estimation.error_state.states import GYRO_BIAS, NoiseLevel
from imu_tracker.geometry.rotation import IDENTITY, from_euler

SECOND_NS = 1_000_000_000


class Course:
    """An upright body at 12 m/s, seen each second."""

    def __init__(self) -> None:
        self.platform = Platform("auto")
        self.eskf = Eskf(NoiseLevel(0.1, 0.1), is_vehicle=False)
        self.t_ns = 0

        self.eskf.set_variances(GYRO_BIAS, [1e-8] * 3)
        self.is_aligned = True

    def go(self, seconds: int, turn_radps: float = 0.0, yaw_rad: float = 0.0) -> None:
        for _ in range(seconds):
            self.t_ns += SECOND_NS
            self.platform.turned_rad += turn_radps
            q_nb = from_euler(0.0, 0.0, yaw_rad)
            self.eskf.nominal = Nominal(self.t_ns, (0, 0, 0), (12.0, 0.0, 0.0), q_nb)
            self.platform.add_motion(self.eskf, IDENTITY, is_aligned=self.is_aligned)


def test_upright_turns_make_a_vehicle_and_are_told_once() -> None:
    course = Course()
    course.go(30, turn_radps=0.25)
    assert course.platform.profile == "free"  # until somebody acts on it
    assert course.platform.adopt_found_profile()
    assert course.platform.is_vehicle
    assert not course.platform.adopt_found_profile()


def test_a_heading_that_is_found_is_no_turn() -> None:
    course = Course()
    course.go(10)
    course.go(60, yaw_rad=math.radians(160.0))
    assert not course.platform.adopt_found_profile()


def test_nobody_is_judged_by_turns_before_heading_and_gyro_are_known() -> None:
    # Turned by half against its way an aeroplane leans out; and a bias turns for ever.
    lost, drifting = Course(), Course()
    lost.is_aligned = False
    drifting.eskf.set_variances(GYRO_BIAS, [math.radians(2.0) ** 2] * 3)
    for course in (lost, drifting):
        course.go(60, turn_radps=0.25)
        assert not course.platform.adopt_found_profile()


def test_what_turned_in_the_dark_says_nothing_at_its_end() -> None:
    # An aeroplane lost the receiver in a turn, and levels out before it comes back.
    course = Course()
    for _ in range(20):
        course.go(5)
        course.t_ns += 30 * SECOND_NS
        course.platform.turned_rad += 2.0
    assert not course.platform.adopt_found_profile()


def test_a_profile_that_was_given_is_kept() -> None:
    course = Course()
    course.platform = Platform("free")
    course.go(60, turn_radps=0.25)
    assert not course.platform.adopt_found_profile()
    assert course.platform.profile == "free"
