"""The speed that is heard, as a measurement of the error-state filter."""

import math

import numpy as np
import pytest

from imu_tracker.estimation.error_state.constraints.wheel_aiding import along, correct
from imu_tracker.estimation.error_state.filter import Eskf
from imu_tracker.estimation.error_state.mechanisation import Nominal
from imu_tracker.estimation.error_state.states import (
    N_ERRORS,
    VELOCITY,
    WHEEL_SCALE,
    NoiseLevel,
)
from imu_tracker.estimation.settings import TrackerSettings
from imu_tracker.geometry.rotation import IDENTITY
from imu_tracker.pipeline import Pipeline
from imu_tracker.samples import Source, Vec3
from imu_tracker.simulation import simulate
from imu_tracker.wheels.posterior import SpeedError
from support.simulated import without

NOISE = NoiseLevel(gyro_share=0.1, accel_share=0.1)


def moving(v_n: Vec3, speed_sigma_mps: float = 2.0) -> Eskf:
    eskf = Eskf(NOISE, is_vehicle=True)
    eskf.nominal = Nominal(0, (0.0, 0.0, 0.0), v_n, IDENTITY)
    P = np.eye(N_ERRORS) * 1e-6
    P[VELOCITY, VELOCITY] = np.eye(3) * speed_sigma_mps**2
    eskf.P = P
    return eskf


def test_a_speed_and_its_sigma_are_those_along_the_track() -> None:
    eskf = moving((12.0, 16.0, 0.0))
    assert along(eskf) == pytest.approx((20.0, 2.0))
    assert along(moving((0.0, 0.0, 0.0))) == (0.0, math.inf)


def test_a_measurement_changes_the_speed_and_not_the_course() -> None:
    eskf = moving((12.0, 16.0, 0.0))
    correct(eskf, SpeedError(1.5, 0.01), 20.0, 0.0, has_gps=False)
    vn, ve, _ = eskf.nominal.v_n
    assert math.hypot(vn, ve) == pytest.approx(21.5, abs=0.02)
    assert math.atan2(ve, vn) == pytest.approx(math.atan2(16.0, 12.0), abs=1e-6)


def test_a_filter_that_is_slower_than_the_one_that_was_asked_is_brought_to_it() -> None:
    eskf = moving((18.0, 0.0, 0.0))
    asked_mps = 20.0
    correct(eskf, SpeedError(1.0, 0.01), asked_mps, 0.0, has_gps=False)
    assert eskf.nominal.v_n[0] == pytest.approx(21.0, abs=0.02)


def test_an_answer_beyond_three_sigma_counts_for_little() -> None:
    eskf = moving((20.0, 0.0, 0.0), speed_sigma_mps=0.2)
    correct(eskf, SpeedError(6.0, 0.01), 20.0, 0.0, has_gps=False)
    assert eskf.nominal.v_n[0] - 20.0 < 0.2


def test_an_unknown_circumference_does_not_average_out() -> None:
    # 1 % of the circumference is 0.2 m/s, however often the wheels speak.
    eskf = moving((20.0, 0.0, 0.0))
    eskf.set_variances(WHEEL_SCALE, 0.01**2)
    for _ in range(200):
        correct(eskf, SpeedError(0.0, 0.01), 20.0, eskf.wheel_scale, has_gps=False)
    assert eskf.sigma(3) == pytest.approx(0.2, rel=0.05)


def test_a_known_speed_teaches_the_circumference() -> None:
    eskf = moving((20.0, 0.0, 0.0), speed_sigma_mps=0.01)
    eskf.set_variances(WHEEL_SCALE, 0.01**2)
    for _ in range(50):  # the wheels are 0.5 % larger than is believed
        believed_mps = 20.0 * (1.0 + eskf.wheel_scale) / 1.005
        answer = SpeedError(believed_mps - 20.0, 0.02)
        correct(eskf, answer, 20.0, eskf.wheel_scale, has_gps=True)
    assert eskf.wheel_scale == pytest.approx(0.005, abs=0.0005)
    assert eskf.nominal.v_n[0] == pytest.approx(20.0, abs=0.05)
    assert eskf.sigma(WHEEL_SCALE) < 0.002


def test_with_gps_the_speed_is_the_receivers() -> None:
    eskf = moving((20.0, 0.0, 0.0))
    eskf.set_variances(WHEEL_SCALE, 0.01**2)
    correct(eskf, SpeedError(3.0, 0.01), 20.0, 0.0, has_gps=True)
    assert eskf.nominal.v_n[0] == 20.0
    assert eskf.sigma(3) == pytest.approx(2.0)


def test_wheels_can_be_switched_off_and_change_nothing_where_none_are_heard() -> None:
    found = []
    for hears in (True, False):
        session = simulate("drive", seed=2, duration_s=150.0, wheels=False)
        settings = TrackerSettings(profile="vehicle", uses_wheels=hears)
        pipeline = Pipeline(session.header, settings)
        hidden = without(session.frames, Source.GPS, 100.0, 140.0)
        rows = [row for frame in hidden for row in pipeline.feed(frame)]
        found.append((rows, pipeline.report()["wheels"]))
    (heard, report), (off, nothing) = found
    assert heard == off
    assert report is not None
    assert nothing is None


def test_the_wheels_of_a_drive_are_found_and_given_on_to_the_next_run() -> None:
    session = simulate("drive", seed=2, duration_s=180.0)
    settings = TrackerSettings(profile="vehicle")
    pipeline = Pipeline(session.header, settings)
    for frame in session.frames:
        pipeline.feed(frame)
    learnt = pipeline.learned_parameters()
    assert learnt is not None
    assert learnt.wheels is not None
    told = pipeline.report()["wheels"]
    assert isinstance(told, dict)
    assert told["circumference_m"] == pytest.approx(learnt.wheels.circumference_m)

    again = simulate("drive", seed=2, duration_s=40.0)
    next_run = Pipeline(again.header, settings._replace(prior=learnt))
    for frame in again.frames:
        next_run.feed(frame)
    remembered = next_run.report()["wheels"]
    assert isinstance(remembered, dict)
    assert remembered["circumference_m"] == pytest.approx(
        learnt.wheels.circumference_m, rel=0.02
    )
