"""The whole daemon on models of everything around it, and what it did.

Loop, queue, both sensor threads, driver, files: all of it is the product. Chip, bus,
serial line and clock are models; the truth is the simulator's.
"""

import json
import logging
import math
from bisect import bisect_left
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple, cast

import pytest

from fake_i2c import FakeBus, FakeMpu6050
from faults.drives import LENGTH_S, Drive, S, Said, clock_ns, drive
from faults.serial_line import SerialLine
from faults.turns import TurnClock, Turner
from imu_tracker.config import Config, load_config
from imu_tracker.daemon.run import run
from imu_tracker.daemon.supervision import Signals
from imu_tracker.estimation.receiver.gate import FixOutcome
from imu_tracker.estimation.tracker import Tracker
from imu_tracker.samples import Frame, GpsFix, NavState, Source
from imu_tracker.sensors.gnss.reader import GpsReader
from imu_tracker.sensors.imu.reader import ImuReader
from imu_tracker.sensors.sensor_thread import SensorThread
from imu_tracker.sources.factory import imu_settings
from imu_tracker.sources.live import GpsFactory, ImuFactory
from imu_tracker.storage.latlong import LatLongLog
from support.simulated import METRES_PER_RAD

USED = (FixOutcome.INITIALISED, FixOutcome.ACCEPTED, FixOutcome.REACQUIRED)


class Written(NamedTuple):
    """A row, the second of the drive at which it was written, and its error."""

    at_s: float
    state: NavState
    error_m: float

    @property
    def mode(self) -> str:
        return str(self.state.mode)

    @property
    def is_true(self) -> bool:
        return self.error_m <= self.state.r95_m


class Spoken(NamedTuple):
    """A line of the journal."""

    at_s: float
    level: int
    text: str


class Result(NamedTuple):
    """What a daemon did; seconds are those of the drive."""

    exit_code: int
    rows: list[Written]
    samples_s: list[float]  # when each arrived
    used_s: list[float]  # when a fix was used
    journal: list[Spoken]
    counters: dict[str, int]  # of the last status
    status: dict[str, Any]
    fed_s: list[float]  # the watchdog
    log: Path

    def between(self, start_s: float, end_s: float) -> list[Written]:
        """Rows of these instants."""
        first, end = clock_ns(start_s), clock_ns(end_s)
        return [row for row in self.rows if first <= row.state.t_ns < end]

    def modes(self, start_s: float, end_s: float) -> set[str]:
        return {row.mode for row in self.between(start_s, end_s)}

    def said(self, text: str, from_s: float = -math.inf) -> list[Spoken]:
        return [
            line for line in self.journal if text in line.text and line.at_s >= from_s
        ]


class _Ear(logging.Handler):
    def __init__(self, hear: Callable[[logging.LogRecord], None]) -> None:
        super().__init__(logging.INFO)
        self._hear = hear

    def emit(self, record: logging.LogRecord) -> None:
        self._hear(record)


class Bench:
    """One daemon, one drive, and what the world does to it.

    Parameters
    ----------
    directory : Path
        For its files.
    monkeypatch : MonkeyPatch
    drives : Drive
    say : callable, optional
        Changes the lines of the receiver beforehand.
    baud, buffer_s
        See `SerialLine`.
    clock_error : float
        By how much the chip's clock is fast.
    """

    def __init__(
        self,
        directory: Path,
        monkeypatch: pytest.MonkeyPatch,
        *,
        drives: Drive | None = None,
        say: Callable[[list[Said]], list[Said]] = lambda lines: lines,
        baud: int = 9600,
        buffer_s: float = math.inf,
        clock_error: float = 0.004,
    ) -> None:
        self.monkeypatch = monkeypatch
        self.drive = drives or drive()
        self.clock = TurnClock(clock_ns(0))
        self.chip = FakeMpu6050(self.clock, clock_error=clock_error, noise_counts=0.0)
        self.chip.world.follow(self.drive.feel)
        self.bus = FakeBus(self.clock, {0x68: self.chip})
        self.line = SerialLine(self.clock, say(list(self.drive.lines)), baud, buffer_s)
        self.signals = Signals()
        self.log = directory / "log" / "latlong.csv"
        self.status = directory / "run" / "status.json"
        self.state = directory / "state" / "state.json"
        self.put: Callable[[Frame], None]
        self._truth_utc_ms = [round(row.utc_s * 1000) for row in self.drive.truth]
        self._rows: list[Written] = []
        self._samples_s: list[float] = []
        self._used_s: list[float] = []
        self._fed_s: list[float] = []
        self._journal: list[Spoken] = []
        self._status: dict[str, Any] = {}

    @property
    def now_s(self) -> float:
        return (self.clock.now_ns() - clock_ns(0)) / S

    def at(self, second: float, action: Callable[[], object]) -> None:
        """Plan something for a second of the drive."""
        self.clock.at(clock_ns(second), action)

    def config(self, *overrides: str) -> Config:
        own = (
            f"log.path={self.log}",
            f"status.path={self.status}",
            f"state.path={self.state}",
            "log.min_free_mb=0",
            "filter.profile=vehicle",
        )
        return load_config(None, [*own, *overrides])

    def run(self, seconds: float, *overrides: str) -> Result:
        """Run the daemon so long."""
        assert seconds <= LENGTH_S
        self.at(seconds, self._look)
        self.at(seconds, self.signals.stop)
        self._listen()
        ear = _Ear(self._hear)
        logger = logging.getLogger("imu_tracker")
        level = logger.level
        logger.addHandler(ear)
        logger.setLevel(logging.INFO)
        try:
            code = run(
                self.config(*overrides),
                clock=self.clock,
                signals=self.signals,
                notify=self._notify,
                imu_reader=cast(ImuFactory, self._imu_reader),
                gps_reader=cast(GpsFactory, self._gps_reader),
            )
        finally:
            logger.removeHandler(ear)
            logger.setLevel(level)
        return Result(
            code,
            self._rows,
            self._samples_s,
            self._used_s,
            self._journal,
            self._status.get("counters", {}),
            self._status,
            self._fed_s,
            self.log,
        )

    # ---------------------------------------------------------------- the sensors

    def _imu_reader(self, config: Config, put: Any, clock: Any) -> ImuReader:
        def heard(frame: Frame) -> None:
            if frame.source is Source.IMU:
                self._samples_s.append(self.now_s)
            put(frame)

        self.put = put
        return _TurningImu(
            self.bus.open,
            heard,
            clock,
            settings=imu_settings(config),
            read=config.imu.read,
            allow_unknown=config.imu.allow_unknown_chip,
        )

    def _gps_reader(self, config: Config, put: Any, clock: Any) -> GpsReader:
        return _TurningGps(
            config.gps.port, config.gps.baud, put, clock, open_port=self.line.open
        )

    # ---------------------------------------------------------------- what it does

    def _listen(self) -> None:
        bench, take, write = self, Tracker.on_fix, LatLongLog.write

        def on_fix(tracker: Tracker, fix: GpsFix) -> FixOutcome:
            outcome = take(tracker, fix)
            if outcome in USED:
                bench._used_s.append(bench.now_s)
            return outcome

        def on_row(log: LatLongLog, state: NavState) -> None:
            bench._rows.append(Written(bench.now_s, state, bench._error_m(state)))
            write(log, state)

        self.monkeypatch.setattr(Tracker, "on_fix", on_fix)
        self.monkeypatch.setattr(LatLongLog, "write", on_row)

    def _error_m(self, state: NavState) -> float:
        """Distance from the truth of the instant that the row really describes."""
        utc_ms = round(state.t_ns / 1e6) - round(clock_ns(0) / 1e6)
        utc_ms += self._truth_utc_ms[0]
        index = min(
            max(bisect_left(self._truth_utc_ms, utc_ms), 1), len(self._truth_utc_ms) - 1
        )
        old, new = self.drive.truth[index - 1], self.drive.truth[index]
        share = (utc_ms - self._truth_utc_ms[index - 1]) / (
            self._truth_utc_ms[index] - self._truth_utc_ms[index - 1]
        )
        lat = old.lat_rad + share * (new.lat_rad - old.lat_rad)
        lon = old.lon_rad + share * (new.lon_rad - old.lon_rad)
        north = (state.lat_rad - lat) * METRES_PER_RAD
        east = (state.lon_rad - lon) * METRES_PER_RAD * math.cos(lat)
        return math.hypot(north, east)

    def utc_error_s(self, state: NavState) -> float:
        """Return how far UTC of a row is from that of its instant."""
        true_utc_s = self.drive.truth[0].utc_s + (state.t_ns - clock_ns(0)) / S
        return state.utc_s - true_utc_s

    def _notify(self, line: str) -> None:
        if line == "WATCHDOG=1":
            self._fed_s.append(self.now_s)

    def _hear(self, record: logging.LogRecord) -> None:
        self._journal.append(Spoken(self.now_s, record.levelno, record.getMessage()))

    def _look(self) -> None:
        if self.status.exists():
            self._status = json.loads(self.status.read_text())


class _TakingTurns(SensorThread):
    """A sensor's thread that takes turns with the others."""

    def start(self) -> None:
        self._turner = Turner(cast(TurnClock, self._clock), self._run_and_capture_error)
        self._turner.start()

    def stop(self) -> None:
        super().stop()
        self._turner.wake()

    def join(self, timeout_s: float | None = None) -> None:
        self._turner.join(timeout_s)


class _TurningImu(_TakingTurns, ImuReader):
    """The product's reader of the IMU."""


class _TurningGps(_TakingTurns, GpsReader):
    """The product's reader of the receiver."""
