"""What the daemon does to the computer that it runs on: as little as it can."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from imu_tracker.config import load_config
from imu_tracker.daemon.run import run
from imu_tracker.daemon.supervision import Signals
from support.fake_clock import FakeClock

_WATCHED = """
import json, os, sys

FOUND = ("socket.", "subprocess.", "os.system", "os.exec", "os.posix", "os.fork",
         "pickle.", "ctypes.dlopen")
PATHS = ("os.mkdir", "os.remove", "os.rename", "os.chmod", "os.symlink")
events = []

def watch(event, given):
    if event == "open":
        path, _, flags = given
        is_written = (flags or 0) & (os.O_WRONLY | os.O_RDWR | os.O_CREAT)
        if is_written and not isinstance(path, int):
            events.append([event, os.fsdecode(path)])
    elif event in PATHS:
        paths = [str(part) for part in given if not isinstance(part, int)]
        events.append([event, *paths])
    elif event.startswith(FOUND):
        events.append([event, repr(given)])

sys.addaudithook(watch)
from imu_tracker.cli import main
code = main(["run", "--config", sys.argv[1]])
print(json.dumps([code, events]))
"""
"""Runs the daemon, and tells what Python's audit events say that it did."""


def settings(folder: Path) -> dict[str, str]:
    """A simulated half minute, with every file that the daemon can write."""
    return {
        "source.kind": "simulation",
        "source.duration_s": "30",
        "source.speed": "1000",
        "filter.estimator": "error-state",
        "log.path": str(folder / "log/imu-tracker/latlong.csv"),
        "log.min_free_mb": "0",
        "log.max_mb": "0.01",
        "log.rate_hz": "10",
        "log.sync_s": "30",
        "record.path": str(folder / "log/imu-tracker/raw.rec.gz"),
        "status.path": str(folder / "run/imu-tracker/status.json"),
        "status.prometheus": str(folder / "run/imu-tracker/imu-tracker.prom"),
        "state.path": str(folder / "lib/imu-tracker/state.json"),
    }


def test_files_are_for_the_group_and_nobody_else_whatever_the_umask(
    tmp_path: Path,
) -> None:
    config = load_config(None, [f"{k}={v}" for k, v in settings(tmp_path).items()])
    before = os.umask(0)
    try:
        run(config, clock=FakeClock(), signals=Signals())
    finally:
        os.umask(before)
    found = {path: path.stat().st_mode & 0o7777 for path in tmp_path.rglob("*")}
    files = {path.name: mode for path, mode in found.items() if path.is_file()}
    assert {"latlong.csv", ".latlong.csv.lock", "raw.rec.gz", "state.json"} <= set(
        files
    )
    assert any(name.startswith("latlong-2") for name in files)
    assert set(files.values()) == {0o640}
    assert {mode for path, mode in found.items() if path.is_dir()} == {0o750}


@pytest.mark.parametrize("path", ["status.json", "imu-tracker.prom"])
def test_the_status_is_for_the_group_and_nobody_else(path: str, tmp_path: Path) -> None:
    from imu_tracker.storage.status_file import StatusFile

    before = os.umask(0)
    try:
        StatusFile(tmp_path / "run" / path).write({})
    finally:
        os.umask(before)
    assert (tmp_path / "run" / path).stat().st_mode & 0o777 == 0o640
    assert (tmp_path / "run").stat().st_mode & 0o777 == 0o750


def test_the_daemon_opens_no_socket_starts_no_program_and_writes_only_its_files(
    tmp_path: Path,
) -> None:
    config = tmp_path / "config.toml"
    tables: dict[str, list[str]] = {}
    for name, value in settings(tmp_path).items():
        table, _, key = name.partition(".")
        bare = value if value.replace(".", "").isdigit() else json.dumps(value)
        tables.setdefault(table, []).append(f"{key} = {bare}")
    config.write_text(
        "\n".join(f"[{table}]\n" + "\n".join(keys) for table, keys in tables.items())
    )
    done = subprocess.run(
        [sys.executable, "-c", _WATCHED, str(config)],
        capture_output=True,
        text=True,
        check=True,
        cwd=tmp_path,
        env={"PATH": os.environ["PATH"], "PYTHONDONTWRITEBYTECODE": "1"},
    )
    code, events = json.loads(done.stdout.splitlines()[-1])
    assert code == 0, done.stderr
    own = tuple(str(tmp_path / room) for room in ("log", "run", "lib"))
    written = [event for event in events if event[0] == "open"]
    assert len(written) > 5
    for event, *paths in events:
        if event == "open" or event.startswith("os."):
            assert all(path.startswith(own) for path in paths), (event, paths)
        else:
            assert event == "ctypes.dlopen", (event, paths)
