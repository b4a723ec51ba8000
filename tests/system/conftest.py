"""The machine that these tests share, with imu-tracker installed as a user does."""

import re
import shutil
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from support.paths import REPOSITORY
from system.machine import BUILD, Machine
from system.receiver import Receiver
from system.tracker import Tracker

CONFIGURATION = "/etc/imu-tracker/imu-tracker.toml"
DROP_INS = "/etc/systemd/system/imu-tracker.service.d"
LIBRARIES = "/usr/lib/imu-tracker"
PACKAGE = "/mnt/host/packages/imu-tracker.deb"
CHECK = "sudo -u imu-tracker imu-tracker check"
INSTALL_S = 3600.0  # the libraries are compiled, emulated
GUEST_BUS = "/mnt/host/tests/system/guest/bus.py"

# 20 samples a second keep the emulated chip and its emulated bus at some 45 transfers a
# second; they manage 50 to 80, a real bus a thousand.
SETTINGS = {"rate_hz": "20.0", "bandwidth_hz": "5"}

Measure = Callable[[str, float, str], None]


@pytest.fixture(autouse=True)
def _nothing_is_left_open() -> None:
    """Let the machine outlive a test: what holds everywhere else does not here."""


@pytest.fixture
def measure(record_property: Callable[[str, object], None]) -> Measure:
    """Keep a figure for the summary: what, how much, in which unit."""

    def keep(what: str, value: float, unit: str) -> None:
        record_property("measured", f"{what} {value:.3g} {unit}".rstrip())

    return keep


@pytest.hookimpl(trylast=True)
def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Print one line for each check, with what was measured."""
    reports = [
        report
        for outcome in ("passed", "failed")
        for report in terminalreporter.getreports(outcome)
        if "tests/system/" in report.nodeid and report.when == "call"
    ]
    if reports:
        terminalreporter.section("measured in the machine")
    for report in reports:
        name = report.nodeid.rpartition("::")[2].removeprefix("test_")
        figures = [
            str(text) for key, text in report.user_properties if key == "measured"
        ]
        words = name.replace("_", " ")
        terminalreporter.line(
            f"{report.outcome}: {words}" + "".join(f"; {text}" for text in figures)
        )


def documented_install() -> list[str]:
    """Return the three commands of docs/install.md, as they are typed here.

    This is no Pi: there is nothing to set up and to restart, so `check` stands in the
    place of the second.
    """
    text = (REPOSITORY / "docs/install.md").read_text("utf-8")
    block = re.search(r"^```\n(sudo apt install .*?)^```", text, re.M | re.S)
    assert block, "docs/install.md does not tell how to install it"
    install, setup, enable = block[1].splitlines()
    assert setup == "sudo imu-tracker setup && sudo reboot"
    return [
        re.sub(r"\./\S+\.deb", PACKAGE, install) + " --yes",
        CHECK,
        enable,
    ]


@pytest.fixture(scope="session")
def receiver() -> Iterator[Receiver]:
    receiver = Receiver()
    yield receiver
    receiver.close()


@pytest.fixture(scope="session")
def machine(receiver: Receiver) -> Iterator[Machine]:
    """A machine that has booted, and sees what a clone of the repository has."""
    if not (BUILD / "rootfs.ext4").exists():
        pytest.skip("there is no machine: make system-test builds it")
    with tempfile.TemporaryDirectory(prefix="imu-tracker-system-") as name:
        directory = Path(name)
        host = directory / "host"
        for part in ("config", "systemd", "tests/fake_i2c", "tests/system/guest"):
            shutil.copytree(REPOSITORY / part, host / part)
        shutil.copytree(BUILD / "packages", host / "packages")
        machine = Machine(directory, host, receiver)
        try:
            machine.boot()
            yield machine
        finally:
            machine.cut_power()
            shutil.copy(directory / "console", BUILD)


def plug_in_the_chip(machine: Machine) -> None:
    """Make /dev/i2c-1, with an MPU-6050 on it; number 0 is the machine's own."""
    machine.runs("modprobe -a i2c-dev i2c-i801 vhci-hcd i2c-tiny-usb")
    machine.runs(
        "systemd-run --quiet --unit imu-tracker-test-bus"
        f" --setenv PYTHONPATH=/mnt/host/tests:{LIBRARIES}"
        f" --setenv PYTHONDONTWRITEBYTECODE=1 /usr/bin/python3 {GUEST_BUS}"
    )
    machine.runs("for n in $(seq 600); do [ -e /dev/i2c-1 ] && exit; sleep 0.1; done")
    machine.runs("udevadm settle; test -c /dev/i2c-1")


@pytest.fixture(scope="session")
def installation(machine: Machine) -> dict[str, str]:
    """Install it as the documentation says; return what each command printed."""
    printed = {}
    # Of all that the unit says this alone is stretched: numpy and scipy take a tenth of
    # the time on a Pi.
    machine.runs(
        f"mkdir -p {DROP_INS} && printf '[Service]\\nTimeoutStartSec=900\\n'"
        f" > {DROP_INS}/emulated.conf"
    )
    for command in documented_install():
        if command == CHECK:
            plug_in_the_chip(machine)
            for key, value in SETTINGS.items():
                machine.runs(
                    f"sed -i '/^.imu.$/,/^.gps.$/ s/^{key} = .*/{key} = {value}/' "
                    f"{CONFIGURATION}"
                )
        printed[command] = machine.runs(
            f"sudo -u pi -H USER=pi sh -c '{command}'", INSTALL_S
        )
        if command.startswith("sudo apt install"):
            machine.runs("gpasswd --add pi imu-tracker")
    return printed


@pytest.fixture(scope="session")
def installed(machine: Machine, installation: dict[str, str]) -> Tracker:
    return Tracker(machine)


@pytest.fixture
def tracker(installed: Tracker) -> Iterator[Tracker]:
    """The service, writing rows with both sensors; so it must be left as well."""
    installed.wait_for_imu(is_there=True)
    yield installed
    assert installed.bus("report")["violations"] == []
