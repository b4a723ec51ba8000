"""The thread that reads the IMU, and never gives up.

The policy for faults lives here, the driver only raises. A transfer that fails is
tried again at the next tick; a doubt about what the chip delivers costs a restart of
the FIFO. A second one in a row costs a full re-initialisation. If that does not help,
the IMU is lost: the bus is closed, and opened again with a back-off, for ever. What a
newcomer gets wrong: an adapter that was unplugged and plugged back works, but the old
file descriptor never will again.
"""

from collections import Counter
from collections.abc import Callable
from contextlib import closing
from typing import Final, Literal

from imu_tracker.errors import BusError, TrackerError
from imu_tracker.samples import Frame
from imu_tracker.sensors.clock import MILLISECOND_NS, SECOND_NS, Backoff, Clock, Pacer
from imu_tracker.sensors.imu.i2c import OpenI2CBus, explain
from imu_tracker.sensors.imu.mpu6050 import Mpu6050
from imu_tracker.sensors.imu.setup import ImuSettings
from imu_tracker.sensors.imu.sources import (
    BurstSource,
    FifoSource,
    FrameWatch,
    ImuSource,
)
from imu_tracker.sensors.sensor_thread import SensorThread

SCRUB_NS: Final = 500 * MILLISECOND_NS
"""How often the configuration is read back: with the 0.35 s that it takes to set the
chip up again, a brown-out costs less than a second."""

HEALTHY_NS: Final = 2 * SECOND_NS  # without a doubt for so long: all is forgotten
FIRST_RETRY_NS: Final = 100 * MILLISECOND_NS
LAST_RETRY_NS: Final = 500 * MILLISECOND_NS

COUNTERS: Final = (
    "samples",
    "bus_errors",
    "fifo_overflows",
    "fifo_restarts",
    "reinitialisations",
    "frozen_frames",
    "missed_ticks",
)


class ImuReader(SensorThread):
    """Delivers timed frames of the IMU, whatever happens to it.

    Parameters
    ----------
    open_bus : callable
        Opens the bus, as `lambda: i2c.open_bus(1)` does; called again after faults.
    put : callable
        Takes each frame, in the thread of the reader; must not block. Samples have
        the source IMU. Events say `imu_ready <chip, address, rate>` when samples
        begin to come, `imu_lost <reason>` when they end, `imu_reset <reason>` when
        the chip had to be set up again and that helped; and nothing else but
        `imu_failed <error>` as the last word of a bug, see `error`.
    clock : Clock
    address, settings, allow_unknown
        As for `Mpu6050`.
    read : {"fifo", "burst"}
        A chip whose FIFO is not known to hold our frames is read by bursts anyway.

    Attributes
    ----------
    is_ready : bool
        Whether samples are coming.
    chip_name : str
        Who was found; "" before.
    rate_hz : float
        Samples per second of the host's clock, as measured so far.
    """

    def __init__(
        self,
        open_bus: Callable[[], OpenI2CBus],
        put: Callable[[Frame], None],
        clock: Clock,
        *,
        address: int = 0x68,
        settings: ImuSettings | None = None,
        read: Literal["fifo", "burst"] = "fifo",
        allow_unknown: bool = False,
    ) -> None:
        super().__init__("imu", put, clock)
        self._open_bus = open_bus
        self._address, self._read_mode = address, read
        self._settings = settings or ImuSettings()
        self._allow_unknown = allow_unknown
        self._counts = Counter(dict.fromkeys(COUNTERS, 0))
        self._backoff = Backoff(FIRST_RETRY_NS, LAST_RETRY_NS)
        self._is_lost_known = False
        self._reset_reason = ""  # until samples come again
        self.is_ready, self.chip_name = False, ""
        self.rate_hz = self._settings.rate_hz

    def health(self) -> dict[str, int]:
        """Return what was counted since the start, every counter of `COUNTERS`."""
        return dict(self._counts)

    def run(self) -> None:
        """Read until stopped; what the thread does, and a test may do without one."""
        while not self._stop.is_set():
            self.turned_ns = self._clock.now_ns()
            try:
                reason = self._hold_bus()
            except (TrackerError, OSError) as error:
                reason = self._describe(error)
            if self._stop.is_set():
                break
            self._report_lost(reason)
            retry_ns = self._clock.now_ns() + self._backoff.next_ns()
            self._clock.sleep_until_ns(retry_ns, self._stop)
        self.is_ready = False

    def _hold_bus(self) -> str:
        """Read over one opened bus; return why that came to an end."""
        with closing(self._open_bus()) as bus:
            imu = Mpu6050(
                bus, self._address, self._clock, allow_unknown=self._allow_unknown
            )
            while True:
                source = self._initialise(imu)
                started_ns = self._clock.now_ns()
                reason = self._read(imu, source)
                lasted_ns = self._clock.now_ns() - started_ns
                if self._stop.is_set() or lasted_ns < HEALTHY_NS:
                    return reason
                self._counts["reinitialisations"] += 1
                self._reset_reason = reason

    def _initialise(self, imu: Mpu6050) -> ImuSource:
        self.chip_name = imu.probe().name
        if self._read_mode == "fifo" and imu.chip.fifo_bytes:
            return FifoSource(imu, self._settings, self._counts)
        return BurstSource(imu, self._settings, self._clock)

    def _read(self, imu: Mpu6050, source: ImuSource) -> str:
        """Read on the grid until restarting the FIFO does not help; return why."""
        now_ns = self._clock.now_ns()
        pacer = Pacer(self._clock, source.period_ns)
        watch = FrameWatch(source.period_ns, self._counts)
        scrub_ns, doubted_until_ns, has_failed = now_ns + SCRUB_NS, now_ns, False
        while not pacer.wait(self._stop):
            self.turned_ns = now_ns = self._clock.now_ns()
            self._counts["missed_ticks"] += pacer.take_missed()
            try:
                doubt = self._pass_on(source, watch)
                if now_ns >= scrub_ns:
                    if not imu.is_configured():
                        return "the chip lost its configuration: did its power fail?"
                    scrub_ns = now_ns + SCRUB_NS
            except BusError as error:
                reason = self._describe(error)
                if has_failed:
                    return reason
                has_failed = True
                continue
            has_failed = False
            if doubt and now_ns < doubted_until_ns:
                return doubt
            if doubt:
                doubted_until_ns = now_ns + HEALTHY_NS
            pacer.period_ns = source.period_ns
        return ""

    def _pass_on(self, source: ImuSource, watch: FrameWatch) -> str:
        """Deliver what is new; return why the chip is to be doubted, or ""."""
        frames, doubt = source.read()
        if suspicion := watch.look(frames):
            source.restart()
        if watch.is_alive and frames:
            self._deliver(frames, source.rate_hz)
        return doubt or suspicion

    def _deliver(self, frames: list[Frame], rate_hz: float) -> None:
        self.rate_hz = rate_hz
        if not self.is_ready:
            self.is_ready, self._is_lost_known = True, False
            self._backoff.reset()
            where = f"at address 0x{self._address:02X}"
            rate = f"{self._settings.rate_hz:g} Hz"
            self._tell("ready", f"{self.chip_name} {where}, {rate}")
        elif self._reset_reason:
            self._tell("reset", self._reset_reason)
        self._reset_reason = ""
        for frame in frames:
            self._put(frame)
        self._counts["samples"] += len(frames)

    def _describe(self, error: Exception) -> str:
        self._counts["bus_errors"] += isinstance(error, BusError)
        return explain(error)

    def _report_lost(self, reason: str) -> None:
        self.is_ready = False
        if not self._is_lost_known:
            self._is_lost_known = True
            self._tell("lost", reason)
