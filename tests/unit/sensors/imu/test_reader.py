"""The reader of the IMU, driven by a clock that costs no time."""

import errno
from collections.abc import Callable
from itertools import islice, pairwise
from struct import unpack
from typing import Any

import pytest

from fake_i2c import FakeBus, FakeMpu6050
from fake_i2c.frames import number_of, numbered_frames
from fake_i2c.world import Feeling
from imu_tracker.samples import Frame, Source
from imu_tracker.sensors.imu.reader import COUNTERS, ImuReader
from imu_tracker.sensors.imu.setup import ImuSettings
from support.fake_clock import FakeClock

S = 1_000_000_000


class Bench:
    """A chip, its bus, a reader, and what it put."""

    def __init__(self, *, bus_hz: int = 400_000, **chip: Any) -> None:
        self.clock = FakeClock(now_ns=0)
        self.chip = FakeMpu6050(self.clock, **chip)
        self.bus = FakeBus(self.clock, {0x68: self.chip}, hz=bus_hz)
        self.frames: list[Frame] = []

    def read(self, seconds: float, **options: Any) -> ImuReader:
        """Let a reader run for so long, in the foreground."""
        reader = ImuReader(self.bus.open, self.frames.append, self.clock, **options)
        self.clock.at(round(seconds * S), reader.stop)
        reader.run()
        assert self.bus.open_handles == 0
        return reader

    def at(self, seconds: float, action: Callable[[], object]) -> None:
        self.clock.at(round(seconds * S), action)

    @property
    def samples(self) -> list[Frame]:
        return [frame for frame in self.frames if frame.source is Source.IMU]

    @property
    def events(self) -> list[str]:
        """The words of the events."""
        frames = [frame for frame in self.frames if frame.source is Source.EVENT]
        return [frame.data.decode().split()[0] for frame in frames]

    @property
    def said(self) -> str:
        return "\n".join(
            frame.data.decode() for frame in self.frames if frame.source is Source.EVENT
        )

    def longest_gap_s(self, after_s: float = 0) -> float:
        times = [frame.t_ns / S for frame in self.samples if frame.t_ns > after_s * S]
        return max(b - a for a, b in pairwise(times))

    def recovered_s(self, back_s: float) -> float:
        """How long after the bus was back the first sample was taken."""
        return min(f.t_ns / S for f in self.samples if f.t_ns > back_s * S) - back_s


@pytest.fixture
def bench() -> Bench:
    return Bench()


def test_it_delivers_every_sample_and_says_once_that_it_is_ready(bench: Bench) -> None:
    reader = bench.read(10)
    assert len(bench.samples) == pytest.approx(965, abs=6)  # 0.35 s to configure
    assert bench.events == ["imu_ready"]
    assert "imu_ready MPU-6050 at address 0x68, 100 Hz" in bench.said
    assert bench.frames[0].source is Source.EVENT
    assert reader.health() == dict.fromkeys(COUNTERS, 0) | {
        "samples": len(bench.samples)
    }


def test_no_sample_is_lost_or_comes_twice() -> None:
    bench = Bench(bursts=numbered_frames())
    bench.read(10)
    numbers = [number_of(frame.data) for frame in bench.samples]
    assert numbers == list(range(numbers[0], numbers[0] + len(numbers)))


SAW_S, SAW_DPS_PER_S = 4, 100


def saw(t_s: float) -> Feeling:
    """Turn with a rate that tells the time, over and over."""
    return Feeling(gyro_dps=(t_s % SAW_S * SAW_DPS_PER_S, 0, 0))


def error_ms(frame: Frame) -> float:
    """By how much a sample of the saw is stamped late."""
    rate_dps = unpack(">7h", frame.data)[4] / 65.5
    late_s: float = frame.t_ns / S - rate_dps / SAW_DPS_PER_S
    return ((late_s + SAW_S / 2) % SAW_S - SAW_S / 2) * 1e3


@pytest.mark.parametrize("clock_error", [-0.02, 0.0, 0.013, 0.02])
@pytest.mark.parametrize("bus_hz", [100_000, 400_000])
@pytest.mark.parametrize("bandwidth_hz", [42, 10])
def test_a_sample_carries_the_instant_that_it_describes(
    clock_error: float, bus_hz: int, bandwidth_hz: int
) -> None:
    # The whole way: chip clock, low-pass delay, FIFO, bus. What the gyro feels tells
    # the true instant of a sample.
    bench = Bench(clock_error=clock_error, bus_hz=bus_hz, noise_counts=0)
    bench.chip.world.follow(saw)
    reader = bench.read(40, settings=ImuSettings(bandwidth_hz=bandwidth_hz))
    errors_ms = [error_ms(frame) for frame in bench.samples if frame.t_ns > 5 * S]
    assert max(map(abs, errors_ms)) < 0.8
    assert abs(sum(errors_ms)) / len(errors_ms) < 0.2
    assert max(abs(error_ms(frame)) for frame in bench.samples) < 6  # from the first
    assert reader.rate_hz == pytest.approx(100 * (1 + clock_error), rel=1e-3)
    assert all(a.t_ns < b.t_ns for a, b in pairwise(bench.samples))


@pytest.mark.parametrize("rate_hz", [25, 200, 1000])
def test_other_rates_are_drained_before_the_fifo_is_full(rate_hz: float) -> None:
    bench = Bench()
    settings = ImuSettings(rate_hz=rate_hz, bandwidth_hz=188)
    reader = bench.read(5, settings=settings)
    assert len(bench.samples) == pytest.approx(4.65 * rate_hz, rel=0.02)
    assert reader.health()["fifo_overflows"] == 0


def test_bursts_come_on_the_grid_of_the_host_and_a_little_in_the_past() -> None:
    bench = Bench(clock_error=0.02, noise_counts=0)
    bench.chip.world.follow(saw)
    bench.read(20, read="burst")
    steps = {b.t_ns - a.t_ns for a, b in pairwise(bench.samples)}
    assert steps == {10_000_000}
    assert max(abs(error_ms(frame)) for frame in bench.samples) < 0.8


def test_a_chip_without_our_fifo_is_read_by_bursts() -> None:
    bench = Bench(who_am_i=0x11)
    assert bench.read(2).chip_name == "ICM-20600"
    assert {b.t_ns - a.t_ns for a, b in pairwise(bench.samples)} == {10_000_000}


def test_a_single_nack_costs_nothing_but_a_count(bench: Bench) -> None:
    bench.at(5, bench.bus.nack)
    reader = bench.read(10)
    assert bench.longest_gap_s() < 0.015
    assert bench.events == ["imu_ready"]
    assert reader.health()["bus_errors"] == 1


def test_loose_wiring_is_lived_with(bench: Bench) -> None:
    for second in range(2, 20):
        bench.at(second, bench.bus.nack)
    reader = bench.read(20)
    assert bench.events == ["imu_ready"]
    assert reader.health()["bus_errors"] == 18
    assert reader.health()["reinitialisations"] == 0


def test_a_short_disturbance_costs_a_reinitialisation_and_no_event(
    bench: Bench,
) -> None:
    bench.bus.fail_between(5 * S, round(5.06 * S))
    reader = bench.read(10)
    assert bench.events == ["imu_ready"]
    assert reader.health()["reinitialisations"] <= 1
    assert bench.longest_gap_s() < 0.6


def test_a_fifo_read_that_breaks_off_costs_a_restart(bench: Bench) -> None:
    bench.at(5, lambda: bench.bus.nack(after=2, taken=9))
    reader = bench.read(10)
    assert bench.longest_gap_s() < 0.2
    assert bench.events == ["imu_ready"]
    assert reader.health()["fifo_restarts"] == 1


def test_a_stalled_host_costs_an_overflow_and_no_event(bench: Bench) -> None:
    bench.at(5, lambda: bench.clock.advance(s=3))
    reader = bench.read(10)
    assert bench.events == ["imu_ready"]
    health = reader.health()
    assert (health["fifo_overflows"], health["fifo_restarts"]) == (1, 1)
    assert health["missed_ticks"] == pytest.approx(54, abs=2)


@pytest.mark.parametrize("outage_s", [0.3, 2, 60])
@pytest.mark.parametrize("hang_s", [0, 1])
def test_samples_are_back_within_2_s_after_the_bus(
    bench: Bench, outage_s: float, hang_s: float
) -> None:
    bench.bus.fail_between(
        5 * S, round((5 + outage_s) * S), errno.ETIMEDOUT, hang_s=hang_s
    )
    reader = bench.read(70)
    assert bench.recovered_s(5 + outage_s) < 2
    assert bench.events[:1] == ["imu_ready"]
    assert reader.health()["bus_errors"] >= 1
    assert all(a.t_ns < b.t_ns for a, b in pairwise(bench.samples))


def test_an_outage_is_told_once_with_its_reason_and_once_that_it_is_over(
    bench: Bench,
) -> None:
    bench.bus.fail_between(5 * S, 35 * S)
    bench.read(40)
    assert bench.events == ["imu_ready", "imu_lost", "imu_ready"]
    assert "nobody answers" in bench.said


def test_a_chip_that_comes_late_is_waited_for(bench: Bench) -> None:
    chip = bench.bus.chips.pop(0x68)
    bench.at(30, lambda: bench.bus.chips.update({0x68: chip}))
    bench.read(35)
    assert bench.events == ["imu_lost", "imu_ready"]
    assert bench.recovered_s(30) < 2


def test_an_adapter_that_is_replugged_is_opened_again(bench: Bench) -> None:
    bench.at(5, bench.bus.unplug)
    bench.at(8, bench.bus.plug)
    bench.read(15)
    assert bench.events == ["imu_ready", "imu_lost", "imu_ready"]
    assert bench.recovered_s(8) < 2


def test_another_chip_may_be_plugged_in(bench: Bench) -> None:
    other = FakeMpu6050(bench.clock, who_am_i=0x70)
    bench.at(5, bench.bus.unplug)
    bench.at(6, lambda: bench.bus.chips.update({0x68: other}))
    bench.at(6, bench.bus.plug)
    assert bench.read(10).chip_name == "MPU-6500"


@pytest.mark.parametrize("read", ["fifo", "burst"])
def test_a_brown_out_is_repaired_within_1_s_and_told(bench: Bench, read: str) -> None:
    bench.at(5.5, bench.chip.brown_out)
    reader = bench.read(10, read=read)
    assert bench.longest_gap_s() < 1
    assert bench.events == ["imu_ready", "imu_reset"]
    assert reader.health()["reinitialisations"] == 1
    assert unpack(">7h", bench.samples[-1].data)[2] == pytest.approx(8192, abs=30)


@pytest.mark.parametrize("read", ["fifo", "burst"])
def test_a_wedged_chip_is_reset(bench: Bench, read: str) -> None:
    def wedge() -> None:
        bench.chip.is_wedged = True

    bench.at(5, wedge)
    reader = bench.read(10, read=read)
    health = reader.health()
    assert health["reinitialisations"] == 1
    assert health["frozen_frames"] >= 25
    assert bench.events == ["imu_ready", "imu_reset"]
    assert len({frame.data for frame in bench.samples if frame.t_ns > 6 * S}) > 300


@pytest.mark.parametrize("read", ["fifo", "burst"])
def test_a_chip_that_is_dead_but_answers_is_lost_and_not_delivered(read: str) -> None:
    bench = Bench(bursts=islice(numbered_frames(), 800))
    bench.read(60, read=read)
    assert bench.events == ["imu_ready", "imu_lost"]
    assert "repeats the same sample" in bench.said
    assert 10 < len(bench.samples) < 900


def test_a_chip_that_forgets_at_once_is_lost(bench: Bench) -> None:
    for tenth in range(40, 200):
        bench.at(tenth / 10, bench.chip.brown_out)
    bench.read(25)
    assert bench.events == ["imu_ready", "imu_lost", "imu_ready"]


def test_misaligned_frames_twice_in_a_row_cause_a_full_reinitialisation() -> None:
    bench = Bench(bursts=numbered_frames())

    def take_a_byte() -> None:
        bench.chip.read(0x74, 1)

    for ms in range(5000, 5200, 10):
        bench.at(ms / 1000 + 0.005, take_a_byte)
    reader = bench.read(10)
    assert reader.health()["reinitialisations"] >= 1
    numbers = [number_of(frame.data) for frame in bench.samples]
    assert numbers == sorted(set(numbers))


def test_an_unknown_chip_is_refused_unless_it_is_allowed() -> None:
    bench = Bench(who_am_i=0x72)
    bench.read(3)
    assert bench.events == ["imu_lost"]
    assert "allow_unknown_chip" in bench.said
    bench = Bench(who_am_i=0x72)
    bench.read(3, allow_unknown=True)
    assert bench.events == ["imu_ready"]


def test_the_other_address_works() -> None:
    bench = Bench()
    bench.bus.chips = {0x69: bench.chip}
    bench.read(2, address=0x69)
    assert bench.events == ["imu_ready"]


def test_a_bug_ends_the_thread_and_is_handed_to_the_loop(bench: Bench) -> None:
    bug = ZeroDivisionError("a bug")

    def open_bus() -> Any:
        raise bug

    reader = ImuReader(open_bus, bench.frames.append, bench.clock)
    reader.start()
    reader.join()
    assert reader.error is bug
    assert bench.events == ["imu_failed"]


def test_the_thread_starts_stops_and_can_be_joined(bench: Bench) -> None:
    reader = ImuReader(bench.bus.open, bench.frames.append, bench.clock)
    bench.at(2, reader.stop)
    reader.start()
    reader.join(timeout_s=30)
    assert not reader.is_alive()
    assert reader.error is None
    assert bench.samples


def test_the_thread_shows_that_it_turns_even_while_the_bus_hangs(bench: Bench) -> None:
    reader = ImuReader(bench.bus.open, bench.frames.append, bench.clock)
    bench.bus.fail_between(2 * S, 20 * S, errno.ETIMEDOUT, hang_s=1)
    ages_s: list[float] = []
    for second in range(1, 30):
        bench.at(
            second,
            lambda: ages_s.append((bench.clock.now_ns() - reader.turned_ns) / S),
        )
    bench.at(30, reader.stop)
    reader.run()
    assert max(ages_s) < 3
