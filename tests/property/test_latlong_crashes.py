"""Whatever befalls the log, it consists of whole rows whose times strictly grow."""

import logging
import shutil
from itertools import pairwise
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, rule

from imu_tracker.storage.latlong import LatLongLog, format_row, read_log
from support.log_states import SECOND_NS, START_UTC_S, state
from support.small_disk import SmallDisk

ROW_BYTES = len(format_row(state())) + 1


class LogUnderFire(RuleBasedStateMachine):
    """Writes, kills, full disks and reopenings in any order."""

    def __init__(self) -> None:
        super().__init__()
        logging.disable()
        self.patch = pytest.MonkeyPatch()
        self.disk = SmallDisk(self.patch)
        self.folder = TemporaryDirectory()
        self.lives = 0
        self.second = 0
        self.written: set[float] = set()

    @initialize()
    def start(self) -> None:
        self.path = Path(self.folder.name) / f"life{self.lives}" / "latlong.csv"
        self.log = LatLongLog(self.path, max_mb=7 * ROW_BYTES / 1e6, min_free_mb=0)

    @rule(count=st.integers(1, 12), back=st.integers(0, 3))
    def write(self, count: int, back: int) -> None:
        self.second = max(0, self.second - back)
        for _ in range(count):
            self.log.write(state(self.second))
            self.written.add(self.second)
            self.second += 1

    @rule(wait_s=st.integers(1, 6))
    def tick(self, wait_s: int) -> None:
        self.log.tick((self.second + wait_s) * SECOND_NS)

    @rule()
    def reopen(self) -> None:
        self.log.reopen()

    @rule(fitting=st.integers(0, 5 * ROW_BYTES))
    def fill_the_disk(self, fitting: int) -> None:
        self.disk.free_bytes = fitting

    @rule()
    def free_the_disk(self) -> None:
        self.disk.free_bytes = 1_000_000

    @rule(lost=st.integers(0, 3 * ROW_BYTES), zeros=st.integers(0, 200))
    def cut_the_power(self, lost: int, zeros: int) -> None:
        """What is on the disk now, less the tail, is what the next life finds."""
        self.disk.free_bytes = 1_000_000
        before = self.path.parent
        self.lives += 1
        shutil.copytree(before, before.with_name(f"life{self.lives}"))
        self.log.close()
        shutil.rmtree(before)
        path = before.with_name(f"life{self.lives}") / self.path.name
        if path.exists():
            data = path.read_bytes()
            path.write_bytes(data[: max(0, len(data) - lost)] + b"\0" * zeros)
        self.start()

    @invariant()
    def rows_are_whole_and_grow(self) -> None:
        rotated = self.log._file.rotated.find()
        parts = [*rotated] if self.log.is_failing else [*rotated, self.path]
        seconds = [s for part in parts for s in read_log(part).utc_s - START_UTC_S]

        assert all(now < then for now, then in pairwise(seconds))
        assert set(seconds) <= self.written

    def teardown(self) -> None:
        self.disk.free_bytes = 1_000_000
        self.log.close()
        self.patch.undo()
        self.folder.cleanup()
        logging.disable(logging.NOTSET)


TestLogUnderFire = LogUnderFire.TestCase
TestLogUnderFire.settings = settings(
    max_examples=40, stateful_step_count=25, deadline=None
)
