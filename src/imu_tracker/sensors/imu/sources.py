"""Two ways to get timed frames from the chip, and a watch over what it delivers.

What a newcomer gets wrong: a chip that hangs still answers. It repeats its last
sample, or delivers none, and no transfer fails.
"""

from collections import Counter
from collections.abc import Sequence
from typing import Final, Protocol

from imu_tracker.samples import Frame, Source
from imu_tracker.sensors.clock import MILLISECOND_NS, SECOND_NS, Clock
from imu_tracker.sensors.imu.fifo import FRAME_BYTES, DrainOutcome
from imu_tracker.sensors.imu.mpu6050 import Mpu6050
from imu_tracker.sensors.imu.sample_clock import SampleClock
from imu_tracker.sensors.imu.setup import ImuSettings

DRAIN_NS: Final = 50 * MILLISECOND_NS
SUSPECT_NS: Final = 250 * MILLISECOND_NS  # of silence, or of the same sample

_GOLDEN: Final = 0.382
_INTERNAL_HZ: Final = 1000.0
_MICROSECOND_NS: Final = 1000


def drain_period_ns(rate_hz: float, depth: int) -> int:
    """Return how often to drain a FIFO that holds `depth` frames.

    About each 50 ms, or when it is half full, and never after a whole number of
    samples: with the golden section as remainder, and by the measured rate, the looks
    fall evenly on all phases of the chip's clock, which makes its fit sharp.
    """
    sample_ns = SECOND_NS / rate_hz
    whole = min(DRAIN_NS // sample_ns, depth // 2)
    return round((whole + _GOLDEN) * sample_ns)


class ImuSource(Protocol):
    """A configured chip as a source of frames."""

    @property
    def period_ns(self) -> int:
        """How long to wait from one read to the next."""
        ...

    @property
    def rate_hz(self) -> float:
        """Samples per second of the host's clock."""
        ...

    def read(self) -> tuple[list[Frame], str]:
        """Return the new frames, and why they are to be doubted or ""."""
        ...

    def restart(self) -> None:
        """Distrust what the chip holds."""
        ...


class FifoSource:
    """Every sample of the chip, at the instant of the chip's own clock."""

    def __init__(
        self, imu: Mpu6050, settings: ImuSettings, counts: Counter[str]
    ) -> None:
        imu.configure(settings)
        imu.fifo.restart()
        self._imu, self._counts = imu, counts
        self._samples = SampleClock(imu.setup.rate_hz, _delay_ns(imu))
        self._depth = imu.chip.fifo_bytes // FRAME_BYTES

    @property
    def period_ns(self) -> int:
        """How long to wait from one drain to the next, by the chip's own clock."""
        return drain_period_ns(self.rate_hz, self._depth)

    @property
    def rate_hz(self) -> float:
        """The measured sample rate."""
        return self._samples.rate_hz

    def read(self) -> tuple[list[Frame], str]:
        """Drain the FIFO; a FIFO that had to be started anew gives no frames."""
        drain = self._imu.fifo.drain()
        if drain.outcome is DrainOutcome.FRAMES:
            stamps = self._samples.stamp(
                len(drain.frames), drain.before_ns, drain.after_ns
            )
            timed = zip(stamps, drain.frames, strict=True)
            return [Frame(t_ns, Source.IMU, raw) for t_ns, raw in timed], ""
        self._samples.restart()
        self._counts["fifo_restarts"] += 1
        self._counts["fifo_overflows"] += drain.outcome is DrainOutcome.OVERFLOW
        is_odd = drain.outcome is DrainOutcome.MISALIGNED
        return [], "the FIFO held no whole frames" if is_odd else ""

    def restart(self) -> None:
        """Empty the FIFO at the next read."""
        self._imu.fifo.distrust()


class BurstSource:
    """The newest sample at each tick of the host; simpler, and not every sample.

    The chip runs at 1 kHz, so that what a burst finds is at most 1 ms old.
    """

    def __init__(self, imu: Mpu6050, settings: ImuSettings, clock: Clock) -> None:
        imu.configure(settings._replace(rate_hz=_INTERNAL_HZ))
        self._imu, self._clock, self.rate_hz = imu, clock, settings.rate_hz
        self._age_ns = _delay_ns(imu) + round(SECOND_NS / imu.setup.rate_hz / 2)
        self.period_ns = round(SECOND_NS / settings.rate_hz)

    def read(self) -> tuple[list[Frame], str]:
        """Read one burst."""
        now_ns = self._clock.now_ns()
        raw = self._imu.read_burst()
        return [Frame(now_ns - self._age_ns, Source.IMU, raw)], ""

    def restart(self) -> None:
        """Nothing is held between two bursts."""


class FrameWatch:
    """Notices a chip that repeats itself or falls silent.

    Counts looks, not time: a host that was stalled says nothing about the chip.

    Attributes
    ----------
    is_alive : bool
        Whether the newest frames differ, as those of a chip that measures do.
    """

    def __init__(self, period_ns: int, counts: Counter[str]) -> None:
        self.is_alive, self._counts = False, counts
        self._patience = 2 + SUSPECT_NS // period_ns
        self._silent_looks = self._same_looks = 0
        self._last = b""

    def look(self, frames: Sequence[Frame]) -> str:
        """Look at what one read gave; return what is wrong with the chip, or ""."""
        self._silent_looks = 0 if frames else self._silent_looks + 1
        self._same_looks += 1
        for frame in frames:
            if frame.data == self._last:
                self._counts["frozen_frames"] += 1
            else:
                self.is_alive = self.is_alive or bool(self._last)
                self._last, self._same_looks = frame.data, 0
        if max(self._silent_looks, self._same_looks) < self._patience:
            return ""
        is_silent = self._silent_looks >= self._patience
        self.is_alive, self._silent_looks, self._same_looks = False, 0, 0
        if is_silent:
            return "the chip delivers no samples"
        return "the chip repeats the same sample"


def _delay_ns(imu: Mpu6050) -> int:
    return imu.setup.low_pass.delay_us * _MICROSECOND_NS
