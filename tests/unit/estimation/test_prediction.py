"""Where will it be: against plain geometry, and against simulated truth."""

import math

import numpy as np
import pytest

from imu_tracker.estimation.estimate import Estimate
from imu_tracker.estimation.prediction import TURN_S, Prediction, Turning, predict
from imu_tracker.estimation.settings import TrackerSettings
from imu_tracker.motion.preintegration import ImuStep, gap_step
from imu_tracker.pipeline import Pipeline
from imu_tracker.simulation import simulate

LAT_RAD, LON_RAD = math.radians(52.0), math.radians(4.37)
LEVEL = (1.0, 0.0, 0.0, 0.0)
METRES_PER_RAD = 6.37e6


def believed(v_n: tuple[float, float, float], r95_m: float = 2.0) -> Estimate:
    return Estimate(LAT_RAD, LON_RAD, None, v_n, LEVEL, r95_m)


def metres_to(prediction: Prediction) -> tuple[float, float]:
    """North and east of the start, on a sphere: good to 1 %."""
    return (
        (prediction.lat_rad - LAT_RAD) * METRES_PER_RAD,
        (prediction.lon_rad - LON_RAD) * METRES_PER_RAD * math.cos(LAT_RAD),
    )


def step(rate_b: tuple[float, float, float], dt_s: float = 0.04) -> ImuStep:
    x, y, z = rate_b
    zero = (0.0, 0.0, 0.0)
    turned = (x * dt_s, y * dt_s, z * dt_s)
    return ImuStep(
        1, dt_s, turned, zero, 4, zero, zero, 0.0, 0.0, math.nan, False, False
    )


def test_without_a_turn_it_goes_straight_on() -> None:
    (found,) = predict(believed((8.0, 6.0, 0.0)), 0.1, 0.0, "vehicle", [10.0])

    assert metres_to(found) == pytest.approx((80.0, 60.0), rel=0.01)
    assert found.after_s == 10.0


def test_a_turn_to_the_right_leads_to_the_right_and_comes_to_an_end() -> None:
    rate_radps = math.radians(20.0)
    short, long = predict(
        believed((10.0, 0.0, 0.0)), 0.1, rate_radps, "vehicle", [0.5, 60.0]
    )

    north, east = metres_to(short)
    assert north == pytest.approx(5.0, rel=0.01)
    assert east == pytest.approx(0.5 * 10.0 * rate_radps * 0.5**2, rel=0.1)
    # In the end it has turned by rate x TURN_S, and goes straight on.
    north, east = metres_to(long)
    course = math.atan2(east, north)
    assert course == pytest.approx(rate_radps * TURN_S, abs=0.06)


def test_the_way_round_a_turn_is_that_of_small_steps() -> None:
    rate_radps, t_s, h = 1.0, 20.0, 1e-3
    (found,) = predict(believed((10.0, 0.0, 0.0)), 0.1, rate_radps, "vehicle", [t_s])

    t = np.arange(0.0, t_s, h) + h / 2
    course = rate_radps * TURN_S * (1.0 - np.exp(-t / TURN_S))
    expected = (10.0 * h * np.cos(course).sum(), 10.0 * h * np.sin(course).sum())
    assert metres_to(found) == pytest.approx(expected, rel=0.01, abs=0.5)


def test_now_it_is_where_the_filter_says() -> None:
    (found,) = predict(believed((8.0, 6.0, 0.0), 3.5), 0.5, 0.2, "vehicle", [0.0])

    assert found == pytest.approx((0.0, LAT_RAD, LON_RAD, 3.5), abs=1e-12)


@pytest.mark.parametrize("profile", ["vehicle", "walker", "free", "auto"])
def test_the_radius_only_grows(profile: str) -> None:
    after_s = np.linspace(0.0, 600.0, 200).tolist()
    found = predict(believed((1.0, 0.0, 0.0)), 0.2, 0.0, profile, after_s)

    radii = [prediction.r95_m for prediction in found]
    assert np.all(np.diff(radii) > 0.0)


def test_an_unknown_speed_widens_the_radius_by_as_much_as_it_carries() -> None:
    known, unknown = (
        predict(believed((0.0, 0.0, 0.0), 0.0), sigma, 0.0, "walker", [10.0])[0].r95_m
        for sigma in (0.0, 5.0)
    )

    # 95 % of a circular normal distribution: 2.448 standard deviations.
    assert unknown**2 - known**2 == pytest.approx((2.448 * 50.0) ** 2, rel=1e-3)


def test_the_turn_is_about_down_however_the_box_lies() -> None:
    turning, on_its_side = Turning(), (math.sqrt(0.5), math.sqrt(0.5), 0.0, 0.0)
    for _ in range(200):
        turning.add_step(step((0.01, 0.3, 0.02)), (0.01, 0.0, 0.02))

    estimate = believed((5.0, 0.0, 0.0))._replace(q_nb=on_its_side)
    # Rolled by 90 deg, body y points down.
    assert turning.about_down_radps(estimate) == pytest.approx(0.3, abs=1e-3)


def test_after_a_gap_no_turn_is_known() -> None:
    turning = Turning()
    turning.add_step(step((0.0, 0.0, 1.0), 1.0), (0.0, 0.0, 0.0))
    turning.add_step(gap_step(2, 0.1), (0.0, 0.0, 0.0))

    assert turning.about_down_radps(believed((5.0, 0.0, 0.0))) == 0.0


def test_before_the_first_fix_nothing_is_predicted() -> None:
    simulated = simulate("walk-line", duration_s=5.0)
    pipeline = Pipeline(simulated.header, TrackerSettings())
    for frame in simulated.frames:
        pipeline.feed(frame)

    assert pipeline.predict([1.0]) == []


@pytest.mark.parametrize(
    ("scenario", "profile"), [("drive", "vehicle"), ("walk-square", "walker")]
)
def test_the_truth_is_inside_the_radius_of_the_prediction(
    scenario: str, profile: str
) -> None:
    simulated = simulate(scenario, seed=3, duration_s=500.0)
    truth = np.array([(r.utc_s, r.lat_rad, r.lon_rad) for r in simulated.truth]).T
    pipeline = Pipeline(simulated.header, TrackerSettings(profile=profile))
    errors: dict[float, list[tuple[float, float]]] = {}
    due_s = truth[0, 0] + 40.0
    for frame in simulated.frames:
        rows = pipeline.feed(frame)
        if not rows or rows[-1].utc_s < due_s:
            continue
        due_s = rows[-1].utc_s + 2.0
        now_s = rows[-1].utc_s + (frame.t_ns - rows[-1].t_ns) * 1e-9
        for told in pipeline.predict([2.0, 10.0, 30.0]):
            then_s = now_s + told.after_s
            if then_s > truth[0, -1]:
                continue
            lat, lon = (np.interp(then_s, truth[0], column) for column in truth[1:])
            off_m = math.hypot(
                (told.lat_rad - lat) * METRES_PER_RAD,
                (told.lon_rad - lon) * METRES_PER_RAD * math.cos(lat),
            )
            errors.setdefault(told.after_s, []).append((off_m, told.r95_m))

    for pairs in errors.values():
        error_m, r95_m = np.array(pairs).T
        assert np.mean(error_m <= r95_m) >= 0.93
        assert np.median(r95_m) < 3.0 * np.percentile(error_m, 95)


def test_a_profile_that_was_found_bounds_the_prediction() -> None:
    # The configured "auto" knows no habits: a walker was given a car's minute, 707 m.
    simulated = simulate("walk-square", seed=3, duration_s=300.0)
    pipeline = Pipeline(simulated.header, TrackerSettings(profile="auto"))
    for frame in simulated.frames:
        pipeline.feed(frame)
    assert pipeline.report()["profile"] == "walker"
    (told,) = pipeline.predict([60.0])
    assert told.r95_m < 250.0
