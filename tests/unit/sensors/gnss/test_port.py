"""Real ports, and the arithmetic of arrival."""

import os
import socket
from collections.abc import Iterator

import pytest

from imu_tracker.sensors.gnss.port import FAULTS, ArrivalTimes, SerialPort, TimedLines
from support.nmea_text import gga

MS = 1_000_000
BYTE_NS = 1_041_666  # 9600 baud


@pytest.fixture
def terminal() -> Iterator[tuple[int, str]]:
    master, slave = os.openpty()
    yield master, os.ttyname(slave)
    for descriptor in (slave, master):
        try:
            os.close(descriptor)
        except OSError:
            assert descriptor == master  # the test pulled it out


def test_a_read_returns_what_is_there(terminal: tuple[int, str]) -> None:
    master, path = terminal
    port = SerialPort(path, 9600)
    os.write(master, b"abc")
    assert port.read() == b"abc"
    port.set_baud(38400)
    os.write(master, b"old")
    port.discard()
    os.write(master, b"new")
    assert port.read() == b"new"
    port.close()


def test_a_second_program_on_the_port_is_named(terminal: tuple[int, str]) -> None:
    _, path = terminal
    first = SerialPort(path, 9600)
    with pytest.raises(OSError, match="exclusively lock"):
        SerialPort(path, 9600)
    first.close()


def test_a_device_that_goes_away_is_a_fault(terminal: tuple[int, str]) -> None:
    master, path = terminal
    port = SerialPort(path, 9600)
    os.close(master)
    with pytest.raises(FAULTS):
        port.read()
    port.close()


def test_a_missing_device_is_a_fault() -> None:
    with pytest.raises(FAULTS, match="No such file"):
        SerialPort("/dev/no-such-receiver", 9600)


def test_a_peer_may_speak_at_once_and_hang_up(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("serial.urlhandler.protocol_socket.time.sleep", lambda s: None)
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = SerialPort(f"socket://127.0.0.1:{server.getsockname()[1]}", 9600)
        peer, _ = server.accept()
        with peer:
            peer.sendall(b"first")
            port.discard()
            assert port.read() == b"first"
        assert not port.has_speed
        with pytest.raises(FAULTS, match="disconnected"):
            port.read()
        port.close()


def test_nobody_at_the_other_end_is_a_fault() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        number = server.getsockname()[1]
    with pytest.raises(FAULTS, match="Could not open port"):
        SerialPort(f"socket://127.0.0.1:{number}", 9600)


def test_bytes_before_the_last_are_older_by_the_time_of_the_line() -> None:
    times = ArrivalTimes(BYTE_NS, now_ns=0)
    times.add(10, 1000 * MS)
    assert times.of(9) == 1000 * MS
    assert times.of(0) == 1000 * MS - 9 * BYTE_NS


def test_no_byte_is_older_than_the_read_before_it() -> None:
    times = ArrivalTimes(BYTE_NS, now_ns=0)
    times.add(1, 1000 * MS)
    times.add(10, 1005 * MS)
    assert times.of(1) == 1000 * MS
    assert times.of(0) == 1000 * MS


def test_more_bytes_than_the_line_carries_came_at_once() -> None:
    times = ArrivalTimes(BYTE_NS, now_ns=0)
    times.add(64, 1000 * MS)
    times.add(64, 1001 * MS)
    assert times.of(64) == 1001 * MS
    times.add(10, 2000 * MS)
    assert times.of(128) == 2000 * MS


def test_the_line_end_may_come_chunks_later() -> None:
    lines = TimedLines(BYTE_NS, now_ns=0)
    line = gga()
    for index, byte in enumerate(line):
        assert lines.feed(bytes([byte]), (index + 1) * 10 * MS) == []
    (frame,) = lines.feed(b"\r\n", 5000 * MS)
    assert (frame.t_ns, frame.data) == (10 * MS, line)


def test_memory_of_chunks_is_bounded() -> None:
    times = ArrivalTimes(0, now_ns=0)
    for index in range(5000):
        times.add(1, index)
    assert times.of(5000 - 255) == 5000 - 255
    assert len(times._chunks) < 300
