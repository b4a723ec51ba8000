"""Rows to Traccar and InfluxDB, on servers that are as strict as their documents."""

import contextlib
import gzip
import json
import socket
import threading
from collections.abc import Callable, Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any, Final
from urllib.parse import parse_qs, urlsplit

import pytest

from imu_tracker.check.destinations import check_destinations
from imu_tracker.check.sensors import Verdict
from imu_tracker.config import load_config
from imu_tracker.publish import worker as worker_module
from imu_tracker.publish.senders.influx import WINDOW
from imu_tracker.storage.latlong import LogRow, format_utc
from support.brokers import until
from support.influx_lines import parse_line
from support.published import (
    arguments,
    drive,
    publish_once,
    publishing,
    row,
    working,
    write_log,
)

Answer = tuple[int, str]


class Server(ThreadingHTTPServer):
    """Answers each POST by a function of its target, headers and body.

    Attributes
    ----------
    answer : callable
        May be changed meanwhile; raises OSError to hang up without an answer.
    connections : int
        How many were made.
    """

    daemon_threads = False
    block_on_close = True

    def __init__(self, answer: Callable[[str, Any, bytes], Answer]) -> None:
        super().__init__(("127.0.0.1", 0), _Handler)
        self.answer = answer
        self.connections = 0
        self.open: list[Any] = []

    @property
    def port(self) -> int:
        return int(self.server_address[1])


class _Handler(BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"
    server: Server

    def setup(self) -> None:
        super().setup()
        self.server.connections += 1
        self.server.open.append(self.connection)

    def do_POST(self) -> None:
        body = self.rfile.read(int(self.headers["Content-Length"]))
        try:
            status, text = self.server.answer(self.path, self.headers, body)
        except OSError:
            self.close_connection = True
            return
        data = text.encode()
        self.send_response(status)
        self.send_header("Content-Length", str(len(data)))
        self.end_headers()
        self.wfile.write(data)

    def log_message(self, *_: object) -> None:
        pass


@contextlib.contextmanager
def serving(answer: Callable[[str, Any, bytes], Answer]) -> Iterator[Server]:
    server = Server(answer)
    thread = threading.Thread(target=server.serve_forever, args=(0.02,))
    thread.start()
    try:
        yield server
    finally:
        server.shutdown()
        thread.join()
        for connection in server.open:
            with contextlib.suppress(OSError):
                connection.shutdown(2)
        server.server_close()


class Traccar:
    """What its OsmAndProtocolDecoder reads, and how it answers."""

    NUMBERS: Final = ("lat", "lon", "speed", "bearing", "altitude", "accuracy", "r95_m")

    def __init__(self, *devices: str) -> None:
        self.devices = set(devices)
        self.positions: list[dict[str, Any]] = []
        self.refused = 0

    def __call__(self, target: str, headers: Any, body: bytes) -> Answer:
        if urlsplit(target).query:  # then the body is not looked at
            return 400, ""
        assert headers["Content-Type"] == "application/x-www-form-urlencoded"
        form = parse_qs(body.decode("ascii"), strict_parsing=bool(body))
        if form.get("id", [""])[0] not in self.devices:
            self.refused += 1
            return 400, ""
        found: dict[str, Any] = {key: value for key, (value,) in form.items()}
        for key in self.NUMBERS:
            if key in found:
                found[key] = float(found[key])
        stamp = int(found["timestamp"])
        found["time_ms"] = stamp * 1000 if stamp < 2**31 - 1 else stamp
        self.positions.append(found)
        return 200, ""


class Influx:
    """A database that reads strictly, and overwrites what has the same key."""

    def __init__(self, token: str = "", largest: int = 10**9) -> None:
        self.token, self.largest = token, largest
        self.points: dict[tuple[str, int], dict[str, Any]] = {}
        self.batches: list[int] = []

    def __call__(self, target: str, headers: Any, body: bytes) -> Answer:
        if self.token and headers["Authorization"] != f"Token {self.token}":
            return 401, '{"error":"authorization failed"}'
        query = parse_qs(urlsplit(target).query)
        if query.get("db") != ["track"]:
            return 404, '{"error":"database not found: \\"x\\""}'
        assert query["precision"] == ["ms"]
        assert headers["Content-Encoding"] == "gzip"
        lines = gzip.decompress(body).decode().splitlines()
        if len(lines) > self.largest:
            return 413, "Request Entity Too Large"
        for line in lines:
            _, tags, fields, stamp = parse_line(line)
            self.points[tags["id"], stamp] = fields
        self.batches.append(len(lines))
        return 204, ""


def times_ms(rows: list[LogRow]) -> list[int]:
    return [round(each.utc_s * 1000) for each in rows]


def to(tmp_path: Path, server: Server, kind: str, rows: int, **keys: object) -> Any:
    log = tmp_path / "latlong.csv"
    if not log.exists():
        write_log(log, drive(rows))
    path = "/write?db=track" if kind == "influx" else ""
    url = keys.pop("url", f"http://127.0.0.1:{server.port}{path}")
    return arguments(
        log, tmp_path, "home", kind=kind, url=url, **{"moving_s": 0, **keys}
    )


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("FIRST_DELAY_S", "LONGEST_DELAY_S", "IDLE_S"):
        monkeypatch.setattr(worker_module, name, 0.02)


def test_traccar_gets_each_row_in_order_on_one_connection(tmp_path: Path) -> None:
    traccar = Traccar("car")
    with serving(traccar) as server:
        done = publish_once(*to(tmp_path, server, "traccar", 200))
        assert done.returncode == 0, done.stderr
        assert server.connections == 1
    assert [p["time_ms"] for p in traccar.positions] == times_ms(drive(200))
    first = traccar.positions[0]
    assert (first["lat"], first["lon"]) == (40.0, 4.37)
    assert first["speed"] == pytest.approx(13.8 * 3600 / 1852, abs=1e-3)  # knots
    assert (first["accuracy"], first["r95_m"], first["mode"]) == (3.94, 3.94, "gps")


@pytest.mark.usefixtures("quick")
def test_a_device_that_traccar_does_not_know_is_told_once_and_nothing_is_lost(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    traccar = Traccar()
    with serving(traccar) as server, working(*to(tmp_path, server, "traccar", 50)) as w:
        until(lambda: traccar.refused >= 5, "it is tried again and again")
        assert caplog.text.count('does not know the device "car"') == 1
        traccar.devices.add("car")
        until(lambda: w.sent_rows == 50, "every row is taken")
    assert [p["time_ms"] for p in traccar.positions] == times_ms(drive(50))


@pytest.mark.usefixtures("quick")
def test_answers_that_never_come_leave_each_position_at_least_once_in_order(
    tmp_path: Path,
) -> None:
    traccar, calls = Traccar("car"), 0

    def often_gone(target: str, headers: Any, body: bytes) -> Answer:
        nonlocal calls
        calls += 1
        if calls % 5 == 0:
            raise OSError  # before it is stored
        found = traccar(target, headers, body)
        if calls % 7 == 0:
            raise OSError  # after it is stored
        return (503, "busy") if calls % 11 == 0 else found

    with (
        serving(often_gone) as server,
        working(*to(tmp_path, server, "traccar", 60)) as worker,
    ):
        until(lambda: worker.sent_rows == 60, "every row is taken")
    found = [p["time_ms"] for p in traccar.positions]
    assert list(dict.fromkeys(found)) == times_ms(drive(60))
    assert found == sorted(found)  # a position that is sent again is sent next


def test_a_connection_that_was_closed_while_idle_is_no_failure(tmp_path: Path) -> None:
    traccar = Traccar("car")
    log = tmp_path / "latlong.csv"
    with serving(traccar) as server, working(*to(tmp_path, server, "traccar", 3)) as w:
        until(lambda: w.sent_rows == 3, "the rows are taken")
        for connection in server.open:
            with contextlib.suppress(OSError):
                connection.shutdown(2)
        write_log(log, drive(4))
        until(lambda: w.sent_rows == 4, "the next row is taken")
        assert w.errors == 0


def test_influx_gets_batches_of_gzip_and_a_token(tmp_path: Path) -> None:
    influx = Influx(token="s3cr3t")
    secret = tmp_path / "token"
    secret.write_text('token = "s3cr3t"\n')
    secret.chmod(0o600)
    rows = WINDOW * 2 + 17
    with serving(influx) as server:
        keys = {"credentials_file": secret}
        done = publish_once(*to(tmp_path, server, "influx", rows, **keys))
        assert done.returncode == 0, done.stderr
    assert sorted(stamp for _, stamp in influx.points) == times_ms(drive(rows))
    assert sum(influx.batches) == rows
    assert max(influx.batches) == WINDOW
    assert influx.points["car", times_ms(drive(1))[0]]["r95_m"] == 3.94
    assert "s3cr3t" not in done.stderr


@pytest.mark.usefixtures("quick")
def test_a_batch_that_is_too_large_is_made_smaller(tmp_path: Path) -> None:
    influx = Influx(largest=100)
    with (
        serving(influx) as server,
        working(*to(tmp_path, server, "influx", 1000)) as worker,
    ):
        until(lambda: worker.sent_rows == 1000, "every row is taken")
    assert sorted(stamp for _, stamp in influx.points) == times_ms(drive(1000))
    assert sum(influx.batches) == 1000


def test_what_influx_never_takes_is_counted_and_holds_up_nothing(
    tmp_path: Path,
) -> None:
    said = '{"error":"partial write: points beyond retention policy dropped=3"}'
    with (
        serving(lambda *_: (400, said)) as server,
        working(*to(tmp_path, server, "influx", 10)) as worker,
    ):
        until(lambda: worker.sent_rows + worker.refused_rows == 10, "it went on")
        assert (worker.sent_rows, worker.refused_rows) == (7, 3)
        assert worker.errors == 0


@pytest.mark.parametrize(
    ("status", "kind", "words"),
    [
        (401, "influx", "answers 401: see credentials_file"),
        (404, "influx", "is this the URL of writing"),
        (500, "influx", "answers 500"),
        (302, "influx", "answers 302"),
        (403, "traccar", "answers 403: see credentials_file"),
        (404, "traccar", 'does not know the device "car"'),
        (502, "traccar", "answers 502"),
    ],
)
def test_what_an_answer_means_is_said(
    tmp_path: Path, status: int, kind: str, words: str
) -> None:
    with serving(lambda *_: (status, "x\n\x1b[31m" * 50)) as server:
        done = publish_once(*to(tmp_path, server, kind, 3))
    assert done.returncode == 69
    assert words in done.stderr
    assert "\x1b" not in done.stderr


def test_something_that_is_no_http_is_said(tmp_path: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:

        def babble() -> None:
            for _ in range(1):
                connection, _ = server.accept()
                connection.sendall(b"SSH-2.0-OpenSSH\r\n" * 5)
                connection.close()

        thread = threading.Thread(target=babble)
        thread.start()
        url = f"http://127.0.0.1:{server.getsockname()[1]}"
        log = tmp_path / "latlong.csv"
        write_log(log, drive(3))
        done = publish_once(*arguments(log, tmp_path, "a", kind="traccar", url=url))
        thread.join()
    assert done.returncode == 69
    assert "warning: a: 127.0.0.1" in done.stderr


def test_one_that_hangs_holds_up_no_other(tmp_path: Path) -> None:
    traccar, release = Traccar("car"), threading.Event()

    def hangs(*_: object) -> Answer:
        release.wait(60.0)
        return 200, ""

    log = tmp_path / "latlong.csv"
    write_log(log, drive(100))
    status = tmp_path / "publish.json"
    with serving(traccar) as good, serving(hangs) as bad:
        both = to(tmp_path, good, "traccar", 100)
        url = f"http://127.0.0.1:{bad.port}/write?db=x"
        both += arguments(log, tmp_path, "slow", kind="influx", url=url, moving_s=0)
        with publishing(*both):
            until(lambda: len(traccar.positions) == 100, "the other has its rows")

            def told() -> Any:
                return json.loads(status.read_text())["destinations"]

            until(
                lambda: status.exists() and told()["home"]["unsent_rows"] == 0, "told"
            )
            assert told()["slow"]["unsent_rows"] == 100
            assert told()["slow"]["oldest_unsent"] == format_utc(row(0).utc_s)
            release.set()
            until(lambda: told()["slow"]["unsent_rows"] == 0, "then it has them too")


def test_check_tries_each_destination_and_sends_nothing(tmp_path: Path) -> None:
    traccar, influx = Traccar("car"), Influx()
    with serving(traccar) as one, serving(influx) as other:
        chosen = to(tmp_path, one, "traccar", 3)
        url = f"http://127.0.0.1:{other.port}"
        for name, path in (("good", "/write?db=track"), ("bad", "/write?db=y")):
            keys = {"kind": "influx", "url": url + path}
            chosen += arguments(tmp_path / "log", tmp_path, name, **keys)
        found = list(check_destinations(load_config(None, chosen[1::2])))
    assert [(f.verdict, f.exit_code) for f in found] == [
        (Verdict.OK, 0),
        (Verdict.OK, 0),
        (Verdict.FAILED, 69),
    ]
    assert "is this the URL of writing" in found[2].text
    assert not traccar.positions
    assert not influx.points
