"""The serial line between a receiver and the daemon, in the time of a `TurnClock`.

Each byte arrives when the line has carried it, and at another speed than the
receiver's as another byte. What the receiver says is known before; what happens to
the plug and to the speed is a matter of when.
"""

import math
from bisect import bisect_right
from collections.abc import Callable, Iterable
from typing import Final

import serial

from faults.drives import S, Said, clock_ns
from faults.turns import TurnClock

POLL_NS: Final = 200_000_000
WAKES_NS: Final = 10_000_000  # a kernel hands over what came in so much time
NOISE: Final = bytes((37 * value + 11) % 256 for value in range(256))


class SerialLine:
    """What the receiver says, byte by byte.

    Parameters
    ----------
    clock : TurnClock
    lines : iterable of Said
    baud : int
    buffer_s : float
        What waits longer than this for the line is never sent: the receiver's own
        buffer is full.

    Attributes
    ----------
    baud : int
        The receiver's speed now.
    is_plugged : bool
    hear : callable
        Changes what a listener gets: noise.
    """

    def __init__(
        self,
        clock: TurnClock,
        lines: Iterable[Said],
        baud: int,
        buffer_s: float = math.inf,
    ) -> None:
        self.clock, self.baud, self.is_plugged = clock, baud, True
        self.hear: Callable[[bytes], bytes] = lambda heard: heard
        self.openings = 0
        said = bytearray()
        arrivals: list[int] = []
        self.epochs_s: list[tuple[float, float]] = []  # first and last byte of each
        byte_ns, free_ns = 10 * S // baud, 0
        for t_ns, line in lines:
            begin_ns = max(t_ns, free_ns)
            if begin_ns - t_ns > buffer_s * S:
                continue
            free_ns = begin_ns + byte_ns * (len(line) + 2)
            said += line + b"\r\n"
            arrivals += range(begin_ns, free_ns, byte_ns)
            begin_s, end_s = ((t - clock_ns(0)) / S for t in (begin_ns, free_ns))
            if line[3:6] == b"RMC":
                self.epochs_s.append((begin_s, end_s))
            elif self.epochs_s:
                self.epochs_s[-1] = self.epochs_s[-1][0], end_s
        self.said, self.arrivals = bytes(said), arrivals

    def open(self, path: str, baud: int) -> "LinePort":
        if not self.is_plugged:
            raise serial.SerialException(2, f"could not open port {path}")
        self.openings += 1
        return LinePort(self, baud)

    def unplug(self) -> None:
        self.is_plugged = False

    def plug(self) -> None:
        self.is_plugged = True


class LinePort:
    """Satisfies `imu_tracker.sensors.gnss.port.GpsPort`."""

    has_speed = True

    def __init__(self, line: SerialLine, baud: int) -> None:
        self._line, self._baud, self._is_open = line, baud, True
        self._heard = bisect_right(line.arrivals, line.clock.now_ns())

    def read(self) -> bytes:
        """Return what arrived since the last read, when there is something."""
        line, clock = self._line, self._line.clock
        until_ns = clock.now_ns() + POLL_NS
        while line.is_plugged:
            now_ns = clock.now_ns()
            end = bisect_right(line.arrivals, now_ns)
            if chunk := line.hear(line.said[self._heard : end]):
                self._heard = end
                is_clear = self._baud == line.baud
                return chunk if is_clear else chunk.translate(NOISE)
            self._heard = end
            if now_ns >= until_ns:
                return b""
            wake_ns = until_ns
            if end < len(line.arrivals):
                wake_ns = min(until_ns, line.arrivals[end] + WAKES_NS)
            clock.sleep_until_ns(wake_ns)
        raise serial.SerialException("device reports readiness to read but is gone")

    def discard(self) -> None:
        self._heard = bisect_right(self._line.arrivals, self._line.clock.now_ns())

    def set_baud(self, baud: int) -> None:
        self._baud = baud

    def close(self) -> None:
        assert self._is_open
        self._is_open = False
