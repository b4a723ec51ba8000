"""What holds for every test: nothing left open, nothing random, nothing endless."""

import gc
import logging
import threading
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import hypothesis
import pytest

hypothesis.settings.register_profile(
    "repeatable",
    deadline=None,
    derandomize=True,
    # Of a machine that is busy, not of a test.
    suppress_health_check=[hypothesis.HealthCheck.too_slow],
)
hypothesis.settings.load_profile("repeatable")


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption(
        "--regen",
        action="store_true",
        help="write the golden outputs of tests/replay anew instead of comparing",
    )


def pytest_configure(config: pytest.Config) -> None:
    if not config.option.markexpr:
        config.option.markexpr = "not acceptance and not system"


@pytest.fixture
def is_regen(request: pytest.FixtureRequest) -> bool:
    return bool(request.config.getoption("--regen"))


def _open_files() -> dict[str, Path]:
    """Descriptors of this process and what they are open on."""
    found = {}
    for fd in Path("/proc/self/fd").iterdir():
        with suppress(FileNotFoundError):  # the one that lists
            found[fd.name] = fd.readlink()
    return found


@pytest.fixture(autouse=True)
def _nothing_is_left_open() -> Iterator[None]:
    """Fail any test that leaves a thread or a file descriptor behind."""
    threads, files = set(threading.enumerate()), _open_files()
    yield
    left = [thread.name for thread in threading.enumerate() if thread not in threads]
    assert not left, f"threads left running: {left}"
    if _open_files().keys() - files.keys():
        gc.collect()  # what nobody holds any more is closed, not left open
    opened = {fd: to for fd, to in _open_files().items() if fd not in files}
    assert not opened, f"file descriptors left open: {opened}"


@pytest.fixture(autouse=True)
def _logging_is_as_at_the_start() -> None:
    """Undo what commands set up before: tests of messages run in any order."""
    package = logging.getLogger("imu_tracker")
    package.handlers, package.propagate = [], True
    package.setLevel(logging.NOTSET)
