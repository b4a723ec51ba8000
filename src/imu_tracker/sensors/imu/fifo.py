"""The FIFO of the MPU-6050: whole frames, or a clean restart.

What a newcomer gets wrong: the FIFO holds bytes, not frames. After an overflow, or
a read that broke off, every later frame is shifted and still looks plausible. So it
is emptied on any doubt, and the temperature of every frame is followed: it is the
one field that cannot jump.

Source: RM-MPU-6000A-00 rev. 4.2, sections 4.6, 4.16, 4.27, 4.30, 4.31.
"""

from enum import Enum, auto
from struct import Struct
from typing import Final, NamedTuple

from imu_tracker.sensors.clock import Clock
from imu_tracker.sensors.imu.chips import Chip
from imu_tracker.sensors.imu.registers import (
    FIFO_ENABLE,
    FIFO_OFLOW_INT,
    FIFO_RESET,
    FIFO_TEMP_GYRO_ACCEL,
    Reg,
    Registers,
)

FRAME_BYTES: Final = 14

_ALL_SENSORS: Final = 0b11111  # temperature, gyro x y z, accelerometer: 14 bytes
_TEMPERATURE: Final = Struct(">6x h 6x")
_TEMPERATURE_STEP: Final = 1000  # counts, about 3 degC: no chip warms up so fast


class DrainOutcome(Enum):
    """What became of a look into the FIFO. Expected in service: no exception."""

    FRAMES = auto()  # some, or none yet
    OVERFLOW = auto()  # the host came too late; started anew
    MISALIGNED = auto()  # the bytes were no whole frames; started anew
    RESTARTED = auto()  # it was not running, or its last read broke off


class Drain(NamedTuple):
    """The frames that were complete when the FIFO was looked into.

    The look was between `before_ns` and `after_ns`: all frames were complete at the
    latter, and no further one was at the former.
    """

    outcome: DrainOutcome
    frames: list[bytes]
    before_ns: int
    after_ns: int


class Fifo:
    """The FIFO of one chip, filled with 14-byte frames.

    Attributes
    ----------
    setup : dict
        What its registers hold, for the check of the configuration.
    """

    def __init__(self, registers: Registers, chip: Chip, clock: Clock) -> None:
        self._registers, self._chip, self._clock = registers, chip, clock
        self.setup = {Reg.FIFO_EN: 0, Reg.USER_CTRL: 0}
        self._is_in_doubt = True
        self._temperature = 0  # counts of the last frame

    def drain(self) -> Drain:
        """Take out all whole frames, oldest first, in the counts of the MPU-6050.

        Returns
        -------
        Drain
            Without frames when the FIFO was started anew: what it held cannot be
            trusted, and the next sample is the first of a new series.
        """
        if self._is_in_doubt:
            return self._restarted(DrainOutcome.RESTARTED)
        status = self._registers.read_byte(Reg.INT_STATUS)  # first: reading clears it
        count, before_ns, after_ns = self._count()
        if count % FRAME_BYTES:  # the chip may be in the middle of writing a frame
            count, before_ns, after_ns = self._count()
        if FIFO_OFLOW_INT.get(status) or count >= self._chip.fifo_bytes:
            return self._restarted(DrainOutcome.OVERFLOW)
        if count % FRAME_BYTES:
            return self._restarted(DrainOutcome.MISALIGNED)
        frames = self._take(count)
        if not self._is_aligned(frames):
            return self._restarted(DrainOutcome.MISALIGNED)
        translated = [self._chip.to_mpu6050(frame) for frame in frames]
        return Drain(DrainOutcome.FRAMES, translated, before_ns, after_ns)

    def distrust(self) -> None:
        """Start anew at the next drain."""
        self._is_in_doubt = True

    def restart(self) -> None:
        """Empty the FIFO and let it run, in the one order that is safe."""
        self._is_in_doubt = True
        self._put(Reg.FIFO_EN, 0)
        self._put(Reg.USER_CTRL, 0)
        self._registers.write(Reg.USER_CTRL, FIFO_RESET.put(1))
        frame = self._registers.read(Reg.ACCEL_XOUT_H, FRAME_BYTES)
        (self._temperature,) = _TEMPERATURE.unpack(frame)
        self._registers.read_byte(Reg.INT_STATUS)  # forget an old overflow
        self._put(Reg.FIFO_EN, FIFO_TEMP_GYRO_ACCEL.put(_ALL_SENSORS))
        self._put(Reg.USER_CTRL, FIFO_ENABLE.put(1))
        self._is_in_doubt = False

    def _put(self, register: Reg, value: int) -> None:
        self.setup[register] = value
        self._registers.put(register, value)

    def _count(self) -> tuple[int, int, int]:
        before_ns = self._clock.now_ns()
        count = int.from_bytes(self._registers.read(Reg.FIFO_COUNT_H, 2), "big")
        return count, before_ns, self._clock.now_ns()

    def _take(self, count: int) -> list[bytes]:
        if not count:
            return []
        self._is_in_doubt = True  # until the whole transfer has gone well
        data = self._registers.read_fifo(count)
        self._is_in_doubt = False
        return [data[i : i + FRAME_BYTES] for i in range(0, count, FRAME_BYTES)]

    def _is_aligned(self, frames: list[bytes]) -> bool:
        for frame in frames:
            (temperature,) = _TEMPERATURE.unpack(frame)
            if abs(temperature - self._temperature) > _TEMPERATURE_STEP:
                return False
            self._temperature = temperature
        return True

    def _restarted(self, outcome: DrainOutcome) -> Drain:
        self.restart()
        now_ns = self._clock.now_ns()
        return Drain(outcome, [], now_ns, now_ns)
