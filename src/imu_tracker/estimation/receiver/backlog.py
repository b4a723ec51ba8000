"""A receiver that sends more than its line carries.

Its epochs wait in its own buffer, each longer than the one before. Sentences and
checksums are right, but they describe a position of seconds ago. It is detected by the
host's clock: arrival less UTC must not grow.
"""

from collections import Counter, deque
from collections.abc import Iterable
from typing import Final

from imu_tracker.samples import GpsFix, UtcTime

EPOCHS: Final = 12
GROWN_NS: Final = 500_000_000
"""Over so many epochs, each later than the one before: latencies jitter, and those of
receivers that smooth come and go by a second within a minute."""

LARGEST_SHARE: Final = 0.6
"""Of the growth in a single step: more is a receiver that has changed its mind about
the time."""

RELIEVED_NS: Final = 150_000_000
ABSURD_NS: Final = 60_000_000_000  # no buffer holds so much: the time was changed

CREEP: Final = 1e-4
"""The two clocks drift apart by less than this; the least lag is forgotten so fast."""


class Backlog:
    """Compares arrivals with UTC, and takes the waiting out of the arrivals.

    Attributes
    ----------
    counters : Counter
        `overdue_epochs`: had waited at the other end of an overloaded line.
    """

    def __init__(self) -> None:
        self.counters: Counter[str] = Counter()
        self._lags: deque[int] = deque(maxlen=EPOCHS)
        self._least_ns, self._last_ns = 0, 0
        self._is_overloaded = False
        self._notices: list[str] = []

    def relieved(self, epochs: Iterable[GpsFix | UtcTime]) -> list[GpsFix | UtcTime]:
        """Return fixes and times as if the line had been free when they were sent."""
        return [self._relieve(each) for each in epochs]

    def _relieve(self, epoch: GpsFix | UtcTime) -> GpsFix | UtcTime:
        if epoch.utc_s is None:
            return epoch
        lag_ns = epoch.t_ns - round(epoch.utc_s * 1e9)
        self._learn(epoch.t_ns, lag_ns)
        waited_ns = lag_ns - self._least_ns
        if not self._is_overloaded and self._grows(waited_ns):
            self._is_overloaded = True
            self._notices.append(
                "the receiver sends more than its line carries, and comes later and "
                "later: raise its speed, or have it send less"
            )
        elif self._is_overloaded and waited_ns < RELIEVED_NS:
            self._is_overloaded = False
            self._notices.append("the receiver's epochs come in time again")
        if not self._is_overloaded:
            return epoch
        self.counters["overdue_epochs"] += 1
        return epoch._replace(t_ns=epoch.t_ns - waited_ns)

    def take_notices(self) -> list[str]:
        """Transitions since the last call."""
        notices, self._notices = self._notices, []
        return notices

    def _learn(self, t_ns: int, lag_ns: int) -> None:
        if not self._lags or abs(lag_ns - self._lags[-1]) > ABSURD_NS:
            self._lags.clear()
            self._least_ns, self._is_overloaded = lag_ns, False
        self._lags.append(lag_ns)
        self._least_ns += round(CREEP * max(0, t_ns - self._last_ns))
        self._least_ns, self._last_ns = min(self._least_ns, lag_ns), t_ns

    def _grows(self, waited_ns: int) -> bool:
        lags = self._lags
        if len(lags) < EPOCHS or waited_ns < GROWN_NS:
            return False
        steps = [b - a for a, b in zip(lags, list(lags)[1:], strict=False)]
        grown_ns = lags[-1] - lags[0]
        return (
            grown_ns >= GROWN_NS
            and min(steps) > 0
            and max(steps) <= LARGEST_SHARE * grown_ns
        )
