"""Time for the sensor threads: the clock, a fixed grid, and a back-off.

A clock is an argument everywhere, so a test drives hours in no time. What a
newcomer gets wrong: a thread must not sleep deaf. Every wait takes the event that
tells the thread to stop, and ends with it.
"""

import time
from threading import Event
from typing import Final, Protocol

SECOND_NS: Final = 1_000_000_000
MILLISECOND_NS: Final = 1_000_000


class Clock(Protocol):
    """CLOCK_MONOTONIC, or what a test puts in its place."""

    def now_ns(self) -> int:
        """Tell the time."""
        ...

    def sleep_until_ns(self, t_ns: int, stop: Event | None = None) -> bool:
        """Wait until `t_ns` or until `stop` is set; return whether it is set."""
        ...


class MonotonicClock:
    """The host's CLOCK_MONOTONIC."""

    def now_ns(self) -> int:
        """Tell the time."""
        return time.monotonic_ns()

    def sleep_until_ns(self, t_ns: int, stop: Event | None = None) -> bool:
        """Wait until `t_ns` or until `stop` is set; return whether it is set."""
        wait_s = max(0, t_ns - self.now_ns()) / SECOND_NS
        if stop is not None:
            return stop.wait(wait_s)
        time.sleep(wait_s)
        return False


class Pacer:
    """Wake on a fixed grid; skip missed slots instead of bursting to catch up.

    Parameters
    ----------
    clock : Clock
    period_ns : int
        Distance of the slots; the first is one period from now. The owner may change
        it: it counts from the next slot on.
    """

    def __init__(self, clock: Clock, period_ns: int) -> None:
        self._clock, self.period_ns, self._missed_ticks = clock, period_ns, 0
        self._next_ns = clock.now_ns() + period_ns

    def wait(self, stop: Event | None = None) -> bool:
        """Wait for the next slot or for `stop`; return whether `stop` is set."""
        late_ns = self._clock.now_ns() - self._next_ns
        skipped = max(0, late_ns) // self.period_ns
        self._missed_ticks += skipped
        self._next_ns += skipped * self.period_ns
        is_stopped = self._clock.sleep_until_ns(self._next_ns, stop)
        self._next_ns += self.period_ns
        return is_stopped

    def take_missed(self) -> int:
        """Return how many slots went by unused since the last call."""
        missed, self._missed_ticks = self._missed_ticks, 0
        return missed


class Backoff:
    """How long to wait before the next attempt: doubling from first to last.

    Deterministic on purpose: one device, one thread, nobody to collide with.
    """

    def __init__(self, first_ns: int, last_ns: int) -> None:
        self._first_ns, self._last_ns, self._next_ns = first_ns, last_ns, first_ns

    def next_ns(self) -> int:
        """Return the pause before the next attempt."""
        pause_ns = self._next_ns
        self._next_ns = min(2 * pause_ns, self._last_ns)
        return pause_ns

    def reset(self) -> None:
        """Start over: an attempt succeeded."""
        self._next_ns = self._first_ns
