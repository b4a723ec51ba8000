"""Settings from recordings: how the box sits, the lever arm, and what is not told."""

import math
import tomllib
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from imu_tracker.config import load_config
from imu_tracker.estimation.error_state.warm_start import LearnedParameters
from imu_tracker.geometry.rotation import from_euler
from imu_tracker.recording.advice import Finding, find, toml
from imu_tracker.recording.tuning import (
    CORRELATED,
    Estimate,
    Innovation,
    Trial,
    all_mounts,
    lever_arm,
    mount_matrix,
    seat,
    together,
)
from imu_tracker.samples import DEFAULT_MOUNT, Frame, SessionHeader
from imu_tracker.simulation import simulate
from imu_tracker.simulation.receiver.receiver import TYPICAL_RECEIVER

UNKNOWN = Estimate(0.0, math.inf)
N_FIXES, NOISE_M = 300, 0.5


def learned(yaw_deg: float = 0.0, *, profile: str = "vehicle") -> LearnedParameters:
    """What a filter learnt in a box that is turned to the right by so much."""
    none, nine = (0.0, 0.0, 0.0), (0.0,) * 9
    is_vehicle = profile == "vehicle"
    return LearnedParameters(
        profile=profile,
        noise_level=1,
        gyro_bias_radps=(0.0, 0.0, math.radians(3.0)),
        gyro_bias_sigma_radps=(1e-4, 1e-4, 1e-4),
        accel_bias_mps2=none,
        accel_bias_sigma_mps2=(0.02, 0.02, 0.02),
        gyro_gain=nine,
        gyro_gain_sigma=(0.001,) * 9,
        q_vb=from_euler(0.0, 0.0, math.radians(yaw_deg)) if is_vehicle else None,
        mounting_sigma_rad=(0.01, 0.01),
        axle_m=1.0,
        axle_sigma_m=0.1,
        latency_s=0.2,
        latency_sigma_s=0.01,
        velocity_latency_s=0.2,
        velocity_latency_sigma_s=0.01,
    )


def test_there_are_24_ways_to_sit_along_the_axes() -> None:
    matrices = [mount_matrix(mount) for mount in all_mounts()]
    assert len(matrices) == 24
    assert all(np.linalg.det(each) == pytest.approx(1.0) for each in matrices)
    assert len({each.tobytes() for each in matrices}) == 24


@pytest.mark.parametrize(
    ("yaw_deg", "mount"),
    [
        (4.0, ("+x", "-y", "-z")),
        (94.0, ("+y", "+x", "-z")),
        (-88.0, ("-y", "-x", "-z")),
        (177.0, ("-x", "+y", "-z")),
    ],
)
def test_a_box_that_was_found_turned_has_another_mount(
    yaw_deg: float, mount: tuple[str, str, str]
) -> None:
    """The body's x, seen from a vehicle that it is turned in: by hand."""
    sits = seat(learned(yaw_deg), DEFAULT_MOUNT)
    assert sits is not None
    assert sits.mount == mount
    assert sits.off_deg == pytest.approx(min(yaw_deg % 90, -yaw_deg % 90), abs=0.1)


def test_what_has_no_wheels_has_no_mounting() -> None:
    assert seat(learned(profile="walker"), DEFAULT_MOUNT) is None


def trials(rng: np.random.Generator, true_m: tuple[float, float]) -> list[Trial]:
    """Innovations of fixes amid turns, by the equations of a fix."""
    config = load_config(None)
    found = [Trial(config) for _ in range(3)]
    for t in range(N_FIXES):
        yaw = 0.1 * t
        C = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
        noise = rng.normal(size=2) * NOISE_M
        for trial, arm in zip(found, ((0, 0), (0.5, 0), (0, 0.5)), strict=True):
            z = C @ (np.array(true_m) - arm) + noise
            key = (1, t, "position", 0)
            trial.innovations[key] = Innovation(z, np.eye(2) / NOISE_M**2)
    return found


@pytest.mark.parametrize("reach_m", [0.0, 1.0])
def test_the_lever_arm_scatters_as_its_covariance_says(reach_m: float) -> None:
    """Against weighted least squares by hand: J' W J is N / sigma^2 in all directions.

    A half of z' W z is 1 for the noise alone, and a wrong arm l adds l^2 / (2 sigma^2).
    """
    rng, inside = np.random.default_rng(5), []
    for _ in range(200):
        arm_m = rng.uniform(-reach_m, reach_m, 2)
        first, *moved = trials(rng, (float(arm_m[0]), float(arm_m[1])))
        ideal_m = NOISE_M / math.sqrt(N_FIXES)
        excess = 1.0 + float(arm_m @ arm_m) / (2.0 * NOISE_M**2)
        for (value, sigma), true in zip(lever_arm(first, moved), arm_m, strict=True):
            inside.append(abs(value - true) < 1.96 * ideal_m)
            expected_m = CORRELATED * ideal_m * math.sqrt(excess)
            assert sigma == pytest.approx(expected_m, rel=0.15)
    # Of 400 values 95 %, with three sigmas of their number. The margin comes on top.
    assert 0.917 < np.mean(inside) < 0.983


def test_without_a_turn_no_lever_arm_is_told() -> None:
    config = load_config(None)
    first, *moved = (Trial(config) for _ in range(3))
    for trial in (first, *moved):
        for t in range(50):
            key = (1, t, "position", 0)
            trial.innovations[key] = Innovation(np.zeros(2), np.eye(2))
    assert [math.isinf(sigma) for _, sigma in lever_arm(first, moved)] == [True, True]


def test_recordings_are_weighed_and_may_contradict_each_other() -> None:
    found = together([Estimate(1.0, 0.1), Estimate(1.2, 0.1), UNKNOWN])
    assert found is not None
    assert found.value == pytest.approx(1.1)
    assert found.sigma == pytest.approx(0.1 / math.sqrt(2.0))
    assert together([Estimate(0.0, 0.1), Estimate(1.0, 0.1)]) is None


def test_what_is_told_is_toml_that_configures(tmp_path: Path) -> None:
    arms = [Estimate(1.234, 0.05), Estimate(-0.4, 0.05)]
    found = Finding(
        *(learned(), 600.0, Estimate(0.23, 0.01), arms),
        *(("+y", "+x", "-z"), DEFAULT_MOUNT, 4.0),
    )
    path = tmp_path / "tuned.toml"
    path.write_text("\n".join(toml([found])), encoding="utf-8")
    config = load_config(path)
    assert config.imu.mount == ("+y", "+x", "-z")
    assert config.gps.latency_s == 0.23
    assert config.gps.lever_arm_m == (1.23, -0.4, 0.0)
    assert config.filter.profile == "vehicle"
    assert "calibrate gyro" in path.read_text(encoding="utf-8")


def test_what_cannot_be_told_is_not_set() -> None:
    found = Finding(
        *(learned(profile="free"), 60.0, Estimate(0.2, 0.3), [UNKNOWN, UNKNOWN]),
        *(DEFAULT_MOUNT, DEFAULT_MOUNT, None),
    )
    text = "\n".join(toml([found]))
    assert tomllib.loads(text) == {"imu": {}, "gps": {}, "filter": {}}
    for name in ("mount", "latency_s", "lever_arm_m", "profile"):
        assert f"# {name}: cannot tell" in text


def test_of_a_recording_without_fixes_nothing_is_told() -> None:
    found = Finding(
        *(None, 10.0, UNKNOWN, [UNKNOWN, UNKNOWN]),
        *(DEFAULT_MOUNT, DEFAULT_MOUNT, None),
    )
    assert "cannot tell anything" in "\n".join(toml([found]))


@cache
def drive_with_a_turned_box() -> Finding:
    """A drive of five minutes whose header is wrong by a quarter turn."""
    receiver = TYPICAL_RECEIVER._replace(latency_s=0.4)

    def stream() -> Iterator[SessionHeader | Frame]:
        made = simulate(
            "drive",
            seed=4,
            duration_s=300.0,
            receiver=receiver,
            mount=("+y", "+x", "-z"),
        )
        yield made.header._replace(mount=DEFAULT_MOUNT)
        yield from made.frames

    return find(load_config(None, ["filter.profile=vehicle"]), stream)


def test_a_drive_tells_how_its_box_sits_and_how_late_its_receiver_is() -> None:
    found = drive_with_a_turned_box()
    assert found.used_mount == DEFAULT_MOUNT
    assert found.mount == ("+y", "+x", "-z")
    assert found.latency_s.value == pytest.approx(0.4, abs=0.1)
