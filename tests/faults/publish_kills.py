"""Kill `publish` again and again, lose what was not synced, and start it again.

    python -m faults.publish_kills --kills 500

Each life is a process of its own that SIGKILL ends at a random call of the operating
system; then the power is cut (`losing_disk`), and the next life starts from the cursor
that is left. The log grows and rotates between them, and its oldest files go. The other
side acknowledges a few rows at a time, each a hundredth of a second of a clock that
only it moves. Prints what was found as one JSON object.
"""

import argparse
import json
import logging
import os
import signal
import tempfile
import time
from collections import Counter
from collections.abc import Sequence
from math import cos, sin
from pathlib import Path
from random import Random
from threading import Event
from typing import Any, Final

import pytest

from faults.losing_disk import LosingDisk
from imu_tracker.publish.cursor import Cursor
from imu_tracker.publish.outbox import Outbox, Selection
from imu_tracker.publish.senders.payloads import json_row
from imu_tracker.publish.senders.sender import Item
from imu_tracker.publish.thinning import Placed, Rules, Thinner
from imu_tracker.publish.worker import Worker
from imu_tracker.storage.latlong import LatLongLog, LogRow, read_rows
from imu_tracker.storage.log_tail import TailPosition
from support.log_states import state

WINDOW: Final = 20
ROW_NS: Final = 10_000_000  # of an acknowledgement: a hundred a second
MOST_CALLS: Final = 24  # of a life; one that makes fewer ends by itself
ROWS_A_LIFE: Final = 1000
SMALL_MB: Final = 0.05  # so that files are rotated
RULES: Final = Rules(moving_s=0.5)


class OtherSide:
    """Takes rows and remembers them, whatever becomes of who sent them.

    Writes `NANOSECONDS PAYLOAD` in lines before it acknowledges.
    """

    window = WINDOW

    def __init__(self, told: Path, rng: Random, begin_ns: int) -> None:
        self._fd = os.open(told, os.O_WRONLY | os.O_CREAT | os.O_APPEND)
        self._write, self._rng, self.now_ns = os.write, rng, begin_ns
        self._sent: list[LogRow] = []

    def open(self) -> None:
        """Connect."""
        self._sent.clear()

    def send(self, items: Sequence[Item]) -> None:
        """Take rows in."""
        self._sent += [item.row for item in items]

    def wait(self, timeout_s: float) -> tuple[int, int]:
        """Acknowledge some of them; time passes."""
        self.now_ns += ROW_NS
        taken = self._sent[: self._rng.randrange(len(self._sent) + 1)]
        del self._sent[: len(taken)]
        for row in taken:
            self.now_ns += ROW_NS
            self._write(self._fd, b"%d %s\n" % (self.now_ns, json_row("car", row)))
        return len(taken), 0

    def probe(self) -> str:
        """Say nothing."""
        return ""

    def close(self) -> None:
        """Disconnect."""


def live(disk: LosingDisk, log: Path, told: Path, die_at: int, begin_ns: int) -> None:
    """Be the program until the end; never returns."""
    code = 1
    try:
        rng = Random(die_at)
        side = OtherSide(told, rng, begin_ns)
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(time, "monotonic_ns", lambda: side.now_ns)
            disk.mount(patch, die_at, rng)
            cursor = Cursor(disk.life / "cursors", "a")
            last = cursor.placed
            outbox = Outbox(log, Selection(RULES), last)
            Worker("a", outbox, cursor, side, Event(), is_once=True).run()
        code = 0
    finally:
        os._exit(code)


def grow(writer: LatLongLog, begin: int) -> None:
    """Write more of a drive in bends of a few hundred metres."""
    for number in range(begin, begin + ROWS_A_LIFE):
        angle = number / 100.0
        writer.write(
            state(
                number / 4,
                lat_deg=51.99 + 0.003 * sin(angle),
                lon_deg=4.37 + 0.005 * cos(angle),
                v_ne_mps=(13.0 * cos(angle), -13.0 * sin(angle)),
            )
        )
        writer.tick(number * 250_000_000)


def rotated(log: Path) -> list[Path]:
    return sorted(log.parent.glob(f"{log.stem}-*"))


def main() -> None:
    """Live and die so many times."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kills", type=int, default=20)
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    logging.disable(logging.WARNING)
    with tempfile.TemporaryDirectory(prefix="publish-kills-") as directory:
        print(json.dumps(campaign(Path(directory), arguments.kills, arguments.seed)))


def campaign(directory: Path, kills: int, seed: int) -> dict[str, Any]:
    """Return what was found."""
    rng = Random(seed)
    log, told = directory / "log" / "latlong.csv", directory / "told"
    told.touch()
    disk = LosingDisk(directory / "life", directory / "disk")
    writer = LatLongLog(log, sync_s=3600.0, max_mb=SMALL_MB, min_free_mb=0.0)
    thinner, expected = Thinner(RULES), list[bytes]()
    figures: Counter[str] = Counter()
    repeated_ns = 0
    taken_ns: dict[bytes, int] = {}  # when each row was last acknowledged
    seen: set[str] = set()
    life = end = begin_ns = 0
    while True:
        is_last = figures["killed"] >= kills
        grow(writer, life * ROWS_A_LIFE)
        expected += _chosen(thinner, log, seen)
        die_at = 0 if is_last else rng.randrange(1, MOST_CALLS)
        pid = os.fork()
        if not pid:
            live(disk, log, told, die_at, begin_ns)
        _, status = os.waitpid(pid, 0)
        is_killed = os.WIFSIGNALED(status) and os.WTERMSIG(status) == signal.SIGKILL
        figures["killed" if is_killed else "ended"] += 1
        figures["bad_ends"] += not is_killed and status != 0
        disk.cut_the_power(rng)
        with told.open("rb") as file:
            file.seek(end)
            after = file.read()
        end += len(after)
        for now_ns, payload in (line.split(b" ", 1) for line in after.splitlines()):
            if payload in taken_ns:
                repeated_ns = max(repeated_ns, begin_ns - taken_ns[payload])
            taken_ns[payload] = int(now_ns)
        begin_ns = max(taken_ns.values(), default=0) + ROW_NS
        if not is_killed and status == 0:
            # All of it is sent: what was put aside may go, as when the disk is full.
            figures["files_deleted"] += len(rotated(log))
            for path in rotated(log):
                path.unlink()
        life += 1
        if is_last:
            break
    writer.close()
    payloads = [line.split(b" ", 1)[1] for line in told.read_bytes().splitlines()]
    return {
        **dict(sorted(figures.items())),
        "rows": len(expected),
        "sent": len(payloads),
        "lost": len(set(expected) - set(payloads)),
        "never_in_the_log": len(set(payloads) - set(expected)),
        "in_order": list(dict.fromkeys(payloads)) == expected,
        "longest_repeated_s": repeated_ns / 1e9,
    }


def _chosen(thinner: Thinner, log: Path, seen: set[str]) -> list[bytes]:
    """Return what should be sent of the rows that are new, in the order of the log."""
    found = []
    # What was put aside does not change any more.
    new = [path for path in rotated(log) if path.name.removesuffix(".gz") not in seen]
    for row in (row for path in [*new, log] for row in read_rows(path)):
        key = f"{row.utc_s:.3f}"
        if key not in seen:
            seen.add(key)
            placed = Placed(row, TailPosition())
            found += [json_row("car", due.row) for due in thinner.feed(placed)]
    seen.update(path.name.removesuffix(".gz") for path in new)
    return found


if __name__ == "__main__":
    main()
