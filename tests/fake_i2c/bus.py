"""An I2C bus with the calls of smbus2.SMBus, that fails by plan."""

import errno
import os
from collections.abc import Mapping
from ctypes import memmove
from threading import Event
from typing import NamedTuple, Protocol

from smbus2 import i2c_msg

from fake_i2c.chip import FakeMpu6050
from imu_tracker.errors import DeviceNotFoundError

_READ = 1  # I2C_M_RD of the kernel
_SMBUS_BLOCK = 32


class Clock(Protocol):
    """What the bus needs of a clock: its transfers take time."""

    def now_ns(self) -> int: ...

    def sleep_until_ns(self, t_ns: int, stop: Event | None = None) -> bool: ...


class Outage(NamedTuple):
    """From one instant to another, every transfer fails."""

    start_ns: int
    end_ns: int
    error: int
    hang_ns: int


class Flip(NamedTuple):
    """One bit of what a transfer reads arrives wrong."""

    byte: int
    bit: int


class FakeBus:
    """The wires, the adapter, and the chips by address.

    Attributes
    ----------
    transfers : int
        How many were tried.
    open_handles : int
        How many `open` gave out that were not closed.
    """

    def __init__(
        self, clock: Clock, chips: Mapping[int, FakeMpu6050], *, hz: int = 400_000
    ) -> None:
        self._clock, self._byte_ns = clock, 9 * 1_000_000_000 // hz
        self.chips = dict(chips)
        self.transfers = self.open_handles = self.generation = 0
        self._nacks: dict[int, int] = {}
        self._flips: dict[int, Flip] = {}
        self._lost: set[int] = set()
        self._outages: list[Outage] = []
        self._is_plugged = True

    # The plan of faults.

    def nack(self, *, after: int = 0, times: int = 1, taken: int = 0) -> None:
        """Refuse `times` transfers, after that many more have gone well.

        A FIFO read that breaks off has taken `taken` bytes out of the chip.
        """
        first = self.transfers + after
        self._nacks |= dict.fromkeys(range(first, first + times), taken)

    def flip(self, byte: int, bit: int, *, after: int = 0) -> None:
        """Turn round one bit that a transfer reads."""
        self._flips[self.transfers + after] = Flip(byte, bit)

    def lose(self, *, after: int = 0) -> None:
        """Acknowledge a write that the chip then does not do."""
        self._lost.add(self.transfers + after)

    def fail_between(
        self,
        start_ns: int,
        end_ns: int,
        error: int = errno.EREMOTEIO,
        *,
        hang_s: float = 0.0,
    ) -> None:
        """Fail all transfers of a time span, each after having hung for a while."""
        self._outages.append(Outage(start_ns, end_ns, error, round(hang_s * 1e9)))

    def unplug(self) -> None:
        """Take the adapter away: open handles are dead for ever."""
        self._is_plugged = False
        self.generation += 1

    def plug(self) -> None:
        """Put the adapter back; it has to be opened again."""
        self._is_plugged = True

    # smbus2.SMBus.

    def open(self) -> "Handle":
        if not self._is_plugged:
            raise DeviceNotFoundError("no such bus")
        return Handle(self)

    def close(self) -> None:
        """Nothing to give back: only handles are counted."""

    def read_i2c_block_data(
        self, address: int, register: int, length: int, /
    ) -> list[int]:
        if not 0 < length <= _SMBUS_BLOCK:
            raise ValueError(f"an SMBus block has 1 to 32 bytes, not {length}")
        return list(self._read(address, register, length))

    def write_byte_data(self, address: int, register: int, value: int, /) -> None:
        is_lost = self.transfers in self._lost
        chip, _ = self._begin(address, register, 1)
        self._spend(3)
        if not is_lost:
            chip.write(register, value)

    def i2c_rdwr(self, *messages: i2c_msg) -> None:
        """Serve what the driver needs: a register to begin with, then a read."""
        pointer, reader = messages
        assert not pointer.flags & _READ
        assert reader.flags & _READ
        assert pointer.addr == reader.addr
        (register,) = bytes(pointer)
        data = self._read(pointer.addr, register, reader.len)
        memmove(reader.buf, data, len(data))

    def _read(self, address: int, register: int, length: int) -> bytes:
        chip, flip = self._begin(address, register, length)
        self._spend(3)  # address, register, address: then the chip takes a snapshot
        data = bytearray(chip.read(register, length))
        if flip:
            data[flip.byte % length] ^= 1 << flip.bit
        self._spend(length)
        return bytes(data)

    def _begin(
        self, address: int, register: int, length: int
    ) -> tuple[FakeMpu6050, Flip | None]:
        """Address a chip, unless the plan says that it fails."""
        number = self.transfers
        self.transfers += 1
        if not self._is_plugged:
            raise _failure(errno.EIO)
        now_ns = self._clock.now_ns()
        for outage in self._outages:
            if outage.start_ns <= now_ns < outage.end_ns:
                self._clock.sleep_until_ns(now_ns + outage.hang_ns)
                raise _failure(outage.error)
        if address not in self.chips:
            self._spend(1)
            raise _failure(errno.EREMOTEIO)
        chip = self.chips[address]
        if number in self._nacks:
            if taken := min(self._nacks[number], length):
                chip.read(register, taken)
            self._spend(1 + taken)
            raise _failure(errno.EREMOTEIO)
        return chip, self._flips.get(number)

    def _spend(self, n_bytes: int) -> None:
        self._clock.sleep_until_ns(self._clock.now_ns() + n_bytes * self._byte_ns)


class Handle:
    """An open device file."""

    def __init__(self, bus: FakeBus) -> None:
        self._bus, self._generation, self._is_open = bus, bus.generation, True
        bus.open_handles += 1

    def close(self) -> None:
        self._bus.open_handles -= self._is_open
        self._is_open = False

    def _alive(self) -> FakeBus:
        assert self._is_open, "a closed bus was used"
        if self._generation != self._bus.generation:
            raise _failure(errno.EIO)
        return self._bus

    def read_i2c_block_data(
        self, address: int, register: int, length: int, /
    ) -> list[int]:
        return self._alive().read_i2c_block_data(address, register, length)

    def write_byte_data(self, address: int, register: int, value: int, /) -> None:
        self._alive().write_byte_data(address, register, value)

    def i2c_rdwr(self, *messages: i2c_msg) -> None:
        self._alive().i2c_rdwr(*messages)


def _failure(number: int) -> OSError:
    return OSError(number, os.strerror(number))
