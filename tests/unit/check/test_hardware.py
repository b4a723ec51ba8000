"""`imu-tracker hardware-report`, dry: on a fake bus and a scripted receiver."""

import errno
import json
import logging
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from fake_i2c import FakeBus, FakeMpu6050
from imu_tracker import __version__
from imu_tracker.check import hardware as measuring
from imu_tracker.cli import main
from imu_tracker.config import Config
from imu_tracker.samples import Frame, Source
from imu_tracker.sensors import clock as clocks
from imu_tracker.sensors.gnss.reader import GpsHealth, GpsState
from imu_tracker.sources import factory
from support.fake_clock import FakeClock

RMC = b"$GNRMC,120001.00,A,5159.4000000,N,00422.2000000,E,0.012,,221126,,,A*61"


class Receiver:
    """Sends one sentence as soon as it is started."""

    def __init__(self, put: Callable[[Frame], None], t_ns: int) -> None:
        self._put, self._t_ns = put, t_ns

    def start(self) -> None:
        self._put(Frame(self._t_ns, Source.GPS, RMC))

    def stop(self) -> None:
        pass

    def join(self) -> None:
        pass

    def health(self) -> GpsHealth:
        return GpsHealth(GpsState.OK, "", 9600, 1, 1, 1, 0)


class Bench:
    """A clock, and a chip on a bus whose transfers take 400 us."""

    def __init__(self) -> None:
        self.clock = FakeClock()
        self.chip = FakeMpu6050(self.clock)
        self.bus = FakeBus(self.clock, {0x68: self.chip})

    def gps_reader(
        self, config: object, put: Callable[[Frame], None], clock: object
    ) -> Receiver:
        return Receiver(put, self.clock.now_ns())


@pytest.fixture
def bench(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Iterator[Bench]:
    bench = Bench()
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(clocks, "MonotonicClock", lambda: bench.clock)
    monkeypatch.setattr(factory, "open_bus", lambda number: bench.bus.open())
    monkeypatch.setattr(factory, "gps_reader", bench.gps_reader)
    yield bench
    assert bench.bus.open_handles == 0
    logging.getLogger("imu_tracker").handlers = []


def report(*more: str) -> tuple[int, dict[str, Any]]:
    """Run the command; return its code and what it wrote."""
    settings = ("--set", "status.path=status.json", "--set", "imu.read=burst")
    argv = ["hardware-report", "--output", "report.json", *settings, *more]
    code = main(argv)
    return code, json.loads(Path("report.json").read_text("utf-8"))


def test_one_file_has_what_a_real_pi_shows_and_no_position(bench: Bench) -> None:
    code, found = report("--rest", "60")
    assert code == 0
    assert found["computer"]["imu_tracker"] == __version__
    assert found["computer"]["start_s"] >= 0
    assert found["computer"]["power_cut"]["advice"]
    assert found["bus"]["chip"] == "MPU-6050"
    assert found["bus"]["failed"] == 0
    assert found["bus"]["bursts_per_s"] > 100
    assert len(found["bus"]["self_test"]) == 6
    assert found["rest"]["rate_hz"] == pytest.approx(100, rel=0.01)
    assert found["rest"]["missing"] == 0
    assert len(found["rest"]["axes"]) == 6
    assert "wire" not in found  # nobody at a terminal
    assert found["receiver"] == [
        "ok GPS port: /dev/serial0 at 9600 baud: RMC",
        "ok GPS: a fix, at 2026-11-22T12:00:01.000Z",
    ]
    text = Path("report.json").read_text("utf-8")
    assert "5159.4" not in text
    assert "51.99" not in text


def test_a_chip_that_is_missing_is_told_and_the_rest_is_measured(bench: Bench) -> None:
    bench.bus.chips.clear()
    code, found = report("--rest", "60")
    assert code == 69
    assert "0x68" in found["bus"]["error"]
    assert "error" in found["rest"]
    assert found["receiver"][-1].startswith("ok GPS: a fix")


def test_a_pulled_wire_shows_the_errors_of_the_kernel(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    terminal = SimpleNamespace(isatty=lambda: True, readline=lambda: "\n")
    monkeypatch.setattr(sys, "stdin", terminal)
    pull = measuring.pulled_wire

    def pulled(config: Config, clock: FakeClock) -> dict[str, Any]:
        start_ns = bench.clock.now_ns() + 5_000_000_000
        bench.bus.fail_between(start_ns, start_ns + 2_000_000_000, errno.ETIMEDOUT)
        return pull(config, clock)

    monkeypatch.setattr(measuring, "pulled_wire", pulled)
    code, found = report("--rest", "60")
    assert code == 0
    wire = found["wire"]
    # 2 s at one burst every 20 ms.
    assert wire["errors"] == {"ETIMEDOUT": pytest.approx(100, abs=3)}
    assert wire["read"] > 800
    assert wire["answers_again"]
    assert wire["still_configured"]


def test_a_played_source_is_refused(bench: Bench) -> None:
    argv = ["hardware-report", "--output", "r.json", "--set", "source.kind=simulation"]
    assert main(argv) == 78
    assert not Path("r.json").exists()


@pytest.mark.parametrize(
    ("mounts", "kind", "word"),
    [
        ("/dev/mmcblk0p2 / ext4 rw,noatime 0 0\n", "ext4", "log.sync_s"),
        (
            "/dev/root / ext4 rw 0 0\ntmpfs /var/log tmpfs rw 0 0\n",
            "tmpfs",
            "nothing outlasts",
        ),
        ("/dev/sda1 / vfat rw 0 0\n", "vfat", "not tried"),
    ],
)
def test_what_a_power_cut_takes_depends_on_the_file_system_of_the_log(
    mounts: str, kind: str, word: str
) -> None:
    found = measuring.power_cut(Path("/var/log/imu-tracker/latlong.csv"), mounts)
    assert found["file_system"] == kind
    assert word in found["advice"]
