"""The server as a process: viewers, clients, a daemon that comes and goes."""

import http.client
import json
import os
import re
import select
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager, suppress
from pathlib import Path
from typing import Any

import pytest

from imu_tracker.storage.latlong import HEADER
from support.served import Daemon, Served, line, serving

PATIENCE_S = 20.0


@pytest.fixture
def daemon(tmp_path: Path) -> Daemon:
    daemon = Daemon(tmp_path)
    daemon.write(*["gps"] * 40)
    daemon.tell()
    return daemon


@pytest.fixture
def served(daemon: Daemon) -> Iterator[Served]:
    with serving(daemon) as served:
        yield served


class Client:
    """A connection that reads lines."""

    def __init__(self, port: int, request: bytes = b"") -> None:
        self.socket = socket.create_connection(("127.0.0.1", port), PATIENCE_S)
        self.socket.sendall(request)
        self._file = self.socket.makefile("rb")

    def line(self) -> str:
        return self._file.readline().decode()

    def until(self, begin: str, holds: str = "") -> str:
        """Read lines until one begins so; return it."""
        while text := self.line():
            if text.startswith(begin) and holds in text:
                return text
        raise AssertionError(f"the connection ended before {begin!r} {holds!r}")

    def is_closed(self) -> bool:
        """Read on until the other side ends it, politely or not."""
        with suppress(ConnectionError):
            while self.line():
                pass
        return True

    def close(self) -> None:
        self._file.close()
        self.socket.close()


@contextmanager
def client(port: int, request: bytes = b"") -> Iterator[Client]:
    with closing(Client(port, request)) as made:
        yield made


def viewer(served: Served) -> Any:
    request = b"GET /events HTTP/1.1\r\nHost: localhost\r\n\r\n"
    return client(served.ports["page"], request)


def get(served: Served, path: str, **fields: str) -> tuple[int, bytes]:
    address = ("127.0.0.1", served.ports["page"])
    with closing(http.client.HTTPConnection(*address, timeout=PATIENCE_S)) as asked:
        asked.request("GET", path, headers=fields)
        answer = asked.getresponse()
        return answer.status, answer.read()


def event(text: str) -> Any:
    return json.loads(text.removeprefix("data: "))


def test_a_viewer_hears_history_status_and_each_row(
    daemon: Daemon, served: Served
) -> None:
    with viewer(served) as page:
        page.until("event: hello")
        track = event(page.line())["track"]
        page.until("event: row")  # the newest one there is
        page.line()
        daemon.write("dr", r95=12.5)
        page.until("event: row")
        row = event(page.line())
        assert (row["mode"], row["r95_m"], row["has_fix"]) == ("dr", 12.5, False)
        assert track["segments"] == [] or len(track["segments"][0]["t_ms"]) <= 41
        page.until("event: status")
        assert event(page.line())["away"] == ""


def test_a_parked_car_has_gps_as_long_as_the_status_says_so(
    daemon: Daemon, served: Served
) -> None:
    with client(served.ports["nmea"]) as plotter, viewer(served) as page:
        plotter.until("$GPRMC")
        daemon.write("still")
        assert plotter.until("$GPRMC").split(",")[12][0] == "A"
        daemon.tell(fix_age_s=30)
        page.until("data: ", '"fix_age_s":30')  # the server knows
        daemon.write("still")
        assert plotter.until("$GPRMC").split(",")[12][0] == "E"


def test_the_page_says_that_the_daemon_is_away_and_that_it_is_back(
    daemon: Daemon, served: Served
) -> None:
    watch = b'?WATCH={"enable":true,"json":true}\n'
    with viewer(served) as page, client(served.ports["gpsd"], watch) as gpsd:
        gpsd.until('{"class":"WATCH"')
        page.until("event: hello")
        daemon.leave()
        page.until("data: ", '"away":"imu-tracker is not running"')
        assert '"mode":1' in gpsd.until('{"class":"TPV"', '"mode":1')
        daemon.tell()
        page.until("data: ", '"away":""')


def test_a_relaying_gpsd_asks_nothing_and_gets_reports(served: Served) -> None:
    with client(served.ports["gpsd"]) as relay:
        relay.until('{"class":"TPV"')


def test_rotation_deletion_and_a_flood_are_followed(
    daemon: Daemon, served: Served
) -> None:
    with client(served.ports["nmea"]) as plotter:
        plotter.until("$GPRMC")
        daemon.write("gps")
        plotter.until("$GPRMC")
        daemon.log.rename(daemon.log.with_name("latlong-20261122T120000Z.csv"))
        daemon.log.write_text(f"{HEADER}\n")
        daemon.write("dr")
        assert plotter.until("$GPRMC").split(",")[1] == "120010.250"
        daemon.log.unlink()
        daemon.rows += 100_000
        with daemon.log.open("w") as file:
            file.write(f"{HEADER}\n")
            file.writelines(map(line, range(daemon.rows, daemon.rows + 20_000)))
        daemon.rows += 20_000
        daemon.write("dr")
        plotter.until("$GPRMC", ",E*")  # the newest alone, not the flood
    assert get(served, "/")[0] == 200


def peak_kb(process: subprocess.Popen[str]) -> int:
    """Return the most memory that a process had so far."""
    status = Path(f"/proc/{process.pid}/status").read_text()
    match = re.search(r"VmHWM:\s+(\d+) kB", status)
    assert match
    return int(match[1])


def test_a_log_that_grows_by_a_hundred_megabytes_takes_no_memory(
    daemon: Daemon, served: Served
) -> None:
    with client(served.ports["nmea"]) as plotter:
        plotter.until("$GPRMC")
        before_kb = peak_kb(served.process)
        os.truncate(daemon.log, daemon.log.stat().st_size + 100_000_000)
        daemon.append(b"\n")
        daemon.write(*["gps"] * 20_000, "dr")
        plotter.until("$GPRMC", ",E*")
        assert peak_kb(served.process) - before_kb < 10_000
    assert get(served, "/")[0] == 200


@pytest.mark.parametrize(
    "path",
    [
        "/../../etc/passwd",
        "//etc/passwd",
        "/%2e%2e/live.js",
        "/latlong.csv",
        "/tiles/1",
    ],
)
def test_nothing_but_the_page_can_be_read(path: str, served: Served) -> None:
    assert get(served, path)[0] == 404


def test_a_name_of_somebody_else_gets_nothing(served: Served) -> None:
    assert get(served, "/", Host="evil.example")[0] == 421


def test_a_token_opens_the_page_and_a_cookie_keeps_it_open(
    daemon: Daemon, tmp_path: Path
) -> None:
    token = tmp_path / "token"
    token.write_text("0123456789abcdef\n")
    with serving(daemon, f"serve.token_file={token}") as served:
        assert get(served, "/")[0] == 403
        assert get(served, "/?token=wrong")[0] == 403
        assert get(served, "/events")[0] == 403
        assert get(served, "/?token=0123456789abcdef")[0] == 303
        assert get(served, "/", Cookie="imu-tracker=0123456789abcdef")[0] == 200


def test_the_sixteen_first_viewers_see_and_the_next_is_told_to_wait(
    served: Served,
) -> None:
    viewers = [viewer(served) for _ in range(16)]
    pages = [page.__enter__() for page in viewers]
    try:
        for page in pages:
            page.until("event: hello")
        assert get(served, "/events")[0] == 503
    finally:
        for opened in viewers:
            opened.__exit__(None, None, None)


def test_hostile_peers_are_closed_and_others_do_not_notice(
    daemon: Daemon, served: Served
) -> None:
    ports = list(served.ports.values())
    watch = b'?WATCH={"enable":true,"json":true}\n'
    with client(served.ports["gpsd"], watch) as good:
        good.until('{"class":"WATCH"')
        half_open = [socket.create_connection(("127.0.0.1", p)) for p in ports * 20]
        for number in range(1000):
            socket.create_connection(("127.0.0.1", ports[number % 3])).close()
        with client(served.ports["gpsd"], b"x" * 20_000) as endless:
            assert endless.is_closed()
        with client(served.ports["page"], b"GET /" + b"x" * 20_000) as endless:
            assert endless.is_closed()
        daemon.write("dr")
        assert '"status":5' in good.until('{"class":"TPV"', '"status":5')
        for peer in half_open:
            peer.close()
    assert served.process.poll() is None


def test_a_killed_server_is_no_affair_of_the_daemon_and_comes_back(
    daemon: Daemon,
) -> None:
    with serving(daemon) as served:
        served.process.send_signal(signal.SIGKILL)
        served.process.wait()
    daemon.write("dr")
    with serving(daemon) as served, viewer(served) as page:
        page.until("event: hello")


def test_the_real_daemon_and_the_server_outlive_each_other(tmp_path: Path) -> None:
    files = Daemon(tmp_path)
    files.log.unlink()
    command = [sys.executable, "-m", "imu_tracker", "run", "-q"]
    settings = ("source.kind=simulation", "source.duration_s=36000", "source.speed=50")
    own = (f"log.path={files.log}", f"status.path={files.status}", "state.path=")
    for setting in (*settings, *own, "log.min_free_mb=0"):
        command += ["--set", setting]

    def running() -> "subprocess.Popen[bytes]":
        return subprocess.Popen(command, stderr=subprocess.DEVNULL)

    def killed(process: "subprocess.Popen[Any]") -> None:
        process.kill()
        process.wait()

    def rows() -> int:
        return files.log.read_text().count("\n") if files.log.exists() else 0

    def writes(daemon: "subprocess.Popen[bytes]") -> bool:
        before, end = rows(), time.monotonic() + PATIENCE_S * 3
        while rows() <= before + 10 and time.monotonic() < end:
            time.sleep(0.05)
        return daemon.poll() is None and rows() > before + 10

    daemon = running()
    try:
        assert writes(daemon)
        with serving(files) as served:
            with viewer(served) as page:
                page.until("event: row")
            killed(served.process)
            assert writes(daemon)
        with serving(files) as served, viewer(served) as page:
            page.until("event: row")
            killed(daemon)
            page.until("data: ", "is not running")
            daemon = running()
            page.until("data: ", '"away":""')
            page.until("event: row")
    finally:
        killed(daemon)


def test_a_port_that_is_taken_and_a_missing_token_are_one_line(
    tmp_path: Path, daemon: Daemon
) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        number = taken.getsockname()[1]
        code, said = failing(daemon, f"serve.gpsd=127.0.0.1:{number}")
        assert (code, said.count("\n")) == (73, 1)
        assert f'serve.gpsd = "127.0.0.1:{number}": ' in said
    code, said = failing(daemon, f"serve.token_file={tmp_path}/none")
    assert code == 78
    assert "No such file" in said
    code, said = failing(daemon, "serve.page=0.0.0.0:8086")
    assert code == 78
    assert "serve.token_file" in said


def failing(daemon: Daemon, *settings: str) -> tuple[int, str]:
    chosen = [f"log.path={daemon.log}", "serve.page=", "serve.nmea=", *settings]
    arguments = [part for key in chosen for part in ("--set", key)]
    done = subprocess.run(
        [sys.executable, "-m", "imu_tracker", "serve", "-q", *arguments],
        capture_output=True,
        text=True,
        check=False,
    )
    return done.returncode, done.stderr


def test_a_bad_route_is_told_and_guides_nowhere(daemon: Daemon, tmp_path: Path) -> None:
    missing = tmp_path / "none.gpx"
    arguments = ("--set", f"guide.route={missing}", "--set", f"log.path={daemon.log}")
    chosen = ("serve.page=127.0.0.1:0", "serve.gpsd=", "serve.nmea=")
    ports = [part for key in chosen for part in ("--set", key)]
    process = subprocess.Popen(
        [sys.executable, "-m", "imu_tracker", "serve", *arguments, *ports],
        stderr=subprocess.PIPE,
        text=True,
    )
    assert process.stderr is not None
    try:
        ready, _, _ = select.select([process.stderr], [], [], PATIENCE_S)
        assert ready
        assert "no guidance: " in process.stderr.readline()
        assert "the page: " in process.stderr.readline()
    finally:
        os.kill(process.pid, signal.SIGTERM)
        assert process.wait(10) == 0
        process.stderr.close()
