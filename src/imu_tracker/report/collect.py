"""One pass over a recording, or over logs: all that the report shows.

The recording is tracked once, by the configured estimator; on its way each frame is
also shown to those who measure the sensors.
"""

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

from imu_tracker.config import Config
from imu_tracker.exports.merging import merged
from imu_tracker.recording.edit import Stopwatch
from imu_tracker.recording.replay import Replay
from imu_tracker.report.measures.imu_log import ImuFigures, ImuLog
from imu_tracker.report.measures.receiver_log import ReceiverFigures, ReceiverLog
from imu_tracker.report.measures.track_log import TrackLog
from imu_tracker.samples import (
    DEFAULT_MOUNT,
    Frame,
    GpsFix,
    NavState,
    SessionHeader,
    Source,
)
from imu_tracker.storage.latlong import format_row, parse_row


class Notice(NamedTuple):
    """A transition that the tracker told of."""

    t_s: float
    text: str


class Sensors(NamedTuple):
    """What only a recording has."""

    imu_log: ImuLog
    receiver_log: ReceiverLog
    imu: ImuFigures | None
    receiver: ReceiverFigures
    result: dict[str, Any]
    notices: list[Notice]


class Collected(NamedTuple):
    """All that the report shows; `sensors` is None for logs."""

    names: list[str]
    length_s: float
    track: TrackLog
    sensors: Sensors | None
    is_cut: bool


def collect_logs(paths: list[Path]) -> Collected:
    """Read logs; what they say of sensors is nothing.

    Raises
    ------
    LogError, InputMissingError
        When a log is malformed, or not there.
    """
    track = TrackLog("")
    segment, names = -1, []
    for point in merged(paths):
        if point.track not in names:
            names.append(point.track)
        track.add_row(point.row, is_new_segment=point.segment != segment)
        track.add_mode(point.row)
        segment = point.segment
    track.end()
    length_s = track.last_utc_s - track.first_utc_s if track.rows else 0.0
    return Collected(names or [p.name for p in paths], length_s, track, None, False)


class Tracked:
    """Tracks a recording, and looks at its frames on their way to the tracker.

    Parameters
    ----------
    name : str
        Of the recording.
    config : Config
    """

    def __init__(self, name: str, config: Config) -> None:
        self._name, self._config = name, config
        self._replay = Replay(config)
        self._imu, self._receiver = ImuLog(), ReceiverLog()
        self._track = TrackLog(name)
        self._length_s = 0.0
        self._stopwatch = Stopwatch()

    def rows(self, stream: Iterable[SessionHeader | Frame]) -> Iterator[NavState]:
        """Yield the rows of the log."""
        for row in self._replay.rows(self._seen(stream)):
            self._track.add_row(parse_row(format_row(row).encode("ascii")))
            yield row

    def collected(self, *, is_cut: bool = False) -> Collected:
        """Return all that was seen, once the rows are over.

        Parameters
        ----------
        is_cut : bool
            Whether the file ends in the middle of a line.
        """
        self._track.end()
        sensors = Sensors(
            self._imu,
            self._receiver,
            self._imu.figures(self._receiver.speeds),
            self._receiver.figures(),
            self._replay.result(),
            [Notice(*notice) for notice in self._replay.notices],
        )
        return Collected([self._name], self._length_s, self._track, sensors, is_cut)

    def _seen(
        self, stream: Iterable[SessionHeader | Frame]
    ) -> Iterator[SessionHeader | Frame]:
        """Pass the stream on."""
        for item in stream:
            t_s = self._stopwatch.read(item)
            self._length_s = max(self._length_s, t_s)
            if isinstance(item, SessionHeader):
                self._begin(item)
            elif item.source is Source.IMU:
                self._take(self._receiver.advance(t_s, item.t_ns))
                self._imu.add(t_s, item.data)
            elif item.source is Source.GPS:
                self._take(self._receiver.add(t_s, item.t_ns, item.data))
            yield item

    def _begin(self, header: SessionHeader) -> None:
        header = self._config.amended(header)
        settings = self._config.tracker_settings(header)
        self._imu.begin(header, settings.mount or header.mount or DEFAULT_MOUNT)
        self._receiver.begin(header)

    def _take(self, fixes: list[GpsFix]) -> None:
        for fix in fixes:
            self._track.add_fix(fix)
