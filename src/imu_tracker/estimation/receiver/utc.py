"""UTC against the host's monotonic clock, learnt from the receiver.

An epoch carries a time, and arrives later by a latency that jitters, or by many seconds
when a buffer was full of old ones. The true relation of the two clocks
hardly changes; so the median over many epochs gives it, and with it the
instant that a single epoch describes. Rows are put on the grid of UTC by a copy of the
relation that only slews.
"""

from collections import deque
from statistics import median_low
from typing import Final

from imu_tracker.samples import GpsFix

WINDOW_EPOCHS: Final = 40
"""Epochs whose median is the relation: half a minute at 1 Hz evens out the jitter."""

STALE_NS: Final = 2_000_000_000
"""Beyond the spread of any receiver's latency; an epoch later than this against the
freshest one waited in a buffer."""

JUMP_EPOCHS: Final = 3
JUMP_NS: Final = 1_800_000_000
"""A receiver that says another time so often, for so long (three at 1 Hz, less their
jitter), has changed its mind: leap seconds arrive with the almanac, up to 12 minutes
after a cold start. A port that works off a backlog says another one with each epoch."""

WHOLE_NS: Final = 1_000_000_000
NEAR_NS: Final = 150_000_000
"""A receiver that changes its mind does so from one epoch to the next, and by whole
seconds: so near to them, for latencies jitter. One that smooths comes later and later
until it is a second late."""

SETTLE_NS: Final = 300_000_000
"""Before the first row: a burst of old epochs in a full buffer has passed by then."""

SLEW: Final = 0.1
"""Rows move by this part of their period at most, until they agree."""

HOLE_NS: Final = 5_000_000_000
BACK_NS: Final = 60_000_000_000
"""A correction forward by more than 5 s is taken at once and leaves a hole in the rows'
times; one backward by more than a minute makes them go back, and a new log begin. To
slew these in would take minutes, or for ever."""

SURE_EPOCHS: Final = 20
MAX_SURE_EPOCHS: Final = 1280
"""A step is only taken when so many epochs agree, and each step doubles the number for
the next one: a date that moves back and forth is doubted, not followed."""

STEADY_EPOCHS: Final = 86_400
"""After a day of them at 1 Hz the receiver is believed as at the start."""

LEAPS_NS: Final = 20_000_000_000
"""Between GPS time and UTC lie 18 s. Rows that are dated wrong by more than that are
right of their place, and wrong of the time."""


class UtcClock:
    """`utc = t + offset`, all integers in nanoseconds.

    Parameters
    ----------
    latency_ns : int
        Time from the instant an epoch describes to its first byte, typically.

    Attributes
    ----------
    latency_ns : int
        As it was given: an estimator may find that fixes are later still.
    jumps : int
        How often the receiver changed its mind.
    holes : int
        How often the rows' times went forward or back at once.
    is_uncertain : bool
        Whether it may just have done so: what the last epoch describes, nobody knows.
    """

    def __init__(self, latency_ns: int) -> None:
        self.latency_ns = latency_ns
        self._offsets: deque[int] = deque(maxlen=WINDOW_EPOCHS)
        self._candidates: list[tuple[int, int]] = []
        self._offset_ns: int | None = None
        self._shown_ns: int | None = None
        self._first_ns: int | None = None
        self._told_ns: int | None = None  # the relation by the last epoch alone
        self._n_agreeing = 0  # epochs since the relation last changed
        self._n_sure = SURE_EPOCHS  # to be enough for a step
        self.jumps = 0
        self.holes = 0
        self.is_uncertain = False

    @property
    def is_sure(self) -> bool:
        """Whether enough epochs agree on the relation, and so on the date."""
        return self._n_agreeing >= SURE_EPOCHS

    def follows(self, jump_s: float) -> str:
        """Say when the rows follow a receiver that jumped."""
        if -BACK_NS <= jump_s * 1e9 <= HOLE_NS:
            return "the rows' follows slowly"
        n = self._n_sure
        is_fickle = n > SURE_EPOCHS
        why = "it moves back and forth, " if is_fickle else ""
        return f"{why}the rows' follows once {n} fixes agree"

    @property
    def settled_ns(self) -> int | None:
        """Instant from which UTC is known well enough to write rows."""
        return None if self._first_ns is None else self._first_ns + SETTLE_NS

    def add_epoch(self, arrival_ns: int, utc_s: float) -> float:
        """Take the time of one epoch and when its first byte came.

        Returns
        -------
        float
            Seconds by which the receiver has now changed its mind; mostly 0.
        """
        offset = round(utc_s * 1e9) - (arrival_ns - self.latency_ns)
        is_leap = self._leaps(offset)
        self._told_ns, self.is_uncertain = offset, False
        if self._first_ns is None:
            self._first_ns = arrival_ns
        if self._offset_ns is None:
            self._add_offset(offset)
        elif self._shown_ns is None and offset > self._offset_ns:
            # Nothing was written yet: the freshest epoch is right at once.
            self._offsets.clear()
            self._add_offset(offset)
        elif abs(offset - self._offset_ns) < STALE_NS and not is_leap:
            self._candidates.clear()
            self._add_offset(offset)
            self._n_agreeing += 1
            if self._n_agreeing == STEADY_EPOCHS:
                self._n_sure = SURE_EPOCHS
        else:
            # From the future no buffer delivers.
            self.is_uncertain = is_leap or offset > self._offset_ns
            return self._add_candidate(arrival_ns, offset)
        return 0.0

    def start_rows(self) -> None:
        """Begin rows: from now on UTC only slews."""
        self._shown_ns = self._offset_ns

    def instant_ns(self, utc_s: float) -> int | None:
        """Monotonic instant that an epoch of this UTC describes; None: not known."""
        if self._offset_ns is None:
            return None
        return round(utc_s * 1e9) - self._offset_ns

    def instant_of(self, fix: GpsFix) -> int:
        """Return the instant that a fix describes, not later than its arrival."""
        if fix.utc_s is None or (instant_ns := self.instant_ns(fix.utc_s)) is None:
            return fix.t_ns - self.latency_ns
        return min(instant_ns, fix.t_ns)

    def row_instant_ns(self, utc_ns: int) -> int:
        """Monotonic instant of a row of the log."""
        assert self._shown_ns is not None
        return utc_ns - self._shown_ns

    def row_utc_ns(self, t_ns: int) -> int:
        """UTC of an instant as the rows count it."""
        assert self._shown_ns is not None
        return t_ns + self._shown_ns

    def behind_ns(self, period_ns: int) -> int:
        """Say by how much the next row is dated wrong, or may be; 0 but for jumps."""
        assert self._shown_ns is not None
        assert self._offset_ns is not None
        behind = abs(self._offset_ns - self._shown_ns)
        if self.is_uncertain and self._told_ns is not None:
            behind = max(behind, abs(self._told_ns - self._shown_ns))
        return behind if int(period_ns * SLEW) < behind <= LEAPS_NS else 0

    def slew(self, period_ns: int) -> int:
        """Move the rows' relation towards the truth; called once a row.

        Returns
        -------
        int
            By how much (ns) it went forward, or back, at once; mostly 0.
        """
        assert self._shown_ns is not None
        assert self._offset_ns is not None
        behind_ns = self._offset_ns - self._shown_ns
        if -BACK_NS <= behind_ns <= HOLE_NS:
            most = int(period_ns * SLEW)
            self._shown_ns += min(max(behind_ns, -most), most)
            return 0
        if self._n_agreeing < self._n_sure:
            return 0
        self._shown_ns = self._offset_ns
        self.holes += 1
        self._n_sure = min(2 * self._n_sure, MAX_SURE_EPOCHS)
        return behind_ns

    def _add_offset(self, offset: int) -> None:
        self._offsets.append(offset)
        freshest = max(self._offsets)
        self._offset_ns = median_low(
            o for o in self._offsets if o > freshest - STALE_NS
        )

    def _leaps(self, offset: int) -> bool:
        """Whether an epoch is whole seconds off, and came to be so at once."""
        if self._offset_ns is None or self._told_ns is None:
            return False
        off, step = offset - self._offset_ns, offset - self._told_ns
        leap = round(off / WHOLE_NS) * WHOLE_NS
        if not leap or abs(off - leap) > NEAR_NS:
            return False
        return bool(self._candidates) or abs(step - leap) <= 2 * NEAR_NS

    def _add_candidate(self, arrival_ns: int, offset: int) -> float:
        """Collect epochs of another time; follow them when they last."""
        if self._candidates and abs(offset - self._candidates[0][1]) > STALE_NS // 2:
            self._candidates.clear()
        self._candidates.append((arrival_ns, offset))
        lasted_ns = arrival_ns - self._candidates[0][0]
        if len(self._candidates) < JUMP_EPOCHS or lasted_ns < JUMP_NS:
            return 0.0
        before_ns = self._offset_ns
        self.jumps += 1
        self._n_agreeing = 0
        self.is_uncertain = False
        self._offsets.clear()
        for _, candidate in self._candidates:
            self._add_offset(candidate)
        self._candidates.clear()
        assert before_ns is not None
        assert self._offset_ns is not None
        return (self._offset_ns - before_ns) * 1e-9
