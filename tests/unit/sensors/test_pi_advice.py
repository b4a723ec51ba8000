"""What is said to somebody whose Pi has not been told everything yet."""

import grp
import os
import pwd
from pathlib import Path
from types import SimpleNamespace

import pytest

from imu_tracker.sensors import pi_advice as mending

I2C_ON = "sudo raspi-config nonint do_i2c 0"
UART_ON = "sudo raspi-config nonint do_serial_hw 0"


@pytest.fixture
def boot(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The boot configuration of a Pi without any buses."""
    path = tmp_path / "config.txt"
    monkeypatch.setattr(mending, "BOOT_CONFIGS", (tmp_path / "none", path))
    monkeypatch.setattr(mending, "ADAPTERS", tmp_path / "adapters")
    return path


@pytest.fixture
def members(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """The members of every group; all files are of the group `wires`."""
    found: list[str] = []
    group = SimpleNamespace(gr_name="wires", gr_mem=found)
    monkeypatch.setattr(grp, "getgrgid", lambda gid: group)
    monkeypatch.setattr(grp, "getgrnam", lambda name: group)
    monkeypatch.setattr(pwd, "getpwuid", lambda uid: SimpleNamespace(pw_name="pi"))
    return found


def test_a_user_is_put_into_the_group_that_the_device_has(
    members: list[str],
) -> None:
    device = SimpleNamespace(stat=lambda: SimpleNamespace(st_gid=998))
    advice = mending.join_group(device, "i2c")  # type: ignore[arg-type]
    assert "sudo usermod -aG wires pi, and log in again" in advice
    device = SimpleNamespace(stat=lambda: SimpleNamespace(st_gid=0))
    advice = mending.join_group(device, "i2c")  # type: ignore[arg-type]
    assert "sudo usermod -aG i2c pi" in advice  # nobody should join root


def test_who_is_in_the_group_already_logs_in_again(members: list[str]) -> None:
    members.append("pi")
    advice = mending.join_group(Path("/nowhere"), "dialout")
    assert advice == "pi is in the group dialout, but this session is not: log in again"


def test_i2c_that_is_off_is_switched_on(boot: Path) -> None:
    assert I2C_ON in mending.switch_i2c_on(1)
    boot.write_text("# dtparam=i2c_arm=on\ndtparam=spi=on\n")
    assert I2C_ON in mending.switch_i2c_on(1)


@pytest.mark.parametrize(
    "setting", ["dtparam=i2c_arm=on", "  dtparam=spi=on,i2c_arm=on,audio=on"]
)
def test_i2c_that_is_on_wants_a_restart(setting: str, boot: Path) -> None:
    boot.write_text(f"[all]\n{setting}\n")
    assert mending.switch_i2c_on(1).endswith("sudo reboot")


def test_a_bus_without_its_driver_wants_the_driver(boot: Path) -> None:
    (mending.ADAPTERS / "i2c-1").mkdir(parents=True)
    assert "sudo modprobe i2c-dev" in mending.switch_i2c_on(1)
    assert I2C_ON in mending.switch_i2c_on(0)


def test_a_serial_port_that_is_off_is_switched_on(boot: Path) -> None:
    assert UART_ON in mending.switch_uart_on()
    boot.write_text("enable_uart=1\n")
    assert mending.switch_uart_on().endswith("sudo reboot")


def test_a_directory_of_nobody_is_made_and_one_of_a_service_is_used_as_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(pwd, "getpwuid", lambda uid: SimpleNamespace(pw_name=f"u{uid}"))
    monkeypatch.setattr(os, "geteuid", lambda: 1000)
    none = tmp_path / "none"
    advice = mending.own_directory(none)
    assert advice == f"sudo install -d -m 750 -o u1000 -g u1000 {none}"
    theirs = SimpleNamespace(stat=lambda: SimpleNamespace(st_uid=997))
    advice = mending.own_directory(theirs)  # type: ignore[arg-type]
    assert advice == "it is u997's: run this as u997, with sudo -u u997"
