"""When rows are due, and which sensors they rest on.

Rows lie on the grid of UTC, and never use what arrived after them.
"""

from collections.abc import Callable, Iterator
from typing import Final

from imu_tracker.estimation.receiver.fix_period import FixPeriod
from imu_tracker.estimation.receiver.utc import UtcClock
from imu_tracker.notices import Flapping
from imu_tracker.samples import GpsFix, Mode

GPS_MODE_NS: Final = 2_000_000_000
GPS_MODE_PERIODS: Final = 1.5
"""A row is `gps` when a fix was used within the longer of these."""

_NOTICES: Final = {
    (True, True): "GPS in use",
    (True, False): "{no_gps}: dead reckoning",
    (False, True): "IMU unavailable: GPS alone",
    (False, False): "IMU unavailable, {no_gps}",
}
"""By whether there is an IMU, and whether there is a receiver."""


class RowGrid:
    """Whole periods of UTC, from the first instant at which UTC is known.

    Parameters
    ----------
    rate_hz : int
    notify : callable
        Takes messages for the log.

    Attributes
    ----------
    next_utc_ns : int or None
        Of the next row; None before the grid has begun.
    """

    def __init__(self, rate_hz: int, notify: Callable[[str], None]) -> None:
        self.period_ns = 1_000_000_000 // rate_hz
        self.next_utc_ns: int | None = None
        self._notify = notify

    def due(
        self, utc: UtcClock, begin_ns: int, now_ns: int, step_ns: int
    ) -> Iterator[tuple[int, int]]:
        """Yield the instant and the UTC, ns, of each row up to `step_ns`.

        The grid begins at `begin_ns` at the earliest, once UTC is settled.
        """
        if self.next_utc_ns is None:
            settled_ns = utc.settled_ns
            if settled_ns is None or now_ns < settled_ns:
                return
            utc.start_rows()
            begin_utc_ns = utc.row_utc_ns(max(begin_ns, settled_ns))
            self.next_utc_ns = self._rounded_up(begin_utc_ns)
        while (row_ns := utc.row_instant_ns(self.next_utc_ns)) <= step_ns:
            yield row_ns, self.next_utc_ns
            self.next_utc_ns += self.period_ns
            if hole_ns := utc.slew(self.period_ns):
                self.next_utc_ns += self._rounded_up(hole_ns)
                way = "forward" if hole_ns > 0 else "back"
                self._notify(
                    f"rows jump {way} by {abs(hole_ns) * 1e-9:.1f} s, as the receiver "
                    "corrected its time: earlier rows may be dated wrong by as much"
                )

    def _rounded_up(self, utc_ns: int) -> int:
        return -(-utc_ns // self.period_ns) * self.period_ns


class ModeMonitor:
    """Tells from which sensors a row comes, and reports changes.

    Parameters
    ----------
    period : FixPeriod
    notify : callable
        Takes messages for the log.
    """

    def __init__(self, period: FixPeriod, notify: Callable[[str], None]) -> None:
        self._period, self._notify = period, notify
        self._fix_ns: int | None = None
        self._used_ns: int | None = None
        self._imu_flapping = Flapping()
        self._last_notice = ""

    def add_fix(self, fix: GpsFix) -> None:
        """Take the arrival of a fix."""
        self._fix_ns = fix.t_ns

    def set_used(self, now_ns: int) -> None:
        """Note that the estimator has used a fix now."""
        self._used_ns = now_ns

    def mode_at(
        self, row_ns: int, *, has_imu: bool, is_resting: bool, is_imu_out: bool
    ) -> Mode:
        """Return the mode of a row.

        Parameters
        ----------
        row_ns : int
        has_imu : bool
            Whether the last step has samples; one that flaps does not count.
        is_resting : bool
        is_imu_out : bool
            Whether the estimator follows the receiver against the IMU.
        """
        has_imu = self._imu_flapping.counts(row_ns, has_imu)
        window_ns = max(GPS_MODE_NS, int(GPS_MODE_PERIODS * self._period.shortest_ns))
        has_gps = self._used_ns is not None and row_ns - self._used_ns <= window_ns
        no_gps = "no GPS yet" if self._used_ns is None else "GPS lost"
        if self._fix_ns is not None and row_ns - self._fix_ns <= window_ns:
            no_gps = "fixes do not fit"
        notice = _NOTICES[has_imu, has_gps].format(no_gps=no_gps)
        if notice != self._last_notice:
            self._last_notice = notice
            self._notify(notice)
        if not has_imu or is_imu_out:
            return Mode.GPSONLY
        if is_resting:
            return Mode.STILL
        return Mode.GPS if has_gps else Mode.DR
