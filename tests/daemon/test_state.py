"""What the daemon learns outlasts it, and never ends it."""

import logging
from pathlib import Path

import pytest

from imu_tracker.config import load_config
from imu_tracker.daemon.run import run
from support.fake_clock import FakeClock


def play(directory: Path, *overrides: str) -> None:
    """Run the daemon over half a minute of a simulated drive."""
    config = load_config(
        None,
        [
            *("source.kind=simulation", "source.duration_s=30", "log.min_free_mb=0"),
            *("filter.estimator=error-state", "filter.profile=vehicle"),
            f"log.path={directory / 'log.csv'}",
            f"status.path={directory / 'status.json'}",
            *overrides,
        ],
    )
    (directory / "log.csv").unlink(missing_ok=True)
    assert run(config, clock=FakeClock(), notify=lambda _: None) == 0


def test_the_next_start_begins_with_what_was_learnt(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.INFO)
    state = tmp_path / "lib" / "state.json"
    play(tmp_path, f"state.path={state}")
    assert "nothing was learnt yet" in caplog.text
    assert state.exists()
    play(tmp_path, f"state.path={state}")
    assert "begins with what was learnt 2026-11-22 12:00" in caplog.text
    assert "began with what the last run learnt" in caplog.text


def test_a_damaged_state_is_told_and_replaced(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    state = tmp_path / "state.json"
    state.write_text('{"version": NaN')
    play(tmp_path, f"state.path={state}")
    assert "not a state of imu-tracker" in caplog.text
    assert state.read_text().startswith('{\n "format": "imu-tracker state"')


def test_a_state_that_cannot_be_kept_ends_nothing(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    (tmp_path / "file").write_text("")
    play(tmp_path, f"state.path={tmp_path / 'file' / 'state.json'}")
    assert "what was learnt is not kept" in caplog.text


def test_a_simulation_keeps_no_state_unless_it_is_named() -> None:
    simulated = load_config(None, ["source.kind=simulation"])
    assert simulated.state_path is None
    assert load_config(None, []).state_path == Path("/var/lib/imu-tracker/state.json")
    assert load_config(None, ["state.path="]).state_path is None
