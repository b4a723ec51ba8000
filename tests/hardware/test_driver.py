"""The driver, on the fake and, where there is one, on a real chip.

A real chip lies still on the bus IMU_TRACKER_I2C_BUS, at IMU_TRACKER_I2C_ADDRESS
(0x68 by default), and no daemon uses it.
"""

import os
from collections.abc import Callable, Iterator
from math import hypot
from struct import unpack
from typing import NamedTuple

import pytest

from fake_i2c import FakeBus, FakeMpu6050
from imu_tracker.samples import Frame, Source
from imu_tracker.sensors.clock import Clock, MonotonicClock
from imu_tracker.sensors.imu.fifo import DrainOutcome
from imu_tracker.sensors.imu.i2c import OpenI2CBus, open_bus
from imu_tracker.sensors.imu.mpu6050 import Mpu6050
from imu_tracker.sensors.imu.reader import ImuReader
from imu_tracker.sensors.imu.selftest import Verdict, self_test
from imu_tracker.sensors.imu.setup import ImuSettings
from support.fake_clock import FakeClock

BUS = os.environ.get("IMU_TRACKER_I2C_BUS")
ADDRESS = int(os.environ.get("IMU_TRACKER_I2C_ADDRESS", "0x68"), 0)

REAL = pytest.param(
    "real",
    marks=[
        pytest.mark.hardware,
        pytest.mark.skipif(BUS is None, reason="IMU_TRACKER_I2C_BUS is not set"),
    ],
)


class Bus(NamedTuple):
    """A way to a chip, and the time that it lives in."""

    open: Callable[[], OpenI2CBus]
    clock: Clock
    address: int

    def sleep(self, seconds: float) -> None:
        self.clock.sleep_until_ns(self.clock.now_ns() + round(seconds * 1e9))


@pytest.fixture(params=["fake", REAL])
def bus(request: pytest.FixtureRequest) -> Bus:
    if request.param == "real":
        return Bus(lambda: open_bus(int(BUS or "")), MonotonicClock(), ADDRESS)
    clock = FakeClock()
    fake = FakeBus(clock, {0x68: FakeMpu6050(clock, clock_error=0.008)})
    return Bus(fake.open, clock, 0x68)


@pytest.fixture
def imu(bus: Bus) -> Iterator[Mpu6050]:
    handle = bus.open()
    imu = Mpu6050(handle, bus.address, bus.clock)
    imu.configure(ImuSettings())
    yield imu
    imu.reset()
    handle.close()


def test_it_names_itself_and_keeps_its_configuration(bus: Bus, imu: Mpu6050) -> None:
    assert imu.chip.is_known
    bus.sleep(0.5)
    assert imu.is_configured()


def test_it_feels_gravity_and_a_plausible_temperature(imu: Mpu6050) -> None:
    *accel, temperature, _, _, _ = unpack(">7h", imu.read_burst())
    assert hypot(*accel) / 8192 == pytest.approx(1, abs=0.1)
    assert -20 < temperature / 340 + 36.53 < 70


def test_the_fifo_fills_at_the_rate_that_was_asked_for(bus: Bus, imu: Mpu6050) -> None:
    imu.fifo.restart()
    n_frames = 0
    for _ in range(20):
        bus.sleep(0.1)
        drain = imu.fifo.drain()
        assert drain.outcome is DrainOutcome.FRAMES
        n_frames += len(drain.frames)
    assert n_frames == pytest.approx(200, rel=0.05)


def test_a_fifo_that_was_left_alone_overflows_and_recovers(
    bus: Bus, imu: Mpu6050
) -> None:
    imu.fifo.restart()
    bus.sleep(1.5)
    assert imu.fifo.drain().outcome is DrainOutcome.OVERFLOW
    bus.sleep(0.2)
    assert len(imu.fifo.drain().frames) in range(17, 24)


def test_the_reader_delivers_in_order_and_in_time(bus: Bus) -> None:
    frames: list[Frame] = []

    def put(frame: Frame) -> None:
        frames.append(frame)
        if len(frames) > 500:
            reader.stop()

    reader = ImuReader(bus.open, put, bus.clock, address=bus.address)
    reader.run()
    times = [frame.t_ns for frame in frames if frame.source is Source.IMU]
    assert times == sorted(set(times))
    assert len(times) / (times[-1] - times[0]) * 1e9 == pytest.approx(100, rel=0.05)
    assert reader.health()["bus_errors"] == 0


def test_the_self_test_finds_no_fault(bus: Bus, imu: Mpu6050) -> None:
    assert Verdict.FAILED not in {r.verdict for r in self_test(imu, bus.clock)}
