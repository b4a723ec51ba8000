"""The figures of the thesis: their shapes, their thousand points, their sensors."""

import math

import numpy as np
import pytest

from imu_tracker.calibration.counts import CountsModel
from imu_tracker.samples import DEFAULT_MOUNT, GpsFix, Source
from imu_tracker.sensors.gnss.epoch_reader import EpochReader
from imu_tracker.simulation import SCENARIOS, simulate
from imu_tracker.simulation.motion.figures import (
    POINTS,
    ROUND_S,
    RUN_UP_S,
    circle,
    going_round,
    lissajous,
    side_by_side,
)
from imu_tracker.simulation.motion.paths import FloatArray
from imu_tracker.simulation.scenarios import START_STILL_S

FIGURES = ("square", "circle", "lissajous")
METRES_PER_RAD = 6.37e6


def truth_ne_m(scenario: str) -> FloatArray:
    """North and east of the truth since the start, on a sphere: good to 1 %."""
    rows = list(simulate(scenario, truth_hz=20).truth)
    lat, lon = np.array([(row.lat_rad, row.lon_rad) for row in rows]).T
    east = (lon - lon[0]) * math.cos(lat[0])
    return np.column_stack([lat - lat[0], east]) * METRES_PER_RAD


def test_the_circle_is_one() -> None:
    start_ne_m = np.array([math.cos(1.0), -math.sin(1.0)])  # a radian of run-up
    ne_m = truth_ne_m("circle") + start_ne_m

    np.testing.assert_allclose(np.hypot(*ne_m.T), 1.0, atol=0.01)


def test_the_lissajous_figure_is_three_to_two() -> None:
    t_s = START_STILL_S + RUN_UP_S + np.linspace(0.0, ROUND_S, POINTS)
    ne_m = going_round(lissajous, START_STILL_S).ne_m(t_s)
    t = np.linspace(0.0, 2.0 * np.pi, POINTS)

    np.testing.assert_allclose(ne_m[:, 0], np.cos(3.0 * t), atol=1e-12)
    np.testing.assert_allclose(ne_m[:, 1], np.sin(2.0 * t), atol=1e-12)


def test_the_square_has_sides_of_a_metre_and_closes() -> None:
    ne_m = truth_ne_m("square")

    assert np.ptp(ne_m, axis=0) == pytest.approx([1.0, 1.0], rel=0.01)
    assert ne_m[-1] == pytest.approx([0.0, 0.0], abs=1e-6)
    # Always on a side: north or east is that of a corner.
    from_side = np.minimum(np.abs(ne_m), np.abs(ne_m - 1.0)).min(axis=1)
    assert from_side.max() < 0.01


def test_it_stands_still_in_the_corners_of_the_square() -> None:
    corners_s = np.linspace(0.0, ROUND_S, 5)
    motion = side_by_side(0.0).at(corners_s)

    assert np.abs(motion.v_n).max() < 1e-9
    assert np.abs(motion.a_n).max() < 1e-6


def test_the_velocity_is_that_of_the_curve() -> None:
    h = 1e-5
    t_s = np.linspace(0.5, 12.0, 400)
    figure = going_round(circle, 1.0)

    slope = (figure.ne_m(t_s + h) - figure.ne_m(t_s - h)) / (2.0 * h)

    np.testing.assert_allclose(figure.at(t_s).v_n[:, :2], slope, atol=1e-9)


@pytest.mark.parametrize("scenario", FIGURES)
def test_a_round_takes_a_thousand_samples(scenario: str) -> None:
    simulated = simulate(scenario)

    assert simulated.header.imu_rate_hz * ROUND_S == pytest.approx(1000.0)
    is_imu = [frame.source is Source.IMU for frame in simulated.frames]
    assert sum(is_imu) == pytest.approx(
        SCENARIOS[scenario].duration_s * 1000.0 / (2.0 * math.pi), rel=0.001
    )


def test_the_accelerometer_is_as_noisy_as_the_tablets() -> None:
    simulated = simulate("circle", duration_s=20.0, mount=DEFAULT_MOUNT)
    decode = CountsModel(4, 500, DEFAULT_MOUNT).decode
    accel = np.array(
        [
            decode(frame.t_ns, frame.data).accel_mps2
            for frame in simulated.frames
            if frame.source is Source.IMU
        ]
    )

    # The thesis's variances; the chip's rounding adds 1.2e-7.
    expected = [2.4572e-05, 3.1813e-05, 1.6963e-04]
    assert accel.var(axis=0) == pytest.approx(expected, rel=0.08)


def test_the_receiver_is_a_metre_off_and_says_so() -> None:
    simulated = simulate("circle", duration_s=600.0)
    reader = EpochReader(reference_utc_s=simulated.header.start_utc_s)
    fixes = [
        told
        for frame in simulated.frames
        if frame.source is Source.GPS
        for told in reader.feed(frame.t_ns, frame.data)
        if isinstance(told, GpsFix)
    ]
    north_m = np.array([fix.lat_rad for fix in fixes[50:]]) * METRES_PER_RAD

    assert np.std(north_m) == pytest.approx(1.0, rel=0.1)
    assert np.std(np.diff(north_m)) == pytest.approx(math.sqrt(2.0), rel=0.1)
    assert {fix.sigma_h_m for fix in fixes} == {1.0}
