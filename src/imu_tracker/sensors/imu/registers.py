"""The registers of the MPU-6050 that we use, and how to reach them.

One declarative line per register and per field, to be proof-read against the
register map (RM-MPU-6000A-00 rev. 4.2, sections beside each line). What a newcomer
gets wrong: a write that the chip acknowledged may still not have happened, it was
asleep or in reset. `put` reads back.
"""

from enum import IntEnum
from typing import Final, NamedTuple

from imu_tracker.errors import BusError
from imu_tracker.sensors.imu.i2c import I2CBus, read_long


class Reg(IntEnum):
    """Addresses, by the names of the register map."""

    SELF_TEST_X = 0x0D  # 4.1, and the three behind it
    SMPLRT_DIV = 0x19  # 4.2
    CONFIG = 0x1A  # 4.3
    GYRO_CONFIG = 0x1B  # 4.4
    ACCEL_CONFIG = 0x1C  # 4.5
    ACCEL_CONFIG_2 = 0x1D  # 6500 family only: RM-MPU-6500A
    FIFO_EN = 0x23  # 4.6
    INT_PIN_CFG = 0x37  # 4.14
    INT_ENABLE = 0x38  # 4.15
    INT_STATUS = 0x3A  # 4.16
    ACCEL_XOUT_H = 0x3B  # 4.17 to 4.19: accel x y z, temperature, gyro x y z
    SIGNAL_PATH_RESET = 0x68  # 4.26
    USER_CTRL = 0x6A  # 4.27
    PWR_MGMT_1 = 0x6B  # 4.28
    PWR_MGMT_2 = 0x6C  # 4.29
    FIFO_COUNT_H = 0x72  # 4.30: reading it latches both bytes
    FIFO_R_W = 0x74  # 4.31
    WHO_AM_I = 0x75  # 4.32


class Field(NamedTuple):
    """Some adjacent bits of one register."""

    register: Reg
    lsb: int
    width: int

    def put(self, value: int) -> int:
        """Return `value` in its place, all other bits zero."""
        if not 0 <= value < 1 << self.width:
            raise ValueError(f"{value} does not fit in {self.width} bits")
        return value << self.lsb

    def get(self, byte: int) -> int:
        """Return the value of the field in `byte`."""
        return byte >> self.lsb & (1 << self.width) - 1


DLPF_CFG: Final = Field(Reg.CONFIG, lsb=0, width=3)
GYRO_SELF_TEST: Final = Field(Reg.GYRO_CONFIG, lsb=5, width=3)  # x y z
FS_SEL: Final = Field(Reg.GYRO_CONFIG, lsb=3, width=2)
ACCEL_SELF_TEST: Final = Field(Reg.ACCEL_CONFIG, lsb=5, width=3)  # x y z
AFS_SEL: Final = Field(Reg.ACCEL_CONFIG, lsb=3, width=2)
A_DLPF_CFG: Final = Field(Reg.ACCEL_CONFIG_2, lsb=0, width=3)
FIFO_TEMP_GYRO_ACCEL: Final = Field(Reg.FIFO_EN, lsb=3, width=5)
FIFO_OFLOW_EN: Final = Field(Reg.INT_ENABLE, lsb=4, width=1)
FIFO_OFLOW_INT: Final = Field(Reg.INT_STATUS, lsb=4, width=1)
SIGNAL_PATHS: Final = Field(Reg.SIGNAL_PATH_RESET, lsb=0, width=3)
FIFO_ENABLE: Final = Field(Reg.USER_CTRL, lsb=6, width=1)
FIFO_RESET: Final = Field(Reg.USER_CTRL, lsb=2, width=1)  # only while FIFO_ENABLE is 0
DEVICE_RESET: Final = Field(Reg.PWR_MGMT_1, lsb=7, width=1)
CLKSEL: Final = Field(Reg.PWR_MGMT_1, lsb=0, width=3)


class Registers:
    """The registers of the chip at one address of a bus.

    Every method raises `BusError` when the transfer fails, and only that.
    """

    def __init__(self, bus: I2CBus, address: int) -> None:
        self._bus, self.address = bus, address

    def read(self, register: Reg, length: int = 1) -> bytes:
        """Read up to 32 bytes from `register` on, as of one instant."""
        try:
            data = self._bus.read_i2c_block_data(self.address, register, length)
        except OSError as error:
            raise BusError("read", self.address, register) from error
        return bytes(data)

    def read_byte(self, register: Reg) -> int:
        """Read one register."""
        return self.read(register)[0]

    def read_fifo(self, length: int) -> bytes:
        """Take `length` bytes out of the FIFO."""
        try:
            return read_long(self._bus, self.address, Reg.FIFO_R_W, length)
        except OSError as error:
            raise BusError("FIFO read", self.address, Reg.FIFO_R_W) from error

    def write(self, register: Reg, value: int) -> None:
        """Write a register that clears itself; for others see `put`."""
        try:
            self._bus.write_byte_data(self.address, register, value)
        except OSError as error:
            raise BusError("write", self.address, register) from error

    def put(self, register: Reg, value: int) -> None:
        """Write a register and see that it holds the value."""
        self.write(register, value)
        self.expect(register, value)

    def expect(self, register: Reg, value: int) -> None:
        """Raise `BusError` unless `register` holds `value`."""
        found = self.read_byte(register)
        if found != value:
            action = f"check ({register.name} is 0x{found:02X}, not 0x{value:02X})"
            raise BusError(action, self.address, register)
