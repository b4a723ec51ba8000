"""What outlasts a run: doubts that grow, and a box that was taken elsewhere."""

import math
from functools import cache

import numpy as np
import pytest

from imu_tracker.estimation.error_state.warm_start import (
    Downtime,
    LearnedParameters,
    grown,
)
from imu_tracker.estimation.settings import TrackerSettings
from imu_tracker.pipeline import Pipeline
from imu_tracker.samples import DEFAULT_MOUNT, Frame, Mount, SessionHeader, Source
from imu_tracker.simulation import TruthRow, simulate
from imu_tracker.simulation.receiver.receiver import TYPICAL_RECEIVER
from support.simulated import Figures, compare

DAY_S = 86400.0


@cache
def simulated(
    seed: int, mount: Mount = DEFAULT_MOUNT
) -> tuple[SessionHeader, list[Frame], list[TruthRow]]:
    """Simulate another chip in another car for each seed; 150 s."""
    drive = simulate("drive", seed=seed, duration_s=150.0, mount=mount)
    header = drive.header._replace(mount=DEFAULT_MOUNT)
    return header, list(drive.frames), list(drive.truth)


def tracked(
    seed: int,
    prior: LearnedParameters | None = None,
    mount: Mount = DEFAULT_MOUNT,
    latency_s: float | None = None,
) -> tuple[Figures, Pipeline]:
    header, frames, truth = simulated(seed, mount)
    settings = TrackerSettings("error-state", "vehicle", latency_s, prior=prior)
    pipeline = Pipeline(header, settings)
    rows = [row for frame in frames for row in pipeline.feed(frame)]
    return compare(rows, truth), pipeline


@cache
def learnt() -> LearnedParameters:
    found = tracked(4)[1].learned_parameters()
    assert found is not None
    return found


def test_doubts_grow_with_time_and_with_temperature() -> None:
    known = learnt()
    minute = grown(known, Downtime(60.0, 0.0))
    hour = grown(known, Downtime(3600.0, 0.0))
    warmer = grown(known, Downtime(3600.0, 20.0))
    unknown = grown(known, Downtime(None, None))
    for one, other in ((known, minute), (minute, hour), (hour, unknown)):
        assert one.gyro_bias_sigma_radps < other.gyro_bias_sigma_radps
        assert one.accel_bias_sigma_mps2 < other.accel_bias_sigma_mps2
        assert one.mounting_sigma_rad < other.mounting_sigma_rad
    # Boards: 0.03 deg/s per kelvin.
    assert math.degrees(warmer.gyro_bias_sigma_radps[0]) == pytest.approx(0.6, abs=0.05)
    assert warmer.gyro_bias_radps == known.gyro_bias_radps


def test_what_was_learnt_sharpens_the_start_of_the_same_car() -> None:
    _, cold = tracked(4)
    _, warm = tracked(4, learnt()._replace(utc_s=None))
    cold_sigma, warm_sigma = (p.report()["mounting_sigma_deg"] for p in (cold, warm))
    assert isinstance(cold_sigma, list)
    assert isinstance(warm_sigma, list)
    assert np.all(np.less(warm_sigma, cold_sigma))


def test_a_latency_is_remembered_when_another_one_is_configured() -> None:
    """The receiver's is 0.2 s, whatever a run assumes."""
    assert TYPICAL_RECEIVER.latency_s == pytest.approx(0.2, abs=0.05)
    kept = tracked(4, latency_s=0.5)[1].learned_parameters()
    assert kept is not None
    assert kept.latency_s == pytest.approx(TYPICAL_RECEIVER.latency_s, abs=0.1)
    header, frames, _ = simulated(4)
    settings = TrackerSettings("error-state", "vehicle", 0.9, prior=kept)
    pipeline = Pipeline(header, settings)
    for frame in frames[:500]:  # 5 s: nothing has been measured yet
        pipeline.feed(frame)
    # Fixes describe so much later than this run assumes.
    told = pipeline.report()["delay_s"]
    assert told == pytest.approx(0.9 - kept.latency_s, abs=0.02)


@pytest.mark.parametrize("days", [1.0, 30.0])
@pytest.mark.parametrize("seed", [1, 2])
def test_in_another_car_it_is_soon_as_good_as_without_memory(
    seed: int, days: float
) -> None:
    assert learnt().utc_s is not None
    prior = learnt()._replace(utc_s=learnt().utc_s - days * DAY_S)  # type: ignore[operator]
    cold, warm = tracked(seed)[0], tracked(seed, prior)[0]
    assert warm.inside > 0.95
    assert warm.rms < 1.2 * cold.rms
    assert warm.between(60.0, 120.0).error_m.max() < 8.0


def test_a_box_that_was_laid_on_its_side_is_noticed_by_gravity() -> None:
    warm, pipeline = tracked(3, learnt(), mount=("+x", "+z", "-y"))
    cold, _ = tracked(3, mount=("+x", "+z", "-y"))
    assert any("box was turned" in notice for notice in pipeline.take_notices())
    assert warm.rms < 1.2 * cold.rms


def test_what_was_learnt_is_no_poison_when_the_chip_dies_before_the_first_fix() -> None:
    header, frames, _ = simulated(4)
    settings = TrackerSettings("error-state", "vehicle", None, prior=learnt())
    pipeline = Pipeline(header, settings)
    start_ns = frames[0].t_ns
    for t_ns, source, data in frames:
        is_dead = 2 * 10**9 < t_ns - start_ns < 60 * 10**9
        if is_dead and source is Source.IMU:
            continue
        for row in pipeline.feed(Frame(t_ns, source, data)):
            assert math.isfinite(row.lat_rad + row.lon_rad + row.r95_m)
            assert row.r95_m < 1000.0
    kept = pipeline.learned_parameters()
    assert kept is not None
    assert kept.temp_degc is not None
    assert math.isfinite(kept.temp_degc)
