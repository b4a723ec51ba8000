"""Open connections of one kind: so many and no more, none waits for a slow one."""

import asyncio
import contextlib
import socket
from typing import Final

MAX_WAITING: Final = 1_000_000
"""Bytes that a peer has not taken, then it is closed; a history has a quarter."""

GONE_MS: Final = 30_000
"""What was sent and not acknowledged for so long closes a connection: a telephone that
left the network says no goodbye."""


class Peers:
    """Connections that hear the same.

    Parameters
    ----------
    limit : int
        At most so many; the next ones are closed at once.
    """

    def __init__(self, limit: int) -> None:
        self._limit = limit
        self._writers: set[asyncio.StreamWriter] = set()

    def __len__(self) -> int:
        return len(self._writers)

    @property
    def is_full(self) -> bool:
        """Whether there is no room for another one."""
        return len(self._writers) >= self._limit

    def add(self, writer: asyncio.StreamWriter) -> None:
        """Let a connection hear what is sent from now on."""
        self._writers.add(writer)

    def remove(self, writer: asyncio.StreamWriter) -> None:
        """Forget a connection."""
        self._writers.discard(writer)

    def send(self, data: bytes) -> None:
        """Send to everybody."""
        for writer in tuple(self._writers):
            send(writer, data)

    def close(self) -> None:
        """End all of them."""
        for writer in tuple(self._writers):
            writer.transport.abort()


def send(writer: asyncio.StreamWriter, data: bytes) -> None:
    """Send without waiting; whoever does not take it in is closed."""
    transport = writer.transport
    if transport.is_closing():
        return
    if transport.get_write_buffer_size() > MAX_WAITING:
        transport.abort()
        return
    writer.write(data)


def prepare(writer: asyncio.StreamWriter) -> None:
    """Notice when the other side is gone, and send small things at once."""
    connection = writer.get_extra_info("socket")
    if connection is None:
        return
    with contextlib.suppress(OSError):
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, GONE_MS)
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_KEEPIDLE, GONE_MS // 1000)
