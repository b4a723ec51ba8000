"""The three producers of frames for a running daemon, in one shape.

A feed never waits: it hands over what has arrived since it was asked last, in order,
and says up to which time that is all. What a newcomer gets wrong: silence is news. The
loop may let time pass only as far as nothing can come from before it any more.
"""

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from typing import Any, Final, NamedTuple, Protocol, TypeAlias

from imu_tracker import hardware
from imu_tracker.config import Config
from imu_tracker.errors import ConfigError, InputMissingError, RecordingError
from imu_tracker.recording import read_recording
from imu_tracker.samples import Frame, SessionHeader, Source
from imu_tracker.scenes import Stopwatch
from imu_tracker.sensors.clock import MILLISECOND_NS, SECOND_NS, Clock
from imu_tracker.sensors.gps import GpsReader
from imu_tracker.sensors.imu import ImuReader

BATCH: Final = 1000
"""Items of one delivery at most: some 30 ms of work, then signals get their turn."""

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


class Delivery(NamedTuple):
    """What arrived; `complete_ns` is up to when that is all, None when more waits."""

    items: list[SessionHeader | Frame]
    complete_ns: int | None


class Feed(Protocol):
    """Where the loop gets its frames."""

    @property
    def is_live(self) -> bool:
        """Whether the frames are of now."""
        ...

    @property
    def is_over(self) -> bool:
        """Whether everything was delivered that there will ever be."""
        ...

    def take(self) -> Delivery:
        """Return what arrived; raises what ended a thread."""
        ...

    def hang(self) -> str:
        """Say who neither delivers nor retries, or ""; the watchdog bites for it."""
        ...

    def health(self) -> dict[str, dict[str, Any]]:
        """Return how each sensor is, for the status."""
        ...

    def close(self) -> None:
        """End the threads, if there are any; what they left can still be taken."""
        ...


def open_feed(
    config: Config, clock: Clock, imu_reader: ImuFactory, gps_reader: GpsFactory
) -> Feed:
    """Return the feed that the configuration asks for; threads begin at once."""
    if config.source.kind == "hardware":
        return HardwareFeed(config, clock, imu_reader, gps_reader)
    is_simulation = config.source.kind == "simulation"
    stream = simulated(config) if is_simulation else recorded(config)
    return PlayedFeed(stream, config.source.speed, clock)


def simulated(config: Config) -> Iterator[SessionHeader | Frame]:
    """Yield the drive or walk that never happened."""
    from imu_tracker.simulation import simulate

    source, imu = config.source, config.imu
    simulation = simulate(
        source.scenario,
        seed=source.seed,
        duration_s=source.duration_s or None,
        rate_hz=imu.rate_hz,
        accel_range_g=imu.accel_range_g,
        gyro_range_dps=imu.gyro_range_dps,
        mount=imu.mount,
    )
    yield config.amended(simulation.header)
    yield from simulation.frames


def recorded(config: Config) -> Iterator[SessionHeader | Frame]:
    """Yield what a recording holds; the daemon calls a bad one bad configuration."""
    if config.source.path is None:
        raise ValueError("a configuration without a path is refused")
    try:
        for item in read_recording(config.source.path):
            yield item if isinstance(item, Frame) else config.amended(item)
    except (RecordingError, InputMissingError) as error:
        raise ConfigError(f"source.path: {error}") from error


class PlayedFeed:
    """A stream that is there already, handed over at a pace.

    Parameters
    ----------
    stream : iterable
        A header, frames, perhaps a header again.
    speed : float
        How many times faster than real time, if the computer can.
    clock : Clock
    """

    is_live = False

    def __init__(
        self, stream: Iterable[SessionHeader | Frame], speed: float, clock: Clock
    ) -> None:
        self._stopwatch = Stopwatch()
        self._stream = self._timed(stream)
        self._ahead = next(self._stream, None)
        self._speed, self._clock, self._start_ns = speed, clock, clock.now_ns()
        self._last_s, self._last_ns = 0.0, 0

    def _timed(
        self, stream: Iterable[SessionHeader | Frame]
    ) -> Iterator[tuple[float, SessionHeader | Frame]]:
        for item in stream:
            yield self._stopwatch.read(item), item

    @property
    def is_over(self) -> bool:
        """Whether the stream has ended."""
        return self._ahead is None

    def take(self) -> Delivery:
        """Return what is due by now."""
        now_s = (self._clock.now_ns() - self._start_ns) / SECOND_NS * self._speed
        items: list[SessionHeader | Frame] = []
        while (ahead := self._ahead) is not None and ahead[0] <= now_s:
            if len(items) == BATCH:
                return Delivery(items, None)
            elapsed_s, item = ahead
            items.append(item)
            if isinstance(item, Frame):
                self._last_s, self._last_ns = elapsed_s, item.t_ns
            self._ahead = next(self._stream, None)
        if self.is_over:
            return Delivery(items, None)
        silence_ns = round((now_s - self._last_s) * SECOND_NS)
        return Delivery(items, self._last_ns + silence_ns)

    def hang(self) -> str:
        """Return "": there is no thread that could hang."""
        return ""

    def health(self) -> dict[str, dict[str, Any]]:
        """Return nothing: there are no sensors."""
        return {}

    def close(self) -> None:
        """Deliver nothing any more."""
        self._ahead = None


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

    def take(self) -> Delivery:
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

    def hang(self) -> str:
        """Say which thread neither delivers nor retries, or ""."""
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

    def health(self) -> dict[str, dict[str, Any]]:
        """Return how each sensor is, for the status."""
        imu = {
            "is_ready": self._imu.is_ready,
            "chip": self._imu.chip_name or None,
            "rate_hz": round(self._imu.rate_hz, 3) if self._imu.is_ready else 0.0,
            **self._imu.health(),
        }
        queue = {"waiting": len(self._queue), "refused_frames": self._refused_frames}
        return {"imu": imu, "gps": self._gps.health()._asdict(), "queue": queue}

    def close(self) -> None:
        """End both threads; one that waits for a host is left to itself."""
        for reader in (self._imu, self._gps):
            reader.stop()
        for reader in (self._imu, self._gps):
            reader.join(CLOSE_S)
        self._begin_by_ns = 0
