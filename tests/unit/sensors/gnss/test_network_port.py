"""gpsd and UDP as a receiver, on loopback."""

import json
import socket
from collections.abc import Iterator

import pytest

from imu_tracker.sensors.gnss.network_port import (
    MAX_JSON,
    GpsdFilter,
    GpsdPort,
    UdpPort,
    open_port,
)
from imu_tracker.sensors.gnss.port import SerialPort
from support.nmea_text import gga, rmc

VERSION = b'{"class":"VERSION","release":"3.22","proto_major":3,"proto_minor":14}\r\n'


@pytest.fixture
def gpsd() -> Iterator[socket.socket]:
    with socket.create_server(("127.0.0.1", 0)) as server:
        yield server


def url(server: socket.socket, device: str = "") -> str:
    return f"gpsd://127.0.0.1:{server.getsockname()[1]}{device}"


def devices(*paths: str) -> bytes:
    said = [{"class": "DEVICE", "path": path} for path in paths]
    return json.dumps({"class": "DEVICES", "devices": said}).encode() + b"\r\n"


def test_gpsd_is_asked_for_the_sentences_of_a_device(gpsd: socket.socket) -> None:
    port = GpsdPort(url(gpsd, "/dev/ttyACM0"))
    peer, _ = gpsd.accept()
    with peer:
        request = peer.recv(1000).decode()
        assert request.startswith("?WATCH=")
        assert json.loads(request.strip().removeprefix("?WATCH=").rstrip(";")) == {
            "enable": True,
            "nmea": True,
            "json": False,
            "device": "/dev/ttyACM0",
        }
        peer.sendall(VERSION + devices("/dev/ttyACM0") + rmc() + b"\r\n")
        heard = b""
        while not heard.endswith(b"\n"):
            heard += port.read()
        assert heard == rmc() + b"\r\n"
        assert not port.has_speed
    with pytest.raises(OSError, match="hung up"):
        port.read()
    port.close()


def test_sentences_pass_however_the_stream_is_cut() -> None:
    lines = rmc() + b"\r\n" + gga() + b"\r\n"
    stream = VERSION + devices("/dev/gps") + lines + b'{"class":"TPV"}\r\n' + lines
    for step in (1, 2, 7, 50, 1000):
        gpsd_filter = GpsdFilter()
        pieces = [stream[i : i + step] for i in range(0, len(stream), step)]
        assert b"".join(map(gpsd_filter.feed, pieces)) == lines * 2


@pytest.mark.parametrize(
    "said",
    [
        devices("imu-tracker"),
        devices("/dev/gps", "gpsd://127.0.0.1:2948#imu-tracker"),
        b'{"class":"DEVICE","path":"tcp://localhost:10110#imu-tracker"}\r\n',
        b'{"class":"VERSION","release":"imu-tracker 0.1.0"}\r\n',
    ],
)
def test_our_own_output_is_refused_as_input(said: bytes) -> None:
    with pytest.raises(OSError, match="imu-tracker itself"):
        GpsdFilter().feed(said)


def test_a_receiver_beside_our_own_output_is_taken_when_it_is_named() -> None:
    both = devices("/dev/gps", "gpsd://127.0.0.1:2948#imu-tracker")
    assert GpsdFilter("/dev/gps").feed(both + rmc()) == rmc()
    assert GpsdFilter().feed(VERSION) == b""


def test_a_gpsd_that_only_relays_another_one_has_no_receiver() -> None:
    relay = {"class": "DEVICE", "path": "gpsd://pi:1", "driver": "JSON slave driver"}
    said = {"class": "DEVICES", "devices": [relay]}
    with pytest.raises(OSError, match="relays another gpsd"):
        GpsdFilter().feed(json.dumps(said).encode() + b"\r\n")
    said["devices"] = [relay, {"class": "DEVICE", "path": "/dev/gps"}]
    assert GpsdFilter().feed(json.dumps(said).encode() + b"\r\n") == b""


def test_what_gpsd_complains_of_is_told() -> None:
    with pytest.raises(OSError, match="no such device"):
        GpsdFilter().feed(b'{"class":"ERROR","message":"no such device"}\r\n')


def test_an_object_without_end_ends_the_connection() -> None:
    gpsd_filter = GpsdFilter()
    assert gpsd_filter.feed(b"{" * MAX_JSON) == b""
    with pytest.raises(OSError, match="endless"):
        gpsd_filter.feed(b"{")


def test_socket_on_the_port_of_gpsd_says_what_to_write(
    gpsd: socket.socket, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("serial.urlhandler.protocol_socket.time.sleep", lambda s: None)
    port = open_port(url(gpsd).replace("gpsd", "socket"), 9600)
    assert isinstance(port, SerialPort)
    peer, _ = gpsd.accept()
    with peer:
        peer.sendall(VERSION)
        with pytest.raises(OSError, match="gpsd://"):
            port.read()
    port.close()


def test_a_datagram_is_a_line_with_or_without_its_end() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        number = probe.getsockname()[1]
    port = open_port(f"udp://127.0.0.1:{number}", 9600)
    assert isinstance(port, UdpPort)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        for data in (rmc() + b"\r\n", gga()):
            sender.sendto(data, ("127.0.0.1", number))
        assert port.read() == rmc() + b"\r\n"
        assert port.read() == gga() + b"\n"
    assert port.read() == b""
    port.close()


def test_a_port_that_is_no_number_of_a_port_is_a_fault() -> None:
    with pytest.raises(OSError, match="70000"):
        open_port("udp://:70000", 9600)
