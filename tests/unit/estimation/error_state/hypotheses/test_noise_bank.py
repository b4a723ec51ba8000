"""The filters that compete: who leads, who is dropped, and what they weigh."""

import math

import numpy as np
import pytest

from imu_tracker.estimation.error_state.hypotheses.noise_bank import (
    EARLY_WIN_NATS,
    HEADING_LOST_NATS,
    HEADING_WIN_NATS,
    MOST_NATS,
    NOISE_LEVELS,
    Kind,
    NoiseBank,
    Rival,
)
from imu_tracker.estimation.error_state.hypotheses.yaw_bank import YawBank


def with_headings(*nats: float) -> NoiseBank:
    bank = NoiseBank(1, is_vehicle=True)
    bank.begin_headings(
        [
            Rival(bank.main.clone(bank.main.noise), Kind.HEADING, str(i or ""), each)
            for i, each in enumerate(nats)
        ]
    )
    return bank


def test_the_most_probable_heading_leads_and_weights_are_probabilities() -> None:
    bank = with_headings(-2.0, 0.0, -1.0)
    assert bank.main_name == "1"
    odds = [1.0, math.exp(-2.0), math.exp(-1.0)]
    headings = [each / sum(odds) for each in odds]
    assert bank.weights == pytest.approx([*headings, 0.0])  # and a noise level


def test_no_single_fix_decides_between_headings() -> None:
    bank = with_headings(0.0, -2.0)
    leader = bank.main
    assert bank.add_log_likelihoods([-1000.0, 0.0, -1000.0], 1.0) is None
    assert bank.main is leader


def test_a_heading_that_predicts_better_takes_the_lead() -> None:
    bank = with_headings(0.0, -2.0)
    other = bank.rivals[0].eskf
    verdicts = [
        bank.add_log_likelihoods([-3.0, 0.0, -3.0], 1.0)
        for _ in range(math.ceil(HEADING_WIN_NATS + 2.0) + 1)
    ]
    assert verdicts[-1] is None  # others are alive
    assert bank.main is other
    assert bank.rivals[0].nats < -HEADING_WIN_NATS


def test_fixes_of_one_second_count_as_one() -> None:
    bank = with_headings(0.0, -2.0)
    for _ in range(10):
        bank.add_log_likelihoods([0.0, -3.0, 0.0], 0.1)
    assert bank.rivals[0].nats == pytest.approx(-3.0)


def test_improbable_headings_are_dropped_and_the_noise_stays_on_trial() -> None:
    bank = with_headings(0.0, -2.0)
    verdict = None
    while bank.has_headings:
        nats = bank.rivals[0].nats
        assert nats > HEADING_LOST_NATS
        verdict = bank.add_log_likelihoods([0.0, -3.0, 0.0], 1.0)
    assert verdict is False
    assert [rival.kind for rival in bank.rivals] == [Kind.NOISE]
    assert bank.weights[0] == 1.0


def test_a_noise_level_is_found_while_headings_are_undecided() -> None:
    bank = with_headings(0.0, -2.0)
    quieter = bank.rivals[-1].eskf
    assert quieter.noise == NOISE_LEVELS[0]
    for _ in range(math.ceil(EARLY_WIN_NATS / MOST_NATS) + 1):
        bank.add_log_likelihoods([-2.0, -2.0, 0.0], 1.0)
    assert bank.main is quieter
    assert bank.level == 0
    heading, rival = bank.rivals
    assert (heading.nats, heading.eskf.noise) == (-2.0, NOISE_LEVELS[0])
    assert (rival.kind, rival.eskf.noise) == (Kind.NOISE, NOISE_LEVELS[1])


def test_the_likelier_noise_level_wins_but_not_by_a_single_fix() -> None:
    bank = NoiseBank(1, is_vehicle=True)
    challenger = bank.rivals[0].eskf
    bank.add_log_likelihoods([-100.0, 0.0], 1.0)
    assert bank.main is not challenger
    for _ in range(math.ceil(EARLY_WIN_NATS / MOST_NATS) + 1):
        bank.add_log_likelihoods([-100.0, 0.0], 1.0)
    assert bank.level != 1


def test_the_density_of_a_yaw_integrates_to_one() -> None:
    bank = YawBank()
    z = np.zeros(2)
    for _ in range(3):
        bank.add_stretch(1.0, (1.0, 0.0))
        bank.update(z, 1.0, z, 0.1, 0.01, 0.01, (0.0, 1e-4))
    yaws = np.linspace(-math.pi, math.pi, 721)[:-1]
    density = [math.exp(bank.log_density(float(yaw))) for yaw in yaws]
    assert np.mean(density) * 2.0 * math.pi == pytest.approx(1.0, rel=0.02)
