"""The whole daemon in process and real time: a chip on the fake bus, GPS on a pty.

Nothing here sleeps but to wait for what must come, and that has a deadline.
"""

import json
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from fake_i2c import FakeBus, FakeMpu6050
from imu_tracker.config import Config, load_config
from imu_tracker.daemon.run import run
from imu_tracker.daemon.supervision import Signals
from imu_tracker.sensors.clock import MonotonicClock
from imu_tracker.sensors.imu.reader import ImuReader
from imu_tracker.sources.factory import imu_settings
from imu_tracker.storage.latlong import HEADER, read_log
from support.pty_receiver import PtyReceiver

DEADLINE_S = 20.0


def wait_for(what: str, condition: Callable[[], bool]) -> None:
    """Wait until something is so; much longer than it takes on a busy machine."""
    end_s = time.monotonic() + DEADLINE_S
    while not condition():
        assert time.monotonic() < end_s, f"in vain: {what}"
        time.sleep(0.01)


class Desk:
    """A bus with a chip, a receiver, and the files of the daemon."""

    def __init__(self, directory: Path) -> None:
        self.clock = MonotonicClock()
        self.chip = FakeMpu6050(self.clock)
        self.bus = FakeBus(self.clock, {0x68: self.chip})
        self.port = directory / "gps"
        self.receiver = PtyReceiver(self.port)
        self.log = directory / "latlong.csv"
        self.status = directory / "status.json"
        self.signals = Signals()
        self.told: list[str] = []

    def config(self, *overrides: str) -> Config:
        own = (
            f"log.path={self.log}",
            f"status.path={self.status}",
            "state.path=",
            f"gps.port={self.port}",
            "log.min_free_mb=0",
            "log.rate_hz=10",
        )
        return load_config(None, [*own, *overrides])

    def imu_reader(self, config: Config, put: Any, clock: Any) -> ImuReader:
        return ImuReader(self.bus.open, put, clock, settings=imu_settings(config))

    def run(self, script: Callable[[], object], *overrides: str) -> None:
        """Run the daemon until the script, which another thread follows, is over."""
        failures: list[BaseException] = []
        ready = threading.Event()

        def follow() -> None:
            try:
                assert ready.wait(DEADLINE_S)
                script()
            except BaseException as failure:  # noqa: BLE001 - raised below
                failures.append(failure)
            finally:
                self.signals.stop()

        def notify(line: str) -> None:
            self.told.append(line)
            ready.set()

        thread = threading.Thread(target=follow, name="script")
        with self.receiver:
            thread.start()
            code = run(
                self.config(*overrides),
                signals=self.signals,
                notify=notify,
                imu_reader=self.imu_reader,
            )
            thread.join()
        for failure in failures:
            raise failure
        assert code == 0
        assert self.bus.open_handles == 0

    def rows(self) -> list[str]:
        """What somebody who follows the file sees."""
        if not self.log.exists():
            return []
        return self.log.read_text().split("\n")[1:-1]

    def modes(self, of_last: int) -> set[str]:
        return {row.rpartition(",")[2] for row in self.rows()[-of_last:]}

    def state(self) -> dict[str, Any]:
        try:
            status: dict[str, Any] = json.loads(self.status.read_text())
        except FileNotFoundError:
            return {}
        return status

    def wait_for_modes(self, *modes: str) -> None:
        """Wait until the rows of half a second have these modes."""
        wait_for(f"rows: {modes}", lambda: self.modes(of_last=5) <= set(modes))

    def wait_for_rows(self, more: int) -> None:
        goal = len(self.rows()) + more
        wait_for(f"{more} more rows", lambda: len(self.rows()) >= goal)


WITH_IMU = ("still", "gps", "dr")


@pytest.fixture
def desk(tmp_path: Path) -> Desk:
    return Desk(tmp_path)


def assert_whole(desk: Desk) -> None:
    """Every row is there, from the first to the last."""
    utc_s = read_log(desk.log).utc_s
    steps_s = utc_s[1:] - utc_s[:-1]
    assert abs(steps_s - 0.1).max() < 1e-6


def test_rows_can_be_seen_as_they_come(desk: Desk) -> None:
    ages_s: list[float] = []

    def script() -> None:
        desk.wait_for_rows(5)
        assert desk.log.read_text().startswith(HEADER)
        desk.wait_for_modes(*WITH_IMU)
        wait_for("a status", lambda: desk.state().get("state") == "tracking")
        ages_s.append(desk.state()["row_age_s"])

    desk.run(script)
    assert_whole(desk)
    assert ages_s[0] < 2  # half a second, on a machine that is not busy
    assert "WATCHDOG=1" in desk.told


def test_the_imu_can_be_unplugged_and_plugged_in_again(desk: Desk) -> None:
    def script() -> None:
        desk.wait_for_rows(5)
        desk.wait_for_modes(*WITH_IMU)
        desk.bus.unplug()
        desk.wait_for_modes("gpsonly")
        desk.bus.plug()
        desk.wait_for_modes(*WITH_IMU)

    desk.run(script)
    assert_whole(desk)


def test_the_receiver_can_be_unplugged_and_plugged_in_again(desk: Desk) -> None:
    def script() -> None:
        desk.wait_for_rows(5)
        desk.receiver.unplug()
        wait_for("closed", lambda: desk.state()["gps"]["state"] == "closed")
        desk.wait_for_rows(10)
        desk.receiver.plug()
        wait_for("open", lambda: desk.state()["gps"]["state"] == "ok")
        desk.wait_for_rows(10)

    desk.run(script)
    assert_whole(desk)


def test_both_sensors_may_come_after_the_start(desk: Desk) -> None:
    desk.bus.unplug()

    def script() -> None:
        desk.receiver.unplug()
        wait_for("a status", lambda: desk.state().get("state") is not None)
        assert not desk.state()["imu"]["is_ready"]
        desk.receiver.plug()
        desk.bus.plug()
        desk.wait_for_rows(5)
        desk.wait_for_modes(*WITH_IMU)

    desk.run(script)
    assert_whole(desk)


def test_a_chip_that_loses_its_power_is_set_up_again(desk: Desk) -> None:
    def script() -> None:
        desk.wait_for_rows(5)
        desk.chip.power_on()
        desk.wait_for_rows(15)
        desk.wait_for_modes(*WITH_IMU)

    desk.run(script)
    assert_whole(desk)
