"""The sensors as a feed: two threads, and the queue between them and the loop."""

from collections import Counter, deque
from collections.abc import Callable
from typing import Final, TypeAlias

from imu_tracker.config import Config
from imu_tracker.samples import Frame, SessionHeader, Source
from imu_tracker.sensors.clock import MILLISECOND_NS, SECOND_NS, Clock
from imu_tracker.sensors.gnss.reader import GpsReader
from imu_tracker.sensors.imu.reader import ImuReader
from imu_tracker.sources import factory as hardware
from imu_tracker.sources.feed import BATCH, Delivery, SensorHealth

MAX_WAITING: Final = 20_000
"""Frames that wait while the loop is busy: three minutes at 100 Hz, and 5 MB."""

ARRIVAL_NS: Final = 60 * MILLISECOND_NS
"""From an instant to its frame in the queue: the grid of the FIFO, and its filter."""

CHIP_NS: Final = 300 * MILLISECOND_NS
"""So long the header waits for the name of the chip."""

HANGS_NS: Final = 10 * SECOND_NS
"""A thread that did not turn for so long does not retry, it hangs."""

CLOSE_S: Final = 0.7
"""For the end of each thread: SIGTERM leaves 2 s for everything."""

ImuFactory: TypeAlias = Callable[[Config, hardware.Put, Clock], ImuReader]
GpsFactory: TypeAlias = Callable[[Config, hardware.Put, Clock], GpsReader]


class HardwareFeed:
    """Two threads that read the sensors, and the queue between them and the loop.

    A full queue refuses frames: they are counted, and an event `queue_overrun <n>`
    stands in the stream where they are missing.

    Parameters
    ----------
    config : Config
    clock : Clock
    imu_reader, gps_reader : callable
        Make the threads.
    """

    is_live = True
    is_over = False

    def __init__(
        self,
        config: Config,
        clock: Clock,
        imu_reader: ImuFactory,
        gps_reader: GpsFactory,
    ) -> None:
        self._config, self._clock = config, clock
        self._queue: deque[Frame] = deque()
        self._refused_frames = self._overruns = 0
        self._imu = imu_reader(config, self._put, clock)
        self._gps = gps_reader(config, self._put, clock)
        self._has_begun = False
        self._samples, self._sampled_ns = 0, clock.now_ns()
        self._begin_by_ns = clock.now_ns() + CHIP_NS
        self._imu.start()
        self._gps.start()

    def _put(self, frame: Frame) -> None:
        """Take a frame, in the thread of a sensor: never waits."""
        if len(self._queue) < MAX_WAITING:
            self._queue.append(frame)
        else:
            self._refused_frames += 1

    def read(self) -> Delivery:
        """Return what the sensors have put."""
        for reader in (self._imu, self._gps):
            if reader.error is not None:
                raise reader.error
        now_ns = self._clock.now_ns()
        items: list[SessionHeader | Frame] = []
        if not self._has_begun:
            if not self._imu.chip_name and now_ns < self._begin_by_ns:
                return Delivery([], None)
            self._has_begun = True
            chip = {"chip": self._imu.chip_name} if self._imu.chip_name else {}
            items.append(hardware.live_header(self._config, **chip))
        queue = self._queue
        items += [queue.popleft() for _ in range(min(len(queue), BATCH))]
        if queue:
            return Delivery(items, None)
        if self._refused_frames > self._overruns:
            lost = self._refused_frames - self._overruns
            self._overruns += lost
            text = b"queue_overrun %d frames were lost" % lost
            items.append(Frame(now_ns, Source.EVENT, text))
        return Delivery(items, now_ns - ARRIVAL_NS)

    def stalled_source(self) -> str:
        """Name the thread that neither delivers nor retries, or ""."""
        now_ns = self._clock.now_ns()
        for name, reader in (("IMU", self._imu), ("GPS", self._gps)):
            if now_ns - reader.turned_ns > HANGS_NS:
                return f"the thread of the {name} hangs"
        samples = self._imu.health()["samples"]
        if samples > self._samples or not self._imu.is_ready:
            self._samples, self._sampled_ns = samples, now_ns
        if now_ns - self._sampled_ns > HANGS_NS:
            return "the thread of the IMU neither delivers nor retries"
        return ""

    def health(self) -> SensorHealth:
        """Return how each sensor is, for the status."""
        imu, gps = self._imu, self._gps.health()
        rate_hz = round(imu.rate_hz, 3) if imu.is_ready else 0.0
        return {
            "imu": {
                "is_ready": imu.is_ready,
                "chip": imu.chip_name,
                "rate_hz": rate_hz,
            },
            "gps": {"state": gps.state, "detail": gps.detail, "baud": gps.baud},
        }

    @property
    def counters(self) -> Counter[str]:
        """What the threads counted, and the frames that did not fit in the queue."""
        imu, gps = self._imu.health(), self._gps.health()
        total = Counter({f"imu_{name}": n for name, n in imu.items()})
        for name in ("bytes", "lines", "sentences", "reopens"):
            total[f"gps_{name}"] = getattr(gps, name)
        total["refused_frames"] = self._refused_frames
        return total

    def close(self) -> None:
        """End both threads; one that waits for a host is left to itself."""
        for reader in (self._imu, self._gps):
            reader.stop()
        for reader in (self._imu, self._gps):
            reader.join(CLOSE_S)
        self._begin_by_ns = 0
