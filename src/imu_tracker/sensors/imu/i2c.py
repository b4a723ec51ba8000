"""The I2C bus: the Protocol that drivers are written against, and the real one.

The only module that knows smbus2, and it imports it when a bus is opened. What a
newcomer gets wrong: an SMBus block ends at 32 bytes, so draining a FIFO needs
`i2c_rdwr`, one combined transfer of a write (the register) and a read.
"""

import errno
import os
from pathlib import Path
from typing import TYPE_CHECKING, Final, Protocol

from imu_tracker.errors import DeviceNotFoundError
from imu_tracker.sensors import pi_advice as mending

if TYPE_CHECKING:
    from smbus2 import SMBus, i2c_msg


class I2CBus(Protocol):
    """The calls of `smbus2.SMBus` that we use, and nothing else."""

    def read_i2c_block_data(
        self, address: int, register: int, length: int, /
    ) -> list[int]:
        """Read up to 32 bytes from `register` on."""
        ...

    def write_byte_data(self, address: int, register: int, value: int, /) -> None:
        """Write one byte to `register`."""
        ...

    def i2c_rdwr(self, *messages: "i2c_msg") -> None:
        """Transfer messages with repeated starts; the read ones are filled in."""
        ...


class OpenI2CBus(I2CBus, Protocol):
    """A bus that somebody has to close."""

    def close(self) -> None:
        """Give the device file back."""
        ...


if TYPE_CHECKING:

    def _smbus2_satisfies_the_protocol(bus: SMBus) -> OpenI2CBus:
        return bus


NACK: Final = frozenset({errno.EREMOTEIO, errno.ENXIO})
"""What adapters report when nobody acknowledges: the Pi's the first, others both."""

_ADVICE: Final = {
    errno.EREMOTEIO: "nobody answers: check wiring, power and the address",
    errno.ENXIO: "nobody answers: check wiring, power and the address",
    errno.ETIMEDOUT: "the bus hangs: a device holds it low; check wiring and pull-ups",
    errno.EIO: "the adapter failed: check the wiring, or whether it was unplugged",
    errno.ENODEV: "the adapter is gone: was it unplugged?",
    errno.EBUSY: "a kernel driver or another program owns this address",
}


def open_bus(number: int) -> OpenI2CBus:
    """Open `/dev/i2c-<number>`.

    Raises
    ------
    DeviceNotFoundError
        When there is no such bus or we may not use it; says how to mend it.
    """
    from smbus2 import SMBus

    bus = SMBus()
    try:
        bus.open(number)
    except OSError as error:
        bus.close()  # the file may be open already when it turns out to be no bus
        raise DeviceNotFoundError(_why_closed(number, error)) from error
    return bus


def read_long(bus: I2CBus, address: int, register: int, length: int) -> bytes:
    """Read more bytes from `register` than an SMBus block can hold."""
    from smbus2 import i2c_msg

    data = i2c_msg.read(address, length)
    bus.i2c_rdwr(i2c_msg.write(address, [register]), data)
    return bytes(data)


def explain(error: Exception) -> str:
    """Say what went wrong, and for a transfer what its errno means on a real desk."""
    cause = error.__cause__
    if not isinstance(cause, OSError) or cause.errno is None:
        return str(error)
    advice = _ADVICE.get(cause.errno, os.strerror(cause.errno))
    return f"{error} ({errno.errorcode.get(cause.errno, cause.errno)}: {advice})"


def _why_closed(number: int, error: OSError) -> str:
    path = f"/dev/i2c-{number}"
    if isinstance(error, FileNotFoundError):
        others = ", ".join(sorted(map(str, Path("/dev").glob("i2c-*")))) or "no bus"
        return (
            f"{path} does not exist (there is {others}): "
            f"{mending.switch_i2c_on(number)}; or set imu.bus"
        )
    if isinstance(error, PermissionError):
        return f"no permission for {path}: {mending.join_group(Path(path), 'i2c')}"
    return f"{path} cannot be opened: {error.strerror or error}"
