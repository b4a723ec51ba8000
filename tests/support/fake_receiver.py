"""A receiver on a serial line, in the time of a `FakeClock`.

It speaks once a second whether anybody listens or not. Each byte arrives when the
line has carried it; at another speed than its own it arrives as another byte.
"""

from collections.abc import Callable
from typing import Final

import serial

from support.fake_clock import FakeClock

S: Final = 1_000_000_000
POLL_NS: Final = 200_000_000
NOISE: Final = bytes((37 * value + 11) % 256 for value in range(256))


class FakeReceiver:
    """A receiver, its line, and the device that comes and goes with the plug.

    `says` gives the bytes of a second; `usb` delivers them at once and at any speed.
    """

    def __init__(
        self,
        clock: FakeClock,
        says: Callable[[int], bytes],
        *,
        baud: int = 9600,
        usb: bool = False,
    ) -> None:
        self.clock, self.says, self.baud, self.usb = clock, says, baud, usb
        self.is_plugged, self.is_mute = True, False
        self.opened: list[int] = []  # the speed of each opening
        self.ports: list[FakePort] = []

    def open(self, path: str, baud: int) -> "FakePort":
        if not self.is_plugged:
            raise serial.SerialException(2, f"could not open port {path}")
        self.opened.append(baud)
        self.ports.append(FakePort(self, baud))
        return self.ports[-1]

    def plug(self) -> None:
        self.is_plugged = True

    def unplug(self) -> None:
        self.is_plugged = False

    def between(self, after_ns: int, until_ns: int, baud: int) -> bytes:
        """Return what arrives in (after, until] at somebody listening at `baud`."""
        if self.is_mute:
            return b""
        seconds = range(max(0, after_ns // S - 2), until_ns // S + 1)
        heard = b"".join(self._part(k, after_ns, until_ns) for k in seconds)
        return heard if self.usb or baud == self.baud else heard.translate(NOISE)

    def _part(self, second: int, after_ns: int, until_ns: int) -> bytes:
        start_ns = second * S
        if self.usb:
            return self.says(second) if after_ns < start_ns <= until_ns else b""
        byte_ns = 10 * S // self.baud
        first, end = (max(0, t - start_ns) // byte_ns for t in (after_ns, until_ns))
        return self.says(second)[first:end] if end > first else b""


class FakePort:
    """Satisfies `imu_tracker.sensors.gnss.port.GpsPort`."""

    def __init__(self, receiver: FakeReceiver, baud: int) -> None:
        self.receiver, self.bauds = receiver, [baud]
        self.has_speed, self.is_open = True, True
        self._read_ns = receiver.clock.now_ns() - 5 * S  # old bytes wait in the device

    def read(self) -> bytes:
        """Wake at the next millisecond in which bytes arrived."""
        clock = self.receiver.clock
        until_ns = clock.now_ns() + POLL_NS
        while self.receiver.is_plugged:
            now_ns = clock.now_ns()
            if chunk := self.receiver.between(self._read_ns, now_ns, self.bauds[-1]):
                self._read_ns = now_ns
                return chunk
            if now_ns >= until_ns:
                return b""
            clock.advance(ms=5)
        raise serial.SerialException("device reports readiness to read but is gone")

    def discard(self) -> None:
        self._read_ns = self.receiver.clock.now_ns()

    def set_baud(self, baud: int) -> None:
        self.bauds.append(baud)

    def close(self) -> None:
        assert self.is_open
        self.is_open = False
