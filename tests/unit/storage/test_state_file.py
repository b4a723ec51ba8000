"""The state file: what comes back, what is refused, and what a power cut leaves."""

import json
from pathlib import Path
from typing import Any

import pytest

from imu_tracker.errors import OutputError, StateError
from imu_tracker.estimation.error_state.warm_start import LearnedParameters, Place
from imu_tracker.storage.state_file import StateFile, read_state, write_state
from imu_tracker.storage.state_model import Sensor
from imu_tracker.wheels.orders import KeptWheels

SENSOR = Sensor("MPU-6050", ("+x", "-y", "-z"), "")
LEARNT = LearnedParameters(
    *("vehicle", 1, (0.01, -0.02, 0.003), (1e-3, 1e-3, 2e-3)),
    *((0.1, -0.2, 0.05), (0.01, 0.01, 0.02), (0.001,) * 9, (0.002,) * 9),
    q_vb=(1.0, 0.0, 0.0, 0.0),
    mounting_sigma_rad=(0.004, 0.005),
    axle_m=1.2,
    axle_sigma_m=0.1,
    latency_s=0.27,
    latency_sigma_s=0.05,
    velocity_latency_s=0.19,
    velocity_latency_sigma_s=0.04,
    temp_degc=25.0,
    utc_s=1795348800.0,
    place=Place(0.9, 0.08, 2.0, (1.0, 0.0, 0.0, 0.0), 0.01, is_at_rest=True),
    still_levels=((False, 0.002, 0.08), (True, 0.02, 0.5)),
    wheels=KeptWheels(1.88, 0.01, tuple(0.1 * k for k in range(18))),
)


def saved(tmp_path: Path) -> tuple[Path, dict[str, Any]]:
    path = tmp_path / "state.json"
    write_state(path, LEARNT, SENSOR)
    return path, json.loads(path.read_text())


def test_what_is_written_comes_back(tmp_path: Path) -> None:
    path, _ = saved(tmp_path)
    assert read_state(path, SENSOR) == LEARNT
    assert path.stat().st_mode & 0o777 == 0o640
    assert list(tmp_path.iterdir()) == [path]


def test_a_state_of_before_the_wheels_is_read(tmp_path: Path) -> None:
    path, state = saved(tmp_path)
    del state["learnt"]["wheels"]
    path.write_text(json.dumps(state))
    assert read_state(path, SENSOR) == LEARNT._replace(wheels=None)


def test_no_file_is_no_error(tmp_path: Path) -> None:
    assert read_state(tmp_path / "none.json", SENSOR) is None


@pytest.mark.parametrize(
    "data",
    [
        *(b"", b"{", b"null", b"[]", b"{}", b"\xff\xfe\x00", b"x" * 70_000),
        *(b"[" * 60_000, b'{"a":' * 10_000, b'{"version": 1}'),
    ],
)
def test_damage_is_refused_in_one_line(tmp_path: Path, data: bytes) -> None:
    path = tmp_path / "state.json"
    path.write_bytes(data)
    with pytest.raises(StateError) as caught:
        read_state(path, SENSOR)
    assert str(caught.value).startswith(str(path))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("key", "value"),
    [
        *(("axle_m", float("nan")), ("axle_m", float("inf")), ("axle_m", 10**400)),
        *(("axle_m", "1"), ("axle_m", None), ("axle_m", 1e9), ("noise_level", 99)),
        *(("noise_level", True), ("profile", "boat"), ("q_vb", [1, 1, 0, 0])),
        *(("gyro_bias_radps", [0, 0]), ("gyro_bias_sigma_radps", [0, 0, 0])),
        *(("accel_bias_mps2", [0, 0, 50]), ("still_levels", [[1, 2, 3]])),
        *(("wheels", {"circumference_m": 1.9}), ("wheels", [1.9, 0.01])),
        *(("place", {"lat_rad": 4}), ("surprise", 1), ("temp_degc", -400)),
    ],
)
def test_what_is_not_plausible_is_refused(
    tmp_path: Path, key: str, value: object
) -> None:
    path, state = saved(tmp_path)
    state["learnt"][key] = value
    path.write_text(json.dumps(state))
    with pytest.raises(StateError, match="not a state of imu-tracker"):
        read_state(path, SENSOR)


@pytest.mark.parametrize(
    ("sensor", "reason"),
    [
        (SENSOR._replace(chip="MPU-6500"), "another chip"),
        (SENSOR._replace(mount=("+y", "+x", "-z")), "imu.mount"),
        (SENSOR._replace(calibration="abc"), "another calibration"),
    ],
)
def test_the_state_of_another_sensor_is_refused(
    tmp_path: Path, sensor: Sensor, reason: str
) -> None:
    path, _ = saved(tmp_path)
    with pytest.raises(StateError, match=reason):
        read_state(path, sensor)


def test_an_estimator_that_went_astray_is_not_kept(tmp_path: Path) -> None:
    path, before = saved(tmp_path)
    with pytest.raises(StateError, match="not plausible"):
        write_state(path, LEARNT._replace(axle_m=float("nan")), SENSOR)
    assert json.loads(path.read_text()) == before


@pytest.mark.parametrize("call", ["open", "fsync", "rename"])
def test_a_disk_that_fails_leaves_the_old_state_whole(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, call: str
) -> None:
    path, before = saved(tmp_path)

    def full(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device")

    if call == "fsync":
        monkeypatch.setattr("imu_tracker.storage.atomic.os.fsync", full)
    elif call == "open":
        monkeypatch.setattr("imu_tracker.storage.atomic.os.open", full)
    else:
        monkeypatch.setattr(Path, "replace", full)
    with pytest.raises(OutputError, match="No space left"):
        write_state(path, LEARNT._replace(axle_m=2.0), SENSOR)
    assert json.loads(path.read_text()) == before


def test_a_refused_file_is_replaced_by_what_is_learnt_anew(tmp_path: Path) -> None:
    path = tmp_path / "state.json"
    path.write_text("garbage")
    file = StateFile(path)
    with pytest.raises(StateError):
        file.begin(SENSOR)
    assert not file.write()
    file.set_learned(LEARNT)
    assert file.write()
    assert read_state(path, SENSOR) == LEARNT
