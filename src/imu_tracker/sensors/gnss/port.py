"""The port of a receiver, and when each byte of it arrived.

The only module that knows pyserial. What a newcomer gets wrong: `Serial.read(n)`
waits for all n bytes or its timeout, so a line would be stamped late; here a read
waits for the first byte and takes what is there.
"""

import select
import termios
from collections import deque
from typing import Final, NamedTuple, Protocol

import serial

from imu_tracker.errors import ConfigError
from imu_tracker.samples import Frame, Source
from imu_tracker.sensors.clock import MILLISECOND_NS
from imu_tracker.sensors.gnss.lines import MAX_LINE, LineSplitter

FAULTS: Final = (OSError, termios.error)
"""What a port raises when it is gone; `serial.SerialException` is an OSError."""

_GPSD_GREETING: Final = b'{"class":"VERSION"'

POLL_S: Final = 0.2
CHUNK: Final = 4096
BATCHING_NS: Final = 50 * MILLISECOND_NS  # USB converters (16 ms) and a busy host


class GpsPort(Protocol):
    """What the reader needs of a port."""

    @property
    def has_speed(self) -> bool:
        """Whether bytes take their time on a line."""
        ...

    def read(self) -> bytes:
        """Wait a moment for bytes, and return those that are there."""
        ...

    def discard(self) -> None:
        """Forget what arrived before now."""
        ...

    def set_baud(self, baud: int) -> None:
        """Listen at another speed."""
        ...

    def close(self) -> None:
        """Give the port back."""
        ...


class SerialPort:
    """A device path, or `socket://host:port`."""

    def __init__(self, path: str, baud: int) -> None:
        self.has_speed = is_device = "://" not in path
        try:
            self._serial = serial.serial_for_url(
                path, baudrate=baud, timeout=0, exclusive=is_device or None
            )
        except ValueError as error:
            raise ConfigError(
                f"gps.port = {path!r}, gps.baud = {baud}: {error}"
            ) from error

    def read(self) -> bytes:
        """Wait a moment for bytes, and return those that are there."""
        select.select([self._serial.fileno()], [], [], POLL_S)
        data = self._serial.read(CHUNK)
        if not self.has_speed and data.startswith(_GPSD_GREETING):
            raise ConnectionError(
                "gpsd answers here: write gpsd:// instead of socket://"
            )
        return data

    def discard(self) -> None:
        """Forget what arrived before now; what a peer sends first is never old."""
        if self.has_speed:
            self._serial.reset_input_buffer()

    def set_baud(self, baud: int) -> None:
        """Listen at another speed."""
        self._serial.baudrate = baud

    def close(self) -> None:
        """Give the port back."""
        self._serial.close()


class _Chunk(NamedTuple):
    start: int  # offset in the stream
    end: int
    after_ns: int  # when the one before was read: nothing was left then
    t_ns: int


class ArrivalTimes:
    """When each byte of a stream arrived, from when its chunks were read.

    Parameters
    ----------
    byte_ns : int
        What the line takes for a byte; 0 when a chunk comes at once.
    now_ns : int
        When the stream began.

    Notes
    -----
    The last byte of a chunk has only just arrived, the others before it at the speed
    of the line. A USB receiver has no such speed, whatever was configured: as soon as
    more bytes came than the line could carry, a chunk counts as having come at once.
    """

    def __init__(self, byte_ns: int, now_ns: int) -> None:
        self._byte_ns = byte_ns
        self._chunks = deque([_Chunk(0, 0, now_ns, now_ns)])

    def add(self, count: int, t_ns: int) -> None:
        """Note that `count` bytes were read at `t_ns`."""
        last = self._chunks[-1]
        if count * self._byte_ns > t_ns - last.t_ns + BATCHING_NS:
            self._byte_ns = 0
        self._chunks.append(_Chunk(last.end, last.end + count, last.t_ns, t_ns))
        while self._chunks[0].end < last.end - MAX_LINE:
            self._chunks.popleft()

    def of(self, offset: int) -> int:
        """Return when the byte at `offset` arrived: one of the last line's."""
        chunk = next(chunk for chunk in reversed(self._chunks) if chunk.start <= offset)
        bytes_after = chunk.end - 1 - offset
        return max(chunk.after_ns, chunk.t_ns - bytes_after * self._byte_ns)


class TimedLines:
    """Bytes as they are read to frames, each of the time of its first byte.

    Parameters
    ----------
    byte_ns, now_ns : int
        See `ArrivalTimes`.
    """

    def __init__(self, byte_ns: int, now_ns: int) -> None:
        self._splitter = LineSplitter()
        self._times = ArrivalTimes(byte_ns, now_ns)

    def feed(self, chunk: bytes, t_ns: int) -> list[Frame]:
        """Return the lines that a chunk completes which was read at `t_ns`."""
        self._times.add(len(chunk), t_ns)
        return [
            Frame(self._times.of(line.offset), Source.GPS, line.data)
            for line in self._splitter.split(chunk)
        ]
