"""`imu-tracker setup` on the boot files of four generations of Raspberry Pi."""

import difflib
import grp
import logging
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace

import pytest

from imu_tracker import cli
from imu_tracker.errors import OutputError
from imu_tracker.setup import machine as machines
from imu_tracker.setup.actions import Command, Edit
from imu_tracker.setup.boot_config import BootConfig, NotUnderstoodError, Setting
from imu_tracker.setup.kernel_command import consoles_on, without_consoles
from imu_tracker.setup.machine import Machine
from support.paths import TESTS

BOOT_FILES = TESTS / "boot_files"

I2C = Setting(("i2c_arm", "i2c"), "on", is_parameter=True)
UART = Setting(("enable_uart",), "1", is_parameter=False)

# What changes: lines that go, and lines that come, in their order. By the documentation
# Zero 2 W, 3 and 4 need enable_uart=1; serial0 of the Pi 5 is its debug connector.
UNFINISHED = "dtparam=i2c_arm_baudrate=1000000"  # the last line lacks its line end
CHANGES = {
    "zero2w": (
        ["#dtparam=i2c_arm=on"],
        [
            "dtparam=i2c_arm=on",
            "dtparam=i2c_arm_baudrate=400000",
            "enable_uart=1",
        ],
    ),
    "pi3": (
        [
            "dtparam=spi=on,i2c_arm=off,audio=on",
            "enable_uart=0",
            UNFINISHED,
        ],
        [
            "dtparam=spi=on,i2c_arm=on,audio=on",
            "enable_uart=1",
            UNFINISHED,
            "[all]",
            "dtparam=i2c_arm_baudrate=400000",
        ],
    ),
    "pi4": (
        ["#enable_uart=1"],
        ["enable_uart=1", "[all]", "dtparam=i2c_arm_baudrate=400000"],
    ),
    "pi5": (
        ["#dtparam=i2c_arm=on"],
        [
            "dtparam=i2c_arm=on",
            "dtparam=i2c_arm_baudrate=400000",
            "dtparam=uart0_console=on",
        ],
    ),
}

CONSOLE_GONE = {
    "zero2w": "console=serial0,115200 ",
    "pi3": "  console=ttyAMA0,115200",
    "pi4": "console=serial0,115200 ",
    "pi5": "console=serial0,115200 ",
}

SERIAL0 = {"zero2w": "ttyS0", "pi3": "ttyAMA0", "pi4": "ttyS0", "pi5": "ttyAMA10"}


def pi(folder: Path, name: str) -> Path:
    """Lay a Raspberry Pi of that name out, never set up, and return its root."""
    boot = folder / "boot/firmware"
    boot.mkdir(parents=True)
    for file in ("config.txt", "cmdline.txt"):
        shutil.copy(BOOT_FILES / name / file, boot / file)
    tree = folder / "proc/device-tree"
    tree.mkdir(parents=True)
    shutil.copy(BOOT_FILES / name / "model", tree / "model")
    (folder / "dev").mkdir()
    (folder / "dev" / SERIAL0[name]).touch()
    (folder / "dev/serial0").symlink_to(SERIAL0[name])
    if SERIAL0[name] == "ttyS0":  # the mini UART's port comes with enable_uart=1
        (folder / "dev/serial0").unlink()
    return folder


@pytest.fixture
def started(monkeypatch: pytest.MonkeyPatch) -> list[tuple[str, ...]]:
    """The programs that were started, instead of starting them; gpasswd alone."""
    found: list[tuple[str, ...]] = []

    def run(words: tuple[str, ...], **_: object) -> None:
        found.append(tuple(words))
        members.setdefault(words[3], []).append(words[2])

    members: dict[str, list[str]] = {}

    def group(name: str) -> SimpleNamespace:
        return SimpleNamespace(gr_mem=members.get(name, []))

    monkeypatch.setattr(grp, "getgrnam", group)
    monkeypatch.setattr(subprocess, "run", run)
    return found


@pytest.fixture(params=sorted(CHANGES))
def name(request: pytest.FixtureRequest) -> str:
    return str(request.param)


@pytest.fixture
def root(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A Pi, asked by root through sudo of the user pi, who is in no group."""
    folder = pi(tmp_path / "root", name)
    use(folder, monkeypatch)
    yield folder
    logging.getLogger("imu_tracker").handlers = []


def use(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Let the command see this root, the rights of root and the user pi."""
    monkeypatch.setattr(os, "geteuid", lambda: 0)
    monkeypatch.setenv("SUDO_USER", "pi")
    monkeypatch.setattr(machines, "Machine", lambda user: Machine(folder, user))


def boot(root: Path, file: str) -> bytes:
    return (root / "boot/firmware" / file).read_bytes()


def changed(before: bytes, after: bytes) -> tuple[list[str], list[str]]:
    """Return the lines that went and those that came, each with its line end."""
    old, new = (text.decode().splitlines(keepends=True) for text in (before, after))
    rows = list(difflib.ndiff(old, new))
    return [r[2:] for r in rows if r[0] == "-"], [r[2:] for r in rows if r[0] == "+"]


def test_each_generation_gets_the_lines_that_it_needs_and_no_other(
    name: str, root: Path, started: list[tuple[str, ...]]
) -> None:
    before = boot(root, "config.txt")
    assert cli.main(["setup", "--yes"]) == 0
    after = boot(root, "config.txt")
    end = "\r\n" if name == "pi4" else "\n"
    gone, came = CHANGES[name]
    assert changed(before, after) == (
        [line if line == UNFINISHED else line + end for line in gone],
        [line + end for line in came],
    )


def test_the_console_leaves_the_port_and_nothing_else_changes(
    name: str, root: Path, started: list[tuple[str, ...]]
) -> None:
    before = boot(root, "cmdline.txt").decode()
    assert cli.main(["setup", "--yes"]) == 0
    after = boot(root, "cmdline.txt").decode()
    assert before.count(CONSOLE_GONE[name]) == 1
    assert after == before.replace(CONSOLE_GONE[name], "")
    assert "console=tty1" in after


def test_a_second_run_changes_nothing(
    root: Path, started: list[tuple[str, ...]], capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.main(["setup", "--yes"]) == 0
    files = {path: path.read_bytes() for path in root.rglob("*.txt")}
    modules = root / "etc/modules-load.d/imu-tracker.conf"
    assert modules.read_text() == "i2c-dev\n"
    capsys.readouterr()
    assert cli.main(["setup", "--yes"]) == 0
    assert {path: path.read_bytes() for path in root.rglob("*.txt")} == files
    out = capsys.readouterr().out
    assert "edit" not in out
    assert "undone" not in out
    assert "now restart: sudo reboot" in out  # it was not restarted between


def test_each_command_is_shown_before_and_so_is_its_undoing(
    root: Path, started: list[tuple[str, ...]], capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.main(["setup", "--yes"]) == 0
    out = capsys.readouterr().out
    assert started == [
        ("gpasswd", "--add", "pi", group) for group in ("i2c", "dialout", "imu-tracker")
    ]
    for words in started:
        assert f"    $ {' '.join(words)}\n" in out
    config = root / "boot/firmware/config.txt"
    assert f"sudo cp {config}.before-imu-tracker {config}\n" in out
    assert "sudo gpasswd --delete pi i2c\n" in out
    assert "sudo rm " in out


def test_the_undoing_brings_back_what_was_there(
    name: str, root: Path, started: list[tuple[str, ...]]
) -> None:
    assert cli.main(["setup", "--yes"]) == 0
    for file in ("config.txt", "cmdline.txt"):
        copy = boot(root, f"{file}.before-imu-tracker")
        assert copy == (BOOT_FILES / name / file).read_bytes()


def test_without_an_answer_and_in_a_dry_run_nothing_is_done(
    name: str,
    root: Path,
    started: list[tuple[str, ...]],
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr(sys, "stdin", SimpleNamespace(readline=lambda: ""))
    assert cli.main(["setup"]) == 0
    assert "run it again when you want it" in capsys.readouterr().out
    monkeypatch.setattr(os, "geteuid", lambda: 1000)
    assert cli.main(["setup", "--dry-run"]) == 0
    out = capsys.readouterr().out
    assert "      + dtparam=i2c_arm_baudrate=400000\n" in out
    assert started == []
    for file in ("config.txt", "cmdline.txt"):
        assert boot(root, file) == (BOOT_FILES / name / file).read_bytes()
    assert cli.main(["setup", "--yes"]) == 2  # not root


def test_what_is_answered_with_yes_is_done_and_the_rest_is_not(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, started: list[tuple[str, ...]]
) -> None:
    root = pi(tmp_path / "root", "zero2w")
    use(root, monkeypatch)
    answers = iter(["y\n", "n\n", "yes\n", "\n"])
    monkeypatch.setattr(
        sys, "stdin", SimpleNamespace(readline=lambda: next(answers, ""))
    )
    assert cli.main(["setup"]) == 0
    text = boot(root, "config.txt").decode()
    assert "\ndtparam=i2c_arm=on\n" in text
    assert "baudrate" not in text
    assert "\nenable_uart=1\n" in text
    assert "console=serial0" in boot(root, "cmdline.txt").decode()
    assert started == []


def test_what_is_in_effect_already_needs_no_restart(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    started: list[tuple[str, ...]],
    capsys: pytest.CaptureFixture[str],
) -> None:
    root = pi(tmp_path / "root", "pi4")
    use(root, monkeypatch)
    assert cli.main(["setup", "--yes"]) == 0
    # After the restart: the bus at 400 kHz, the port, and no console on it.
    (root / "dev/i2c-1").touch()
    (root / "dev/serial0").symlink_to("ttyS0")
    clock = root / "sys/bus/i2c/devices/i2c-1/of_node/clock-frequency"
    clock.parent.mkdir(parents=True)
    clock.write_bytes((400_000).to_bytes(4, "big"))
    (root / "proc/cmdline").write_text("console=tty1 root=/dev/mmcblk0p2")
    group = SimpleNamespace(gr_mem=["pi"])
    monkeypatch.setattr(grp, "getgrnam", lambda name: group)
    capsys.readouterr()
    assert cli.main(["setup", "--yes"]) == 0
    out = capsys.readouterr().out
    assert "nothing is missing; next: imu-tracker check" in out
    assert {line.split()[0] for line in out.splitlines()[:7]} == {"ok"}


def test_a_clock_that_somebody_chose_is_left(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, started: list[tuple[str, ...]]
) -> None:
    root = pi(tmp_path / "root", "zero2w")
    use(root, monkeypatch)
    path = root / "boot/firmware/config.txt"
    path.write_text("dtparam=i2c_baudrate=50000,i2c=on\nenable_uart=1\n")
    before = path.read_bytes()
    assert cli.main(["setup", "--yes"]) == 0
    assert path.read_bytes() == before


@pytest.mark.parametrize(
    "text",
    [
        "dtparam=i2c_arm=on\ninclude more.txt\n",
        "dtparam=i2c_arm=on\n<<<<<<< HEAD\n",
        "[all\ndtparam=spi=on\n",
        "[gpio4=1]\ndtparam=i2c_arm=off,i2c_arm_baudrate=1\nenable_uart=0\n",
        b"dtparam=audio=on\n\xff\xfe\n".decode("latin-1"),
    ],
)
def test_a_file_that_is_not_understood_is_left_and_said(
    text: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    started: list[tuple[str, ...]],
    capsys: pytest.CaptureFixture[str],
) -> None:
    root = pi(tmp_path / "root", "pi4")
    use(root, monkeypatch)
    path = root / "boot/firmware/config.txt"
    path.write_bytes(text.encode("latin-1"))
    cmdline = root / "boot/firmware/cmdline.txt"
    cmdline.write_text("console=serial0,115200 root=/dev/x\nconsole=tty1\n")
    assert cli.main(["setup", "--yes"]) == 69
    assert path.read_bytes() == text.encode("latin-1")
    assert cmdline.read_text() == "console=serial0,115200 root=/dev/x\nconsole=tty1\n"
    out = capsys.readouterr().out
    assert out.count("left as it is") == 4
    assert "add dtparam=i2c_arm=on yourself" in out
    assert "2 lines where there should be one" in out


def test_other_computers_and_other_sensors_are_left_alone(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    started: list[tuple[str, ...]],
    capsys: pytest.CaptureFixture[str],
) -> None:
    root = pi(tmp_path / "root", "pi4")
    use(root, monkeypatch)
    simulated = ["setup", "--yes", "--set", "source.kind=simulation"]
    assert cli.main(simulated) == 0
    usb = ["setup", "--dry-run", "--set", "gps.port=/dev/ttyACM0"]
    assert cli.main(usb) == 0
    out = capsys.readouterr().out
    assert "nothing to switch on" in out
    assert "enable_uart" not in out
    assert "console" not in out
    (root / "proc/device-tree/model").unlink()
    assert cli.main(["setup", "--yes"]) == 69
    assert "no Raspberry Pi" in capsys.readouterr().out
    assert boot(root, "config.txt") == (BOOT_FILES / "pi4/config.txt").read_bytes()


@pytest.mark.parametrize(
    ("text", "model", "value"),
    [
        ("dtparam=i2c_arm=off\ndtparam=i2c=on\n", "Raspberry Pi 4 Model B", "on"),
        ("[pi4]\ndtparam=i2c_arm=on\n", "Raspberry Pi 400 Rev 1.0", "on"),
        ("[pi400]\ndtparam=i2c_arm=on\n", "Raspberry Pi 4 Model B", None),
        ("[pi0w]\ndtparam=i2c_arm=on\n", "Raspberry Pi Zero 2 W Rev 1.0", "on"),
        ("[pi4]\n[pi5]\ndtparam=i2c_arm\n", "Raspberry Pi 5 Model B", ""),
        ("[none]\n[all]\ndtparam=i2c_arm=on\n", "Raspberry Pi 3 Model B", "on"),
        ("[EDID=X]\n[pi3]\ndtparam=i2c_arm=on\n", "Raspberry Pi 4 Model B", None),
        ("enable_uart=1\n#dtparam=i2c_arm=on\n", "Raspberry Pi 4 Model B", None),
    ],
)
def test_the_last_line_that_holds_on_this_model_decides(
    text: str, model: str, value: str | None
) -> None:
    assert BootConfig(text, model).value_of(I2C) == value


@pytest.mark.parametrize("text", ["[pi4]\n", "[0x1234]\n", "[board-type=0x11]\n"])
def test_a_filter_that_nobody_can_judge_here_decides_nothing(text: str) -> None:
    boot = BootConfig(f"{text}dtparam=i2c_arm=on\n", "Raspberry Pi 9 Model Z")
    with pytest.raises(NotUnderstoodError, match="line 2: dtparam=i2c_arm=on below"):
        boot.value_of(I2C)
    with pytest.raises(NotUnderstoodError):
        boot.with_setting(I2C)
    # A later line that certainly holds settles it.
    settled = f"{text}enable_uart=0\n[all]\nenable_uart=1\n"
    assert BootConfig(settled, "Raspberry Pi 9 Model Z").value_of(UART) == "1"


def test_an_example_behind_a_filter_is_not_uncommented() -> None:
    boot = BootConfig("[pi5]\n#dtparam=i2c_arm=on\n", "Raspberry Pi 4 Model B")
    assert boot.with_setting(I2C) == (
        "[pi5]\n#dtparam=i2c_arm=on\n[all]\ndtparam=i2c_arm=on\n"
    )
    assert BootConfig("", "Raspberry Pi 4 Model B").with_setting(UART) == (
        "enable_uart=1\n"
    )


@pytest.mark.parametrize(
    ("text", "kept"),
    [
        ("console=serial0,115200 root=x\n", "root=x\n"),
        ("root=x\tconsole=ttyS0", "root=x"),
        ("root=x console=ttyAMA10 console=tty1\n", None),
        ("root=x mtdconsole=serial0,9600\n", None),
    ],
)
def test_only_a_console_on_the_port_is_taken_out(text: str, kept: str | None) -> None:
    names = {"serial0", "ttyS0"}
    assert bool(consoles_on(text, names)) is (kept is not None)
    assert without_consoles(text, names) == (text if kept is None else kept)


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("", "0 lines"),
        ("root=x\nconsole=tty1\n", "2 lines"),
        ("console=serial0,115200\n", "no root="),
        ('root=x dyndbg="file a +p" console=serial0\n', "quotation"),
    ],
)
def test_a_strange_kernel_command_line_is_refused(text: str, why: str) -> None:
    with pytest.raises(NotUnderstoodError, match=why):
        without_consoles(text, {"serial0"})


def test_an_edit_of_a_file_that_changed_meanwhile_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "config.txt"
    path.write_text("a=1\n")
    edit = Edit(path, "a=1\n", "a=2\n")
    path.write_text("a=3\n")
    with pytest.raises(OutputError, match="somebody else"):
        edit.run()
    assert path.read_text() == "a=3\n"
    assert list(tmp_path.iterdir()) == [path]


def test_a_program_that_fails_or_is_missing_ends_in_one_line() -> None:
    for word in ("false", "no-such-program-anywhere"):
        with pytest.raises(OutputError, match=word):
            Command((word,), ("true",)).run()


def test_who_asks_is_found_through_sudo(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SUDO_USER", "pi")
    assert machines.who_asks() == "pi"
    monkeypatch.setenv("SUDO_USER", "root")
    assert machines.who_asks() == ""
