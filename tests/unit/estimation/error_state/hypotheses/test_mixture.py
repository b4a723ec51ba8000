"""The odds of the IMU against the receiver alone, and the radius of both."""

import math

import numpy as np
import pytest

from imu_tracker.estimation.error_state.hypotheses.mixture import (
    FIX_NATS,
    LOST_NATS,
    MOST_NATS,
    Odds,
    Verdict,
    radius_m,
)
from imu_tracker.estimation.estimate import R95_PER_SIGMA


def test_no_single_fix_decides() -> None:
    odds = Odds()
    before = odds.nats
    assert odds.compare(-1e6, 0.0, 1.0) is Verdict.NONE
    assert odds.nats == before - FIX_NATS


def test_fixes_of_one_second_are_one_vote_at_any_rate() -> None:
    slow, fast = Odds(), Odds()
    slow.compare(-1.0, 0.0, 1.0)
    for _ in range(10):
        fast.compare(-1.0, 0.0, 0.1)
    assert fast.nats == pytest.approx(slow.nats)


def test_an_imu_that_was_right_for_an_hour_loses_within_five_seconds() -> None:
    odds = Odds()
    for _ in range(3600):
        odds.compare(0.0, -3.0, 1.0)
    assert odds.nats == MOST_NATS
    verdicts = [odds.compare(-100.0, 0.0, 1.0) for _ in range(5)]
    assert verdicts == [Verdict.NONE] * 4 + [Verdict.IMU_LOST]
    assert not odds.has_imu_lead
    assert odds.nats < LOST_NATS


def test_a_heading_is_not_believed_before_some_seconds_of_fixes() -> None:
    odds = Odds()
    for _ in range(5):
        odds.compare(0.0, -3.0, 1.0)
    assert odds.imu_weight < 0.98
    odds.restart_trial()
    assert odds.imu_weight < 0.9


def test_an_imu_that_proves_itself_comes_back_later_each_time() -> None:
    odds, waited = Odds(), []
    for _ in range(3):
        while odds.compare(-100.0, 0.0, 1.0) is not Verdict.IMU_LOST:
            pass
        seconds = 1
        while odds.compare(0.0, -3.0, 1.0) is not Verdict.IMU_BACK:
            seconds += 1
        waited.append(seconds)
        assert odds.has_imu_lead
    assert waited == sorted(set(waited))
    assert max(waited) <= 120


@pytest.mark.parametrize(
    ("weight", "distance_m", "sigma_m", "other_sigma_m"),
    [(0.5, 0.0, 3.0, 30.0), (0.9, 50.0, 3.0, 3.0), (0.2, 10.0, 20.0, 4.0)],
)
def test_the_radius_holds_at_least_95_percent_of_the_mixture(
    weight: float, distance_m: float, sigma_m: float, other_sigma_m: float
) -> None:
    rng, n = np.random.default_rng(5), 200_000
    is_leader = rng.random(n) < weight
    place = rng.standard_normal((n, 2))
    place *= np.where(is_leader, sigma_m, other_sigma_m)[:, None]
    place[:, 0] += np.where(is_leader, 0.0, distance_m)
    radius = radius_m(
        [
            (weight, 0.0, R95_PER_SIGMA * sigma_m),
            (1.0 - weight, distance_m, R95_PER_SIGMA * other_sigma_m),
        ]
    )
    held = float((np.hypot(*place.T) <= radius).mean())
    assert 0.945 <= held <= 0.99  # on the safe side for what lies apart


def test_one_hypothesis_has_its_own_radius() -> None:
    assert radius_m([(1.0, 0.0, 7.0), (0.0, 1e6, math.inf)]) == 7.0
