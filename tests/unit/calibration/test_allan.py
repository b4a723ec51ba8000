"""Allan deviation against allantools, and noise that is known read off it."""

import allantools
import numpy as np
import pytest
from numpy.typing import NDArray

from imu_tracker.calibration.allan import FLICKER, Coefficient, allan_curve, fit_noise

RATE_HZ = 4.0
LENGTH_S = 7200.0

Array = NDArray[np.float64]


def white(rng: np.random.Generator, random_walk: float, n: int) -> Array:
    values: Array = random_walk * np.sqrt(RATE_HZ) * rng.standard_normal(n)
    return values


def flicker(rng: np.random.Generator, instability: float, n: int) -> Array:
    """Shape white noise to the one-sided spectrum B^2 / (pi f) of IEEE Std 952."""
    f_hz = np.fft.rfftfreq(4 * n, 1 / RATE_HZ)
    f_hz[0] = f_hz[1]
    spectrum = np.fft.rfft(rng.standard_normal(4 * n)) * np.sqrt(RATE_HZ / 2)
    return np.fft.irfft(spectrum * instability / np.sqrt(np.pi * f_hz))[:n]


def holds(coefficient: Coefficient, truth: float) -> bool:
    return coefficient.low <= truth <= coefficient.high


@pytest.mark.parametrize("seed", [1, 2])
def test_the_curve_is_that_of_allantools(seed: int) -> None:
    rng = np.random.default_rng(seed)
    values = 5.0 + white(rng, 0.1, 5000) + np.cumsum(white(rng, 0.001, 5000))
    curve = allan_curve([values], RATE_HZ)
    taus, deviation, _, _ = allantools.oadev(
        values, rate=RATE_HZ, data_type="freq", taus=curve.tau_s
    )
    assert taus == pytest.approx(curve.tau_s)
    assert curve.deviation == pytest.approx(deviation, rel=1e-9)


def test_two_stretches_are_not_joined() -> None:
    rng = np.random.default_rng(3)
    one, other = white(rng, 0.1, 4000), 100.0 + white(rng, 0.1, 4000)
    alone, both = allan_curve([one], RATE_HZ), allan_curve([one, other], RATE_HZ)
    assert both.deviation[:10] == pytest.approx(alone.deviation[:10], rel=0.1)
    assert both.length_s == 8000 / RATE_HZ


@pytest.mark.parametrize(
    ("instability", "rate_walk"), [(0.002, 0.0), (0.0, 0.0), (0.002, 1e-4)]
)
def test_what_is_known_lies_in_its_interval_95_times_in_100(
    instability: float, rate_walk: float
) -> None:
    truth = (0.0035, instability, rate_walk)
    n, runs = int(LENGTH_S * RATE_HZ), 40
    hits = np.zeros(3)
    for seed in range(runs):
        rng = np.random.default_rng(seed)
        values = white(rng, truth[0], n) + flicker(rng, instability, n)
        values += rate_walk * np.cumsum(rng.standard_normal(n)) / np.sqrt(RATE_HZ)
        noise = fit_noise(allan_curve([values], RATE_HZ))
        assert noise is not None
        assert noise.random_walk.value == pytest.approx(truth[0], rel=0.05)
        assert noise.misfit < 3.0
        hits += [holds(c, t) for c, t in zip(noise[:3], truth, strict=True)]
    # Of 40 runs at 95 % fewer than 34 hits have a probability of 0.3 %.
    assert (hits >= 34).all(), hits


def test_the_intervals_say_something() -> None:
    n = int(LENGTH_S * RATE_HZ)
    rng = np.random.default_rng(5)
    noise = fit_noise(
        allan_curve([white(rng, 0.0035, n) + flicker(rng, 0.002, n)], RATE_HZ)
    )
    assert noise is not None
    low, high = noise.bias_instability.low, noise.bias_instability.high
    assert 0.7 * 0.002 < low < high < 1.3 * 0.002
    assert noise.lowest == pytest.approx(0.002 * np.sqrt(FLICKER), rel=0.4)


@pytest.mark.parametrize(
    "values", [np.zeros(5000), np.full(5000, 3.0), np.arange(30.0), np.zeros(0)]
)
def test_a_dead_axis_and_a_short_one_say_nothing(values: Array) -> None:
    assert fit_noise(allan_curve([values], RATE_HZ)) is None


def test_vibration_is_no_noise_of_a_chip() -> None:
    rng = np.random.default_rng(6)
    t_s = np.arange(20_000) / RATE_HZ
    shaken = white(rng, 0.001, 20_000) + 0.1 * np.sin(2 * np.pi * 0.7 * t_s)
    noise = fit_noise(allan_curve([shaken], RATE_HZ))
    assert noise is not None
    assert noise.misfit > 5.0
