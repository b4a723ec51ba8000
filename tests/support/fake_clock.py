"""A clock that moves only when somebody sleeps on it."""

from collections.abc import Callable
from heapq import heappop, heappush
from itertools import count
from threading import Event


class FakeClock:
    """Satisfies `imu_tracker.sensors.clock.Clock`; sleeping costs no time.

    `at` plans what the world does at an instant: pull a cable, set an event. It
    happens when time passes over the instant, in order.
    """

    def __init__(self, now_ns: int = 1_000_000_000) -> None:
        self._now_ns = now_ns
        self._plans: list[tuple[int, int, Callable[[], object]]] = []
        self._order = count()

    def now_ns(self) -> int:
        return self._now_ns

    def sleep_until_ns(self, t_ns: int, stop: Event | None = None) -> bool:
        while not (stop and stop.is_set()):
            if not self._plans or self._plans[0][0] > t_ns:
                self._now_ns = max(self._now_ns, t_ns)
                return False
            due_ns, _, action = heappop(self._plans)
            self._now_ns = max(self._now_ns, due_ns)
            action()
        return True

    def advance(self, *, s: float = 0, ms: float = 0, ns: int = 0) -> None:
        """Let time pass."""
        self.sleep_until_ns(self._now_ns + round(s * 1e9 + ms * 1e6) + ns)

    def at(self, t_ns: int, action: Callable[[], object]) -> None:
        """Plan `action` for the instant `t_ns`."""
        heappush(self._plans, (t_ns, next(self._order), action))
