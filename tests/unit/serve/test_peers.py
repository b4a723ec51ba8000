"""Connections that do not take in what is sent, beside one that does."""

import asyncio
import socket

from imu_tracker.serve.peers import MAX_WAITING, Peers

BLOCK = b"x" * 65_535 + b"\n"
BLOCKS = 400
"""More than the kernel keeps for a connection by itself."""


async def _sent_to(slow: socket.socket, quick: socket.socket) -> tuple[int, int, int]:
    """Send to both; return how much each may still have waiting, and what one read."""
    peers = Peers(2)
    _, slow_writer = await asyncio.open_connection(sock=slow)
    _, quick_writer = await asyncio.open_connection(sock=quick)
    peers.add(slow_writer)
    peers.add(quick_writer)
    waiting = 0
    for _ in range(BLOCKS):
        peers.send(BLOCK)
        waiting = max(waiting, slow_writer.transport.get_write_buffer_size())
        await quick_writer.drain()
    is_closed = slow_writer.transport.is_closing()
    quick_writer.close()
    await quick_writer.wait_closed()
    return waiting, is_closed, not slow_writer.transport.get_write_buffer_size()


def test_a_slow_reader_is_closed_and_a_quick_one_gets_everything() -> None:
    async def run() -> None:
        slow, slow_end = socket.socketpair()
        quick, quick_end = socket.socketpair()
        slow_end.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        reader, writer = await asyncio.open_connection(sock=quick_end)
        read = asyncio.create_task(reader.read(-1))
        waiting, is_closed, is_let_go = await _sent_to(slow, quick)
        assert await read == BLOCK * BLOCKS
        assert is_closed
        assert is_let_go
        assert waiting <= MAX_WAITING + len(BLOCK)
        writer.close()
        slow_end.close()

    asyncio.run(run())
