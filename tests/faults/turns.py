"""A fake clock for several threads: they take turns, and every run is the same."""

import threading
from collections.abc import Callable
from heapq import heappop, heappush
from itertools import count
from typing import Final

MILLISECOND_NS: Final = 1_000_000


class _Sleeper:
    """A thread that waits for its turn; a turn of an older ticket is stale."""

    def __init__(self) -> None:
        self.baton, self.ticket = threading.Lock(), 0
        self.baton.acquire()


class TurnClock:
    """Satisfies `imu_tracker.sensors.clock.Clock`, for all threads of a daemon.

    Exactly one thread runs at a time; when it sleeps, the one that is due next goes
    on, and time leaps to its instant. `at` plans what the world does meanwhile.
    """

    def __init__(self, now_ns: int) -> None:
        self._now_ns = now_ns
        self._order = count()
        self._due: list[tuple[int, int, Callable[[], object] | _Sleeper, int]] = []
        self._own = threading.local()

    def now_ns(self) -> int:
        return self._now_ns

    def at(self, t_ns: int, action: Callable[[], object]) -> None:
        """Plan `action` for the instant `t_ns`."""
        heappush(self._due, (t_ns, next(self._order), action, 0))

    def stall(self, stall_ns: int) -> None:
        """Let time pass in which nobody gets his turn: a host that stood still."""
        self._now_ns += stall_ns

    def sleep_until_ns(self, t_ns: int, stop: threading.Event | None = None) -> bool:
        if stop is not None and stop.is_set():
            return True
        if self._due and self._due[0][0] <= t_ns:
            me = self._me()
            self._queue(me, t_ns)
            self._pass_on(me)
        else:
            self._now_ns = max(self._now_ns, t_ns)
        return stop is not None and stop.is_set()

    def _me(self) -> _Sleeper:
        if not hasattr(self._own, "sleeper"):
            self._own.sleeper = _Sleeper()
        sleeper: _Sleeper = self._own.sleeper
        return sleeper

    def _queue(self, sleeper: _Sleeper, t_ns: int) -> None:
        heappush(self._due, (t_ns, next(self._order), sleeper, sleeper.ticket))

    def _pass_on(self, me: _Sleeper | None) -> None:
        """Let others run until it is one's own turn; None: for ever."""
        while True:
            due_ns, _, what, ticket = heappop(self._due)
            if isinstance(what, _Sleeper):
                if what.ticket != ticket:
                    continue
                what.ticket += 1
                self._now_ns = max(self._now_ns, due_ns)
                if what is me:
                    return
                what.baton.release()
                if me is not None:
                    me.baton.acquire()
                return
            self._now_ns = max(self._now_ns, due_ns)
            what()


class Turner:
    """A thread that runs when the clock gives it a turn, in place of a real one."""

    def __init__(self, clock: TurnClock, target: Callable[[], None]) -> None:
        self._clock, self._target = clock, target
        self._sleeper, self._is_over = _Sleeper(), False
        self._thread = threading.Thread(target=self._run, daemon=True)

    def start(self) -> None:
        self._clock._queue(self._sleeper, self._clock.now_ns())
        self._thread.start()

    def wake(self) -> None:
        """End a sleep: what it waits for has happened."""
        if not self._is_over:  # else the turn would be nobody's
            self._clock._queue(self._sleeper, self._clock.now_ns())

    def join(self, timeout_s: float | None) -> None:
        assert timeout_s is not None, "SIGTERM must not wait for ever"
        end_ns = self._clock.now_ns() + round(timeout_s * 1e9)
        while not self._is_over and self._clock.now_ns() < end_ns:
            self._clock.sleep_until_ns(self._clock.now_ns() + MILLISECOND_NS)
        if self._is_over:
            self._thread.join()

    def _run(self) -> None:
        self._sleeper.baton.acquire()
        self._clock._own.sleeper = self._sleeper
        try:
            self._target()
        finally:
            self._is_over = True
            self._clock._pass_on(None)
