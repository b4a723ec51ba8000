"""The daemon on recordings and simulations, on a clock that costs no time."""

import itertools
import logging
from collections.abc import Iterator
from pathlib import Path

import pytest

from imu_tracker.cli import main
from imu_tracker.config import Config, load_config
from imu_tracker.daemon.run import run
from imu_tracker.daemon.supervision import Signals
from imu_tracker.errors import ConfigError
from imu_tracker.recording.files import RecordingWriter
from imu_tracker.samples import Frame, SessionHeader, Source
from imu_tracker.simulation import simulate
from imu_tracker.sources.feed import BATCH
from imu_tracker.sources.played import PlayedFeed
from imu_tracker.storage.latlong import read_log
from support.fake_clock import FakeClock

S = 1_000_000_000
HEADER = SessionHeader(4, 500, 100)


@pytest.fixture
def log(tmp_path: Path) -> Path:
    return tmp_path / "latlong.csv"


def configured(log: Path, kind: str, *overrides: str) -> Config:
    own = (
        f"source.kind={kind}",
        f"log.path={log}",
        "log.min_free_mb=0",
        f"status.path={log.with_name('status.json')}",
    )
    return load_config(None, [*own, *overrides])


def play(config: Config, clock: FakeClock | None = None) -> float:
    """Run the daemon to its end; return how many seconds that took."""
    clock = clock or FakeClock()
    start_ns = clock.now_ns()
    assert run(config, clock=clock, signals=Signals()) == 0
    return (clock.now_ns() - start_ns) / S


def recorded(path: Path, **sessions: float) -> Path:
    """Write walks of so many seconds, each on a clock that began anew."""
    with RecordingWriter(path) as writer:
        for seed, seconds in enumerate(sessions.values()):
            simulated = simulate("walk-line", duration_s=seconds, seed=seed)
            writer.write_header(simulated.header)
            for frame in simulated.frames:
                writer.write(frame)
    return path


# ---------------------------------------------------------------------- whole programs


def test_a_simulated_drive_is_tracked_to_its_end(
    log: Path, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.INFO)
    config = configured(
        log, "simulation", "source.duration_s=120", "source.speed=20", "source.seed=3"
    )
    assert play(config) == pytest.approx(120 / 20, abs=0.1)
    track = read_log(log)
    assert track.utc_s[-1] - track.utc_s[0] > 105
    assert "ended: simulation is over" in caplog.messages[-1]


def test_the_daemon_writes_what_replay_writes(tmp_path: Path, log: Path) -> None:
    recording = recorded(tmp_path / "two.rec", first=40, second=80)
    play(configured(log, "recording", f"source.path={recording}", "source.speed=7"))
    replayed = tmp_path / "replayed.csv"
    assert main(["replay", str(recording), "--output", str(replayed)]) == 0
    assert log.read_bytes() == replayed.read_bytes()
    assert len(read_log(log).utc_s) > 200


def test_silences_of_a_recording_pass_at_its_pace(tmp_path: Path, log: Path) -> None:
    simulated = simulate("still", duration_s=60)
    with RecordingWriter(tmp_path / "gap.rec") as writer:
        writer.write_header(simulated.header)
        for frame in simulated.frames:
            if not 21 * S < frame.t_ns < 51 * S:
                writer.write(frame)
    config = configured(log, "recording", f"source.path={tmp_path / 'gap.rec'}")
    clock = FakeClock()
    rows: list[int] = []
    for seconds in (30, 40):
        clock.at(S + seconds * S, lambda: rows.append(len(read_log(log).utc_s)))
    play(config, clock)
    assert rows[1] - rows[0] == 40


def test_the_raw_capture_of_a_simulation_is_the_simulation(
    tmp_path: Path, log: Path
) -> None:
    capture = tmp_path / "raw.rec"
    recording = recorded(tmp_path / "walk.rec", only=40)
    play(
        configured(
            log,
            "simulation",
            "source.scenario=walk-line",
            "source.duration_s=40",
            f"record.path={capture}",
        )
    )
    assert capture.read_bytes() == recording.read_bytes()


def test_a_recording_that_is_missing_is_a_wrong_configuration(
    tmp_path: Path, log: Path
) -> None:
    config = configured(log, "recording", f"source.path={tmp_path / 'none.rec'}")
    with pytest.raises(ConfigError, match=r"source\.path: .*none\.rec"):
        run(config, clock=FakeClock(), signals=Signals())


def test_a_recording_that_turns_bad_loses_nothing_that_was_logged(
    tmp_path: Path, log: Path
) -> None:
    recording = recorded(tmp_path / "walk.rec", only=40)
    with recording.open("ab") as file:
        file.write(b"I am not a frame\nG 41000000000 $GP\n")
    with pytest.raises(ConfigError, match=r"source\.path: .*walk\.rec:\d+: expected"):
        play(configured(log, "recording", f"source.path={recording}"))
    assert len(read_log(log).utc_s) > 100


# ----------------------------------------------------------------------------- the feed


def frames(count: int, every_ns: int) -> Iterator[SessionHeader | Frame]:
    yield HEADER
    for n in range(count):
        yield Frame(5 * S + n * every_ns, Source.IMU, bytes(14))


def test_frames_are_delivered_when_they_are_due() -> None:
    clock = FakeClock()
    feed = PlayedFeed(frames(100, S), 20.0, clock)
    assert feed.read() == ([HEADER, Frame(5 * S, Source.IMU, bytes(14))], 5 * S)
    clock.advance(ms=125)
    items, complete_ns = feed.read()
    assert [item.t_ns / S for item in items if isinstance(item, Frame)] == [6, 7]
    assert complete_ns == 7.5 * S
    assert not feed.is_over


def test_the_last_frame_ends_it() -> None:
    clock = FakeClock()
    feed = PlayedFeed(frames(10, S), 1.0, clock)
    clock.advance(s=9)
    assert len(feed.read().items) == 11
    assert feed.is_over


def test_an_empty_stream_is_over_at_once() -> None:
    assert PlayedFeed([], 1.0, FakeClock()).is_over


def test_a_computer_that_is_too_slow_gets_all_frames_later() -> None:
    # In parts, so that signals get their turn; and time does not run ahead of them.
    clock = FakeClock()
    feed = PlayedFeed(frames(2500, 1000), 1.0, clock)
    clock.advance(s=60)
    parts = list(itertools.takewhile(lambda part: part.items, iter(feed.read, None)))
    assert [len(part.items) for part in parts] == [BATCH, BATCH, 501]
    assert {part.complete_ns for part in parts} == {None}


def test_a_closed_feed_delivers_nothing_more() -> None:
    feed = PlayedFeed(frames(10, S), 1.0, FakeClock())
    feed.close()
    assert feed.read().items == []
    assert feed.is_over
