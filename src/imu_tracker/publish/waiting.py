"""How many rows wait for each destination, counted beside those that send.

The log is read once more, a little each second, by who only counts. What was counted
and never comes to a destination, which has reached the end of the log, was deleted
before it was sent: the disk was full.
"""

import time
from collections.abc import Iterator, Sequence
from itertools import islice
from pathlib import Path
from typing import Final

from imu_tracker.publish.worker import Worker
from imu_tracker.storage.latlong import LogRow
from imu_tracker.storage.log_tail import LogTail, TailPosition

ROWS_A_TURN: Final = 20_000


class Waiting:
    """Counts for several destinations.

    Parameters
    ----------
    path : Path
        The log.
    workers : sequence of Worker
        Before they begin.

    Attributes
    ----------
    deleted_rows : list of int
        By destination.
    """

    def __init__(self, path: Path, workers: Sequence[Worker]) -> None:
        self._workers = workers
        starts = [worker.outbox.start for worker in workers]
        self._starts_s = [start.utc_s for start in starts]
        first = min(starts, key=lambda start: start.utc_s, default=TailPosition())
        self._tail = LogTail(path, first)
        self._rows: Iterator[LogRow] = iter(())
        self._newest_s = first.utc_s
        self._counted = [0] * len(workers)
        self._end_ns: int | None = None
        self._at_end = list(self._counted)
        self.deleted_rows = [0] * len(workers)

    def count(self) -> None:
        """Count a bounded number of rows, and what was deleted meanwhile."""
        found = self._count_some()
        if not found:
            self._rows = self._tail.rows()
            found = self._count_some()
        self._look_for_deleted()
        if found < ROWS_A_TURN:
            self._end_ns, self._at_end = time.monotonic_ns(), list(self._counted)

    def unsent_rows(self, number: int) -> int:
        """Return how many rows wait for a destination."""
        worker = self._workers[number]
        if worker.is_newest_only:
            return worker.waiting_rows
        unread = self._counted[number] - self._passed(number)
        return max(0, unread) + worker.outbox.ready_rows + worker.waiting_rows

    def behind_newest_s(self, utc_s: float) -> float:
        """Return how much older than the newest row a time is."""
        return round(max(0.0, self._newest_s - utc_s), 1)

    def close(self) -> None:
        """Let the log go."""
        self._tail.close()

    def _count_some(self) -> int:
        found = 0
        for row in islice(self._rows, ROWS_A_TURN):
            found += 1
            self._newest_s = row.utc_s
            for number, start_s in enumerate(self._starts_s):
                self._counted[number] += row.utc_s > start_s
        return found

    def _passed(self, number: int) -> int:
        return self._workers[number].outbox.read_rows + self.deleted_rows[number]

    def _look_for_deleted(self) -> None:
        """Who reached the end after us has read what we have, if it was there."""
        if self._end_ns is None:
            return
        for number, worker in enumerate(self._workers):
            if worker.end_ns is not None and worker.end_ns > self._end_ns:
                gone = self._at_end[number] - self._passed(number)
                self.deleted_rows[number] += max(0, gone)
