"""Edit a stream of frames on its way: hide the receiver, thin it out, slow it down.

A recording stays what it was; a scene is what would have been recorded had there been
a tunnel, or a receiver that reports less often. All of it is lazy and free of any
clock of its own.
"""

from collections.abc import Iterable, Iterator, Sequence
from typing import TYPE_CHECKING, Final, NamedTuple, TypeAlias

from imu_tracker.errors import NmeaError
from imu_tracker.samples import Frame, SessionHeader, Source
from imu_tracker.sensors.gnss.epoch import EPOCH_NS
from imu_tracker.sensors.gnss.sentences import read_sentence

if TYPE_CHECKING:
    from imu_tracker.sensors.clock import Clock

Stream: TypeAlias = Iterable[SessionHeader | Frame]

_SECOND_NS: Final = 1_000_000_000

_POSITIONS: Final = frozenset({"RMC", "GGA", "GNS", "GLL"})


class Outage(NamedTuple):
    """The receiver is hidden from `start_s` on, for `length_s`; the end is open."""

    start_s: float
    length_s: float

    def holds(self, elapsed_s: float) -> bool:
        """Tell whether an instant of the recording lies in the outage."""
        return self.start_s <= elapsed_s < self.start_s + self.length_s


class Stopwatch:
    """Seconds of a recording since its first frame.

    The monotonic clock may restart with a session; the stopwatch goes on from there.
    """

    def __init__(self) -> None:
        self._zero_ns = self._last_ns = 0
        self._has_begun = False
        self._is_new_session = True

    def read(self, item: SessionHeader | Frame) -> float:
        """Return the seconds at which an item arrived, in the order of the stream."""
        if isinstance(item, SessionHeader):
            self._is_new_session = True
            return (self._last_ns - self._zero_ns) / _SECOND_NS
        t_ns = item.t_ns
        if self._is_new_session:
            self._is_new_session = False
            if not self._has_begun:
                self._has_begun, self._zero_ns = True, t_ns
            elif t_ns < self._last_ns:
                self._zero_ns += t_ns - self._last_ns
        self._last_ns = t_ns
        return (t_ns - self._zero_ns) / _SECOND_NS


def hide_gps(
    stream: Stream, outages: Sequence[Outage]
) -> Iterator[SessionHeader | Frame]:
    """Leave out what the receiver says in the outages, by time of arrival."""
    stopwatch = Stopwatch()
    for item in stream:
        elapsed_s = stopwatch.read(item)
        is_gps = isinstance(item, Frame) and item.source is Source.GPS
        if not (is_gps and any(outage.holds(elapsed_s) for outage in outages)):
            yield item


def keep_every_nth_epoch(stream: Stream, n: int) -> Iterator[SessionHeader | Frame]:
    """Keep the first, (n+1)th, (2n+1)th ... epoch of the receiver."""
    epochs = _Epochs()
    for item in stream:
        if isinstance(item, Frame) and item.source is Source.GPS:
            is_kept = epochs.number(item) % n == 0
        else:
            is_kept = True
        if is_kept:
            yield item


def pace(
    stream: Stream, speed: float, clock: "Clock"
) -> Iterator[SessionHeader | Frame]:
    """Yield each frame when it is due at `speed` times real time."""
    stopwatch = Stopwatch()
    start_ns: int | None = None
    for item in stream:
        elapsed_s = stopwatch.read(item)
        if start_ns is None:
            start_ns = clock.now_ns()
        due_ns = start_ns + round(elapsed_s / speed * _SECOND_NS)
        if due_ns > clock.now_ns():
            clock.sleep_until_ns(due_ns)
        yield item


class _Epochs:
    """Numbers epochs as `sensors.nmea` tells them apart.

    A position with another time of day begins one. Other sentences belong to the one
    of their time or, untimed, to the last; those that cannot come ahead of the next.
    """

    def __init__(self) -> None:
        self._number = -1
        self._begin_ns = 0
        self._time_of_day_s: float | None = None

    def number(self, frame: Frame) -> int:
        """Return the number of the epoch, from 0 on, to which a sentence belongs."""
        try:
            report = read_sentence(frame.data)
        except NmeaError:
            report = None
        time_of_day_s = report.tod_s if report is not None else None
        if time_of_day_s is None:
            is_of_last = frame.t_ns - self._begin_ns < EPOCH_NS
        else:
            is_of_last = time_of_day_s == self._time_of_day_s
        if is_of_last or report is None or report.kind not in _POSITIONS:
            return max(0, self._number + (not is_of_last))
        self._number += 1
        self._begin_ns, self._time_of_day_s = frame.t_ns, time_of_day_s
        return self._number
