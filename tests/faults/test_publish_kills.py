"""`publish` killed at random instants, on a disk that loses what was not synced."""

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
    done = subprocess.run(
        [sys.executable, "-m", "faults.publish_kills", f"--kills={kills}"],
        capture_output=True,
        text=True,
        check=False,
        env={**os.environ, "PYTHONPATH": path},
    )
    assert done.returncode == 0, done.stderr
    found: dict[str, Any] = json.loads(done.stdout)
    return found


@pytest.mark.parametrize("kills", [25, pytest.param(500, marks=pytest.mark.acceptance)])
def test_nothing_is_lost_and_five_seconds_at_most_are_sent_again(kills: int) -> None:
    found = killed(kills)
    assert found["killed"] == kills
    assert found["bad_ends"] == 0
    assert found["lost"] == 0
    assert found["never_in_the_log"] == 0
    assert found["in_order"]
    assert found["rows"] > 30 * kills
    assert found["files_deleted"] > 0
    # Something was sent again, or the kills came at no bad moment.
    assert found["sent"] > found["rows"]
    assert 0 < found["longest_repeated_s"] <= 5.0
