"""A receiver in a train: ten metres a second due east, for as long as the tests last.

A train at constant speed feels nothing but gravity and its own shaking, as the chip
inside the machine does, so both sensors tell the same story and the truth of every row
is known. Its UTC goes on through power cuts, and is not that of anybody's system clock.
"""

import math
import socket
import threading
import time
from collections.abc import Iterator
from contextlib import suppress
from datetime import UTC, datetime, timedelta
from random import Random

from support.nmea_text import sentence

START = datetime(2026, 12, 1, 8, 0, tzinfo=UTC)
LAT_DEG, LON_DEG = 51.99, 4.37
SPEED_MPS = 10.0
# Metres in a degree there, by the radii of curvature of WGS-84.
NORTH_M = 111_267.2
EAST_M = 111_551.5 * math.cos(math.radians(LAT_DEG))

NOISE_M = 1.0  # of each axis; RMC and GGA of one instant share it
LATENCY_S = 0.2  # from the instant to the first byte, as gps.latency_s has it
BYTES_PER_S = 960.0  # 9600 baud; QEMU itself would deliver all at once
_PIECE = 32


class Receiver:
    """Speaks once a second to whichever machine is on.

    `hold` lets what it says pile up on the way, `release` delivers the pile at once, as
    a buffer in between does; `silence` and `speak` are for an antenna that is torn off.
    """

    def __init__(self) -> None:
        self._begun_s = time.monotonic()
        self._random = Random(6050)
        self._wire: socket.socket | None = None
        self._lock = threading.Lock()
        self._pile: list[bytes] | None = None
        self._is_silent = False
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._speak, name="receiver")
        self._thread.start()

    def close(self) -> None:
        self._stop.set()
        self._thread.join()
        self.pull_out()

    def plug_in(self, wire: socket.socket) -> None:
        # Minutes of sentences would fit in there, to be read when they are old.
        wire.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 1)
        wire.settimeout(1.0)
        with self._lock:
            self._wire = wire

    def pull_out(self) -> None:
        with self._lock:
            if self._wire is not None:
                self._wire.close()
            self._wire = None

    def silence(self) -> None:
        self._is_silent = True

    def speak(self) -> float:
        """Speak again; return the UTC of the next epoch."""
        self._is_silent = False
        return START.timestamp() + self._next_s()

    def hold(self) -> None:
        self._pile = []

    def release(self) -> int:
        """Deliver the pile at once; return how many epochs it held."""
        pile, self._pile = self._pile or [], None
        self._send(b"".join(pile), 0.0)
        return len(pile)

    def utc(self) -> datetime:
        """Tell the time."""
        return START + timedelta(seconds=time.monotonic() - self._begun_s)

    def _speak(self) -> None:
        for elapsed_s in self._seconds():
            epoch = epoch_at(START + timedelta(seconds=elapsed_s), self._random)
            if self._pile is not None:
                self._pile.append(epoch)
            elif not self._is_silent:
                self._send(epoch, _PIECE / BYTES_PER_S)

    def _next_s(self) -> int:
        """Return the second of the next epoch, from the beginning."""
        return math.floor(time.monotonic() - self._begun_s - LATENCY_S) + 1

    def _seconds(self) -> Iterator[int]:
        """Yield each whole second when its epoch is due."""
        while not self._stop.is_set():
            elapsed_s = self._next_s()
            due_s = self._begun_s + elapsed_s + LATENCY_S
            if not self._stop.wait(max(0.0, due_s - time.monotonic())):
                yield elapsed_s

    def _send(self, data: bytes, pause_s: float) -> None:
        """Send in pieces; what nobody takes is lost, as on a wire."""
        for start in range(0, len(data), _PIECE):
            with self._lock, suppress(OSError):
                if self._wire is not None:
                    self._wire.sendall(data[start : start + _PIECE])
            self._stop.wait(pause_s)


def lon_deg_at(utc_s: float) -> float:
    """Return where the train is."""
    way_m = SPEED_MPS * (utc_s - START.timestamp())
    return LON_DEG + way_m / EAST_M


def error_m(utc_s: float, lat_deg: float, lon_deg: float) -> float:
    """Return how far off a position is."""
    return math.hypot(
        (lat_deg - LAT_DEG) * NORTH_M,
        (lon_deg - lon_deg_at(utc_s)) * EAST_M,
    )


def epoch_at(utc: datetime, random: Random) -> bytes:
    """Return the sentences of one instant."""
    lat_deg = LAT_DEG + random.gauss(0, NOISE_M) / NORTH_M
    lon_deg = lon_deg_at(utc.timestamp()) + random.gauss(0, NOISE_M) / EAST_M
    place = f"{_degrees(lat_deg, 2)},N,{_degrees(lon_deg, 3)},E"
    knots = SPEED_MPS * 3600 / 1852
    gga = f"GNGGA,{utc:%H%M%S}.00,{place},1,12,0.8,5.0,M,45.0,M,,"
    rmc = f"GNRMC,{utc:%H%M%S}.00,A,{place},{knots:.3f},90.0,{utc:%d%m%y},,,A"
    return b"".join(sentence(body) + b"\r\n" for body in (gga, rmc))


def _degrees(value_deg: float, width: int) -> str:
    degrees = int(value_deg)
    return f"{degrees:0{width}d}{(value_deg - degrees) * 60:010.7f}"
