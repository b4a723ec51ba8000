"""From frames to rows: decode, join, estimate. Pure, and the same for all producers.

Live hardware, a recording and the simulator each yield a `SessionHeader` and then
frames in the order of arrival; a `Pipeline` turns one session of any of them into the
rows of the log.
"""

from collections import Counter
from collections.abc import Iterable
from datetime import UTC, datetime

from imu_tracker import RELEASE_DATE
from imu_tracker.calibration.corrected import CorrectedModel, Corrections
from imu_tracker.calibration.counts import CountsModel
from imu_tracker.estimation.error_state.warm_start import LearnedParameters
from imu_tracker.estimation.prediction import Prediction
from imu_tracker.estimation.receiver.backlog import Backlog
from imu_tracker.estimation.receiver.spoofing import SpoofingMonitor
from imu_tracker.estimation.report import EstimatorReport
from imu_tracker.estimation.settings import TrackerSettings
from imu_tracker.estimation.tracker import Tracker
from imu_tracker.motion.stuck_axes import StuckAxes
from imu_tracker.notices import HoldOff
from imu_tracker.samples import (
    DEFAULT_MOUNT,
    Frame,
    GpsFix,
    NavState,
    SessionHeader,
    Source,
    UtcTime,
)
from imu_tracker.sensors.gnss.epoch_reader import EpochReader


class Pipeline:
    """One session: frames in, rows out.

    Parameters
    ----------
    header : SessionHeader
        Ranges, mounting and date of the frames.
    settings : TrackerSettings
        What is set there goes before the header.
    live : bool
        Frames come from hardware now: a receiver's date before the release of this
        program is then a rolled-over one.
    corrections : Corrections, optional
        What is known of this chip; without them the datasheet is assumed.

    Raises
    ------
    CalibrationError
        When the corrections are those of another chip or mounting.
    """

    def __init__(
        self,
        header: SessionHeader,
        settings: TrackerSettings,
        *,
        live: bool = False,
        corrections: Corrections | None = None,
    ) -> None:
        mount = settings.mount or header.mount or DEFAULT_MOUNT
        model: CountsModel | CorrectedModel
        if corrections is None:
            model = CountsModel(header.accel_range_g, header.gyro_range_dps, mount)
        else:
            model = CorrectedModel(header, mount, corrections)
        self._decode = model.decode
        # Where it stands was written down: of the receiver only the time is missing.
        self._start_utc_s = header.start_utc_s if settings.start else None
        release = datetime.fromisoformat(RELEASE_DATE).replace(tzinfo=UTC)
        self._epochs = EpochReader(
            reference_utc_s=header.start_utc_s,
            date=settings.gps_date,
            earliest_utc_s=release.timestamp() if live else None,
        )
        self._tracker = Tracker(settings)
        self._hold_off, self._now_ns = HoldOff(), 0
        self._axes, self._backlog = StuckAxes(), Backlog()
        self._spoofing = SpoofingMonitor()

    def feed(self, frame: Frame) -> list[NavState]:
        """Take the next frame; return the rows that became due."""
        t_ns, source, data = frame
        self._now_ns = max(self._now_ns, t_ns)
        if self._start_utc_s is not None:
            self._tracker.on_time(UtcTime(t_ns, self._start_utc_s))
            self._start_utc_s = None
        if source is Source.IMU:
            rows = self._close_epoch(t_ns)
            if self._axes.look(t_ns, data):
                return rows + self._tracker.advance(t_ns)
            sample = self._decode(t_ns, data)
            if self._axes.clips(sample):
                return rows + self._tracker.advance(t_ns)
            return rows + self._tracker.on_imu(sample)
        rows = self.advance(t_ns)
        if source is Source.GPS:
            self._deliver(self._epochs.feed(t_ns, data))
        return rows

    def advance(self, t_ns: int) -> list[NavState]:
        """Let time pass without a frame: rows are the same however often it is told.

        No frame of before `t_ns` may come after this.
        """
        self._now_ns = max(self._now_ns, t_ns)
        return self._close_epoch(t_ns) + self._tracker.advance(t_ns)

    def _close_epoch(self, t_ns: int) -> list[NavState]:
        """Complete what time alone completes, at its own instant."""
        closes_ns = self._epochs.closes_ns
        if closes_ns is None or closes_ns > t_ns:
            return []
        rows = self._tracker.advance(closes_ns)
        self._deliver(self._epochs.advance(closes_ns))
        return rows

    def _deliver(self, positions: list[GpsFix | UtcTime]) -> None:
        for position in self._backlog.relieved(positions):
            if isinstance(position, GpsFix):
                is_standing = self._tracker.is_standing
                self._spoofing.add_fix(position, is_standing=is_standing)
                self._tracker.on_fix(position)
            else:
                self._tracker.on_time(position)

    def predict(self, after_s: Iterable[float]) -> list[Prediction]:
        """Say where it will be, counted from the newest frame; [] before the start."""
        return self._tracker.predict(after_s)

    @property
    def counters(self) -> Counter[str]:
        """All that was counted: sentences, fixes, samples."""
        total = self._epochs.counters + self._tracker.counters
        for watch in (self._axes, self._backlog, self._spoofing):
            total += watch.counters
        return total

    def take_notices(self, *, is_over: bool = False) -> list[str]:
        """Transitions since the last call, for the log.

        What repeats is held off, until the stream is over.
        """
        watches = (self._epochs, self._axes, self._backlog, self._spoofing)
        said = [notice for watch in watches for notice in watch.take_notices()]
        said += self._tracker.take_notices()
        told = self._hold_off.pass_on(self._now_ns, said)
        return told + self._hold_off.take_held() if is_over else told

    @property
    def unread(self) -> dict[str, int]:
        """How many sentences could not be used, by reason."""
        return self._epochs.unread.reasons() | self._epochs.damaged.reasons()

    def learned_parameters(self) -> LearnedParameters | None:
        """What a next session can begin with; None: nothing, or not yet."""
        return self._tracker.learned_parameters()

    def report(self) -> EstimatorReport:
        """What was learnt, for `replay --json` and `status`."""
        report = self._tracker.report()
        report["counters"] = dict(self.counters)
        return report
