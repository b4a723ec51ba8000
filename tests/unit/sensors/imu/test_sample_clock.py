"""Instants of samples, fitted from counts alone."""

from collections.abc import Callable
from itertools import pairwise
from math import ceil, floor

import numpy as np
import pytest

from imu_tracker.sensors.imu.sample_clock import SampleClock
from imu_tracker.sensors.imu.sources import drain_period_ns

MS = 1_000_000


class Chip:
    """Counts samples: the n-th becomes complete at `phase + n * period`."""

    def __init__(
        self, rate_hz: float, error: float, phase_ns: float = 3.3 * MS
    ) -> None:
        self.period_ns = 1e9 / rate_hz / (1 + error)
        self.phase_ns, self.taken = phase_ns, 0

    def look(self, t_ns: float) -> int:
        """Return how many samples became complete since the last look."""
        total = floor((t_ns - self.phase_ns) / self.period_ns)
        count, self.taken = total - self.taken, total
        return count

    def truth_ns(self, count: int) -> list[float]:
        first = self.taken - count + 1
        return [self.phase_ns + n * self.period_ns for n in range(first, first + count)]


def errors_ms(
    chip: Chip,
    clock: SampleClock,
    seconds: float,
    rate_hz: float,
    delay_ns: Callable[[], float] = lambda: 0.0,
) -> list[tuple[float, float]]:
    """Look for a while; return the time and the error of every stamp."""
    found, period_ns = [], drain_period_ns(rate_hz, 73)
    for slot in range(1, ceil(seconds * 1e9 / period_ns)):
        late_ns = delay_ns()
        latched_ns = slot * period_ns + 0.1 * MS + late_ns
        count = chip.look(latched_ns)
        stamps = clock.stamp(
            count, round(slot * period_ns), round(latched_ns + 0.1 * MS)
        )
        truth = chip.truth_ns(count)
        found += [(t / 1e9, (s - t) / MS) for s, t in zip(stamps, truth, strict=True)]
    return found


@pytest.mark.parametrize("error", [-0.02, -0.01, 0.0, 0.0137, 0.02])
@pytest.mark.parametrize("rate_hz", [25, 100, 200, 1000])
def test_stamps_are_within_a_tenth_of_a_period_whatever_the_chips_clock(
    rate_hz: float, error: float
) -> None:
    clock = SampleClock(rate_hz, 0)
    found = errors_ms(Chip(rate_hz, error), clock, 60, rate_hz)
    period_ms = 1000 / rate_hz
    late = [abs(e) for t, e in found if t > 10]
    assert max(late) < 0.1 * period_ms + 0.1
    assert max(abs(e) for _, e in found) < 1.5 * period_ms
    assert clock.rate_hz == pytest.approx(rate_hz * (1 + error), rel=2e-4)


def test_a_host_that_is_interrupted_inside_a_look_does_no_harm() -> None:
    # The scheduler may strike between reading the clock and latching the count.
    random = np.random.default_rng(6)
    clock, chip = SampleClock(100, 0), Chip(100, 0.015)
    found = errors_ms(
        chip, clock, 60, 100, lambda: 40 * MS * float(random.random() < 0.1)
    )
    assert max(abs(e) for t, e in found if t > 10) < 1.5


def test_stamps_follow_a_chip_that_warms_up() -> None:
    chip, clock = Chip(100, 0.01), SampleClock(100, 0)
    worst_ms, period_ns = 0.0, drain_period_ns(100, 73)
    for slot in range(1, 6000):
        chip.phase_ns += chip.taken * chip.period_ns * 1e-7  # 0.1 ppm a look, 5 min
        chip.period_ns *= 1 - 1e-7
        count = chip.look(slot * period_ns)
        stamps = clock.stamp(count, slot * period_ns, slot * period_ns)
        if slot > 200 and count:
            worst_ms = max(worst_ms, abs(stamps[-1] - chip.truth_ns(count)[-1]) / MS)
    assert worst_ms < 1.0


def test_stamps_grow_strictly_and_evenly() -> None:
    clock, chip, stamps = SampleClock(100, 0), Chip(100, 0.02), []
    for slot in range(1, 400):
        stamps += clock.stamp(chip.look(slot * 53 * MS), slot * 53 * MS, slot * 53 * MS)
    steps_ms = [(b - a) / MS for a, b in pairwise(stamps)]
    assert min(steps_ms) > 8
    assert max(steps_ms) < 12
    assert steps_ms[-1] == pytest.approx(10 / 1.02, rel=0.02)


def test_no_sample_is_from_the_future() -> None:
    clock, chip = SampleClock(100, 0), Chip(100, -0.02)
    for slot in range(1, 400):
        now_ns = slot * 53 * MS
        assert all(t <= now_ns for t in clock.stamp(chip.look(now_ns), now_ns, now_ns))


def test_the_delay_of_the_filter_is_taken_off() -> None:
    plain, delayed = SampleClock(100, 0), SampleClock(100, 4_800_000)
    for now_ns in (50 * MS, 103 * MS):
        stamps = plain.stamp(5, now_ns, now_ns)
        assert delayed.stamp(5, now_ns, now_ns) == [t - 4_800_000 for t in stamps]


def test_after_a_restart_the_phase_is_new_and_the_period_is_kept() -> None:
    clock, chip = SampleClock(100, 0), Chip(100, 0.02)
    errors_ms(chip, clock, 30, 100)
    clock.restart()
    chip.phase_ns += 4.2 * MS
    assert clock.stamp(0, 30_000 * MS, 30_000 * MS) == []
    chip.look(30_050 * MS)
    stamps = clock.stamp(5, 30_050 * MS, 30_050 * MS)
    assert len(stamps) == 5
    assert stamps[1] - stamps[0] == pytest.approx(10 * MS / 1.02, rel=1e-3)
    assert abs(stamps[-1] - chip.truth_ns(1)[0]) < 5 * MS


def test_stamps_grow_even_if_the_counts_are_absurd() -> None:
    clock = SampleClock(100, 0)
    stamps = clock.stamp(5, 50 * MS, 50 * MS)
    clock.restart()
    stamps += clock.stamp(70, 60 * MS, 60 * MS)
    stamps += clock.stamp(70, 61 * MS, 61 * MS)
    assert all(a < b for a, b in pairwise(stamps))
