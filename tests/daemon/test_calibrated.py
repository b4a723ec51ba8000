"""The daemon and its calibration file: used when good, told and left when not."""

import json
import logging
from pathlib import Path

import pytest

from imu_tracker.config import load_config
from imu_tracker.daemon.run import run
from imu_tracker.storage.calibration_file import (
    Calibration,
    GyroPart,
    write_calibration,
)

BIAS = (0.02, -0.01, 0.03)


def calibration(chip: str = "MPU-6050") -> Calibration:
    row = (0.0, 0.0, 0.0)
    gyro = GyroPart(
        bias_radps=BIAS,
        covariance=(row, row, row),
        temp_degc=25.0,
        temps_degc=(20.0, 30.0),
        still_s=30.0,
    )
    return Calibration(chip=chip, gyro=gyro)


def tracked(tmp_path: Path, caplog: pytest.LogCaptureFixture, name: str) -> str:
    """Run the daemon on a simulation; return what it said."""
    overrides = [
        "source.kind=simulation",
        "source.scenario=still",
        "source.duration_s=40",
        "source.speed=1000",
        f"log.path={tmp_path}/log.csv",
        f"status.path={tmp_path}/status.json",
        "log.min_free_mb=0",
        f"imu.calibration={tmp_path / name}",
    ]
    with caplog.at_level(logging.DEBUG, logger="imu_tracker"):
        code = run(load_config(None, overrides), notify=lambda _: None)
    assert code == 0
    assert len((tmp_path / "log.csv").read_text().splitlines()) > 5
    return caplog.text


def test_a_good_file_is_used(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    write_calibration(tmp_path / "c.json", calibration())
    said = tracked(tmp_path, caplog, "c.json")
    assert "calibrated by" in said
    assert "uncalibrated" not in said


@pytest.mark.parametrize("text", ["", "{", json.dumps({"version": 1, "chip": 5})])
def test_a_damaged_file_is_told_and_the_daemon_goes_on(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, text: str
) -> None:
    (tmp_path / "c.json").write_text(text)
    assert "calibrate again, or remove it; goes on uncalibrated" in tracked(
        tmp_path, caplog, "c.json"
    )


def test_a_file_that_is_named_and_missing_is_told(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    assert "goes on uncalibrated" in tracked(tmp_path, caplog, "none.json")


def test_the_file_of_another_chip_is_told_and_left(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    write_calibration(tmp_path / "c.json", calibration("MPU-6500"))
    said = tracked(tmp_path, caplog, "c.json")
    assert "made for the chip MPU-6500" in said
    assert "goes on uncalibrated" in said
