"""Sensors that deliver a simulation to the daemon, at its instants of a `FakeClock`.

They take the place of the sensor threads: everything happens in the thread of the
test, when the daemon's loop lets time pass.
"""

from collections.abc import Callable, Iterable
from functools import partial
from typing import Any, cast

from imu_tracker.config import Config
from imu_tracker.samples import Frame, Source
from imu_tracker.sensors.gnss.reader import GpsHealth, GpsState
from imu_tracker.simulation import simulate
from imu_tracker.sources.live import GpsFactory, ImuFactory
from support.fake_clock import FakeClock

S = 1_000_000_000
DRAIN_NS = 50_000_000  # the FIFO's grid
LINE_NS = 80_000_000  # at 9600 baud

Hidden = Iterable[tuple[float, float]]


class ScriptedReader:
    """What the daemon knows of a sensor thread."""

    def __init__(self, put: Callable[[Frame], None], clock: FakeClock) -> None:
        self.put, self._clock = put, clock
        self.error: BaseException | None = None
        self.is_ready, self.chip_name, self.rate_hz = False, "", 100.0
        self.hung_ns: int | None = None
        self.samples = 0
        self.calls: list[str] = []

    @property
    def turned_ns(self) -> int:
        return self._clock.now_ns() if self.hung_ns is None else self.hung_ns

    def hang(self) -> None:
        self.hung_ns = self._clock.now_ns()

    def wake(self) -> None:
        self.hung_ns = None

    def die(self, error: BaseException) -> None:
        self.error = error

    def start(self) -> None:
        self.calls.append("start")

    def stop(self) -> None:
        self.calls.append("stop")

    def join(self, timeout_s: float | None = None) -> None:
        assert timeout_s is not None, "SIGTERM must not wait for ever"
        self.calls.append("join")


class ScriptedImu(ScriptedReader):
    """Reads a chip that is there from the beginning."""

    def deliver(self, frame: Frame) -> None:
        if not self.is_ready:
            self.is_ready, self.chip_name = True, "MPU-6050"
            self.tell(b"imu_ready MPU-6050 at address 0x68, 100 Hz")
        self.samples += 1
        self.put(frame)

    def lose(self) -> None:
        self.is_ready = False
        self.tell(b"imu_lost I2C read failed")

    def tell(self, event: bytes) -> None:
        self.put(Frame(self._clock.now_ns(), Source.EVENT, event))

    def health(self) -> dict[str, int]:
        return {"samples": self.samples}


class ScriptedGps(ScriptedReader):
    """Listens to a receiver that is there from the beginning."""

    def health(self) -> GpsHealth:
        return GpsHealth(GpsState.OK, "", 9600, 0, 0, 0, 0)


class ScriptedSensors:
    """A walk of so many seconds, with spans in which a sensor is silent.

    Parameters
    ----------
    clock : FakeClock
        Stands where the simulation begins.
    seconds : float
        Length of the walk.
    imu_hidden, gps_hidden : iterable of (from, to)
        In seconds since its begin.
    """

    def __init__(
        self,
        clock: FakeClock,
        seconds: float,
        *,
        imu_hidden: Hidden = (),
        gps_hidden: Hidden = (),
    ) -> None:
        self._clock, self._seconds = clock, seconds
        self._hidden = {Source.IMU: tuple(imu_hidden), Source.GPS: tuple(gps_hidden)}
        self.imu: ScriptedImu
        self.gps: ScriptedGps

    def imu_reader(self, config: Config, put: Any, clock: Any) -> ScriptedImu:
        self.imu = ScriptedImu(put, self._clock)
        return self.imu

    def gps_reader(self, config: Config, put: Any, clock: Any) -> ScriptedGps:
        self.gps = ScriptedGps(put, self._clock)
        start_ns = self._clock.now_ns()
        for frame in simulate("walk-line", duration_s=self._seconds).frames:
            seconds = (frame.t_ns - start_ns) / S
            if any(a <= seconds < b for a, b in self._hidden[frame.source]):
                continue
            if frame.source is Source.IMU:
                arrival_ns = -(-frame.t_ns // DRAIN_NS) * DRAIN_NS
                self._clock.at(arrival_ns, partial(self.imu.deliver, frame))
            else:
                self._clock.at(frame.t_ns + LINE_NS, partial(self.gps.put, frame))
        for from_s, _ in self._hidden[Source.IMU]:
            self._clock.at(start_ns + round(from_s * S) + DRAIN_NS, self.imu.lose)
        return self.gps

    @property
    def readers(self) -> dict[str, Any]:
        """The arguments of `daemon.run.run`."""
        return {
            "imu_reader": cast(ImuFactory, self.imu_reader),
            "gps_reader": cast(GpsFactory, self.gps_reader),
        }
