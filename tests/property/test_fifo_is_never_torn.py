"""Whatever the drain schedule and wherever the bus fails: no torn sample."""

from contextlib import suppress

from hypothesis import given
from hypothesis import strategies as st

from fake_i2c import FakeBus, FakeMpu6050
from fake_i2c.frames import number_of, numbered_frames
from imu_tracker.errors import BusError
from imu_tracker.sensors.imu.mpu6050 import Mpu6050
from imu_tracker.sensors.imu.setup import ImuSettings
from support.fake_clock import FakeClock

pauses_us = st.integers(0, 1_500_000) | st.integers(0, 30_000)
nacks = st.none() | st.tuples(st.integers(0, 12), st.integers(0, 200))
steps = st.lists(st.tuples(pauses_us, nacks), min_size=1, max_size=20)


@given(steps=steps, bus_hz=st.sampled_from([100_000, 400_000]))
def test_every_frame_is_whole_and_comes_once_in_order(
    steps: list[tuple[int, tuple[int, int] | None]], bus_hz: int
) -> None:
    clock = FakeClock()
    chip = FakeMpu6050(clock, bursts=numbered_frames())
    bus = FakeBus(clock, {0x68: chip}, hz=bus_hz)
    imu = Mpu6050(bus, 0x68, clock)
    imu.configure(ImuSettings(rate_hz=200))
    frames: list[bytes] = []
    for pause_us, nack in steps:
        clock.advance(ns=pause_us * 1000)
        if nack is not None:
            bus.nack(after=nack[0], taken=nack[1])
        with suppress(BusError):
            frames += imu.fifo.drain().frames
    numbers = [number_of(frame) for frame in frames]
    assert numbers == sorted(set(numbers))
