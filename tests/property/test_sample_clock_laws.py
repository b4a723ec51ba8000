"""Whenever the host looks: stamps grow, and stay near the truth."""

from itertools import pairwise
from math import floor

from hypothesis import given
from hypothesis import strategies as st

from imu_tracker.sensors.imu.sample_clock import SampleClock

PERIOD_NS = 10_000_000


@given(
    pauses_us=st.lists(st.integers(1, 700_000), min_size=1, max_size=60),
    widths_us=st.lists(st.integers(0, 20_000), min_size=60, max_size=60),
    error=st.floats(-0.02, 0.02),
    phase=st.floats(0, 1),
    restarts=st.sets(st.integers(0, 59), max_size=3),
)
def test_stamps_grow_and_are_never_off_by_much_more_than_a_period(
    pauses_us: list[int],
    widths_us: list[int],
    error: float,
    phase: float,
    restarts: set[int],
) -> None:
    clock, period_ns = SampleClock(1e9 / PERIOD_NS, 0), PERIOD_NS / (1 + error)
    now_ns, taken, stamps = 10 * PERIOD_NS, 0, [0]
    for look, (pause_us, width_us) in enumerate(
        zip(pauses_us, widths_us, strict=False)
    ):
        now_ns += pause_us * 1000
        total = floor(now_ns / period_ns - phase)
        if look in restarts:
            clock.restart()
            taken = total  # the FIFO was emptied
            continue
        count, taken = total - taken, total
        new = clock.stamp(count, now_ns - width_us * 1000, now_ns)
        assert len(new) == count
        newest_ns = (total + phase) * period_ns
        slack_ns = 1.1 * PERIOD_NS + width_us * 1000
        assert all(abs(t - newest_ns) < slack_ns for t in new[-1:])
        stamps += new
    assert all(a < b for a, b in pairwise(stamps))
