"""Receivers on the network: behind gpsd, or broadcast by UDP.

Both deliver NMEA as a serial port does, so that everything behind them stays the same.
What a newcomer gets wrong: gpsd that relays this very program would feed the estimate
back as a measurement; such a device is refused.
"""

import json
import select
import socket
from io import BytesIO
from typing import Any, Final
from urllib.parse import urlsplit

from imu_tracker.sensors.gnss.port import CHUNK, POLL_S, SerialPort

CONNECT_S: Final = 5.0
MAX_JSON: Final = 65_536
"""Bytes of one object of gpsd; its longest, SKY with all satellites, has 10,000."""

OWN_NAME: Final = "imu-tracker"
"""In the path of the device that `imu-tracker serve` is, also behind a gpsd."""


class _SocketPort:
    """What both have in common: no speed, and nothing that could be old."""

    has_speed = False

    def __init__(self, connection: socket.socket) -> None:
        self._socket = connection

    def discard(self) -> None:
        """Do nothing: what a peer sends first is never old."""

    def set_baud(self, baud: int) -> None:
        """Do nothing: a network has no speed."""

    def close(self) -> None:
        """Give the port back."""
        self._socket.close()

    def _receive(self) -> bytes | None:
        """Return what came; None when nothing did in a moment."""
        ready, _, _ = select.select([self._socket], [], [], POLL_S)
        return self._socket.recv(max(CHUNK, MAX_JSON)) if ready else None


class UdpPort(_SocketPort):
    """`udp://:10110`: NMEA that somebody sends or broadcasts to a port of ours."""

    def __init__(self, url: str) -> None:
        parts = urlsplit(url)
        family = socket.AF_INET6 if ":" in (parts.hostname or "") else socket.AF_INET
        super().__init__(socket.socket(family, socket.SOCK_DGRAM))
        try:
            self._socket.bind((parts.hostname or "", _port_of(url)))
        except BaseException:
            self._socket.close()
            raise

    def read(self) -> bytes:
        """Return a datagram; its end is the end of a line."""
        data = self._receive() or b""
        return data if not data or data.endswith(b"\n") else data + b"\n"


class GpsdPort(_SocketPort):
    """`gpsd://host:port[/device]`: the sentences of a receiver that gpsd has."""

    def __init__(self, url: str) -> None:
        parts = urlsplit(url)
        self._device = parts.path if len(parts.path) > 1 else ""
        address = (parts.hostname or "localhost", _port_of(url))
        super().__init__(socket.create_connection(address, CONNECT_S))
        self._filter = GpsdFilter(self._device)
        device = {"device": self._device} if self._device else {}
        watch = json.dumps({"enable": True, "nmea": True, "json": False, **device})
        try:
            self._socket.sendall(f"?WATCH={watch};\n".encode())
        except BaseException:
            self._socket.close()
            raise

    def read(self) -> bytes:
        """Wait a moment for bytes, and return those that belong to sentences."""
        data = self._receive()
        if data == b"":
            raise ConnectionResetError("gpsd hung up")
        return self._filter.feed(data or b"")


class GpsdFilter:
    """Takes gpsd's own objects out of the stream, and reads what they say.

    Parameters
    ----------
    device : str
        The path of the only device that is wanted; "" for any.
    """

    def __init__(self, device: str = "") -> None:
        self._device, self._object, self._is_start = device, bytearray(), True

    def feed(self, data: bytes) -> bytes:
        """Return what is not JSON, byte by byte as it came.

        Raises
        ------
        ConnectionError
            When gpsd says that this cannot work.
        """
        sentences = bytearray()
        for piece in BytesIO(data):  # a line each, the last one perhaps half
            is_json = bool(self._object) or (self._is_start and piece[:1] == b"{")
            self._is_start = piece.endswith(b"\n")
            if not is_json:
                sentences += piece
                continue
            self._object += piece
            if len(self._object) > MAX_JSON:
                raise ConnectionError("gpsd sends an endless line")
            if self._is_start:
                text, self._object = bytes(self._object), bytearray()
                self._read(text)
        return bytes(sentences)

    def _read(self, text: bytes) -> None:
        try:
            said = json.loads(text)
        except (ValueError, RecursionError):
            return
        if not isinstance(said, dict):
            return
        match said.get("class"):
            case "VERSION" if OWN_NAME in str(said.get("release")):
                raise ConnectionError(_OWN_OUTPUT)
            case "ERROR":
                raise ConnectionError(f"gpsd says: {str(said.get('message'))[:200]}")
            case "DEVICES" if isinstance(devices := said.get("devices"), list):
                for device in devices:
                    self._look_at(device)
                if devices and all(map(_is_relay, devices)):
                    raise ConnectionError(_RELAY)
            case "DEVICE":
                self._look_at(said)

    def _look_at(self, device: Any) -> None:
        path = str(device.get("path")) if isinstance(device, dict) else ""
        if OWN_NAME in path and self._device in ("", path):
            raise ConnectionError(_OWN_OUTPUT)


def _is_relay(device: Any) -> bool:
    return isinstance(device, dict) and device.get("driver") == "JSON slave driver"


_RELAY: Final = (
    "this gpsd has no receiver, it relays another gpsd (imu-tracker itself?): name the "
    "one that has the receiver"
)
_OWN_OUTPUT: Final = (
    "this is the output of imu-tracker itself, not a receiver: name the receiver, "
    "gpsd://HOST:PORT/dev/..."
)


def open_port(path: str, baud: int) -> SerialPort | UdpPort | GpsdPort:
    """Open whatever `gps.port` names."""
    if path.startswith("gpsd://"):
        return GpsdPort(path)
    if path.startswith("udp://"):
        return UdpPort(path)
    return SerialPort(path, baud)


def _port_of(url: str) -> int:
    try:
        return urlsplit(url).port or 0
    except ValueError as error:
        raise OSError(f"{url}: {error}") from error
