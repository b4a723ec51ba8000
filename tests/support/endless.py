"""A drive without end: sensors for the daemon that plan one frame at a time.

`scripted_sensors` plans a whole walk at once; here the memory of a month is that of a
second, so that what grows is the daemon's. It drives anywhere on the Earth and at any
time, the truth beside it.
"""

from collections.abc import Callable, Iterator
from functools import partial
from itertools import islice
from typing import Any, NamedTuple, cast

import numpy as np

from imu_tracker.calibration.counts import CountsModel
from imu_tracker.config import Config
from imu_tracker.geometry.geodesy import gravity_mps2
from imu_tracker.samples import DEFAULT_MOUNT, Frame, Source
from imu_tracker.simulation import SCENARIOS
from imu_tracker.simulation.imu.chip import Imu
from imu_tracker.simulation.imu.errors import TYPICAL_CHIP, ChipTraits
from imu_tracker.simulation.motion.positions import TICKS_PER_S, Place, whereabouts
from imu_tracker.simulation.motion.trajectory import Trajectory
from imu_tracker.simulation.receiver.receiver import TYPICAL_RECEIVER, Receiver
from imu_tracker.sources.live import GpsFactory, ImuFactory
from support.fake_clock import FakeClock
from support.scripted_sensors import LINE_NS, S, ScriptedGps, ScriptedImu

RATE_HZ = 10.0
ARRIVAL_NS = 50_000_000  # the grid of the FIFO

Edit = Callable[[bytes], bytes | None]
Silences = tuple[float, float, float]
"""Every so many seconds, from this second on, for so long."""


class Where(NamedTuple):
    """A point of the truth, by the host's clock."""

    t_ns: int
    lat_rad: float
    lon_rad: float
    alt_m: float


class EndlessDrive:
    """Sensors that drive about for ever.

    Parameters
    ----------
    clock : FakeClock
        The drive begins at its present time.
    place : Place
        Where it begins.
    start_utc_s : float
        When.
    edit : callable, optional
        What the wire makes of the receiver's line; None swallows it.
    imu_silence, gps_silence : Silences, optional
        When a sensor is gone.
    """

    def __init__(
        self,
        clock: FakeClock,
        place: Place,
        start_utc_s: float,
        *,
        seed: int = 1,
        edit: Edit | None = None,
        imu_silence: Silences | None = None,
        gps_silence: Silences | None = None,
    ) -> None:
        self._clock, self._place, self._seed = clock, place, seed
        self._start_ns, self._start_utc_s = clock.now_ns(), start_utc_s
        self._edit = edit
        self._silences = {Source.IMU: imu_silence, Source.GPS: gps_silence}
        self._frames: dict[Source, Iterator[Frame]] = {}
        self.imu: ScriptedImu
        self.gps: ScriptedGps

    # ------------------------------------------------------------- what happens

    def _rng(self, stream: int) -> np.random.Generator:
        return np.random.default_rng([self._seed, stream])

    def _trajectory(self) -> Trajectory:
        return SCENARIOS["drive"].trajectory(self._rng(1))

    def _bursts(self) -> Iterator[Frame]:
        chip = ChipTraits.draw(TYPICAL_CHIP, self._rng(2))
        imu = Imu(TYPICAL_CHIP, chip, self._rng(3), RATE_HZ, has_engine=True)
        gravity = gravity_mps2(self._place.lat_rad, self._place.alt_m)
        counts = CountsModel(4, 500, DEFAULT_MOUNT)
        for t_ns, data in imu.bursts(self._trajectory(), gravity, counts):
            yield Frame(self._start_ns + t_ns, Source.IMU, data)

    def _lines(self) -> Iterator[Frame]:
        receiver = Receiver(TYPICAL_RECEIVER, self._rng(4), 1.0, self._start_utc_s)
        for t_s, line in receiver.lines(whereabouts(self._trajectory(), self._place)):
            data = line if self._edit is None else self._edit(line)
            if data is not None:
                yield Frame(self._start_ns + round(t_s * S), Source.GPS, data)

    def truth(self, seconds: float, every_s: int = 1) -> Iterator[Where]:
        """Where the drive really is, each so many seconds."""
        ticks = (
            Where(self._start_ns + round(t_s * S), *place)
            for motion, *places in whereabouts(self._trajectory(), self._place)
            for t_s, *place in zip(motion.t_s.tolist(), *places, strict=True)
        )
        return islice(ticks, 0, round(seconds * TICKS_PER_S), every_s * TICKS_PER_S)

    # ------------------------------------------------------------ who delivers it

    def _is_silent(self, frame: Frame) -> bool:
        silence = self._silences[frame.source]
        if silence is None:
            return False
        every_s, from_s, for_s = silence
        phase_s = (frame.t_ns - self._start_ns) / S % every_s
        return from_s <= phase_s < from_s + for_s

    def _plan(self, source: Source) -> None:
        """Plan the next frame of a source; what is silent is left out."""
        frame = next(f for f in self._frames[source] if not self._is_silent(f))
        if source is Source.IMU:
            arrival_ns = -(-frame.t_ns // ARRIVAL_NS) * ARRIVAL_NS
        else:
            arrival_ns = frame.t_ns + LINE_NS
        self._clock.at(arrival_ns, partial(self._deliver, frame))

    def _deliver(self, frame: Frame) -> None:
        if frame.source is Source.IMU:
            self.imu.deliver(frame)
        else:
            self.gps.put(frame)
        self._plan(frame.source)

    def _imu_reader(self, config: Config, put: Any, clock: Any) -> ScriptedImu:
        self.imu = ScriptedImu(put, self._clock)
        self._frames[Source.IMU] = self._bursts()
        self._plan(Source.IMU)
        if (silence := self._silences[Source.IMU]) is not None:
            every_s, from_s, _ = silence
            self._lose_imu(self._start_ns + round(from_s * S), round(every_s * S))
        return self.imu

    def _lose_imu(self, at_ns: int, every_ns: int) -> None:
        def lose() -> None:
            self.imu.lose()
            self._lose_imu(at_ns + every_ns, every_ns)

        self._clock.at(at_ns, lose)

    def _gps_reader(self, config: Config, put: Any, clock: Any) -> ScriptedGps:
        self.gps = ScriptedGps(put, self._clock)
        self._frames[Source.GPS] = self._lines()
        self._plan(Source.GPS)
        return self.gps

    @property
    def readers(self) -> dict[str, Any]:
        """The arguments of `daemon.run.run`."""
        return {
            "imu_reader": cast(ImuFactory, self._imu_reader),
            "gps_reader": cast(GpsFactory, self._gps_reader),
        }
