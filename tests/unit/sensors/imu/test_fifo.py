"""The FIFO on the strict fake: whole frames, or a clean restart."""

from itertools import chain, repeat
from struct import pack

import pytest

from fake_i2c import FakeBus, FakeMpu6050
from fake_i2c.frames import number_of, numbered_frames
from imu_tracker.errors import BusError
from imu_tracker.sensors.imu.fifo import Drain, DrainOutcome, Fifo
from imu_tracker.sensors.imu.mpu6050 import Mpu6050
from imu_tracker.sensors.imu.setup import ImuSettings
from support.fake_clock import FakeClock


class Bench:
    """A configured chip at 100 Hz whose frames are numbered, its FIFO running."""

    def __init__(self, who_am_i: int = 0x68) -> None:
        self.clock = FakeClock()
        self.chip = FakeMpu6050(self.clock, who_am_i=who_am_i, bursts=numbered_frames())
        self.bus = FakeBus(self.clock, {0x68: self.chip})
        self.imu = Mpu6050(self.bus, 0x68, self.clock)
        self.imu.configure(ImuSettings())
        self.fifo.restart()

    @property
    def fifo(self) -> Fifo:
        return self.imu.fifo

    def drain_after(self, ms: float) -> Drain:
        self.clock.advance(ms=ms)
        return self.fifo.drain()


@pytest.fixture
def bench() -> Bench:
    return Bench()


def numbers(drain: Drain) -> list[int]:
    return [number_of(frame) for frame in drain.frames]


def test_a_drain_returns_every_sample_once_oldest_first(bench: Bench) -> None:
    seen = numbers(bench.drain_after(55))
    for ms in (0, 20, 3, 170, 1, 400, 50):
        seen += numbers(bench.drain_after(ms))
    assert seen == list(range(seen[0], seen[0] + len(seen)))
    assert len(seen) == pytest.approx(70, abs=2)


def test_more_than_an_smbus_block_comes_in_one_transfer(bench: Bench) -> None:
    before = bench.bus.transfers
    assert len(bench.drain_after(700).frames) == 70
    assert bench.bus.transfers - before == 3  # status, count, data


def test_the_first_drain_after_configuring_starts_the_fifo(bench: Bench) -> None:
    bench.imu.configure(ImuSettings())
    bench.clock.advance(ms=50)
    drain = bench.fifo.drain()
    assert (drain.outcome, drain.frames) == (DrainOutcome.RESTARTED, [])
    assert len(bench.drain_after(55).frames) == 5


def test_what_the_fifo_held_before_is_thrown_away(bench: Bench) -> None:
    bench.clock.advance(ms=300)
    newest = number_of(bench.imu.read_burst())
    bench.fifo.restart()
    assert min(numbers(bench.drain_after(55))) > newest


def test_a_frame_that_lacks_its_last_byte_is_not_passed_on(bench: Bench) -> None:
    # The frames before it are aligned, and their temperature is right.
    bench.clock.advance(ms=55)
    bench.chip.read(0x72, 2)
    bench.chip._fifo.pop()
    drain = bench.fifo.drain()
    assert (drain.outcome, drain.frames) == (DrainOutcome.MISALIGNED, [])
    assert numbers(bench.drain_after(55))


def test_an_overflow_throws_all_away_and_starts_anew(bench: Bench) -> None:
    drain = bench.drain_after(1000)
    assert drain.outcome is DrainOutcome.OVERFLOW
    assert drain.frames == []
    assert len(numbers(bench.drain_after(55))) in (5, 6)


def test_an_overflow_between_status_and_count_does_not_slip_through(
    bench: Bench,
) -> None:
    bench.clock.advance(ms=1000)
    bench.chip.read(0x3A, 1)  # as if it happened just after the status was read
    assert bench.fifo.drain().outcome is DrainOutcome.OVERFLOW


def test_a_6500_overflows_at_half_the_depth() -> None:
    bench = Bench(who_am_i=0x70)
    assert len(bench.drain_after(350).frames) == 35
    assert bench.drain_after(400).outcome is DrainOutcome.OVERFLOW


def test_a_frame_that_is_being_written_waits_for_the_next_drain(bench: Bench) -> None:
    written_ns = bench.chip.period_ns + bench.chip.samples[-1][0]
    # The count is latched after the status was read, both at 400 kHz.
    into_the_frame_ns = round(written_ns) + 3_000 - 4 * 22_500
    bench.clock.sleep_until_ns(into_the_frame_ns)
    assert len(numbers(bench.fifo.drain())) == 1


def test_bytes_that_stay_odd_are_misaligned(bench: Bench) -> None:
    bench.clock.advance(ms=55)
    bench.chip.read(0x74, 1)  # somebody else took a byte
    drain = bench.fifo.drain()
    assert (drain.outcome, drain.frames) == (DrainOutcome.MISALIGNED, [])
    assert len(numbers(bench.drain_after(55))) in (5, 6)


def test_a_temperature_that_jumps_is_misaligned() -> None:
    bench = Bench()
    hot = pack(">7h", 0, 0, 0, 12000, 0, 0, 0)
    bench.chip = FakeMpu6050(
        bench.clock, bursts=chain(repeat(bytes(14), 80), repeat(hot))
    )
    bench.bus.chips[0x68] = bench.chip
    bench.imu.configure(ImuSettings())
    bench.fifo.restart()
    outcomes = [bench.drain_after(100).outcome for _ in range(8)]
    assert outcomes.count(DrainOutcome.MISALIGNED) == 1
    assert outcomes[-1] is DrainOutcome.FRAMES  # hot it is, then


def test_a_flipped_bit_in_the_count_is_read_again(bench: Bench) -> None:
    for bit in range(8):
        bench.clock.advance(ms=55)
        bench.bus.flip(1, bit, after=1)
        assert len(numbers(bench.fifo.drain())) in (5, 6)


def test_a_read_that_breaks_off_puts_the_fifo_in_doubt(bench: Bench) -> None:
    bench.clock.advance(ms=55)
    bench.bus.nack(after=2, taken=9)
    with pytest.raises(BusError, match=r"FIFO read failed at .*register 0x74"):
        bench.fifo.drain()
    assert bench.fifo.drain().outcome is DrainOutcome.RESTARTED
    assert len(numbers(bench.drain_after(55))) in (5, 6)


@pytest.mark.parametrize("nth", [0, 1])
def test_a_nack_before_the_read_loses_no_sample(bench: Bench, nth: int) -> None:
    seen = numbers(bench.drain_after(55))
    bench.clock.advance(ms=50)
    bench.bus.nack(after=nth)
    with pytest.raises(BusError):
        bench.fifo.drain()
    seen += numbers(bench.drain_after(50))
    assert seen == list(range(seen[0], seen[0] + len(seen)))


def test_a_restart_that_breaks_off_is_done_again(bench: Bench) -> None:
    for nth in range(11):
        bench.bus.nack(after=nth)
        with pytest.raises(BusError):
            bench.fifo.restart()
        assert bench.fifo.drain().outcome is DrainOutcome.RESTARTED
    assert len(numbers(bench.drain_after(55))) in (5, 6)


def test_the_count_was_latched_between_the_two_instants(bench: Bench) -> None:
    drain = bench.drain_after(55)
    newest_ns = bench.chip.samples[-1][0]
    assert newest_ns < drain.after_ns
    assert drain.before_ns < newest_ns + bench.chip.period_ns
    assert 0 < drain.after_ns - drain.before_ns < 200_000


def test_the_registers_of_the_fifo_belong_to_the_configuration(bench: Bench) -> None:
    assert bench.imu.is_configured()
    bench.chip.write(0x6A, 0x00)
    assert not bench.imu.is_configured()
