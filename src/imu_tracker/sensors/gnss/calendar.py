"""Which day a time of day belongs to, and the weeks that old receivers lose.

GPS counts weeks modulo 1024, so a receiver that outlived its firmware reports dates
19.6 years back. What a newcomer gets wrong: around midnight a time without a date is
not of the day of the last date seen.
"""

from datetime import date
from math import ceil
from typing import Final

from imu_tracker import RELEASE_DATE

DAY_S: Final = 86_400.0
ROLLOVER_WEEKS: Final = 1024
ROLLOVER_S: Final = ROLLOVER_WEEKS * 7 * DAY_S


UNSURE_S: Final = 2.0 * DAY_S
"""A reference may be the day alone, and lack the time zone."""

LATE_DATE_S: Final = 2.0 * 365.25 * DAY_S
"""Dates so long before the release are taken as they are sent."""

LIFE_S: Final = 10.0 * 365.25 * DAY_S
"""A release is in use for so long: of the 19.6 years that a rollover leaves open, a
date of manufacture falls into the others."""


def release_utc_s() -> float:
    """Return when this program was released."""
    return _midnight_s(RELEASE_DATE)


def rollovers_before(sent_utc_s: float, earliest_utc_s: float) -> int:
    """Return how many rollovers a date lacks that lies far before the release.

    A date a little before it is a clock that runs late, or a receiver that is right;
    what lies further back has lost whole rollovers.
    """
    return max(0, ceil((earliest_utc_s - LATE_DATE_S - sent_utc_s) / ROLLOVER_S))


class Calendar:
    """Turns times of day into UTC.

    Parameters
    ----------
    reference_utc_s : float, optional
        UTC when the stream begins (the `start_utc` of a recording). Times without a
        date begin here, and a sent date that is whole rollovers off is corrected.
    day : str
        YYYY-MM-DD of the first time of day, for receivers that send no date; used
        without a reference.
    earliest_utc_s : float, optional
        Without a reference: the program's release. A sent date that lies about
        1024 weeks or a multiple of that before it gets them added; one that lies
        some weeks or years before it is taken as it is.

    Notes
    -----
    A time without a date goes next to where the clock must be by now: the last date
    and time that were known, plus the stream time since. So neither midnight nor an
    outage of days needs care. Dates that come without a fix are those of a clock with a
    battery, or of the manufacture: they count until the first that comes with one, and
    only when they may be true, two days around what is known, or in the years
    after the release. For rows that have begun at a wrong date can never go back.
    """

    def __init__(
        self,
        *,
        reference_utc_s: float | None = None,
        day: str = "",
        earliest_utc_s: float | None = None,
    ) -> None:
        self._reference_utc_s, self._earliest_utc_s = reference_utc_s, earliest_utc_s
        self._first_midnight_s = _midnight_s(day) if day else None
        self._known: tuple[int, float] | None = None  # t_ns, utc_s
        self._is_sure = False
        self.rollovers = 0  # that the last date lacked

    @property
    def is_known(self) -> bool:
        """Whether the day is known."""
        return self._known is not None

    def begin(self, t_ns: int) -> None:
        """Note that the stream is at `t_ns`; the first call counts."""
        if self._known is None and self._reference_utc_s is not None:
            self._known = t_ns, self._reference_utc_s

    def learn(self, t_ns: int, sent_utc_s: float, *, is_sure: bool) -> None:
        """Take a date and time as sent; they are sure when there was a fix."""
        if self._is_sure and not is_sure:
            return
        rollovers = self._missing_rollovers(sent_utc_s)
        utc_s = sent_utc_s + rollovers * ROLLOVER_S
        if is_sure or self._may_be(t_ns, utc_s):
            self.rollovers, self._known, self._is_sure = (
                rollovers,
                (t_ns, utc_s),
                is_sure,
            )

    def utc_s(self, t_ns: int, tod_s: float) -> float | None:
        """Return the UTC of a time of day that arrived at `t_ns`, if known."""
        if self._known is None:
            if self._first_midnight_s is None:
                return None
            self._known = t_ns, self._first_midnight_s + tod_s
        known_t_ns, known_utc_s = self._known
        expected_utc_s = known_utc_s + (t_ns - known_t_ns) / 1e9
        return round((expected_utc_s - tod_s) / DAY_S) * DAY_S + tod_s

    def _may_be(self, t_ns: int, utc_s: float) -> bool:
        """Whether a date that came without a fix is worth anything."""
        if self._reference_utc_s is not None and self._known is not None:
            known_t_ns, known_utc_s = self._known
            expected_utc_s = known_utc_s + (t_ns - known_t_ns) / 1e9
            return abs(utc_s - expected_utc_s) < UNSURE_S
        if self._earliest_utc_s is not None:
            return 0 <= utc_s - self._earliest_utc_s < LIFE_S
        return True

    def _missing_rollovers(self, sent_utc_s: float) -> int:
        if self._reference_utc_s is not None:
            return round((self._reference_utc_s - sent_utc_s) / ROLLOVER_S)
        if self._earliest_utc_s is not None:
            return rollovers_before(sent_utc_s, self._earliest_utc_s)
        return 0


def _midnight_s(day: str) -> float:
    return (date.fromisoformat(day) - date(1970, 1, 1)).days * DAY_S
