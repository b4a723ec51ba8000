"""The daemon on sensors that follow a script, and on a clock that costs no time."""

import json
import logging
from collections.abc import Callable
from math import hypot, inf
from pathlib import Path
from typing import Any

import pytest

from imu_tracker.config import Config, load_config
from imu_tracker.daemon.run import run
from imu_tracker.daemon.supervision import Signals
from imu_tracker.recording.files import read_recording
from imu_tracker.samples import Frame, NavState, SessionHeader, Source
from imu_tracker.sources.live import HANGS_NS, MAX_WAITING
from imu_tracker.storage.latlong import HEADER, LatLongLog, read_log
from support.fake_clock import FakeClock
from support.scripted_sensors import S, ScriptedSensors
from support.small_disk import SmallDisk

FIRST_FIX_S = 8  # the simulated receiver looks for satellites


class Bench:
    """The daemon, its sensors, its files, and what it told systemd."""

    def __init__(self, directory: Path) -> None:
        self.clock = FakeClock()
        self.signals = Signals()
        self.told: list[str] = []
        self.log = directory / "latlong.csv"
        self.record = directory / "raw.rec"
        self.status = directory / "run" / "status.json"
        self.state = directory / "lib" / "state.json"
        self.sensors: ScriptedSensors

    def config(self, *overrides: str) -> Config:
        own = (
            f"log.path={self.log}",
            f"status.path={self.status}",
            f"state.path={self.state}",
            "log.min_free_mb=0",
        )
        return load_config(None, [*own, *overrides])

    def script(self, seconds: float, **hidden: Any) -> None:
        """Let the sensors deliver so long; the daemon is stopped at that time."""
        self.sensors = ScriptedSensors(self.clock, seconds, **hidden)
        self.at(seconds, self.signals.stop)

    def at(self, seconds: float, action: Callable[[], object]) -> None:
        self.clock.at(S + round(seconds * S), action)

    def look(self, seconds: float) -> dict[str, Any]:
        """Return what will stand in the status file then."""
        seen: dict[str, Any] = {}
        self.at(seconds, lambda: seen.update(json.loads(self.status.read_text())))
        return seen

    def run(self, *overrides: str) -> int:
        return run(
            self.config(*overrides),
            clock=self.clock,
            signals=self.signals,
            notify=self.told.append,
            **self.sensors.readers,
        )

    def fed(self) -> int:
        return self.told.count("WATCHDOG=1")


@pytest.fixture
def bench(tmp_path: Path) -> Bench:
    return Bench(tmp_path)


@pytest.fixture
def said(caplog: pytest.LogCaptureFixture) -> Callable[[int], list[str]]:
    """What was logged from a level on."""
    caplog.set_level(logging.INFO)
    return lambda level: [r.getMessage() for r in caplog.records if r.levelno >= level]


Said = Callable[[int], list[str]]


# ------------------------------------------------------------------------- the rows


@pytest.fixture
def lateness_s(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """How old each row was when it was written."""
    ages: list[float] = []
    write = LatLongLog.write

    def measured(log: LatLongLog, state: NavState) -> None:
        ages.append((bench.clock.now_ns() - state.t_ns) / S)
        write(log, state)

    monkeypatch.setattr(LatLongLog, "write", measured)
    return ages


SILENCES: dict[str, dict[str, list[tuple[float, float]]]] = {
    "nobody": {},
    "the IMU": {"imu_hidden": [(12.0, 20.0)]},
    "the receiver": {"gps_hidden": [(12.0, 20.0)]},
    "both": {"imu_hidden": [(12.0, 20.0)], "gps_hidden": [(12.0, 20.0)]},
    "the IMU, always": {"imu_hidden": [(0.0, inf)]},
}


@pytest.mark.parametrize("silence", SILENCES.values(), ids=SILENCES)
def test_a_row_is_written_within_half_a_second_whoever_is_silent(
    bench: Bench, lateness_s: list[float], silence: dict[str, Any]
) -> None:
    bench.script(28, **silence)
    status = bench.look(27)
    assert bench.run() == 0
    utc_s = read_log(bench.log).utc_s
    assert len(utc_s) == pytest.approx(4 * (28 - FIRST_FIX_S), abs=4)
    assert (utc_s[1:] - utc_s[:-1] == 0.25).all()
    assert max(lateness_s) <= 0.5
    assert status["counters"]["late_rows"] == 0


def test_the_modes_tell_which_sensor_is_missing(bench: Bench) -> None:
    bench.script(40, imu_hidden=[(15, 22)], gps_hidden=[(28, 36)])
    assert bench.run() == 0
    track = read_log(bench.log)
    seconds = track.utc_s - track.utc_s[0] + FIRST_FIX_S
    assert set(track.mode[(seconds > 17) & (seconds < 21)]) == {"gpsonly"}
    assert set(track.mode[(seconds > 32) & (seconds < 35)]) <= {"dr", "still"}


def test_rows_that_come_late_are_counted(bench: Bench) -> None:
    # The clock jumps inside of a turn: a host that stood still.
    bench.script(20)
    bench.at(15, lambda: bench.clock.advance(s=2))
    status = bench.look(19)
    assert bench.run() == 0
    assert status["counters"]["late_rows"] >= 4


def test_a_raw_capture_replays_to_the_log_that_was_written_live(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    # Live, a date of before the release would be taken for a rolled-over one.
    monkeypatch.setattr("imu_tracker.pipeline.RELEASE_DATE", "2026-11-01")
    bench.script(60, gps_hidden=[(30, 45)])
    assert bench.run(f"record.path={bench.record}") == 0
    header, *frames = read_recording(bench.record)
    assert isinstance(header, SessionHeader)
    assert header.chip == "MPU-6050"
    assert isinstance(frames[0], Frame)
    assert frames[0].data.startswith(b"imu_ready")
    live = bench.log.read_text().splitlines()

    again = bench.log.with_name("again.csv")
    played = (
        "source.kind=recording",
        f"source.path={bench.record}",
        "source.speed=1000",
        "state.path=",  # as cold as the first run
        f"log.path={again}",
    )
    assert run(bench.config(*played), clock=FakeClock(), signals=Signals()) == 0
    replayed = again.read_text().splitlines()
    # What arrived after the last turn is on neither side.
    assert replayed[: len(live)] == live
    assert len(live) > 200


# ----------------------------------------------------------------------- the journal


def test_the_journal_has_one_line_for_each_transition(bench: Bench, said: Said) -> None:
    bench.script(30, imu_hidden=[(10, 15)])
    bench.at(20, lambda: bench.sensors.gps.put(event(b"gps_lost unplugged")))
    assert bench.run() == 0
    assert said(logging.WARNING) == [
        "imu lost: I2C read failed",
        "gps lost: unplugged",
    ]
    for line in ("imu ready: MPU-6050 at address 0x68, 100 Hz", "tracking begins"):
        assert line in said(logging.INFO)
    assert len(said(logging.INFO)) < 15


def event(data: bytes) -> Frame:
    return Frame(20 * S, Source.EVENT, data)


def test_once_a_minute_a_line_says_what_was_counted_since(
    bench: Bench, said: Said
) -> None:
    bench.script(125)
    assert bench.run() == 0
    lines = [line for line in said(logging.INFO) if "in the last minute" in line]
    assert len(lines) == 2
    assert lines[1].startswith("tracking: ")
    assert "r95 " in lines[1]
    assert "imu_samples 60" in lines[1]  # 60 s at 100 Hz, by the chip's own clock
    assert "rows 240" in lines[1]


# ------------------------------------------------------------------------- the status


def test_the_status_tells_how_it_goes(bench: Bench) -> None:
    bench.script(40, gps_hidden=[(25, 40)])
    early, late = bench.look(0.5), bench.look(35.5)
    assert bench.run() == 0
    assert early["state"] == "starting"
    assert early["mode"] is early["r95_m"] is early["fix_age_s"] is early["row"] is None

    assert late["version"] == 1
    assert late["state"] == "tracking"
    assert late["source"] == "hardware"
    assert late["t_ns"] == pytest.approx(36 * S, abs=0.6 * S)
    assert late["uptime_s"] == 35
    assert late["fix_age_s"] in (10, 11)
    assert 0 < late["row_age_s"] < 0.5
    assert late["imu_rate_hz"] == 100
    assert late["disk_free_mb"] > 0
    assert late["r95_m"] == late["row"]["r95_m"] > 0
    assert list(late["row"]) == HEADER.split(",")
    assert late["imu"]["chip"] == "MPU-6050"
    assert late["gps"]["state"] == "ok"
    assert late["log"] == {
        "path": str(bench.log),
        "is_failing": False,
        "trouble": None,
    }
    assert late["counters"]["rows"] > 100
    assert late["learnt"]["estimator"] == "error-state"
    assert "counters" not in late["learnt"]


def test_the_status_tells_where_it_will_be(bench: Bench) -> None:
    bench.script(40, gps_hidden=[(25, 40)])
    early, late = bench.look(0.5), bench.look(35.5)
    assert bench.run() == 0
    assert early["prediction"] is None

    ahead, row = late["prediction"], late["row"]
    assert ahead["after_s"] == [1, 5, 10, 30, 60]
    assert ahead["r95_m"] == sorted(set(ahead["r95_m"]))
    assert ahead["r95_m"][0] >= row["r95_m"]
    for after_s, lat_deg, lon_deg in zip(
        ahead["after_s"], ahead["lat_deg"], ahead["lon_deg"], strict=True
    ):
        north_m = (lat_deg - row["lat_deg"]) * 111_000
        east_m = (lon_deg - row["lon_deg"]) * 68_000
        gone_m = row["speed_mps"] * after_s  # it does not turn
        assert hypot(north_m, east_m) == pytest.approx(gone_m, rel=0.1, abs=1.0)


def test_the_status_says_that_it_waits_for_a_fix(bench: Bench) -> None:
    bench.script(5, gps_hidden=[(0, inf)])
    status = bench.look(4.5)
    assert bench.run() == 0
    assert status["state"] == "waiting for the first fix"
    assert bench.told[-2] == "STATUS=waiting for the first fix"


def test_the_status_is_gone_when_the_daemon_is(bench: Bench) -> None:
    bench.script(2)
    bench.look(1.5)
    assert bench.run() == 0
    assert list(bench.status.parent.iterdir()) == []


def test_a_status_that_cannot_be_written_is_told_once(
    bench: Bench, said: Said, tmp_path: Path
) -> None:
    (tmp_path / "run").write_text("a file where a directory should be")
    bench.script(5)
    assert bench.run() == 0
    (line,) = [line for line in said(logging.WARNING) if "status" in line]
    assert "see [status]" in line


# ----------------------------------------------------------------------- the watchdog


def test_systemd_hears_of_the_start_the_turns_and_the_end(bench: Bench) -> None:
    bench.script(10)
    assert bench.run() == 0
    assert bench.told[0] == "READY=1"
    assert bench.told[-1] == "STOPPING=1"
    assert bench.fed() == 10
    assert any(line.startswith("STATUS=tracking: ") for line in bench.told)


@pytest.mark.parametrize("sensor", ["imu", "gps"])
def test_a_sensor_thread_that_hangs_is_not_covered_up(
    bench: Bench, said: Said, sensor: str
) -> None:
    bench.script(60)
    bench.at(5, lambda: getattr(bench.sensors, sensor).hang())
    fed: list[int] = []
    for seconds in (20, 40):
        bench.at(seconds, lambda: fed.append(bench.fed()))
    bench.at(40, lambda: getattr(bench.sensors, sensor).wake())
    assert bench.run() == 0
    assert fed[0] == fed[1] <= 5 + HANGS_NS // S + 1
    assert bench.fed() == pytest.approx(fed[1] + 20, abs=1)
    assert said(logging.ERROR) == [
        f"the thread of the {sensor.upper()} hangs: the watchdog is not fed"
    ]


def test_an_imu_that_is_ready_and_delivers_nothing_is_a_hang(bench: Bench) -> None:
    bench.script(60, imu_hidden=[(5, inf)])
    bench.at(5.5, lambda: setattr(bench.sensors.imu, "is_ready", True))
    assert bench.run() == 0
    assert bench.fed() <= 5 + HANGS_NS // S + 2


def test_an_imu_that_is_being_retried_is_no_hang(bench: Bench) -> None:
    bench.script(60, imu_hidden=[(5, inf)])
    assert bench.run() == 0
    assert bench.fed() == 60


# -------------------------------------------------------------------------- the faults


def test_frames_that_do_not_fit_into_the_queue_are_counted_and_told(
    bench: Bench, said: Said
) -> None:
    bench.script(20)
    burst = Frame(12 * S, Source.GPS, b"flood")

    def flood() -> None:
        for _ in range(MAX_WAITING + 7):
            bench.sensors.gps.put(burst)

    bench.at(11, flood)
    status = bench.look(19)
    assert bench.run() == 0
    lost = status["counters"]["refused_frames"]
    assert 7 <= lost < 30  # what else had waited for the turn
    assert said(logging.WARNING) == [f"queue overrun: {lost} frames were lost"]


def test_a_bug_in_a_thread_ends_the_daemon_and_nothing_logged_is_lost(
    bench: Bench,
) -> None:
    bench.script(20)
    bench.at(15, lambda: bench.sensors.gps.die(ZeroDivisionError("our own")))
    with pytest.raises(ZeroDivisionError, match="our own"):
        bench.run()
    assert len(read_log(bench.log).utc_s) > 20
    assert bench.sensors.imu.calls == ["start", "stop", "join"]
    assert bench.sensors.gps.calls == ["start", "stop", "join"]
    assert not bench.status.exists()


def test_a_full_disk_is_told_once_and_nothing_is_missing_afterwards(
    bench: Bench, said: Said, monkeypatch: pytest.MonkeyPatch
) -> None:
    disk = SmallDisk(monkeypatch)
    bench.script(40)
    bench.at(15, lambda: setattr(disk, "free_bytes", 30))
    bench.at(25, lambda: setattr(disk, "free_bytes", 1_000_000_000))
    while_full = bench.look(24)
    assert bench.run() == 0
    assert disk.refused_writes
    assert while_full["log"]["is_failing"]
    assert len([line for line in said(logging.WARNING) if "in memory" in line]) == 1
    utc_s = read_log(bench.log).utc_s
    assert (utc_s[1:] - utc_s[:-1] == 0.25).all()
    assert len(utc_s) > 120


# ------------------------------------------------------------------------- the signals


def test_sighup_opens_the_log_and_the_capture_anew(bench: Bench) -> None:
    moved = bench.log.with_name("moved.csv"), bench.log.with_name("moved.rec")
    bench.script(30)

    def move() -> None:
        bench.log.rename(moved[0])
        bench.record.rename(moved[1])
        bench.signals.reopen()

    bench.at(15, move)
    assert bench.run(f"record.path={bench.record}", "log.sync_s=3600") == 0
    first, second = read_log(moved[0]).utc_s, read_log(bench.log).utc_s
    assert second[0] == first[-1] + 0.25
    assert bench.log.read_text().startswith(HEADER)
    for path in (moved[1], bench.record):
        assert isinstance(next(read_recording(path)), SessionHeader)


def test_what_the_sensors_left_at_the_end_is_still_written(bench: Bench) -> None:
    bench.script(20)
    assert bench.run(f"record.path={bench.record}") == 0
    frames = [item for item in read_recording(bench.record) if isinstance(item, Frame)]
    assert frames[-1].t_ns > 20.9 * S
    assert bench.sensors.imu.calls == ["start", "stop", "join"]


def test_a_stop_before_anything_is_open_comes_at_once() -> None:
    with pytest.raises(SystemExit) as end:
        Signals().stop()
    assert end.value.code == 0


def test_a_log_of_the_future_is_no_healthy_status_until_it_is_put_aside(
    bench: Bench, said: Said
) -> None:
    row = "2027-01-01T00:00:00.000Z,51.99000000,4.37000000,5.2,0.00,,3.90,gps"
    bench.log.write_text(f"{HEADER}\n{row}\n")
    bench.script(60)
    early, late = bench.look(20), bench.look(55)
    assert bench.run() == 0
    assert early["state"] == "not logging"
    assert "the log ends later than they are, at 2027-01-01" in early["log"]["trouble"]
    assert early["faults"]["log_times"] > 0
    assert any(line.startswith("STATUS=not logging: ") for line in bench.told)
    assert (late["state"], late["log"]["trouble"]) == ("tracking", None)
    times = read_log(bench.log).utc_s
    assert len(times) == pytest.approx(4 * (60 - FIRST_FIX_S - 20), abs=8)
    (aside,) = bench.log.parent.glob("latlong-20270101T000000Z.csv*")
    assert len(read_log(aside).utc_s) == 1
    assert [line for line in said(logging.WARNING) if "put aside" in line]
