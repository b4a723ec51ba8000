"""The MPU-6050: identify, configure, read.

A driver and nothing else: it raises at once, and never retries, logs or threads
(`imu.ImuReader` does). What a newcomer gets wrong: accelerometer, temperature and
gyro belong to one instant only when one burst reads them.

Sources: RM-MPU-6000A-00 rev. 4.2 (RM), PS-MPU-6000A-00 rev. 3.4 (PS).
"""

import errno
import math
from struct import Struct
from typing import Final

from imu_tracker.errors import BusError, ConfigError, DeviceNotFoundError
from imu_tracker.sensors.clock import MILLISECOND_NS, Clock
from imu_tracker.sensors.imu.chips import CHIPS, Chip, unknown_chip
from imu_tracker.sensors.imu.fifo import FRAME_BYTES, Fifo
from imu_tracker.sensors.imu.i2c import NACK, I2CBus
from imu_tracker.sensors.imu.registers import (
    DEVICE_RESET,
    SIGNAL_PATHS,
    Reg,
    Registers,
)
from imu_tracker.sensors.imu.setup import ImuSettings, Setup, plan

ADDRESSES: Final = (0x68, 0x69)  # pin AD0 low, high

_RESET_MS: Final = 100  # RM 4.28
_GYRO_START_MS: Final = 100  # 30 by PS 6.1; 70 for the 6500 family
_ALL_PATHS: Final = 0b111
_NO_NEIGHBOUR: Final = "and nobody at the other address"
_DEAD_BUS: Final = (0x00, 0xFF)

_PROOF_PATTERNS: Final = (0x55, 0xAA)
_PROOF_SAMPLES: Final = 20
_PROOF_GRAVITY_G: Final = (0.8, 1.2)
_ACCEL: Final = Struct(">3h 8x")


class Mpu6050:
    """One MPU-6050, or a relative of it.

    Parameters
    ----------
    bus : I2CBus
    address : int
        0x68, or 0x69 when pin AD0 is high.
    clock : Clock
    allow_unknown : bool
        Accept a chip whose WHO_AM_I is in no table, if it proves itself: a
        register holds what is written, and the accelerometer feels gravity.

    Attributes
    ----------
    chip : Chip
        Who answered; known after `probe`.
    setup : Setup
        Filter, rate and registers; known after `configure`.
    fifo : Fifo
        Known after `configure`, and not running until its first drain.
    """

    chip: Chip
    setup: Setup
    fifo: Fifo

    def __init__(
        self, bus: I2CBus, address: int, clock: Clock, *, allow_unknown: bool = False
    ) -> None:
        if address not in ADDRESSES:
            raise ConfigError(f"imu.address = 0x{address:02X}: must be 0x68 or 0x69")
        self.registers = Registers(bus, address)
        self._bus, self._clock, self._allow_unknown = bus, clock, allow_unknown

    def probe(self) -> Chip:
        """Ask the chip who it is.

        Raises
        ------
        DeviceNotFoundError
            When nobody answers, or somebody whom we do not know.
        """
        try:
            who_am_i = self.registers.read_byte(Reg.WHO_AM_I)
        except BusError as error:
            cause = error.__cause__
            code = cause.errno if isinstance(cause, OSError) else None
            if code == errno.EBUSY and (neighbour := self._neighbour()):
                raise DeviceNotFoundError(
                    f"address 0x{self.registers.address:02X} is in use by a kernel "
                    f"driver, a clock chip perhaps, {neighbour}"
                ) from error
            if code not in NACK:
                raise
            raise DeviceNotFoundError(self._nobody()) from error
        where = f"at address 0x{self.registers.address:02X}"
        if who_am_i not in CHIPS and self._is_clock_chip():
            raise DeviceNotFoundError(
                f"a clock chip (DS1307, DS3231, PCF8523) {where}, left alone, "
                + (self._neighbour() or f"{_NO_NEIGHBOUR}: tie the MPU's AD0 to 3.3 V")
            )
        if who_am_i in _DEAD_BUS:
            raise DeviceNotFoundError(
                f"the chip {where} says 0x{who_am_i:02X} for its name, as a dead bus "
                "does: check wiring, power and pull-ups"
            )
        if who_am_i not in CHIPS and not self._allow_unknown:
            raise DeviceNotFoundError(
                f"unknown chip 0x{who_am_i:02X} {where}: if it is sold as an MPU-6050, "
                "set imu.allow_unknown_chip = true and hold it still at the start"
            )
        self.chip = CHIPS.get(who_am_i) or unknown_chip(who_am_i)
        return self.chip

    def configure(self, settings: ImuSettings) -> None:
        """Reset the chip and write every register that matters; takes 0.3 s.

        Whatever another program or a brown-out left behind is gone.

        Raises
        ------
        BusError
            When a transfer fails, or a register does not hold what was written.
        DeviceNotFoundError
            As `probe`, or when an unknown chip does not prove itself.
        ConfigError
            When the chip cannot do what `settings` ask for.
        """
        chip = self.probe()
        self.setup = plan(chip, settings)
        self.fifo = Fifo(self.registers, chip, self._clock)
        self.reset()
        for register, value in self.setup.registers.items():
            self.registers.put(register, value)
        self._sleep_ms(_GYRO_START_MS)
        if not chip.is_known:
            self._prove(settings.accel_range_g)

    def is_configured(self) -> bool:
        """Tell whether the chip still holds its configuration.

        After a brown-out it does not: it is asleep, its ranges are the default ones,
        and it answers as if nothing had happened.
        """
        expected = self.setup.registers | self.fifo.setup
        return all(
            self.registers.read_byte(register) == value
            for register, value in expected.items()
        )

    def read_burst(self) -> bytes:
        """Read the newest frame: 14 bytes in MPU-6050 counts, one instant."""
        raw = self.registers.read(Reg.ACCEL_XOUT_H, FRAME_BYTES)
        return self.chip.to_mpu6050(raw)

    def reset(self) -> None:
        """Put all registers back to what they hold after power-on."""
        self.registers.write(Reg.PWR_MGMT_1, DEVICE_RESET.put(1))
        self._sleep_ms(_RESET_MS)
        if DEVICE_RESET.get(self.registers.read_byte(Reg.PWR_MGMT_1)):
            raise BusError("reset", self.registers.address, Reg.PWR_MGMT_1)
        self.registers.write(Reg.SIGNAL_PATH_RESET, SIGNAL_PATHS.put(_ALL_PATHS))
        self._sleep_ms(_RESET_MS)

    def _prove(self, accel_range_g: int) -> None:
        """See that an unknown chip measures like an MPU-6050 that is held still."""
        for value in (*_PROOF_PATTERNS, self.setup.registers[Reg.SMPLRT_DIV]):
            self.registers.put(Reg.SMPLRT_DIV, value)
        counts = []
        for _ in range(_PROOF_SAMPLES):
            self._sleep_ms(math.ceil(1000 / self.setup.rate_hz))
            counts.append(math.hypot(*_ACCEL.unpack(self.read_burst())))
        mean_g = sum(counts) / len(counts) * accel_range_g / 0x8000
        low_g, high_g = _PROOF_GRAVITY_G
        if not low_g <= mean_g <= high_g:
            raise DeviceNotFoundError(
                f"{self.chip.name} at address 0x{self.registers.address:02X} feels "
                f"{mean_g:.2f} g, not 1 g: it is no MPU-6050, or was not held still"
            )

    def _nobody(self) -> str:
        """Say that nobody answers, and whether somebody does next door."""
        text = f"nobody answers at address 0x{self.registers.address:02X}"
        neighbour = self._neighbour()
        if not neighbour:
            return f"{text}: check wiring, power and imu.bus (i2cdetect -y BUS)"
        return f"{text}, {neighbour}"

    def _neighbour(self) -> str:
        """Say that somebody answers at the other address; empty when nobody does."""
        (other,) = set(ADDRESSES) - {self.registers.address}
        try:
            Registers(self._bus, other).read_byte(Reg.WHO_AM_I)
        except BusError:
            return ""
        return (
            f"but something answers at 0x{other:02X}: set imu.address = 0x{other:02X}"
        )

    def _is_clock_chip(self) -> bool:
        """Whether there is a date in BCD where clock chips at this address have it.

        An MPU-6050 has trims there. A write would set such a clock wrong.
        """
        try:
            data = self._bus.read_i2c_block_data(self.registers.address, 0, 7)
            if _is_date(data, 3):
                return True
            if not _is_date([*data[3:], 0, 1, 0], 4):  # only then is more to be read
                return False
            data = self._bus.read_i2c_block_data(self.registers.address, 3, 7)
        except OSError:
            return False
        return _is_date(data, 4)

    def _sleep_ms(self, pause_ms: int) -> None:
        self._clock.sleep_until_ns(self._clock.now_ns() + pause_ms * MILLISECOND_NS)


def _is_date(data: list[int], weekday_at: int) -> bool:
    """Whether seven registers are seconds to year in BCD, with flags in spare bits.

    DS1307 and DS3231 begin at register 0 and count the weekday before the day, from
    1; PCF8523 begins at 3 and counts it after the day, from 0.
    """
    masks = [0x7F, 0x7F, 0x3F, 0x3F, 0x3F, 0x1F, 0xFF]
    masks[weekday_at] = 0x07
    digits = [value & mask for value, mask in zip(data, masks, strict=True)]
    if any(value >> 4 > 9 or value & 0xF > 9 for value in digits):
        return False
    values = [10 * (value >> 4) + (value & 0xF) for value in digits]
    seconds, minutes, hours = values[:3]
    weekday, day, month = values[weekday_at], values[7 - weekday_at], values[5]
    if not (1 <= day <= 31 and 1 <= month <= 12 and weekday >= 4 - weekday_at):
        return False
    return seconds < 60 and minutes < 60 and hours < 40  # 12-hour clocks have a flag
