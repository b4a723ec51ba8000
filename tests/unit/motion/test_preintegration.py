"""Steps against an integration of the same motion that is ten times as fine."""

import math
from collections.abc import Callable, Iterable
from functools import lru_cache

import numpy as np
import pytest
from scipy.spatial.transform import Rotation  # type: ignore[import-untyped]

from imu_tracker.motion.preintegration import (
    FROZEN_SAMPLES,
    GAP_NS,
    STEP_NS,
    ImuStep,
    Preintegrator,
)
from imu_tracker.samples import ImuSample, Vec3

G = 9.81
Rates = Callable[[float], tuple[Vec3, Vec3]]  # t_s -> accel, gyro


def sample(
    t_ns: int, accel: Vec3 = (0.0, 0.0, -G), gyro: Vec3 = (0.0, 0.0, 0.0)
) -> ImuSample:
    return ImuSample(t_ns, accel, gyro, 25.0)


def alive(t_ns: int) -> ImuSample:
    """A body at rest whose last bits move, as a living sensor's do."""
    return sample(t_ns, (1e-6 * (t_ns % 97), 0.0, -G))


def steps_of(
    samples: Iterable[ImuSample], into: Preintegrator | None = None
) -> list[ImuStep]:
    into = into or Preintegrator()
    return [step for s in samples if (step := into.add_sample(s)) is not None]


def sampled(motion: Rates, rate_hz: float, duration_s: float) -> list[ImuSample]:
    return [
        sample(round(k * 1e9 / rate_hz), *motion(k / rate_hz))
        for k in range(round(duration_s * rate_hz) + 1)
    ]


def chained(steps: Iterable[ImuStep]) -> tuple[Rotation, np.ndarray]:
    """Attitude and velocity after all steps, in the axes of the first."""
    turned, velocity = Rotation.identity(), np.zeros(3)
    for step in steps:
        velocity = velocity + turned.apply(step.dv_b_mps)
        turned = turned * Rotation.from_rotvec(step.dtheta_b_rad)
    return turned, velocity


@lru_cache
def integrated(motion: Rates, duration_s: float) -> tuple[Rotation, np.ndarray]:
    """Midpoint rule at 5 kHz: the oracle."""
    dt = 2e-4
    C, velocity = np.eye(3), np.zeros(3)
    for k in range(round(duration_s / dt)):
        accel, gyro = motion((k + 0.5) * dt)
        half = Rotation.from_rotvec(np.array(gyro) * 0.5 * dt).as_matrix()
        velocity += C @ half @ accel * dt
        C = C @ half @ half
    return Rotation.from_matrix(C), velocity


def coning(t: float) -> tuple[Vec3, Vec3]:
    """The axis of rotation goes round: 3 Hz, 60 deg/s, as on a shaking mast."""
    angle = 2.0 * math.pi * 3.0 * t
    return (0.0, 0.0, -G), (math.cos(angle), math.sin(angle), 0.1)


def sculling(t: float) -> tuple[Vec3, Vec3]:
    """Push and turn in step: 3 Hz, 3 m/s^2, which adds up to a velocity."""
    angle = 2.0 * math.pi * 3.0 * t
    return (3.0 * math.cos(angle), 0.0, -G), (0.0, 0.35 * math.sin(angle), 0.0)


def spinning(t: float) -> tuple[Vec3, Vec3]:
    return (0.5, 1.0, -G + 1e-6 * t), (0.2, -0.4, 8.0)


@pytest.mark.parametrize("motion", [coning, sculling, spinning])
@pytest.mark.parametrize("rate_hz", [100, 200])
def test_steps_follow_a_motion_as_a_fine_integration_does(
    motion: Rates, rate_hz: int
) -> None:
    turned, velocity = chained(steps_of(sampled(motion, rate_hz, 2.0)))
    true_turn, true_velocity = integrated(motion, 2.0)
    # The trapezoid rule loses a 12th of (omega dt)^2: 0.3 % of a shake at 3 Hz.
    limit = (100 / rate_hz) ** 2
    assert (turned * true_turn.inv()).magnitude() < 2e-3 * limit
    assert np.linalg.norm(velocity - true_velocity) < 0.05 * limit


def test_plain_sums_would_miss_coning_and_sculling() -> None:
    # So the limits above tell: what is only summed lies far outside of them.
    angle = sum(np.array(s.gyro_radps) for s in sampled(coning, 100, 2.0)[1:]) * 0.01
    turned, _ = integrated(coning, 2.0)
    assert (Rotation.from_rotvec(angle) * turned.inv()).magnitude() > 0.05
    total = sum(np.array(s.accel_mps2) for s in sampled(sculling, 100, 2.0)[1:]) * 0.01
    _, velocity = integrated(sculling, 2.0)
    assert np.linalg.norm(total - velocity) > 0.3


def test_a_wrong_bias_is_taken_out_inside_and_put_back_outside() -> None:
    # The bias only decides where rotation and acceleration mix: a plain sum of
    # angles about one axis must not see it at all.
    plain, corrected = Preintegrator(), Preintegrator()
    corrected.gyro_bias_radps = (0.0, 0.0, 0.05)
    samples = [sample(k * 10**7, gyro=(0.0, 0.0, 0.3)) for k in range(40)]
    for a, b in zip(
        steps_of(samples, plain), steps_of(samples, corrected), strict=True
    ):
        assert a.dtheta_b_rad == pytest.approx(b.dtheta_b_rad, abs=1e-12)


def test_the_velocity_of_a_turning_bias_is_not_smeared() -> None:
    # A resting body under a gyro that reads 3 deg/s: with the bias known, the force
    # of gravity stays on one axis.
    preintegrator = Preintegrator()
    bias = preintegrator.gyro_bias_radps = (0.05, -0.05, 0.05)
    samples = [sample(k * 10**7, gyro=bias) for k in range(9)]
    for step in steps_of(samples, preintegrator):
        assert step.dv_b_mps == pytest.approx((0.0, 0.0, -G * step.dt_s), abs=1e-12)


@pytest.mark.parametrize("rate_hz", [10, 25, 30, 50, 75, 100, 125, 160, 200, 1000])
def test_steps_cover_all_time_at_any_rate(rate_hz: int) -> None:
    samples = [alive(round(k * 1e9 / rate_hz)) for k in range(3 * rate_hz + 1)]
    steps = steps_of(samples)
    end_ns = 0
    for step in steps:
        assert step.t_ns - end_ns == pytest.approx(step.dt_s * 1e9)
        end_ns = step.t_ns
        longest = max(STEP_NS, 1e9 / rate_hz) * 1.26
        assert 0.6 * STEP_NS <= step.dt_s * 1e9 <= longest
    assert end_ns >= samples[-1].t_ns - STEP_NS


def test_jitter_does_not_change_the_number_of_samples_in_a_step() -> None:
    rng = np.random.default_rng(7)
    jitter = rng.integers(-2_000_000, 2_000_000, 500)
    samples = [alive(10**7 * (k + 1) + int(jitter[k])) for k in range(500)]
    sizes = {step.n_samples for step in steps_of(samples)}
    assert sizes <= {3, 4, 5}


def test_the_sums_are_those_of_the_samples() -> None:
    rng = np.random.default_rng(1)
    accel, gyro = rng.normal(size=(5, 3)), rng.normal(size=(5, 3))
    samples = [
        sample(k * 10**7, tuple(accel[k].tolist()), tuple(gyro[k].tolist()))
        for k in range(5)
    ]
    (step,) = steps_of(samples)
    assert step.n_samples == 4
    assert step.accel_sum_mps2 == pytest.approx(accel[1:].sum(axis=0).tolist())
    assert step.gyro_sum_radps == pytest.approx(gyro[1:].sum(axis=0).tolist())
    assert step.accel_sq_sum == pytest.approx((accel[1:] ** 2).sum())
    assert step.gyro_sq_sum == pytest.approx((gyro[1:] ** 2).sum())
    assert step.temp_degc == 25.0


def test_a_short_hole_is_bridged() -> None:
    preintegrator = Preintegrator()
    times = [0, 10, 20, 30, 40, 50, 250, 260, 270, 280, 290]  # ms
    motion_z = [sample(t * 10**6, gyro=(0.0, 0.0, 1.0 + t * 1e-9)) for t in times]
    steps = steps_of(motion_z, preintegrator)
    assert not any(step.is_gap for step in steps)
    assert sum(step.dtheta_b_rad[2] for step in steps) == pytest.approx(0.29, abs=0.011)
    assert preintegrator.counters == {}


def test_a_long_hole_is_a_gap_of_which_nothing_is_known() -> None:
    preintegrator = Preintegrator()
    steps_of([alive(k * 10**7) for k in range(7)], preintegrator)  # until 60 ms
    resumed_ns = 60_000_000 + GAP_NS + 1
    step = preintegrator.add_sample(alive(resumed_ns))
    assert step is not None
    assert step.is_gap
    assert step.t_ns == resumed_ns
    # From the end of the last step: what was summed since then is lost with it.
    assert step.dt_s == pytest.approx((resumed_ns - 40_000_000) * 1e-9)
    assert step.dtheta_b_rad == step.dv_b_mps == (0.0, 0.0, 0.0)
    assert step.n_samples == 0
    assert preintegrator.counters["imu_gaps"] == 1


def test_time_that_was_bridged_from_outside_is_not_integrated_again() -> None:
    preintegrator = Preintegrator()
    steps_of([alive(k * 10**7) for k in range(7)], preintegrator)
    bridge = preintegrator.bridge(500_000_000, 0.1)
    assert bridge.is_gap
    assert bridge.t_ns == 500_000_000
    late = preintegrator.add_sample(alive(400_000_000))
    assert late is None
    assert preintegrator.counters["repeated_samples"] == 1
    step = preintegrator.add_sample(alive(530_000_000))
    assert step is not None
    assert step.is_gap
    assert step.dt_s == pytest.approx(0.030)


def test_in_a_gap_the_temperature_is_the_last_one() -> None:
    # Of what is learnt it says how warm the chip was, and is no number without it.
    preintegrator = Preintegrator()
    assert math.isnan(preintegrator.bridge(10_000_000, 0.1).temp_degc)
    steps_of([alive(k * 10**7) for k in range(2, 7)], preintegrator)
    assert preintegrator.bridge(500_000_000, 0.1).temp_degc == alive(0).temp_degc
    step = preintegrator.add_sample(alive(900_000_000))
    assert step is not None
    assert step.temp_degc == alive(0).temp_degc


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("axis", range(6))
def test_a_sample_that_is_no_number_is_left_out(bad: float, axis: int) -> None:
    values = [0.0, 0.0, -G, 0.0, 0.0, 0.0]
    values[axis] = bad
    broken = sample(
        30_000_000, (values[0], values[1], values[2]), (values[3], values[4], values[5])
    )
    preintegrator = Preintegrator()
    good = [alive(k * 10**7) for k in range(9)]
    good[3] = broken
    steps = steps_of(good, preintegrator)
    assert preintegrator.counters == {"invalid_samples": 1}
    assert [step.t_ns for step in steps] == [40_000_000, 80_000_000]
    for step in steps:
        assert step.dv_b_mps[2] == pytest.approx(-G * 0.04)


@pytest.mark.parametrize("again_ns", [20_000_000, 10_000_000, 0])
def test_repeated_and_backward_times_are_left_out(again_ns: int) -> None:
    preintegrator = Preintegrator()
    steps = steps_of(
        map(alive, [0, 10_000_000, 20_000_000, again_ns, 30_000_000, 40_000_000]),
        preintegrator,
    )
    assert preintegrator.counters == {"repeated_samples": 1}
    assert [step.dt_s for step in steps] == [pytest.approx(0.04)]


def test_a_saturated_sample_is_counted_and_marks_its_step() -> None:
    preintegrator = Preintegrator()
    samples = [alive(k * 10**7) for k in range(13)]
    samples[6] = samples[6]._replace(is_saturated=True)
    steps = steps_of(samples, preintegrator)
    assert [step.is_saturated for step in steps] == [False, True, False]
    assert preintegrator.counters == {"saturated_samples": 1}


def test_a_sensor_that_stands_frozen_is_not_integrated() -> None:
    preintegrator = Preintegrator()
    stuck = [sample(k * 10**7, gyro=(0.0, 0.0, 0.5)) for k in range(201)]
    steps = steps_of(stuck, preintegrator)
    assert steps[-1].t_ns <= FROZEN_SAMPLES * 10**7
    assert preintegrator.counters["frozen_samples"] == 200 - FROZEN_SAMPLES + 1
    back = preintegrator.add_sample(alive(3_000_000_000))
    assert back is not None
    assert back.is_gap


def test_a_sensor_that_repeats_itself_now_and_then_is_alive() -> None:
    preintegrator = Preintegrator()
    pairs = [sample(k * 10**7, (1e-6 * (k // 40), 0.0, -G)) for k in range(400)]
    steps_of(pairs, preintegrator)
    assert preintegrator.counters == {}
