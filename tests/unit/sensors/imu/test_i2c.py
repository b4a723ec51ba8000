"""Opening a bus, and saying what an errno means."""

import errno
import os
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import smbus2

from imu_tracker.errors import BusError, DeviceNotFoundError
from imu_tracker.sensors.imu import i2c


class FailingSMBus:
    """As smbus2.SMBus, with an adapter that cannot be opened."""

    error = FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT))
    is_closed = False

    def open(self, number: int) -> None:
        raise self.error

    def close(self) -> None:
        type(self).is_closed = True


def opening(monkeypatch: pytest.MonkeyPatch, number: int) -> str:
    error = OSError(number, os.strerror(number))
    monkeypatch.setattr(FailingSMBus, "error", error)
    monkeypatch.setattr(FailingSMBus, "is_closed", False)
    monkeypatch.setattr(smbus2, "SMBus", FailingSMBus)
    with pytest.raises(DeviceNotFoundError) as caught:
        i2c.open_bus(1)
    assert caught.value.__cause__ is error
    assert FailingSMBus.is_closed
    return str(caught.value)


def test_a_missing_bus_says_how_to_enable_it_and_which_there_are(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    there = [Path("/dev/i2c-20"), Path("/dev/i2c-0")]
    monkeypatch.setattr(i2c, "Path", lambda _: SimpleNamespace(glob=lambda _: there))
    text = opening(monkeypatch, errno.ENOENT)
    assert "/dev/i2c-1 does not exist (there is /dev/i2c-0, /dev/i2c-20)" in text
    assert "raspi-config" in text


def test_a_forbidden_bus_names_the_group(monkeypatch: pytest.MonkeyPatch) -> None:
    assert "group i2c" in opening(monkeypatch, errno.EACCES)


def test_a_file_that_is_no_bus_is_given_back(monkeypatch: pytest.MonkeyPatch) -> None:
    assert "Inappropriate ioctl" in opening(monkeypatch, errno.ENOTTY)


def test_an_open_bus_is_smbus2s(monkeypatch: pytest.MonkeyPatch) -> None:
    opened: list[int] = []
    monkeypatch.setattr(smbus2.SMBus, "open", lambda _, number: opened.append(number))
    bus: Any = i2c.open_bus(3)
    assert isinstance(bus, smbus2.SMBus)
    assert opened == [3]


@pytest.mark.parametrize(
    ("number", "advice"),
    [
        (errno.EREMOTEIO, "wiring"),
        (errno.ETIMEDOUT, "hangs"),
        (errno.EIO, "unplugged"),
        (errno.EBUSY, "kernel driver"),
        (errno.EPERM, "Operation not permitted"),
    ],
)
def test_a_failed_transfer_is_explained_by_its_errno(number: int, advice: str) -> None:
    error = BusError("read", 0x68, 0x3B)
    error.__cause__ = OSError(number, os.strerror(number))
    text = i2c.explain(error)
    assert text.startswith("I2C read failed at address 0x68, register 0x3B (E")
    assert advice in text


def test_other_errors_speak_for_themselves() -> None:
    assert i2c.explain(DeviceNotFoundError("who?")) == "who?"
    error = BusError("check", 0x68, 0x1A)
    assert i2c.explain(error) == str(error)
