"""What the daemon learns, kept for its next start; nothing about it ends the daemon."""

import logging
from collections import Counter
from datetime import UTC, datetime
from pathlib import Path
from typing import Final

from imu_tracker.errors import OutputError, StateError
from imu_tracker.estimation.error_state.warm_start import LearnedParameters
from imu_tracker.pipeline import Pipeline
from imu_tracker.sensors.clock import SECOND_NS
from imu_tracker.storage.state_file import StateFile
from imu_tracker.storage.state_model import Sensor

SAVE_NS: Final = 300 * SECOND_NS
"""A power cut costs what was learnt in so long: a bias wanders by 0.03 deg/s. Two
kilobytes 300 times a day wear no card."""

log = logging.getLogger(__name__)


class KeptState:
    """The state file of a daemon.

    Parameters
    ----------
    path : Path, optional
        None: nothing is kept.
    now_ns : int

    Attributes
    ----------
    counters : Counter
        `state_saves`, `state_failures` and, once the file was refused, `state_ignored`.
    """

    def __init__(self, path: Path | None, now_ns: int) -> None:
        self._path = path
        self._file = None if path is None else StateFile(path)
        self._save_ns = now_ns + SAVE_NS
        self._is_failing = False
        self.counters: Counter[str] = Counter()

    def begin(self, sensor: Sensor) -> LearnedParameters | None:
        """Return what a session begins with."""
        if self._file is None:
            return None
        try:
            learnt = self._file.begin(sensor)
        except StateError as error:
            self.counters["state_ignored"] += 1
            log.warning("%s; begins without what was learnt", error)
            return None
        if learnt is None:
            log.info("%s: nothing was learnt yet", self._path)
        else:
            utc_s = learnt.utc_s or 0.0
            at = f"{datetime.fromtimestamp(utc_s, UTC):%Y-%m-%d %H:%M}" if utc_s else ""
            log.info("%s: begins with what was learnt %s", self._path, at or "before")
        return learnt

    def set_learned(self, pipeline: Pipeline, chip: str) -> None:
        """Hear what a session has learnt by now."""
        if self._file is not None:
            self._file.set_learned(pipeline.learned_parameters(), chip)

    def tick(self, now_ns: int, pipeline: Pipeline, chip: str) -> None:
        """Save from time to time."""
        if now_ns >= self._save_ns:
            self._save_ns = now_ns + SAVE_NS
            self.save(pipeline, chip)

    def save(self, pipeline: Pipeline, chip: str) -> None:
        """Save now; a disk that refuses is told once, and counted."""
        if self._file is None:
            return
        self.set_learned(pipeline, chip)
        try:
            is_saved = self._file.write()
        except (OutputError, StateError) as error:
            self.counters["state_failures"] += 1
            if not self._is_failing:
                log.warning("%s; what was learnt is not kept", error)
            self._is_failing = True
            return
        self._is_failing = False
        self.counters["state_saves"] += is_saved
