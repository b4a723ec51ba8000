"""The time between fixes: the only place where it is measured."""

from typing import Final

from imu_tracker.estimation.tuning import PAUSE_S
from imu_tracker.samples import GpsFix

SMOOTHING: Final = 0.1
"""Share of a new interval: jitter of arrival evens out over ten fixes."""


class FixPeriod:
    """Learns how often fixes come; a fix that is added twice counts once.

    Attributes
    ----------
    mean_s : float
        Smoothed; 1 s before two fixes came.
    shortest_ns : int
        Of the last two intervals: an outage is none.
    """

    def __init__(self) -> None:
        self.mean_s = 1.0
        self._last_ns: int | None = None
        self._intervals_ns = (1_000_000_000, 1_000_000_000)

    @property
    def shortest_ns(self) -> int:
        """The shorter one of the last two intervals."""
        return min(self._intervals_ns)

    def add_fix(self, fix: GpsFix) -> None:
        """Take the arrival of a fix."""
        last_ns = self._last_ns
        if last_ns is not None and fix.t_ns > last_ns:
            interval_ns = fix.t_ns - last_ns
            self._intervals_ns = (self._intervals_ns[1], interval_ns)
            if interval_ns * 1e-9 < PAUSE_S:
                self.mean_s += SMOOTHING * (interval_ns * 1e-9 - self.mean_s)
        self._last_ns = fix.t_ns
