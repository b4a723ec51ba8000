"""Killed at random instants, on a disk that loses what was not synced."""

import json
import os
import subprocess
import sys
from typing import Any

import pytest

from support.paths import TESTS


def killed(kills: int) -> dict[str, Any]:
    """Do it in a process of its own: one that forks must have a single thread."""
    path = os.pathsep.join([str(TESTS), os.environ.get("PYTHONPATH", "")])
    environment = {**os.environ, "PYTHONPATH": path, "OPENBLAS_NUM_THREADS": "1"}
    done = subprocess.run(
        [sys.executable, "-m", "faults.kills", "--kills", str(kills)],
        capture_output=True,
        text=True,
        env=environment,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    found: dict[str, Any] = json.loads(done.stdout)
    return found


def assert_nothing_is_broken(found: dict[str, Any], kills: int) -> None:
    assert found["complaints"] == []
    assert found["killed"] == kills
    assert found["rows_written"] > 30 * kills
    # The disk does lose something, and never more than `log.sync_s`.
    assert 0 < found["longest_lost_s"] <= 5.0
    assert found["states_whole"] > kills / 2
    assert found["files_replaced"].keys() == {"new", "old"}


def test_twenty_power_cuts_leave_whole_files_and_cost_seconds_at_most() -> None:
    assert_nothing_is_broken(killed(20), 20)


@pytest.mark.acceptance
def test_two_hundred_power_cuts_do_neither() -> None:
    assert_nothing_is_broken(killed(200), 200)
