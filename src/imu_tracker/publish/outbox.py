"""What of the log waits for a destination: rows that are due, oldest first.

The log is the queue; nothing is copied. Rows that were taken are kept by who took them
until the other side has them.
"""

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Final, NamedTuple

from imu_tracker.publish.thinning import Placed, Rules, Thinner, is_due
from imu_tracker.storage.latlong import LogRow
from imu_tracker.storage.log_tail import LogTail, TailPosition, newest_position

ROWS_A_TURN: Final = 2000
"""Then a thread looks whether it should end, and what the other side said."""


class Selection(NamedTuple):
    """Which rows a destination gets.

    Attributes
    ----------
    rules : Rules
    is_newest_only : bool
        What is not the newest any more is of no use to it.
    max_age_s : float
        What is older than the newest by more is left out; 0: nothing is.
    """

    rules: Rules
    is_newest_only: bool = False
    max_age_s: float = 0.0


class Entry(NamedTuple):
    """A row to send.

    Attributes
    ----------
    placed : Placed
    is_newest : bool
        Whether no row after it is due yet.
    """

    placed: Placed
    is_newest: bool

    @property
    def row(self) -> LogRow:
        """What is sent."""
        return self.placed.row


class Outbox:
    """Reads the log for one destination.

    Parameters
    ----------
    path : Path
        The log.
    selection : Selection
    last : Placed, optional
        The row that the destination has; None: begin with the oldest, or, for newest
        rows only, with the next one that is written.

    Attributes
    ----------
    start : TailPosition
        Where it began to read.
    read_rows : int
        Rows of the log that were read, sent or not.
    old_rows : int
        Rows that were left out for their age.
    is_at_end : bool
        Whether there was nothing more to read.
    """

    def __init__(self, path: Path, selection: Selection, last: Placed | None) -> None:
        self._path, self._selection = path, selection
        begin = last.position if last is not None else TailPosition()
        if selection.is_newest_only:
            # The row that is newest now may be of last week: it is of no use either.
            begin = newest_position(path)
        self.start = begin
        self._tail = LogTail(path, begin)
        self._rows: Iterator[LogRow] = iter(())
        self._thinner = Thinner(selection.rules, last.row if last is not None else None)
        self._last = last.row if last is not None else None
        self._ready: list[Placed] = []
        self._newest: Placed | None = None
        self._oldest_s = -math.inf
        self.read_rows = self.old_rows = 0
        self.is_at_end = False

    def take(self, limit: int) -> list[Entry]:
        """Return up to so many rows that are due, having read a bounded number."""
        self.is_at_end = False
        self._begin_reading()
        for _ in range(ROWS_A_TURN):
            # One more than is taken: only so the last one is known to be the newest.
            if len(self._ready) > limit and not self._selection.is_newest_only:
                break
            row = next(self._rows, None)
            if row is None:
                self.is_at_end = True
                break
            self.read_rows += 1
            self._feed(Placed(row, self._tail.position))
        if self._selection.is_newest_only:
            return self._newest_entry(limit)
        taken, self._ready = self._ready[:limit], self._ready[limit:]
        last = len(taken) - 1 if self.is_at_end and not self._ready else -1
        return [Entry(placed, number == last) for number, placed in enumerate(taken)]

    @property
    def ready_rows(self) -> int:
        """Rows that were read and are due, and not taken yet."""
        return len(self._ready)

    def settle(self, row: LogRow) -> None:
        """Note, for newest rows only, that the destination has this one."""
        self._last = row

    def begin(self) -> None:
        """Note that a connection begins: of newest rows the next one is sent.

        What came while there was none is not new any more, and the other side may have
        forgotten what it had.
        """
        if self._selection.is_newest_only:
            self._newest = self._last = None
            self.is_at_end = False
            while not self.is_at_end:
                self.take(0)
            self._newest = None

    def is_old(self, row: LogRow) -> bool:
        """Whether a row is older than the newest by more than is wanted."""
        return row.utc_s < self._oldest_s

    def close(self) -> None:
        """Let the file go."""
        self._tail.close()

    def _begin_reading(self) -> None:
        """Look at the log anew when it was read to its end."""
        if self._selection.max_age_s:
            newest_s = newest_position(self._path).utc_s
            self._oldest_s = newest_s - self._selection.max_age_s
        row = next(self._rows, None)
        if row is None:
            self._rows = self._tail.rows()
            return
        self.read_rows += 1
        self._feed(Placed(row, self._tail.position))

    def _feed(self, placed: Placed) -> None:
        if self._selection.is_newest_only:
            self._newest = placed
        elif self.is_old(placed.row):
            self.old_rows += 1
        else:
            self._ready += self._thinner.feed(placed)

    def _newest_entry(self, limit: int) -> list[Entry]:
        """Return the newest row if it is due, and not sooner than one may be sent."""
        newest, rules = self._newest, self._selection.rules
        if newest is None or not self.is_at_end or limit < 1:
            return []
        if self._last is not None:
            apart_s = newest.row.utc_s - self._last.utc_s
            if 0 <= apart_s < rules.moving_s - 1e-3:
                return []
            if not is_due(rules, self._last, newest.row):
                return []
        self._newest = None
        return [Entry(newest, is_newest=True)]
