"""Recordings and simulations as feeds: frames that are there already, at a pace."""

from collections import Counter
from collections.abc import Iterable, Iterator

from imu_tracker.config import Config
from imu_tracker.errors import ConfigError, InputMissingError, RecordingError
from imu_tracker.recording.edit import Stopwatch
from imu_tracker.recording.files import read_recording
from imu_tracker.samples import Frame, SessionHeader
from imu_tracker.sensors.clock import SECOND_NS, Clock
from imu_tracker.sources.feed import BATCH, Delivery, SensorHealth


def simulated(config: Config) -> Iterator[SessionHeader | Frame]:
    """Yield the drive or walk that never happened."""
    from imu_tracker.simulation import simulate

    source, imu = config.source, config.imu
    simulation = simulate(
        source.scenario,
        seed=source.seed,
        duration_s=source.duration_s or None,
        rate_hz=imu.chosen_rate_hz,
        accel_range_g=imu.accel_range_g,
        gyro_range_dps=imu.gyro_range_dps,
        mount=imu.mount,
        wheels=source.wheels == "on",
        lever_arm_m=config.gps.lever_arm_m,
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

    def read(self) -> Delivery:
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

    def stalled_source(self) -> str:
        """Return "": there is no thread that could hang."""
        return ""

    def health(self) -> SensorHealth:
        """Return nothing: there are no sensors."""
        return {}

    @property
    def counters(self) -> Counter[str]:
        """Nothing: there are no sensors."""
        return Counter()

    def close(self) -> None:
        """Deliver nothing any more."""
        self._ahead = None
