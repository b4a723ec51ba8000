"""The calibration file: what is written is read, and whatever is wrong is refused."""

import copy
import json
import math
from pathlib import Path
from typing import Any

import pytest

from imu_tracker.errors import CalibrationError, InputMissingError, OutputError
from imu_tracker.storage.calibration_file import (
    Calibration,
    read_calibration,
    write_calibration,
)

ZERO3 = [[0.0] * 3] * 3
COS, SIN = math.cos(0.1), math.sin(0.1)

GOOD: dict[str, Any] = {
    "version": 1,
    "chip": "MPU-6050",
    "gyro": {
        "bias_radps": [0.01, -0.02, 0.03],
        "covariance": [[1e-8, 0, 0], [0, 1e-8, 1e-9], [0, 1e-9, 1e-8]],
        "temp_degc": 25.0,
        "temps_degc": [21.0, 27.0],
        "radps_per_degc": [1e-4, 0, -1e-4],
        "still_s": 30.0,
        "utc": "2026-11-22T12:00:00Z",
    },
    "accel": {
        "bias_mps2": [0.1, 0.2, -0.3],
        "gain": [[1.01, 0.0, 0.0], [0.0, 0.99, 0.02], [0.0, 0.0, 1.0]],
        "covariance": [[1e-6 * (i == j) for j in range(4)] for i in range(4)],
        "residuals_mps2": [[0.0, 0.01, 0.0]] * 6,
        "gravity_mps2": 9.81,
        "temp_degc": 24.0,
        "utc": None,
    },
    "mount": {
        "mount": ["+x", "-y", "-z"],
        "rotation": [[COS, -SIN, 0.0], [SIN, COS, 0.0], [0.0, 0.0, 1.0]],
        "yaw_sigma_deg": 0.5,
        "temp_degc": 24.0,
        "utc": None,
    },
}


def changed(where: str, value: object) -> dict[str, Any]:
    """Return a good file with one value changed; a dotted path leads to it."""
    file = copy.deepcopy(GOOD)
    *way, last = where.split(".")
    place: Any = file
    for step in way:
        place = place[int(step) if step.isdigit() else step]
    place[int(last) if last.isdigit() else last] = value
    return file


def test_what_is_written_is_read(tmp_path: Path) -> None:
    path = tmp_path / "new" / "calibration.json"
    (tmp_path / "good.json").write_text(json.dumps(GOOD))
    known = read_calibration(tmp_path / "good.json")
    write_calibration(path, known)
    assert read_calibration(path) == known
    assert path.stat().st_mode & 0o007 == 0
    assert [p.name for p in path.parent.iterdir()] == ["calibration.json"]


@pytest.mark.parametrize(
    ("where", "value"),
    [
        ("version", 2),
        ("version", True),
        ("chip", ""),
        ("chip", 6050),
        ("owner", "me"),
        ("gyro.bias_radps", [0.01, 0.02]),
        ("gyro.bias_radps.0", math.nan),
        ("gyro.bias_radps.0", math.inf),
        ("gyro.bias_radps.0", 1e300),
        ("gyro.bias_radps.0", 1.1),
        ("gyro.bias_radps.0", "0.01"),
        ("gyro.bias_radps.0", True),
        ("gyro.bias_radps.0", None),
        ("gyro.covariance", ZERO3[:2]),
        ("gyro.covariance.0.0", -1e-9),
        ("gyro.covariance.0.1", 1e-7),
        ("gyro.covariance.1.2", 5e-8),
        ("gyro.temp_degc", 400.0),
        ("gyro.temp_degc", 30.0),
        ("gyro.temps_degc", [27.0, 21.0]),
        ("gyro.still_s", 0),
        ("gyro.utc", "yesterday"),
        ("gyro.utc", 5),
        ("accel.bias_mps2.2", -3.1),
        ("accel.gain.0.0", 1.3),
        ("accel.gain.0.0", 0.0),
        ("accel.gain.1.0", 0.3),
        ("accel.gain", [1.0, 1.0, 1.0]),
        ("accel.residuals_mps2", []),
        ("accel.gravity_mps2", 1.62),
        ("mount.mount", ["+x", "+y", "-z"]),
        ("mount.mount", "+x"),
        ("mount.rotation", [[1, 0, 0], [0, 1, 0], [0, 0, -1]]),
        ("mount.rotation", [[-1, 0, 0], [0, -1, 0], [0, 0, 1]]),
        ("mount.rotation.0.0", 1.001),
        ("mount.rotation", [[2, 0, 0], [0, 2, 0], [0, 0, 2]]),
        ("mount", []),
        ("gyro", "yes"),
    ],
)
def test_a_damaged_value_is_refused_with_its_place(
    tmp_path: Path, where: str, value: object
) -> None:
    path = tmp_path / "c.json"
    path.write_text(json.dumps(changed(where, value)))
    with pytest.raises(CalibrationError) as caught:
        read_calibration(path)
    told = str(caught.value)
    assert told.startswith(f"{path}: {where.split('.')[0]}")
    assert told.endswith("calibrate again, or remove it")
    assert "\n" not in told


@pytest.mark.parametrize(
    "data",
    [
        b"",
        b"\0" * 4096,
        b"\xff\xfe{}",
        b"[" * 100_000,
        b"[]",
        b"null",
        b"{}",
        json.dumps(GOOD).encode()[:-5],
        b" " * 2_000_000,
        b'{"version": 1' + b"9" * 5000 + b"}",
    ],
)
def test_a_torn_or_foreign_file_is_refused_in_one_line(
    tmp_path: Path, data: bytes
) -> None:
    path = tmp_path / "c.json"
    path.write_bytes(data)
    with pytest.raises(CalibrationError) as caught:
        read_calibration(path)
    assert "\n" not in str(caught.value)


def test_no_file_is_told_from_a_damaged_one(tmp_path: Path) -> None:
    with pytest.raises(InputMissingError):
        read_calibration(tmp_path / "none.json")


def test_a_file_that_cannot_be_written_leaves_the_old_one(tmp_path: Path) -> None:
    path = tmp_path / "c.json"
    path.mkdir()
    with pytest.raises(OutputError, match=r"c\.json"):
        write_calibration(path, Calibration(chip="MPU-6050"))
    assert path.is_dir()


def test_parts_that_were_not_measured_correct_nothing() -> None:
    known = Calibration(chip="MPU-6050").corrections()
    assert known.accel_bias_mps2 == known.gyro_bias_radps == (0.0, 0.0, 0.0)
    assert known.mount is None
