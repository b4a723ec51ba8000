"""One destination in a thread of its own: what hangs or refuses holds up no other.

Rows are taken from the outbox, sent, and done with when the other side has said that it
has them; then the cursor moves. A connection that fails is tried again, later each
time, and rows that were not acknowledged are sent again, in the same order.
"""

import logging
import time
from collections import deque
from random import Random
from threading import Event, Thread
from typing import Final

from imu_tracker.publish.cursor import Cursor
from imu_tracker.publish.outbox import Entry, Outbox
from imu_tracker.publish.senders.sender import DestinationError, Item, Sender

FIRST_DELAY_S: Final = 1.0
LONGEST_DELAY_S: Final = 120.0
IDLE_S: Final = 1.0
ONCE_S: Final = 5.0
"""So long `--once` waits for a new row where only the newest is wanted."""

log = logging.getLogger(__name__)


class Backoff:
    """How long to wait: later each time, and not all trackers of a fleet together."""

    def __init__(self, rng: Random) -> None:
        self._rng = rng
        self._delay_s = FIRST_DELAY_S

    def reset(self) -> None:
        """Begin with the shortest again."""
        self._delay_s = FIRST_DELAY_S

    def next_s(self) -> float:
        """Return how long to wait now."""
        delay_s = self._delay_s
        self._delay_s = min(LONGEST_DELAY_S, 2.0 * delay_s)
        return delay_s * self._rng.uniform(0.5, 1.0)


class Worker:
    """Brings the rows of the log to one destination.

    Parameters
    ----------
    name : str
    outbox, cursor, sender : Outbox, Cursor, Sender
        Of this destination alone; closed at the end.
    stop : Event
        Set when it should end.
    is_once : bool
        End when nothing waits any more, or at the first failure.
    is_newest_only : bool
        A row that could not be sent is of no use later.

    Attributes
    ----------
    error : BaseException or None
        The bug that ended the thread; for the loop to raise.
    last_error : str
        What went wrong last.
    is_failing : bool
        Whether nothing was taken since.
    success_ns, error_ns, end_ns : int or None
        CLOCK_MONOTONIC when a row was taken last, when it went wrong last, and when
        the end of the log was reached last.
    sent_rows, refused_rows, errors : int
        Counted since the start.
    """

    def __init__(
        self,
        name: str,
        outbox: Outbox,
        cursor: Cursor,
        sender: Sender,
        stop: Event,
        *,
        is_once: bool = False,
        is_newest_only: bool = False,
    ) -> None:
        self.name = name
        self.outbox, self.cursor = outbox, cursor
        self._sender, self._stop = sender, stop
        self.is_once, self.is_newest_only = is_once, is_newest_only
        self._backoff = Backoff(Random())
        self._waiting: deque[Entry] = deque()  # taken from the outbox
        self._on_their_way = 0  # so many of them, the oldest
        self._told = ""
        self._thread = Thread(target=self._run_and_capture, name=name, daemon=True)
        self.error: BaseException | None = None
        self.last_error, self.is_failing, self.is_done = "", False, False
        self.success_ns: int | None = None
        self.error_ns: int | None = None
        self.end_ns: int | None = None
        self.sent_rows = self.refused_rows = self.errors = 0

    def start(self) -> None:
        """Begin, in a thread."""
        self._thread.start()

    def join(self, timeout_s: float) -> bool:
        """Wait for the end; return whether it came."""
        self._thread.join(timeout_s)
        return not self._thread.is_alive()

    @property
    def waiting_rows(self) -> int:
        """Rows that were read and are due, and the other side has not said it has."""
        return len(self._waiting)

    @property
    def oldest_utc_s(self) -> float | None:
        """The time of the oldest of them."""
        try:
            return self._waiting[0].row.utc_s
        except IndexError:
            return None

    def run(self) -> None:
        """Send until stopped, or, once, until nothing waits."""
        try:
            while not self._stop.is_set() and not self.is_done:
                try:
                    self._connect()
                    self._talk()
                except DestinationError as error:
                    self._fail(error)
                    if self.is_once:
                        self.is_done = True
                    else:
                        self._pause(error.again_s)
        finally:
            self._sender.close()
            self.outbox.close()
            self.cursor.close()

    # ------------------------------------------------------------------ a connection

    def _connect(self) -> None:
        self._on_their_way = 0
        if not self.is_newest_only:
            self._take()  # so that the status says what waits
        self._sender.open()
        self.outbox.begin()
        self._begun_ns = time.monotonic_ns()

    def _talk(self) -> None:
        while not self._stop.is_set() and not self._has_done_all():
            self._take()
            self._send()
            is_more = not self.outbox.is_at_end and not self._is_full
            taken, refused = self._sender.wait(0.0 if is_more else IDLE_S)
            self._settle(taken, refused)
            self.cursor.save_if_due(time.monotonic_ns())

    @property
    def _limit(self) -> int:
        return 1 if self.is_newest_only else self._sender.window

    @property
    def _is_full(self) -> bool:
        return len(self._waiting) >= self._limit

    def _take(self) -> None:
        """Take what is due, as far as there is room."""
        while self._waiting and not self._on_their_way:
            if not self.outbox.is_old(self._waiting[0].row):
                break
            self._waiting.popleft()
            self.outbox.old_rows += 1
        if not self._is_full:
            self._waiting.extend(self.outbox.take(self._limit - len(self._waiting)))
            if self.outbox.is_at_end:
                self.end_ns = time.monotonic_ns()

    def _send(self) -> None:
        until = min(self._limit, len(self._waiting))
        entries = [self._waiting[i] for i in range(self._on_their_way, until)]
        if entries:
            self._on_their_way = until
            self._sender.send([Item(e.row, e.is_newest) for e in entries])

    def _settle(self, taken: int, refused: int) -> None:
        if not taken:
            return
        for _ in range(taken):
            entry = self._waiting.popleft()
            self.cursor.move(entry.placed)
            self.outbox.settle(entry.row)
        self._on_their_way -= taken
        self.sent_rows += taken - refused
        self.refused_rows += refused
        self.success_ns = time.monotonic_ns()
        self._backoff.reset()
        if self.is_failing:
            log.info("%s: sends again", self.name)
        self.is_failing, self._told = False, ""

    def _has_done_all(self) -> bool:
        if not self.is_once:
            return False
        if self.is_newest_only:
            late_ns = time.monotonic_ns() - self._begun_ns
            self.is_done = self.sent_rows > 0 or late_ns > ONCE_S * 1e9
            if self.is_done and not self.sent_rows:
                log.warning("%s: no new row came: does imu-tracker run?", self.name)
        else:
            self.is_done = self.outbox.is_at_end and not self._waiting
        return self.is_done

    # -------------------------------------------------------------------- a failure

    def _fail(self, error: DestinationError) -> None:
        self._sender.close()
        self._on_their_way = 0
        if self.is_newest_only:
            self._waiting.clear()
        self.cursor.save()
        self.is_failing, self.last_error = True, str(error)
        self.error_ns = time.monotonic_ns()
        self.errors += 1
        if self.last_error != self._told:  # once, however often it is tried
            log.warning("%s: %s", self.name, self.last_error)
        self._told = self.last_error

    def _pause(self, again_s: float | None) -> None:
        delay_s = self._backoff.next_s() if again_s is None else again_s
        self._stop.wait(delay_s)

    def _run_and_capture(self) -> None:
        try:
            self.run()
        except BaseException as error:  # noqa: BLE001 - handed to the loop
            self.error = error
        finally:
            self.is_done = True
