"""What carries the box: the judge of profiles."""

import math

import pytest

from imu_tracker.motion.profile import ProfileClassifier


def turns(
    classifier: ProfileClassifier, seconds: int, lean_share: float, speed: float
) -> None:
    """Go through corners of 3 m/s^2, to the right and to the left, a fix a second."""
    for k in range(seconds):
        across = 3.0 * math.sin(k / 3.0)
        lean_rad = math.atan(lean_share * across / 9.81)
        classifier.add_motion(1.0, speed, across / speed, lean_rad, is_stepping=False)


@pytest.mark.parametrize(
    ("lean_share", "speed", "profile"),
    [
        (-0.05, 10.0, "vehicle"),  # a car leans out, a little
        (0.1, 30.0, "vehicle"),  # on a banked motorway
        (1.0, 6.0, "free"),  # a bicycle
        (0.95, 60.0, "free"),  # an aeroplane, which leans by 17 deg: as a ramp does
        (1.0, 15.0, "free"),  # a motorcycle
    ],
)
def test_who_leans_into_turns_is_no_car(
    lean_share: float, speed: float, profile: str
) -> None:
    classifier = ProfileClassifier()
    turns(classifier, 100, lean_share, speed)
    assert classifier.profile == profile


def test_nothing_is_said_before_turns_have_shown_it() -> None:
    classifier = ProfileClassifier()
    for _ in range(300):
        classifier.add_motion(1.0, 30.0, 0.001, 0.02, is_stepping=False)
    assert classifier.profile == "free"


def test_a_boat_that_rolls_is_no_car() -> None:
    classifier = ProfileClassifier()
    for k in range(200):
        roll_rad = math.radians(6.0) * math.sin(1.7 * k)
        turn_rad = 0.3 * math.sin(k / 20.0)
        classifier.add_motion(1.0, 8.0, turn_rad, roll_rad, is_stepping=False)
    assert classifier.profile == "free"


def test_who_gets_in_from_the_side_of_the_road_does_not_roll() -> None:
    classifier = ProfileClassifier()
    turns(classifier, 60, 0.0, 12.0)
    for k in range(40):  # each stop tips the box anew; between them it lies still
        classifier.add_motion(1.0, 0.0, 0.0, 0.0, is_stepping=False)
        for _ in range(5):
            classifier.add_motion(1.0, 12.0, 0.0, 0.2 * (-1) ** k, is_stepping=False)
    assert classifier.profile == "vehicle"


def test_nothing_on_wheels_is_as_fast_as_an_aeroplane() -> None:
    classifier = ProfileClassifier()
    turns(classifier, 100, 0.0, 20.0)
    assert classifier.profile == "vehicle"
    classifier.add_motion(1.0, 90.0, 0.0, 0.0, is_stepping=False)
    assert classifier.profile == "free"


def test_steps_make_a_walker_until_he_gets_into_a_car() -> None:
    classifier = ProfileClassifier()
    for _ in range(30):
        classifier.add_motion(1.0, 1.4, 0.1, 0.2, is_stepping=True)
    assert classifier.profile == "walker"
    classifier.add_motion(1.0, 14.0, 0.0, 0.05, is_stepping=False)
    assert classifier.profile == "free"


def test_a_box_that_went_from_the_car_to_the_bicycle_is_found_out() -> None:
    classifier = ProfileClassifier()
    turns(classifier, 600, 0.0, 12.0)
    assert classifier.profile == "vehicle"
    turns(classifier, 300, 1.0, 6.0)
    assert classifier.profile == "free"
