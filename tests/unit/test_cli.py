"""The command line as a whole: help, usage, endings, and what is said where."""

import logging
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from imu_tracker import __version__, cli
from imu_tracker.config import Config
from imu_tracker.errors import (
    CalibrationError,
    ConfigError,
    DeviceNotFoundError,
    InputMissingError,
    OutputError,
    RecordingError,
    TrackerError,
    UsageError,
)

COMMANDS = ("run", "check", "status", "record", "replay", "simulate", "plot")


def command_that(action: Callable[[], int], monkeypatch: pytest.MonkeyPatch) -> None:
    """Let `imu-tracker check` do something else."""
    monkeypatch.setattr(
        "imu_tracker.commands.check.installed_config_of", lambda args: action()
    )


def raising(error: BaseException) -> Callable[[], int]:
    def action() -> int:
        raise error

    return action


@pytest.mark.parametrize("command", [*COMMANDS, "selftest"])
def test_every_command_has_help_with_examples(
    command: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.main([command, "--help"]) == 0
    out = capsys.readouterr().out
    assert "examples:\n" in out
    assert f"  imu-tracker {command} " in out
    for option in ("--verbose", "--quiet", "-v", "-q"):
        assert option in out


def test_help_lists_every_command_and_exit_code(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert cli.main(["--help"]) == 0
    out = capsys.readouterr().out
    for word in (*COMMANDS, "65", "66", "69", "70", "73", "78"):
        assert f" {word} " in out


def test_the_version_is_told(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["--version"]) == 0
    assert capsys.readouterr().out == f"imu-tracker {__version__}\n"


@pytest.mark.parametrize(
    ("argv", "problem"),
    [
        ([], "arguments are required: COMMAND"),
        (["fly"], "invalid choice: 'fly'"),
        (["replay"], "arguments are required: REC"),
        (["replay", "a.rec", "--gps-outage", "120"], "'120': must be START:LENGTH"),
        (["replay", "a.rec", "--gps-outage", "1:0"], "'1:0': must be START:LENGTH"),
        (["replay", "a.rec", "--gps-outage", "a:b"], "'a:b': must be START:LENGTH"),
        (["replay", "a.rec", "--gps-outage=-1:5"], "'-1:5': must be START:LENGTH"),
        (["replay", "a.rec", "--gps-every", "0"], "'0': must be a whole number, 1"),
        (["replay", "a.rec", "--gps-every", "1.5"], "'1.5': must be a whole number"),
        (["replay", "a.rec", "--speed", "0"], "'0': must be a number above 0"),
        (["replay", "a.rec", "--speed", "nan"], "'nan': must be a number above 0"),
        (["replay", "a.rec", "--spe", "1"], "unrecognized arguments: --spe"),
        (["simulate", "drive"], "arguments are required: --output"),
        (["simulate", "drive", "--output", "a", "--seed", "-1"], "'-1': must be"),
        (["plot", "a.csv"], "arguments are required: --output"),
        (["check", "-v", "-q"], "not allowed with argument"),
    ],
)
def test_wrong_usage_is_one_line_and_exit_2(
    argv: list[str], problem: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.main(argv) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert problem in captured.err
    assert captured.err.count("\n") == 1
    assert "--help" in captured.err


@pytest.mark.parametrize(
    ("error", "code"),
    [
        (UsageError("a: no"), 2),
        (RecordingError("a:1: no"), 65),
        (CalibrationError("a: no"), 65),
        (InputMissingError("a: no"), 66),
        (DeviceNotFoundError("a: no"), 69),
        (TrackerError("a: no"), 70),
        (OutputError("a: no"), 73),
        (ConfigError("a: no\nb: no"), 78),
    ],
)
def test_an_error_is_told_in_its_own_lines_and_has_its_exit_code(
    error: TrackerError,
    code: int,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    command_that(raising(error), monkeypatch)
    assert cli.main(["check"]) == code
    captured = capsys.readouterr()
    assert (captured.out, captured.err) == ("", f"{error}\n")


def test_a_bug_is_one_line_and_exit_70(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    command_that(raising(ZeroDivisionError("oh")), monkeypatch)
    assert cli.main(["check"]) == 70
    err = capsys.readouterr().err
    assert err == (
        f"a bug of imu-tracker {__version__}: ZeroDivisionError: oh "
        "(add -v for the details)\n"
    )


def test_a_bug_that_says_much_is_one_line_still(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    command_that(raising(ZeroDivisionError("oh\n    no\n")), monkeypatch)
    assert cli.main(["check"]) == 70
    err = capsys.readouterr().err
    assert "ZeroDivisionError: oh no (add -v" in err
    assert err.count("\n") == 1


def test_the_details_of_a_bug_come_with_verbose(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    command_that(raising(ZeroDivisionError("oh")), monkeypatch)
    assert cli.main(["check", "-v"]) == 70
    assert "Traceback (most recent call last)" in capsys.readouterr().err


def test_an_interrupt_is_silent(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    command_that(raising(KeyboardInterrupt()), monkeypatch)
    assert cli.main(["check"]) == 130
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize(
    ("options", "heard"),
    [
        ([], ["hello", "warning: careful"]),
        (["-q"], ["warning: careful"]),
        (["-v"], ["detail", "hello", "warning: careful"]),
    ],
)
def test_talk_goes_to_stderr_as_much_of_it_as_wanted(
    options: list[str],
    heard: list[str],
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    def talk() -> int:
        log = logging.getLogger("imu_tracker.somewhere")
        log.debug("detail")
        log.info("hello")
        log.warning("careful")
        raise KeyboardInterrupt

    command_that(talk, monkeypatch)
    cli.main(["check", *options])
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.splitlines() == heard


def test_the_daemon_gets_the_configuration_and_decides_the_ending(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    seen: list[Config] = []

    def run(config: Config) -> int:
        seen.append(config)
        return 3

    monkeypatch.setattr("imu_tracker.daemon.run.run", run)
    assert cli.main(["run", "--set", "imu.bus=7"]) == 3
    assert seen[0].imu.bus == 7


def in_a_process(*argv: str, **options: object) -> "subprocess.CompletedProcess[str]":
    return subprocess.run(  # type: ignore[call-overload, no-any-return]
        [sys.executable, *argv],
        **{"capture_output": True, "text": True, "check": False, "timeout": 60}
        | options,
    )


def test_the_module_is_the_program() -> None:
    done = in_a_process("-m", "imu_tracker", "--version")
    assert (done.returncode, done.stdout) == (0, f"imu-tracker {__version__}\n")


def test_help_imports_nothing_heavy() -> None:
    done = in_a_process(
        "-c",
        "import sys; from imu_tracker.cli import main; main(['run', '--help']);"
        "print(sorted({m.partition('.')[0] for m in sys.modules}), file=sys.stderr)",
    )
    heavy = {"numpy", "scipy", "matplotlib", "pydantic", "filterpy", "serial", "smbus2"}
    imported = {name.strip("' ") for name in done.stderr.strip("[]\n").split(",")}
    assert "imu_tracker" in imported
    assert not imported & {*heavy, "pynmea2", "tqdm", "tomllib"}


def test_under_systemd_lines_carry_their_priority(tmp_path: Path) -> None:
    with (tmp_path / "journal").open("w+") as journal:
        stat = os.fstat(journal.fileno())
        in_a_process(
            "-m",
            "imu_tracker",
            "replay",
            "none.rec",
            capture_output=False,
            stderr=journal,
            env={**os.environ, "JOURNAL_STREAM": f"{stat.st_dev}:{stat.st_ino}"},
        )
        journal.seek(0)
        assert journal.read() == "<3>none.rec: No such file or directory\n"


def test_a_reader_that_has_seen_enough_is_no_error(recording: Path) -> None:
    command = f"{sys.executable} -m imu_tracker replay -q {recording}"
    done = subprocess.run(
        ["bash", "-c", f"set -o pipefail; {command} | head -n 1"],
        capture_output=True,
        text=True,
        check=False,
        timeout=60,
    )
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.startswith("time_utc,lat_deg,lon_deg")


@pytest.mark.parametrize("closed", [">&-", "2>&-", ">&- 2>&-"])
def test_closed_outputs_do_no_harm(recording: Path, closed: str) -> None:
    log = recording.with_name("closed.csv")
    command = f"{sys.executable} -m imu_tracker replay {recording}"
    for arguments in (command, f"{command} --output {log}"):
        assert subprocess.run(["sh", "-c", f"{arguments} {closed}"]).returncode == 0
    assert log.read_text().startswith("time_utc,lat_deg,lon_deg,alt_m")


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full")
def test_a_full_disk_behind_stdout_is_an_error_of_the_output(recording: Path) -> None:
    with Path("/dev/full").open("w") as full:
        done = in_a_process(
            "-m",
            "imu_tracker",
            "replay",
            "-q",
            str(recording),
            capture_output=False,
            stdout=full,
            stderr=subprocess.PIPE,
        )
    assert done.returncode == 73
    assert done.stderr == "stdout: No space left on device\n"


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("cli") / "still.rec"
    assert cli.main(["simulate", "still", "-q", "--output", str(path)]) == 0
    return path
