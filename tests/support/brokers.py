"""A real Mosquitto, what goes over the wire to it, and who hears it.

`Wire` stands between a publisher and a broker: it records what was published and what
was acknowledged, in the order in which it passed, and can be cut.
"""

import contextlib
import os
import shutil
import signal
import socket
import subprocess
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Final, NamedTuple

import pytest

DEADLINE_S: Final = 300.0
"""A condition is waited for so long: the machine may be busy with other tests."""

_SBIN: Final = f"{os.environ.get('PATH', '')}:/usr/sbin:/usr/local/sbin"
MOSQUITTO: Final = shutil.which("mosquitto", path=_SBIN)

needs_mosquitto = pytest.mark.skipif(
    MOSQUITTO is None, reason="mosquitto is not here: apt install mosquitto"
)


def until(is_so: Callable[[], bool], what: str) -> None:
    """Wait for a condition."""
    end_s = time.monotonic() + DEADLINE_S
    while not is_so():
        assert time.monotonic() < end_s, f"not within {DEADLINE_S:.0f} s: {what}"
        time.sleep(0.02)


def free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as server:
        return int(server.getsockname()[1])


class Certificates(NamedTuple):
    """Of an authority that nobody else knows, and of a broker at localhost."""

    ca: Path
    certificate: Path
    key: Path


def certificates(folder: Path, days: int = 2) -> Certificates:
    """Make them with openssl; skip where it is not."""
    if shutil.which("openssl") is None:
        pytest.skip("openssl is not here")
    folder.mkdir(parents=True, exist_ok=True)
    names = ("ca.pem", "ca.key", "broker.pem", "broker.key", "broker.csr")
    ca, ca_key, certificate, key, request = (folder / name for name in names)
    extensions = folder / "extensions"
    extensions.write_text("subjectAltName=DNS:localhost,IP:127.0.0.1\n")
    curve = "-newkey ec -pkeyopt ec_paramgen_curve:prime256v1 -nodes"
    for command in (
        f"req -x509 {curve} -keyout {ca_key} -out {ca} -subj /CN=tests -days 2",
        f"req {curve} -keyout {key} -out {request} -subj /CN=localhost",
        f"x509 -req -in {request} -CA {ca} -CAkey {ca_key} -CAcreateserial "
        f"-out {certificate} -days {days} -extfile {extensions}",
    ):
        subprocess.run(["openssl", *command.split()], check=True, capture_output=True)
    return Certificates(ca, certificate, key)


def certificates_of_2040(folder: Path) -> Certificates:
    """Make a broker's certificate that the clock of today does not know yet."""
    made = certificates(folder)
    (folder / "index").touch()
    (folder / "serial").write_text("01")
    config = folder / "ca.conf"
    config.write_text(
        f"[ca]\ndefault_ca=own\n[own]\ndatabase={folder}/index\n"
        f"serial={folder}/serial\nnew_certs_dir={folder}\ndefault_md=sha256\n"
        "policy=any\n[any]\ncommonName=supplied\n"
    )
    command = (
        f"ca -batch -config {config} -cert {made.ca} -keyfile {folder}/ca.key "
        f"-in {folder}/broker.csr -out {made.certificate} -notext "
        f"-startdate 20400101000000Z -enddate 20410101000000Z "
        f"-extfile {folder}/extensions"
    )
    subprocess.run(["openssl", *command.split()], check=True, capture_output=True)
    return made


class Broker:
    """Mosquitto on a port of this computer.

    Parameters
    ----------
    folder : Path
        For its files.
    lines : str
        Of its configuration, beside those that it needs anyway.
    """

    def __init__(self, folder: Path, *lines: str) -> None:
        assert MOSQUITTO is not None
        folder.mkdir(parents=True, exist_ok=True)
        self.port = free_port()
        self._config = folder / "mosquitto.conf"
        is_open = not any(line.startswith("password_file") for line in lines)
        self._config.write_text(
            "\n".join(
                [
                    f"listener {self.port} 127.0.0.1",
                    f"allow_anonymous {'true' if is_open else 'false'}",
                    "max_queued_messages 0",
                    "log_dest stderr",
                    *(["user root"] if os.geteuid() == 0 else []),
                    *lines,
                    "",
                ]
            )
        )
        self._log = (folder / "mosquitto.log").open("ab")
        self._process: subprocess.Popen[bytes] | None = None

    def start(self) -> None:
        """Start it and wait until it listens."""
        assert MOSQUITTO is not None
        self._process = subprocess.Popen(
            [MOSQUITTO, "-c", str(self._config)], stdout=self._log, stderr=self._log
        )
        until(self._listens, "mosquitto listens")

    def _listens(self) -> bool:
        assert self._process is not None
        assert self._process.poll() is None, Path(self._log.name).read_text()
        with contextlib.suppress(OSError):
            socket.create_connection(("127.0.0.1", self.port), 1.0).close()
            return True
        return False

    def kill(self, number: int = signal.SIGKILL) -> None:
        """End it."""
        if self._process is not None:
            self._process.send_signal(number)
            self._process.wait()
        self._process = None

    def close(self) -> None:
        self.kill()
        self._log.close()


@contextlib.contextmanager
def mosquitto(folder: Path, *lines: str) -> Iterator[Broker]:
    """Run one until the end of the block."""
    broker = Broker(folder, *lines)
    try:
        broker.start()
        yield broker
    finally:
        broker.close()


class Sent(NamedTuple):
    """A PUBLISH that passed, or the acknowledgement of one."""

    topic: str
    payload: bytes
    is_acknowledged: bool


class Wire:
    """A TCP relay that reads MQTT as it passes; QoS 1, either version.

    Parameters
    ----------
    port : int
        Of the broker.
    versions : tuple of int
        Of the protocol, as CONNECT has them; it hangs up on others, as old brokers do.

    Attributes
    ----------
    passed : list of Sent
        Each message when it was sent, and again when it was acknowledged.
    """

    def __init__(self, port: int, versions: tuple[int, ...] = (4, 5)) -> None:
        self._to, self._versions = port, versions
        self._server = socket.create_server(("127.0.0.1", 0))
        self.port = int(self._server.getsockname()[1])
        self.passed: list[Sent] = []
        self._is_down = self._is_closed = False
        self._pairs: list[tuple[socket.socket, socket.socket]] = []
        self._threads: list[threading.Thread] = []
        self._lock = threading.Lock()
        self._accepting = threading.Thread(target=self._accept)
        self._accepting.start()

    @property
    def acknowledged(self) -> list[Sent]:
        return [sent for sent in self.passed if sent.is_acknowledged]

    def cut(self) -> None:
        """Lose every connection, and take no other until `mend`."""
        self._is_down = True
        with self._lock:
            pairs, self._pairs = self._pairs, []
        for pair in pairs:
            for end in pair:
                with contextlib.suppress(OSError):
                    end.shutdown(socket.SHUT_RDWR)

    def mend(self) -> None:
        self._is_down = False

    def close(self) -> None:
        self._is_closed = True
        self.cut()
        with contextlib.suppress(OSError):
            socket.create_connection(("127.0.0.1", self.port), 1.0).close()
        self._accepting.join()
        for thread in self._threads:
            thread.join()
        self._server.close()

    def _accept(self) -> None:
        while not self._is_closed:
            client, _ = self._server.accept()
            if self._is_down or self._is_closed:
                client.close()
                continue
            try:
                broker = socket.create_connection(("127.0.0.1", self._to), 5.0)
            except OSError:
                client.close()
                continue
            broker.settimeout(None)
            with self._lock:
                self._pairs.append((client, broker))
            thread = threading.Thread(target=self._relay, args=(client, broker))
            thread.start()
            self._threads.append(thread)

    def _relay(self, client: socket.socket, broker: socket.socket) -> None:
        mids: dict[int, Sent] = {}

        def back() -> None:
            for kind, packet, raw in _packets(broker):
                if kind >> 4 == 4:  # PUBACK
                    refused = packet[2:3] and packet[2] >= 128
                    sent = mids.pop(int.from_bytes(packet[:2]))
                    if not refused:
                        self.passed.append(sent._replace(is_acknowledged=True))
                if not _pass_on(client, raw):
                    break
            _close(client, broker)

        returning = threading.Thread(target=back)
        returning.start()
        is_v5 = False
        for kind, packet, raw in _packets(client):
            if kind >> 4 == 1:  # CONNECT
                is_v5 = packet[6] == 5
                if packet[6] not in self._versions:
                    break
            if kind >> 4 == 3:  # PUBLISH
                length = int.from_bytes(packet[:2])
                topic = packet[2 : 2 + length].decode()
                mid = int.from_bytes(packet[2 + length : 4 + length])
                payload = packet[4 + length + (1 if is_v5 else 0) :]
                mids[mid] = Sent(topic, payload, is_acknowledged=False)
                self.passed.append(mids[mid])
            if not _pass_on(broker, raw):
                break
        _close(client, broker)
        returning.join()
        client.close()
        broker.close()


def _pass_on(to: socket.socket, raw: bytes) -> bool:
    try:
        to.sendall(raw)
    except OSError:
        return False
    return True


def _close(*ends: socket.socket) -> None:
    for end in ends:
        with contextlib.suppress(OSError):
            end.shutdown(socket.SHUT_RDWR)


def _packets(end: socket.socket) -> Iterator[tuple[int, bytes, bytes]]:
    """Yield the first byte of each packet, what follows its length, and all of it."""
    rest = b""
    while True:
        try:
            block = end.recv(65_536)
        except OSError:
            return
        if not block:
            return
        rest += block
        while len(rest) >= 2:
            length = shift = 0
            position = 1
            while position < len(rest):
                length |= (rest[position] & 127) << shift
                shift += 7
                position += 1
                if not rest[position - 1] & 128:
                    break
            else:
                break
            if len(rest) < position + length:
                break
            yield rest[0], rest[position : position + length], rest[: position + length]
            rest = rest[position + length :]
