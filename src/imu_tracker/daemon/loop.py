"""The one loop: frames in, rows out, and everything that goes with it.

A turn takes what the feed has, keeps it when a raw capture is wanted, estimates, and
appends the rows that became due. Once a second it reports to systemd and to the status
file, once a minute to the journal. Nothing in here waits for a sensor.
"""

import logging
import os
from collections import Counter
from typing import Final

from imu_tracker.calibration.corrected import CorrectedModel, Corrections
from imu_tracker.config import Config
from imu_tracker.daemon.faults import faults_of
from imu_tracker.daemon.state import KeptState
from imu_tracker.daemon.status import (
    VERSION,
    Status,
    disk_free_mb,
    log_of,
    prediction_of,
    row_of,
    status_files,
)
from imu_tracker.daemon.supervision import Notify, Signals
from imu_tracker.errors import CalibrationError
from imu_tracker.estimation.report import EstimatorReport
from imu_tracker.notices import HoldOff
from imu_tracker.pipeline import Pipeline
from imu_tracker.recording.files import LiveRecordingWriter
from imu_tracker.samples import DEFAULT_MOUNT, Frame, NavState, SessionHeader, Source
from imu_tracker.sensors.clock import MILLISECOND_NS, SECOND_NS, Clock, Pacer
from imu_tracker.sources.feed import Feed
from imu_tracker.storage.latlong import LatLongLog
from imu_tracker.storage.state_file import sensor_of

TURN_NS: Final = 20 * MILLISECOND_NS
"""Without an IMU rows come 0.4 s after their instant, `ARRIVAL_NS`, and a turn."""

HEALTH_NS: Final = 60 * SECOND_NS

LATE_NS: Final = 500 * MILLISECOND_NS
"""A row that is older than this when it is written is counted as late."""

AHEAD_S: Final = (1, 5, 10, 30, 60)
"""So far ahead the status says where it will be."""

_BAD_ENDS: Final = (" lost", " reset", " failed", " overrun")  # of events: warnings

_USED: Final = ("fixes_initialised", "fixes_accepted", "fixes_reacquired")

log = logging.getLogger(__name__)


class Loop:
    """Tracks until it is told to end, or the feed is over.

    Parameters
    ----------
    config : Config
    feed : Feed
    latlong : LatLongLog
    recorder : LiveRecordingWriter, optional
        Keeps the frames as they came.
    signals, clock, notify
        What the outside says, the time, and how to tell systemd.
    corrections : Corrections, optional
        What the calibration file knows of the chip.
    """

    def __init__(
        self,
        config: Config,
        feed: Feed,
        latlong: LatLongLog,
        recorder: LiveRecordingWriter | None,
        signals: Signals,
        clock: Clock,
        notify: Notify,
        corrections: Corrections | None = None,
    ) -> None:
        self._corrections, self._calibration = corrections, config.imu.calibration
        self._config, self._feed = config, feed
        self._source = config.source.kind
        self._latlong, self._recorder = latlong, recorder
        self._signals, self._clock, self._notify = signals, clock, notify
        self._statuses = status_files(config.status)
        self._state = KeptState(config.state_path, clock.now_ns())
        self._pipeline: Pipeline | None = None
        self._row: NavState | None = None
        self._late_rows = 0
        self._past: Counter[str] = Counter()  # of the sessions that are over
        self._stalled, self._hold_off = "", HoldOff()
        self._start_ns = self._second_ns = clock.now_ns()
        self._health_ns = self._start_ns + HEALTH_NS
        self._logged: Counter[str] = Counter()  # by the last line about the health
        self._used_fixes, self._fix_ns = 0, self._start_ns

    def run(self) -> None:
        """Turn until the end; then write what is left."""
        pacer = Pacer(self._clock, TURN_NS)
        self._notify("READY=1")
        try:
            while not (self._signals.is_stop or self._feed.is_over):
                self.turn()
                pacer.wait()
            self._notify("STOPPING=1")
        finally:
            self._feed.close()
            for file in self._statuses:
                file.remove()
        while self._read_feed():
            pass
        if self._pipeline is not None:
            self._state.save(self._pipeline, self._chip)
        what = "told to" if self._signals.is_stop else f"{self._source} is over"
        log.info("ended: %s; %d rows", what, self._latlong.counters["rows"])

    def turn(self) -> None:
        """Do what is due now."""
        if self._signals.take_reopen():
            log.info("told to open the files anew")
            self._latlong.reopen()
            if self._recorder is not None:
                self._recorder.reopen()
        self._read_feed()
        now_ns = self._clock.now_ns()
        self._latlong.tick(now_ns)
        if self._recorder is not None:
            self._recorder.tick(now_ns)
        if now_ns >= self._second_ns:
            self._second_ns = now_ns + SECOND_NS
            self._each_second(now_ns)
            if self._pipeline is not None:
                self._state.tick(now_ns, self._pipeline, self._chip)
        if now_ns >= self._health_ns:
            self._health_ns = now_ns + HEALTH_NS
            self._log_health()

    # ------------------------------------------------------------- frames to rows

    def _read_feed(self) -> bool:
        """Take what arrived; return whether anything did."""
        items, complete_ns = self._feed.read()
        for item in items:
            if isinstance(item, SessionHeader):
                self._begin(item)
            else:
                self._on_frame(item)
        if self._pipeline is not None:
            if complete_ns is not None:
                self._write(self._pipeline.advance(complete_ns))
            for notice in self._pipeline.take_notices():
                log.info("%s", notice)
        return bool(items)

    def _begin(self, header: SessionHeader) -> None:
        if self._pipeline is not None:
            self._past += self._pipeline.counters
            self._state.set_learned(self._pipeline, self._chip)
        if self._recorder is not None:
            self._recorder.write_header(header)
        settings = self._config.tracker_settings(header)
        live, mount = self._feed.is_live, settings.mount or DEFAULT_MOUNT
        known = self._corrections
        if known is not None:
            try:
                CorrectedModel(header, mount, known)
            except CalibrationError as error:
                log.warning("%s: %s; goes on uncalibrated", self._calibration, error)
                known = None
        sensor = sensor_of(self._chip if live else header.chip, mount, known)
        settings = settings._replace(prior=self._state.begin(sensor))
        self._pipeline = Pipeline(header, settings, live=live, corrections=known)

    @property
    def _chip(self) -> str:
        """Its name, as far as it is known by now."""
        return str(self._feed.health().get("imu", {}).get("chip", ""))

    def _on_frame(self, frame: Frame) -> None:
        if self._pipeline is None:
            raise ValueError("a stream begins with its header")
        if self._recorder is not None:
            self._recorder.write(frame)
        if frame.source is Source.EVENT:
            self._log_event(frame.data.decode("ascii", "replace"))
        if rows := self._pipeline.feed(frame):
            self._write(rows)

    def _write(self, rows: list[NavState]) -> None:
        for row in rows:
            self._latlong.write(row)
            self._row = row
        if rows and self._feed.is_live:
            late_ns = self._clock.now_ns() - LATE_NS
            self._late_rows += sum(row.t_ns < late_ns for row in rows)

    def _log_event(self, text: str) -> None:
        word, _, rest = text.partition(" ")
        self._log([f"{word.replace('_', ' ')}: {rest}"])

    def _log(self, events: list[str]) -> None:
        for text in self._hold_off.pass_on(self._clock.now_ns(), events):
            is_bad = text.partition(":")[0].endswith(_BAD_ENDS)
            log.log(logging.WARNING if is_bad else logging.INFO, "%s", text)

    # ------------------------------------------------------------ each second, minute

    def _each_second(self, now_ns: int) -> None:
        """Report to systemd and the status file."""
        self._log([])
        stalled = self._feed.stalled_source()
        if not stalled:
            self._notify("WATCHDOG=1")
        elif stalled != self._stalled:
            log.error("%s: the watchdog is not fed", stalled)
        self._stalled = stalled
        counters = self._counters()
        used_fixes = sum(counters[name] for name in _USED)
        if used_fixes != self._used_fixes:
            self._used_fixes, self._fix_ns = used_fixes, now_ns
        self._notify(f"STATUS={self._summary()}")
        status = self._describe(now_ns, counters)
        for file in self._statuses:
            file.write(status)

    def _log_health(self) -> None:
        counters = self._counters()
        news = Counter(counters)
        news.subtract(self._logged)
        self._logged = counters
        counted = ", ".join(f"{name} {n}" for name, n in sorted(news.items()) if n)
        log.info("%s; in the last minute: %s", self._summary(), counted or "nothing")

    @property
    def _doing(self) -> str:
        if self._row is not None:
            return "not logging" if self._latlong.trouble else "tracking"
        return "starting" if self._pipeline is None else "waiting for the first fix"

    def _summary(self) -> str:
        if self._row is None:
            return self._doing
        summary = f"{self._doing}: {self._row.mode}, r95 {self._row.r95_m:.1f} m"
        return "; ".join(filter(None, [summary, self._latlong.trouble]))

    def _counters(self) -> Counter[str]:
        total = Counter(self._past)
        if self._pipeline is not None:
            total.update(self._pipeline.counters)
        total.update(self._latlong.counters)
        total.update(self._state.counters)
        total["late_rows"] = self._late_rows
        if self._recorder is not None:
            recorded = self._recorder.counters
            total.update({f"recording_{name}": n for name, n in recorded.items()})
        total.update(self._feed.counters)
        return total

    def _describe(self, now_ns: int, counters: Counter[str]) -> Status:
        """Return the status, see `status`."""
        row = None if self._row is None else row_of(self._row)
        health, fix_age_s = self._feed.health(), (now_ns - self._fix_ns) // SECOND_NS
        learnt, ahead = EstimatorReport(), None
        unread: dict[str, int] = {}
        if self._pipeline is not None:
            if self._row is not None:
                ahead = prediction_of(self._pipeline.predict(AHEAD_S))
            learnt = self._pipeline.report()
            learnt.pop("counters")
            unread = self._pipeline.unread
        return {
            "version": VERSION,
            "pid": os.getpid(),
            "t_ns": now_ns,
            "uptime_s": (now_ns - self._start_ns) // SECOND_NS,
            "source": self._source,
            "state": self._doing,
            "mode": row and row["mode"],
            "r95_m": row and row["r95_m"],
            "row_age_s": (
                round((now_ns - self._row.t_ns) / SECOND_NS, 3)
                if self._row is not None and self._feed.is_live
                else None
            ),
            "fix_age_s": fix_age_s if self._used_fixes else None,
            "imu_rate_hz": health.get("imu", {}).get("rate_hz"),
            "disk_free_mb": disk_free_mb(self._config.log.path),
            "row": row,
            "prediction": ahead,
            **health,
            "unread_sentences": unread,
            "log": log_of(self._config.log.path, self._latlong),
            "faults": faults_of(counters),
            "counters": dict(sorted(counters.items())),
            "learnt": learnt,
        }
