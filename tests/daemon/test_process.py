"""`imu-tracker run` as a process of its own: signals, exit codes, systemd's socket."""

import json
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from imu_tracker.recording.files import RecordingWriter
from imu_tracker.simulation import simulate
from imu_tracker.storage.latlong import HEADER, read_log

START_S = 30.0  # importing scipy on a busy machine
END_S = 2.0  # what the contract allows after SIGTERM


class Daemon:
    """A process that runs, and its files."""

    def __init__(self, directory: Path) -> None:
        self.log = directory / "latlong.csv"
        self.status = directory / "status.json"

    def command(self, *overrides: str) -> list[str]:
        own = (
            f"log.path={self.log}",
            f"status.path={self.status}",
            "state.path=",
            "log.min_free_mb=0",
        )
        sets = (f"--set={override}" for override in (*own, *overrides))
        return [sys.executable, "-m", "imu_tracker", "run", *sets]

    @contextmanager
    def running(self, *overrides: str) -> Iterator["subprocess.Popen[str]"]:
        with subprocess.Popen(
            self.command(*overrides), stderr=subprocess.PIPE, text=True
        ) as process:
            try:
                yield process
            finally:
                process.kill()

    def fails(self, *overrides: str) -> tuple[int, list[str]]:
        """Return the exit code and the lines of a daemon that cannot start."""
        done = subprocess.run(
            self.command(*overrides),
            capture_output=True,
            text=True,
            timeout=START_S,
            check=False,
        )
        assert done.stdout == ""
        return done.returncode, done.stderr.splitlines()

    def rows(self) -> int:
        return self.log.read_text().count("\n") - 1 if self.log.exists() else 0


def wait_for(condition: Callable[[], bool]) -> None:
    end_s = time.monotonic() + START_S
    while not condition():
        assert time.monotonic() < end_s
        time.sleep(0.01)


@pytest.fixture
def daemon(tmp_path: Path) -> Daemon:
    return Daemon(tmp_path)


@pytest.fixture
def walk(tmp_path: Path) -> Path:
    """A recording of ten minutes."""
    path = tmp_path / "walk.rec.gz"
    simulated = simulate("walk-square", duration_s=600)
    with RecordingWriter(path) as writer:
        writer.write_header(simulated.header)
        for frame in simulated.frames:
            writer.write(frame)
    return path


SIMULATED = ("source.kind=simulation", "source.speed=20")


def end(process: "subprocess.Popen[str]", number: int = signal.SIGTERM) -> str:
    """Send a signal; the daemon must end with 0, soon. Return what it said."""
    process.send_signal(number)
    assert process.wait(END_S) == 0
    assert process.stderr is not None
    return process.stderr.read()


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_signal_ends_a_simulation_with_a_whole_file(
    daemon: Daemon, number: int
) -> None:
    with daemon.running(*SIMULATED) as process:
        wait_for(lambda: daemon.rows() > 20)
        assert "ended: told to" in end(process, number)
    assert daemon.log.read_bytes().endswith(b"\n")
    assert len(read_log(daemon.log).utc_s) == daemon.rows() > 20
    assert not daemon.status.exists()


def test_a_signal_ends_a_recording_with_a_whole_file(
    daemon: Daemon, walk: Path
) -> None:
    played = "source.kind=recording", f"source.path={walk}", "source.speed=30"
    with daemon.running(*played) as process:
        wait_for(lambda: daemon.rows() > 20)
        end(process)
    assert len(read_log(daemon.log).utc_s) == daemon.rows() > 20


def test_a_signal_ends_a_daemon_without_any_sensor(daemon: Daemon) -> None:
    # 192.0.2.1 is a host that nobody has: connecting to it takes its time.
    missing = "imu.bus=255", "gps.port=socket://192.0.2.1:10110"
    with daemon.running(*missing) as process:
        wait_for(daemon.status.exists)
        status = json.loads(daemon.status.read_text())
        assert status["state"] in ("starting", "waiting for the first fix")
        said = end(process)
    assert "warning: imu lost: /dev/i2c-255" in said
    assert daemon.log.read_text() == f"{HEADER}\n"


@pytest.mark.parametrize("after_s", [0.1, 0.3, 0.6])
def test_a_signal_during_the_start_leaves_no_mess(
    daemon: Daemon, after_s: float
) -> None:
    with daemon.running(*SIMULATED) as process:
        with pytest.raises(subprocess.TimeoutExpired):
            process.wait(after_s)
        process.terminate()
        _, said = process.communicate(timeout=START_S)
    assert process.returncode in (0, -signal.SIGTERM)  # the latter before our time
    assert "Traceback" not in said
    assert "bug" not in said


def test_a_second_daemon_on_the_same_log_is_refused(daemon: Daemon) -> None:
    with daemon.running(*SIMULATED) as process:
        wait_for(daemon.log.exists)
        code, (line,) = daemon.fails(*SIMULATED)
        assert code == 73
        assert f"{daemon.log}: another process is writing it" in line
        assert process.poll() is None


def test_a_wrong_configuration_is_told_line_by_line(daemon: Daemon) -> None:
    code, lines = daemon.fails("imu.rate_hz=5000", "filter.profle=vehicle")
    assert code == 78
    assert len(lines) == 2
    assert not daemon.log.exists()


def test_a_recording_that_is_missing_is_a_wrong_configuration(daemon: Daemon) -> None:
    code, lines = daemon.fails("source.kind=recording", "source.path=/none.rec")
    assert code == 78
    assert lines[-1].startswith("source.path: /none.rec")


def test_a_log_that_cannot_be_opened_ends_it_at_the_start(
    daemon: Daemon, tmp_path: Path
) -> None:
    (tmp_path / "file").touch()
    daemon.log = tmp_path / "file" / "latlong.csv"
    code, (line,) = daemon.fails(*SIMULATED)
    assert code == 73
    assert str(daemon.log) in line


def test_sighup_opens_a_log_that_was_moved_away_anew(daemon: Daemon) -> None:
    moved = daemon.log.with_name("moved.csv")
    with daemon.running(*SIMULATED) as process:
        wait_for(lambda: daemon.rows() > 20)
        daemon.log.rename(moved)
        process.send_signal(signal.SIGHUP)
        wait_for(lambda: daemon.rows() > 20)
        end(process)
    first, second = read_log(moved).utc_s, read_log(daemon.log).utc_s
    assert second[0] == first[-1] + 0.25


def test_systemd_hears_of_it(
    daemon: Daemon, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    address = tmp_path / "notify"
    monkeypatch.setenv("NOTIFY_SOCKET", str(address))
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as systemd:
        systemd.bind(os.fspath(address))
        systemd.settimeout(START_S)

        def hear() -> str:
            return systemd.recv(4096).decode()

        with daemon.running(*SIMULATED) as process:
            assert [hear(), hear()] == ["READY=1", "WATCHDOG=1"]
            assert hear().startswith("STATUS=")
            end(process)
        heard = ""
        while heard != "STOPPING=1":
            heard = hear()
