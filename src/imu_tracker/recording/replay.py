"""A whole stream through the pipeline, and what is to be told about it afterwards."""

import logging
import math
from array import array
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from typing import Any, Final

import numpy as np

from imu_tracker.calibration.corrected import Corrections
from imu_tracker.config import Config
from imu_tracker.estimation.settings import TrackerSettings
from imu_tracker.pipeline import Pipeline
from imu_tracker.recording.edit import Outage, Stopwatch
from imu_tracker.recording.scoring import Track, score
from imu_tracker.samples import DEFAULT_MOUNT, Frame, NavState, SessionHeader
from imu_tracker.sensors.gnss.sentences import TOLD_AFTER
from imu_tracker.storage.latlong import goes_back
from imu_tracker.storage.state_file import StateFile, sensor_of

_MINUTE_NS: Final = 60_000_000_000

log = logging.getLogger(__name__)


class Replay:
    """Tracks a recording; each header in it begins a session.

    Parameters
    ----------
    config : Config
        What is written in it overrules the headers.
    corrections : Corrections, optional
        Of the chip that was recorded.
    state : StateFile, optional
        What an earlier run learnt.

    Attributes
    ----------
    notices : list of (float, str)
        Transitions that were told, with the seconds since the first frame.
    """

    def __init__(
        self,
        config: Config,
        corrections: Corrections | None = None,
        state: StateFile | None = None,
    ) -> None:
        self._config, self._corrections, self._state = config, corrections, state
        self._pipeline: Pipeline | None = None
        self._last_utc_s = self._begin_utc_s = -math.inf
        self._frame: Frame | None = None  # the last one
        self._now_ns: int | None = None  # of this session
        self._stopwatch = Stopwatch()
        self._sessions = 0
        self.notices: list[tuple[float, str]] = []
        self._elapsed_s = 0.0
        self._zero_utc_s: float | None = None  # of the first frame
        self._counters: Counter[str] = Counter()  # of the sessions that are over
        # utc_s, lat_deg, lon_deg, r95_m: a month of rows takes 330 MB
        self._columns = tuple(array("d") for _ in range(4))

    def rows(self, stream: Iterable[SessionHeader | Frame]) -> Iterator[NavState]:
        """Yield the rows of the log; their times grow, also from session to session.

        Only where many epochs agree that the session's dates were wrong they go back,
        by more than a minute: a new log begins there.
        """
        for item in stream:
            if isinstance(item, SessionHeader):
                self._tell(is_over=True)
                yield from self._kept(self.remaining())
                self._elapsed_s = self._stopwatch.read(item)
                self._begin(item)
                self._begin_utc_s = self._last_utc_s
                continue
            self._elapsed_s = self._stopwatch.read(item)
            if self._pipeline is None:
                raise ValueError("a stream begins with its header")
            self._frame = item
            for due in self._due_rows(self._pipeline, item):
                self._tell()
                yield from self._kept(self.finished(due))
        self._tell(is_over=True)
        yield from self._kept(self.remaining())

    def finished(self, due: list[NavState]) -> list[NavState]:
        """Return the rows to be given out now that `due` have come."""
        return due

    def remaining(self) -> list[NavState]:
        """Return the rows to be given out at the end of a session."""
        return []

    def _kept(self, rows: list[NavState]) -> Iterator[NavState]:
        """Pass rows on whose times grow, or go back because they were wrong."""
        for state in rows:
            last_utc_s = self._last_utc_s
            is_new_log = self._begin_utc_s < last_utc_s and goes_back(state, last_utc_s)
            if state.utc_s <= last_utc_s and not is_new_log:
                self._counters["skipped_rows"] += 1
                continue
            self._last_utc_s = state.utc_s
            self._keep(state)
            yield state

    def _due_rows(self, pipeline: Pipeline, frame: Frame) -> Iterator[list[NavState]]:
        """Feed a frame; the rows of a long silence before it come minute by minute."""
        now_ns = frame.t_ns if self._now_ns is None else self._now_ns
        self._now_ns = max(now_ns, frame.t_ns)
        while frame.t_ns - now_ns > _MINUTE_NS:
            now_ns += _MINUTE_NS
            yield pipeline.advance(now_ns)
        if rows := pipeline.feed(frame):
            yield rows
        self._set_learned()

    def summary(self) -> str:
        """Say in one line what came of it."""
        rows = len(self._columns[0])
        fixes = self._all_counters()["fixes"]
        text = f"{self._elapsed_s:.0f} s, {fixes} fixes, {rows} rows"
        if skipped := self._counters["skipped_rows"]:
            text += f", {skipped} left out (their times are those of earlier rows)"
        unread = Counter(self._unread())
        for reason, n in unread.most_common(1):
            if n >= TOLD_AFTER or not fixes:
                text += f"; sentences that cannot be used: {reason}, {n} times"
        return text

    def result(self) -> dict[str, Any]:
        """Return figures for machines: what was seen, and what was learnt last."""
        learnt = self._pipeline.report() if self._pipeline is not None else {}
        learnt.pop("counters", None)
        return {
            "duration_s": self._elapsed_s,
            "sessions": self._sessions,
            "rows": len(self._columns[0]),
            "counters": dict(self._all_counters()),
            "unread": self._unread(),
            "learnt": learnt,
        }

    def score(self, truth: Track, outages: Sequence[Outage]) -> dict[str, Any]:
        """Score the rows of the last log; the outages count from the first frame."""
        columns = [np.array(column) for column in self._columns]
        backward = np.flatnonzero(np.diff(columns[0]) <= 0)
        begin = int(backward[-1]) + 1 if len(backward) else 0
        utc_s, lat_deg, lon_deg, r95_m = (column[begin:] for column in columns)
        track = Track(utc_s, lat_deg, lon_deg)
        return score(track, r95_m, truth, outages, self._zero_utc_s)

    def _begin(self, header: SessionHeader) -> None:
        if self._pipeline is not None:
            self._counters += self._pipeline.counters
            self._set_learned()
        header = self._config.amended(header)
        if self._sessions == 0:
            self._zero_utc_s = header.start_utc_s
        self._sessions += 1
        self._now_ns = None
        settings = self._config.tracker_settings(header)
        if self._state is not None:
            mount = settings.mount or header.mount or DEFAULT_MOUNT
            sensor = sensor_of(header.chip, mount, self._corrections)
            settings = settings._replace(prior=self._state.begin(sensor))
        self._pipeline = self.pipeline(header, settings)

    def pipeline(self, header: SessionHeader, settings: TrackerSettings) -> Pipeline:
        """Make the pipeline of a session."""
        return Pipeline(header, settings, corrections=self._corrections)

    def _set_learned(self) -> None:
        if self._state is not None and self._pipeline is not None:
            self._state.set_learned(self._pipeline.learned_parameters())

    def _keep(self, state: NavState) -> None:
        if self._zero_utc_s is None and self._frame is not None:
            row_s = self._elapsed_s - (self._frame.t_ns - state.t_ns) / 1e9
            self._zero_utc_s = state.utc_s - row_s
        row = (
            state.utc_s,
            math.degrees(state.lat_rad),
            math.degrees(state.lon_rad),
            state.r95_m,
        )
        for column, value in zip(self._columns, row, strict=True):
            column.append(value)

    def _tell(self, *, is_over: bool = False) -> None:
        if self._pipeline is None:
            return
        for notice in self._pipeline.take_notices(is_over=is_over):
            log.info("at %.1f s: %s", self._elapsed_s, notice)
            self.notices.append((self._elapsed_s, notice))

    def _unread(self) -> dict[str, int]:
        """Why sentences of the last session could not be used, and how often."""
        return self._pipeline.unread if self._pipeline is not None else {}

    def _all_counters(self) -> Counter[str]:
        now = self._pipeline.counters if self._pipeline is not None else Counter()
        return self._counters + now
