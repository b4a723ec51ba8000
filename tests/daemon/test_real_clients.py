"""Programs of others, unmodified: gpspipe, gpxlogger, python3-gps, gpsd, Chromium.

Each skips where it is not installed (Debian: gpsd gpsd-clients python3-gps chromium).
"""

import itertools
import json
import os
import pty
import re
import select
import shutil
import socket
import subprocess
import termios
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from imu_tracker.sensors.gnss.epoch_reader import EpochReader, Positions
from imu_tracker.sensors.gnss.network_port import GpsdPort
from imu_tracker.sensors.gnss.port import TimedLines
from support.browser import CHROMIUM, browsing
from support.mbtiles import BLUE_PNG, mbtiles
from support.nmea_text import gga, rmc
from support.served import Daemon, Served, serving

GPSD = shutil.which("gpsd") or shutil.which("gpsd", path="/usr/sbin")


def needs(program: str) -> pytest.MarkDecorator:
    missing = shutil.which(program) is None
    return pytest.mark.skipif(missing, reason=f"{program} is not here")


@pytest.fixture
def daemon(tmp_path: Path) -> Daemon:
    daemon = Daemon(tmp_path)
    daemon.write("gps")
    daemon.tell()
    return daemon


@contextmanager
def driving(daemon: Daemon) -> Iterator[None]:
    """Write a row of each kind in turn, as long as the block lasts."""
    stop = threading.Event()

    def drive() -> None:
        for mode in itertools.cycle(["gps", "dr"]):
            if stop.wait(0.1):
                return
            daemon.tell()
            daemon.write(mode, r95=3.94 if mode == "gps" else 54.32)

    thread = threading.Thread(target=drive)
    thread.start()
    try:
        yield
    finally:
        stop.set()
        thread.join()


@pytest.fixture
def served(daemon: Daemon) -> Iterator[Served]:
    with serving(daemon) as served, driving(daemon):
        yield served


def run(*arguments: str, **options: Any) -> str:
    done: subprocess.CompletedProcess[str] = subprocess.run(
        arguments, capture_output=True, text=True, timeout=60, check=False, **options
    )
    return done.stdout


def check_reports(lines: list[str]) -> None:
    """Radius and status as the log has them, to the last digit."""
    reports = [json.loads(text) for text in lines if '"class":"TPV"' in text]
    found = {(report.get("status"), report.get("eph")) for report in reports}
    assert {(6, 3.94), (5, 54.32)} <= found
    for report in reports:
        assert re.fullmatch(r"2026-11-22T12:\d\d:\d\d\.\d{3}Z", report["time"])
        assert report["mode"] == 3
        assert (report["altMSL"], report["speed"]) == (5.2, 13.8)


@needs("gpspipe")
def test_gpspipe_hears_reports_and_sentences(served: Served) -> None:
    where = f"127.0.0.1:{served.ports['gpsd']}"
    check_reports(run("gpspipe", "-w", "-n", "10", where).splitlines())
    sentences = run("gpspipe", "-r", "-n", "20", where)
    assert "$GPRMC," in sentences
    assert "$GPGST," in sentences


@needs("gpxlogger")
def test_gpxlogger_writes_a_track(served: Served) -> None:
    logger = subprocess.Popen(
        ["gpxlogger", "-i", "1", f"127.0.0.1:{served.ports['gpsd']}"],
        stdout=subprocess.PIPE,
        text=True,
    )
    assert logger.stdout is not None
    for text in logger.stdout:
        if "<trkpt" in text:
            break
    logger.terminate()
    logger.wait(10)
    logger.stdout.close()
    assert re.search(r'lat="51\.99\d+" lon="4\.370000', text)


@needs("cgps")
def test_cgps_shows_dead_reckoning_and_fused(served: Served) -> None:
    screen, terminal = pty.openpty()
    termios.tcsetwinsize(terminal, (40, 120))
    cgps = subprocess.Popen(
        ["cgps", "-s", f"127.0.0.1:{served.ports['gpsd']}"],
        stdin=terminal,
        stdout=terminal,
        stderr=terminal,
        env=os.environ | {"TERM": "xterm"},
    )
    os.close(terminal)
    shown = b""
    try:
        end = time.monotonic() + 20
        while b"DR FIX" not in shown and time.monotonic() < end:
            if select.select([screen], [], [], 1)[0]:
                shown += os.read(screen, 4096)
    finally:
        cgps.kill()
        cgps.wait(10)
        os.close(screen)
    assert b"DR FIX" in shown


@pytest.mark.skipif(
    subprocess.run(
        ["/usr/bin/python3", "-c", "import gps"], capture_output=True, check=False
    ).returncode
    != 0,
    reason="python3-gps is not here",
)
def test_the_python_of_gpsd_reads_it(served: Served) -> None:
    program = (
        "import gps, json, sys\n"
        f"s = gps.gps(host='127.0.0.1', port='{served.ports['gpsd']}',"
        " mode=gps.WATCH_ENABLE)\n"
        "n = 0\n"
        "while n < 6:\n"
        "    r = s.next()\n"
        "    if r['class'] == 'TPV':\n"
        "        n += 1\n"
        "        print(json.dumps(dict(r)))\n"
    )
    said = run("/usr/bin/python3", "-c", program).replace('": ', '":')
    check_reports(said.replace(", ", ",").splitlines())


def free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as server:
        number: int = server.getsockname()[1]
        return number


@contextmanager
def gpsd(source: str) -> Iterator[int]:
    """Run the real gpsd on a source; yield its port."""
    assert GPSD is not None
    number = free_port()
    process = subprocess.Popen(
        [GPSD, "-N", "-n", "-b", "-S", str(number), source],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    try:
        wait_for(lambda: _answers(number))
        yield number
    finally:
        process.terminate()
        process.wait(10)


def _answers(number: int) -> bool:
    try:
        socket.create_connection(("127.0.0.1", number)).close()
    except OSError:
        return False
    return True


def wait_for(holds: Callable[[], bool], patience_s: float = 20.0) -> None:
    end = time.monotonic() + patience_s
    while not holds():
        assert time.monotonic() < end
        time.sleep(0.05)


@pytest.mark.skipif(GPSD is None, reason="gpsd is not here")
@needs("gpspipe")
def test_a_real_gpsd_relays_radius_and_status(served: Served) -> None:
    with gpsd(f"gpsd://127.0.0.1:{served.ports['gpsd']}") as number:
        check_reports(
            run("gpspipe", "-w", "-n", "20", f"127.0.0.1:{number}").splitlines()
        )
        port = GpsdPort(f"gpsd://127.0.0.1:{number}")
        try:
            with pytest.raises(OSError, match="imu-tracker itself"):  # by its driver
                any(port.read() and False for _ in range(200))
        finally:
            port.close()


@pytest.mark.skipif(GPSD is None, reason="gpsd is not here")
@needs("gpspipe")
def test_a_real_gpsd_reads_our_sentences(served: Served) -> None:
    with gpsd(f"tcp://127.0.0.1:{served.ports['nmea']}") as number:
        said = run("gpspipe", "-w", "-n", "60", f"127.0.0.1:{number}").splitlines()
    reports = [json.loads(text) for text in said if '"class":"TPV"' in text]
    placed = [report for report in reports if report.get("mode") == 3]
    assert placed
    for report in placed:
        assert (report["altMSL"], report["speed"]) == (5.2, pytest.approx(13.8, 3e-3))
        assert report["lon"] == pytest.approx(4.37000034, abs=2e-7)
    # 5 is gpsd's word for a GGA of quality 6; it has none for an ordinary fix.
    assert {report.get("status") for report in placed} == {5, None}
    radii = {round(report["eph"], 1) for report in placed if "eph" in report}
    assert {3.9, 54.3} <= radii


@pytest.mark.skipif(GPSD is None, reason="gpsd is not here")
def test_a_receiver_behind_a_real_gpsd_is_a_receiver() -> None:
    with (
        socket.create_server(("127.0.0.1", 0)) as receiver,
        gpsd(f"tcp://127.0.0.1:{receiver.getsockname()[1]}") as number,
    ):
        port = GpsdPort(f"gpsd://127.0.0.1:{number}")
        peer, _ = receiver.accept()
        stop = threading.Event()

        def speak() -> None:
            for second in range(200):
                tod = f"1200{second % 60:02d}.00"
                try:
                    peer.sendall(rmc(tod) + b"\r\n" + gga(tod) + b"\r\n")
                except OSError:
                    return
                if stop.wait(0.2):
                    return

        speaker = threading.Thread(target=speak)
        speaker.start()
        try:
            lines, reader = TimedLines(0, 0), EpochReader()
            positions: Positions = []
            end = time.monotonic() + 20
            while not positions and time.monotonic() < end:
                now_ns = time.monotonic_ns()
                for frame in lines.feed(port.read(), now_ns):
                    positions += reader.feed(frame.t_ns, frame.data)
            assert positions
        finally:
            stop.set()
            speaker.join()
            peer.close()
            port.close()


@pytest.mark.skipif(CHROMIUM is None, reason="no Chromium here")
def test_tiles_lie_below_the_track_in_a_real_browser(
    daemon: Daemon, tmp_path: Path
) -> None:
    everywhere = [
        (zoom, x, y, BLUE_PNG)
        for zoom in range(4)
        for x in range(2**zoom)
        for y in range(2**zoom)
    ]
    tiles = mbtiles(tmp_path / "a.mbtiles", *everywhere)
    with (
        serving(daemon, f"serve.tiles={tiles}") as served,
        browsing(tmp_path / "home") as browser,
    ):
        browser.open(served.url, 800, 600)
        text = "document.body.innerText"
        wait_for(lambda: "(c) somebody" in browser.ask(text))
        corner = "[...pen.getImageData(4, canvas.height - 4, 1, 1).data].join()"
        wait_for(lambda: browser.ask(corner) == "0,0,255,255")


@pytest.mark.skipif(CHROMIUM is None, reason="no Chromium here")
def test_the_page_lives_in_a_real_browser(
    daemon: Daemon, served: Served, tmp_path: Path
) -> None:
    with browsing(tmp_path / "home") as browser:
        browser.open(served.url, 360, 740, mobile=True)
        written = "document.getElementById('state').innerText"
        for words in ("dead reckoning", "with GPS"):
            wait_for(lambda words=words: words in browser.ask(written))  # type: ignore[misc]
        r95 = "document.getElementById('r95').innerText"
        wait_for(lambda: browser.ask(r95) == "54.3 m")
        assert browser.ask("document.documentElement.scrollWidth") <= 360
        assert browser.ask("points.length") > 2
        asked = [
            event["params"]["request"]["url"]
            for event in browser.events
            if event["method"] == "Network.requestWillBeSent"
        ]
        ours = (served.url, "data:")
        assert all(url.startswith(ours) for url in asked)
        said = {event["method"] for event in browser.events}
        assert not said & {"Runtime.exceptionThrown", "Log.entryAdded"}
