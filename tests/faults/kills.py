"""Kill the daemon again and again, lose what was not synced, and start it again.

    python -m faults.kills --kills 200

Each life is a process of its own that SIGKILL ends at a random call of the operating
system, in the midst of a write perhaps; then the power is cut (`losing_disk`), and the
next life starts from what is left. Prints what was found as one JSON object.
"""

import argparse
import json
import logging
import os
import shutil
import signal
import tempfile
from collections import Counter
from itertools import pairwise
from pathlib import Path
from random import Random
from typing import Any, Final

import pytest

from faults import sentences
from faults.bench import Bench
from faults.campaign import EARLIER
from faults.losing_disk import LosingDisk
from imu_tracker import pipeline
from imu_tracker.daemon import state as kept_state
from imu_tracker.samples import NavState
from imu_tracker.storage.atomic import replace_file
from imu_tracker.storage.latlong import LatLongLog, read_log
from imu_tracker.storage.state_model import State

LIFE_S: Final = 40.0
APART_S: Final = 150  # a life begins so long after the one before
MOST_CALLS: Final = 285  # of a life, about; one that makes fewer ends by itself
SYNC_S: Final = 5.0
TIDIES_TENTHS: Final = 20
"""A start has so many tenths of a second to compress again what was cut off in it."""

SAVES_EACH_S: Final = 4  # five minutes, for a daemon that lives as long
SMALL_MB: Final = 0.02  # so that files are rotated

CALLS_TO_REPLACE: Final = 5  # open, fsync, replace, open and fsync of the directory
REPLACEMENTS: Final = 61

OPTIONS: Final = (
    "filter.estimator=error-state",
    f"log.sync_s={SYNC_S}",
    f"log.max_mb={SMALL_MB}",
)


def live(disk: LosingDisk, told: Path, number: int, die_at: int) -> None:
    """Be the daemon until the end; never returns."""
    code = 1
    try:
        write_line = os.write
        fd = os.open(told, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
        write = LatLongLog.write

        def note(log: LatLongLog, state: NavState) -> None:
            write(log, state)
            write_line(fd, b"%d\n" % round(state.utc_s * 1000))

        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(pipeline, "RELEASE_DATE", EARLIER)
            patch.setattr(kept_state, "SAVE_NS", SAVES_EACH_S * 10**9)
            patch.setattr(LatLongLog, "write", note)
            later = sentences.timed(number * APART_S)
            bench = Bench(
                disk.life,
                patch,
                say=lambda lines: sentences.changed(lines, 0.0, 1e6, later),
            )
            disk.mount(patch, die_at, Random(die_at))
            code = bench.run(LIFE_S, *OPTIONS).exit_code
    finally:
        os._exit(code)


def replace(disk: LosingDisk, path: Path, data: bytes, die_at: int) -> None:
    """Be a process that replaces a small file, until the end; never returns."""
    try:
        with pytest.MonkeyPatch.context() as patch:
            disk.mount(patch, die_at, Random(die_at))
            replace_file(path, data)
    finally:
        os._exit(0)


def replacements(directory: Path, rng: Random) -> Counter[str]:
    """Replace a file (of a calibration, a state), killed at each call in turn."""
    found: Counter[str] = Counter()
    versions = {"old": b"old" * 700, "new": b"new" * 700}
    for die_at in range(1, REPLACEMENTS):
        disk = LosingDisk(directory / f"{die_at}" / "life", directory / f"{die_at}")
        path = disk.life / "file.json"
        for name in versions:
            pid = os.fork()
            if not pid:
                last = die_at % CALLS_TO_REPLACE + 1 if name == "new" else 0
                replace(disk, path, versions[name], last)
            os.waitpid(pid, 0)
            disk.cut_the_power(rng)
        data = path.read_bytes()
        found[next((n for n, v in versions.items() if v == data), "half")] += 1
    return found


class Judge:
    """Compares what is left with what was written."""

    def __init__(self, copies: Path) -> None:
        self._copies = copies
        self.figures: Counter[str] = Counter()
        self.longest_lost_s = 0.0
        self.complaints: list[str] = []

    def look(self, disk: LosingDisk, told: Path, number: int, status: int) -> None:
        """Look at what a next start will find, after its predecessor's death."""
        is_killed = os.WIFSIGNALED(status) and os.WTERMSIG(status) == signal.SIGKILL
        self.figures["killed" if is_killed else "ended"] += 1
        if not is_killed and status != 0:
            self.complaints.append(f"life {number}: ended with {status}")
        self._look_at_state(disk.life / "state" / "state.json", number)
        written = [int(line) for line in told.read_text().split()]
        self.figures["rows_written"] += len(written)
        kept = self._kept(disk.life / "log", number)
        lost = [utc_ms for utc_ms in written if utc_ms not in kept]
        self.figures["rows_lost"] += len(lost)
        if lost:
            if lost != written[-len(lost) :]:
                self.complaints.append(f"life {number}: lost rows are not the last")
            lost_s = (lost[-1] - lost[0]) / 1000
            self.longest_lost_s = max(self.longest_lost_s, lost_s)
            if lost_s > SYNC_S:
                self.complaints.append(f"life {number}: {lost_s} s are lost")

    def _look_at_state(self, path: Path, number: int) -> None:
        if not path.exists():
            self.figures["states_missing"] += 1
            return
        try:
            State.model_validate_json(path.read_bytes())
            self.figures["states_whole"] += 1
        except ValueError as error:
            self.complaints.append(f"life {number}: half a state: {error}")

    def _kept(self, directory: Path, number: int) -> set[int]:
        """Return the rows that the next start keeps when it has tidied up."""
        if not directory.exists():
            return set()
        # In a copy: what a look tidies up must not help the next life.
        directory = shutil.copytree(directory, self._copies / str(number))
        log = LatLongLog(
            directory / "latlong.csv", min_free_mb=0, max_mb=SMALL_MB, sync_s=SYNC_S
        )
        for tenth in range(TIDIES_TENTHS):
            log.tick(tenth * 100_000_000)
        rotated = log._file.rotated.find()
        log.close()
        rows: list[int] = []
        for path in [*rotated, directory / "latlong.csv"]:
            try:
                rows += [round(utc_s * 1000) for utc_s in read_log(path).utc_s]
            except ValueError as error:
                self.complaints.append(f"life {number}: {error}")
        if not all(old < new for old, new in pairwise(rows)):
            self.complaints.append(f"life {number}: times do not grow")
        self.figures["rotated_files"] = len(rotated)
        return set(rows)


def main() -> None:
    """Live and die so many times."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kills", type=int, default=20)
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    logging.disable(logging.WARNING)
    rng = Random(arguments.seed)
    with tempfile.TemporaryDirectory(prefix="kills-") as directory:
        told, judge = Path(directory) / "told", Judge(Path(directory) / "looked at")
        disk = LosingDisk(Path(directory) / "life", Path(directory) / "disk")
        number = 0
        while judge.figures["killed"] < arguments.kills:
            die_at = rng.randrange(1, MOST_CALLS)
            told.write_text("")
            pid = os.fork()
            if not pid:
                live(disk, told, number, die_at)
            _, status = os.waitpid(pid, 0)
            disk.cut_the_power(rng)
            judge.look(disk, told, number, status)
            number += 1
        replaced = replacements(Path(directory) / "replacements", rng)
    found: dict[str, Any] = {
        **dict(sorted(judge.figures.items())),
        "files_replaced": dict(sorted(replaced.items())),
        "longest_lost_s": judge.longest_lost_s,
        "complaints": judge.complaints,
    }
    print(json.dumps(found))


if __name__ == "__main__":
    main()
