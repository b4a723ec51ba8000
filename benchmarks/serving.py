"""What `imu-tracker serve` costs, and how late a row arrives.

A log of so many hours at 4 Hz, one that grows by a row each quarter of a second, and as
many viewers and clients of gpsd as are let in.
"""

import argparse
import asyncio
import json
import os
import re
import sys
import time
from datetime import UTC, datetime
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory
from typing import Final, NamedTuple

from imu_tracker.storage.latlong import HEADER

RATE_HZ: Final = 4
NEWEST_S: Final = datetime(2026, 11, 22, 12, tzinfo=UTC).timestamp()
PORTS: Final = ("page", "gpsd", "nmea")

ROUTE: Final = """<?xml version="1.0"?>
<gpx version="1.1" creator="benchmarks" xmlns="http://www.topografix.com/GPX/1/1"><rte>
<rtept lat="51.9" lon="4.3"/><rtept lat="52.9" lon="5.3"/></rte></gpx>
"""


Peer = tuple[asyncio.StreamReader, asyncio.StreamWriter]


class Serving(NamedTuple):
    """What came out; times in seconds, memory in MB, load as a share of one core."""

    ready_s: float  # from the start to the whole log at a client
    history_s: float  # from a request to the whole track
    row_at_page_s: tuple[float, float]  # median and worst
    row_at_client_s: tuple[float, float]
    load: float
    peak_mb: float


def measure(hours: float, seconds: float, peers: int, *, with_route: bool) -> Serving:
    """Run the program on a log of so many hours, for so many seconds more."""
    with TemporaryDirectory() as name:
        return asyncio.run(_measure(Path(name), hours, seconds, peers, with_route))


async def _measure(
    folder: Path, hours: float, seconds: float, peers: int, with_route: bool
) -> Serving:
    log, status = folder / "latlong.csv", folder / "status.json"
    count = round(hours * 3600 * RATE_HZ)
    begin_s = NEWEST_S - count / RATE_HZ
    with log.open("w") as file:
        file.write(f"{HEADER}\n")
        file.writelines(_line(begin_s, number) for number in range(count))
    settings = [f"log.path={log}", f"status.path={status}"]
    settings += [f"serve.{name}=127.0.0.1:0" for name in PORTS]
    if with_route:
        (folder / "route.gpx").write_text(ROUTE)
        settings.append(f"guide.route={folder / 'route.gpx'}")
    start_s = time.monotonic()
    process = await asyncio.create_subprocess_exec(
        *(sys.executable, "-m", "imu_tracker", "serve"),
        *(part for setting in settings for part in ("--set", setting)),
        stderr=asyncio.subprocess.PIPE,
    )
    try:
        assert process.stderr is not None
        ports = {}
        for name in PORTS:
            said = (await process.stderr.readline()).decode()
            ports[name] = int(re.findall(r":(\d+)/?$", said.strip())[0])
        _tell(status)
        newest = _time(begin_s + (count - 1) / RATE_HZ)
        while newest not in await _poll(ports["gpsd"]):
            _tell(status)
            await asyncio.sleep(0.2)
        ready_s = time.monotonic() - start_s
        asked_s = time.monotonic()
        (await _viewer(ports["page"]))[1].close()
        history_s = time.monotonic() - asked_s
        written: dict[str, float] = {}
        at_page: list[float] = []
        at_client: list[float] = []
        readers = []
        for _ in range(peers):
            viewer = await _viewer(ports["page"])
            readers.append(asyncio.create_task(_hear(viewer, written, at_page)))
            client = await asyncio.open_connection("127.0.0.1", ports["gpsd"])
            client[1].write(b'?WATCH={"enable":true,"json":true}\n')
            readers.append(asyncio.create_task(_hear(client, written, at_client)))
        used_s, from_s = _cpu_s(process.pid), time.monotonic()
        for number in range(count, count + round(seconds * RATE_HZ)):
            with log.open("a") as file:
                file.write(_line(begin_s, number))
            written[_time(begin_s + number / RATE_HZ)] = time.monotonic()
            _tell(status)
            await asyncio.sleep(1 / RATE_HZ)
        load = (_cpu_s(process.pid) - used_s) / (time.monotonic() - from_s)
        for reader in readers:
            reader.cancel()
        peak = re.search(
            r"VmHWM:\s+(\d+)", Path(f"/proc/{process.pid}/status").read_text()
        )
        assert peak is not None
        return Serving(
            ready_s,
            history_s,
            (median(at_page), max(at_page)),
            (median(at_client), max(at_client)),
            load,
            int(peak[1]) / 1024,
        )
    finally:
        process.terminate()
        await process.wait()


def _line(begin_s: float, number: int) -> str:
    lat_deg = 51.99 + 1e-5 * (number % 20_000)
    time_utc = _time(begin_s + number / RATE_HZ)
    return f"{time_utc}Z,{lat_deg:.8f},4.37000000,5.2,13.80,40.1,3.90,gps\n"


def _time(utc_s: float) -> str:
    return datetime.fromtimestamp(utc_s, UTC).strftime("%Y-%m-%dT%H:%M:%S.%f")[:-3]


def _tell(status: Path) -> None:
    text = {"t_ns": time.monotonic_ns(), "pid": os.getpid(), "state": "tracking"}
    new = status.with_suffix(".new")
    new.write_text(json.dumps(text | {"fix_age_s": 0.0}))
    new.replace(status)


async def _poll(port: int) -> str:
    reader, writer = await asyncio.open_connection("127.0.0.1", port)
    writer.write(b'?WATCH={"enable":true,"json":true}\n?POLL;\n')
    text = ""
    while '"class":"POLL"' not in text and (line := await reader.readline()):
        text = line.decode()
    writer.close()
    return text


async def _viewer(port: int) -> Peer:
    """Open the page's events; return once the track is here."""
    reader, writer = await asyncio.open_connection("127.0.0.1", port, limit=1 << 24)
    writer.write(b"GET /events HTTP/1.1\r\nHost: localhost\r\n\r\n")
    while not (await reader.readline()).startswith(b"data: "):
        pass
    return reader, writer


async def _hear(peer: Peer, written: dict[str, float], late_s: list[float]) -> None:
    while line := await peer[0].readline():
        now_s = time.monotonic()
        if (row := _row_of(line.decode())) in written:
            late_s.append(now_s - written[row])


def _row_of(line: str) -> str:
    """Return the time of the row that a report or an event is about; "" for others."""
    if line.startswith('{"class":"TPV"'):
        return str(json.loads(line)["time"][:-1])
    if line.startswith('data: {"utc_s":'):
        return _time(json.loads(line[6:])["utc_s"] + 1e-6)
    return ""


def _cpu_s(pid: int) -> float:
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=20.0, help="default: 20")
    seconds = parser.parse_args().seconds
    print(
        "| log | viewers and clients | route | start | track | page | client |"
        " load of a core | memory |"
    )
    print(f"|{' --- |' * 9}")
    for hours, peers, route in ((1, 16, False), (24, 1, False), (24, 16, True)):
        got = measure(hours, seconds, peers, with_route=route)
        late = [
            f"{usual_s:.2f} s ({worst_s:.2f} s)"
            for usual_s, worst_s in (got.row_at_page_s, got.row_at_client_s)
        ]
        print(
            f"| {hours} h | {peers} + {peers} | {'yes' if route else 'no'} |"
            f" {got.ready_s:.1f} s | {got.history_s:.2f} s | {' | '.join(late)} |"
            f" {got.load:.1%} | {got.peak_mb:.0f} MB |",
            flush=True,
        )


if __name__ == "__main__":
    main()
