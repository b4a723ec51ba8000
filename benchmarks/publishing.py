"""What `imu-tracker publish` costs, how fast it catches up, and what a broker bears.

    python -m benchmarks.publishing [backlog] [steady] [fleet]

It needs Mosquitto (apt install mosquitto). `fleet` simulates trackers by connections of
its own, each with the messages of `publish` (JSON, MQTT 3.1.1, QoS 1).
"""

import argparse
import asyncio
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path
from random import Random
from statistics import median, quantiles
from tempfile import TemporaryDirectory
from typing import Final

from imu_tracker.publish.senders.payloads import json_row
from imu_tracker.storage.latlong import HEADER, LogRow, format_utc

RATE_HZ: Final = 4
BEGIN_S: Final = datetime(2026, 11, 22, 12, tzinfo=UTC).timestamp()
PARTS: Final = ("backlog", "steady", "fleet")
EVERY_S: Final = 10.0
"""A tracker that moves sends a row so often."""


def row(number: int) -> LogRow:
    """Return a row of a drive to the north."""
    lat_deg = round(40.0 + 3e-5 * (number % 1_000_000), 8)
    utc_s = BEGIN_S + number / RATE_HZ
    return LogRow(utc_s, lat_deg, 4.37, 5.2, 13.8, 40.1, 3.94, "gps")


def line(number: int) -> str:
    """Return it as the log has it."""
    each = row(number)
    return (
        f"{format_utc(each.utc_s)},{each.lat_deg:.8f},4.37000000,5.2,13.80,40.1,3.94,"
        "gps\n"
    )


def mosquitto_path() -> str:
    """Return where it is."""
    found = shutil.which("mosquitto", path=f"{os.environ['PATH']}:/usr/sbin")
    if found is None:
        raise SystemExit("mosquitto is missing: apt install mosquitto")
    return found


@contextmanager
def broker(folder: Path, port: int) -> Iterator["subprocess.Popen[bytes]"]:
    """Run Mosquitto until the end of the block."""
    config = folder / "mosquitto.conf"
    config.write_text(
        f"listener {port} 127.0.0.1\nallow_anonymous true\nmax_queued_messages 0\n"
        f"log_dest none\n{'user root' if os.geteuid() == 0 else ''}\n"
    )
    process = subprocess.Popen([mosquitto_path(), "-c", str(config)])
    try:
        time.sleep(0.5)
        yield process
    finally:
        process.kill()
        process.wait()


def program(folder: Path, *, once: bool, every: bool, to: list[str]) -> list[str]:
    """Return the command with a destination for each URL."""
    settings = [f"log.path={folder / 'latlong.csv'}"]
    settings.append(f"status.publish={folder / 'publish.json'}")
    for number, url in enumerate(to):
        keys = {"kind": "mqtt", "url": url, "device": f"d{number}"}
        keys["cursor_dir"] = str(folder / "cursors")
        name = f"publish.d{number}"
        settings += [f"{name}.{key}={value}" for key, value in keys.items()]
        settings += [f"{name}.moving_s=0"] if every else []
    command = [sys.executable, "-m", "imu_tracker", "publish", "--quiet"]
    command += ["--once"] if once else []
    return command + [part for setting in settings for part in ("--set", setting)]


def cpu_s(pid: int) -> float:
    """Return what a process has used of all processors."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def peak_mb(pid: int) -> float:
    """Return the most memory that it had."""
    text = Path(f"/proc/{pid}/status").read_text()
    found = re.search(r"VmHWM:\s+(\d+)", text)
    assert found
    return int(found[1]) / 1024


def backlog(rows: int = 100_000) -> None:
    """Print how fast a backlog is sent, every row of it."""
    with TemporaryDirectory() as name:
        folder = Path(name)
        with (folder / "latlong.csv").open("w") as file:
            file.write(f"{HEADER}\n")
            file.writelines(map(line, range(rows)))
        with broker(folder, 18_840):
            to = ["mqtt://127.0.0.1:18840"]
            begin_s = time.monotonic()
            process = subprocess.Popen(program(folder, once=True, every=True, to=to))
            _, status, usage = os.wait4(process.pid, 0)
            took_s = time.monotonic() - begin_s
        used_s = usage.ru_utime + usage.ru_stime
        print(
            f"backlog: {rows} rows in {took_s:.1f} s, {rows / took_s:.0f} rows/s; "
            f"{used_s:.1f} s of a processor ({rows / used_s:.0f} rows/s), "
            f"{usage.ru_maxrss / 1024:.1f} MB at most, exit {status}"
        )


def steady(destinations: int, seconds: float = 60.0) -> None:
    """Print load and memory while rows come four times a second."""
    with TemporaryDirectory() as name, broker(Path(name), 18_841):
        folder = Path(name)
        log = folder / "latlong.csv"
        log.write_text(f"{HEADER}\n")
        to = ["mqtt://127.0.0.1:18841"] * destinations
        process = subprocess.Popen(program(folder, once=False, every=False, to=to))
        try:
            number = 0
            used_s = from_s = 0.0
            end_s = time.monotonic() + seconds + 5.0
            while time.monotonic() < end_s:
                with log.open("a") as file:
                    file.write(line(number))
                number += 1
                if number == 5 * RATE_HZ:
                    used_s, from_s = cpu_s(process.pid), time.monotonic()
                time.sleep(1 / RATE_HZ)
            load = (cpu_s(process.pid) - used_s) / (time.monotonic() - from_s)
            told = json.loads((folder / "publish.json").read_text())["destinations"]
            sent = [each["sent_rows"] for each in told.values()]
            print(
                f"steady: {destinations} destinations, {load:.2%} of a core, "
                f"{peak_mb(process.pid):.1f} MB at most; sent {sent}"
            )
        finally:
            process.send_signal(signal.SIGTERM)
            process.wait()


# ------------------------------------------------------------------------- a fleet


class Tracker:
    """One connection that publishes like `publish` does, and counts."""

    def __init__(self, number: int, port: int, rng: Random) -> None:
        self.name = f"t{number:04d}"
        self._port, self._rng = port, rng
        self.acknowledged = 0
        self.connections = 0

    async def run(self, rows: int, burst: int) -> None:
        """Publish a row each ten seconds; what waited meanwhile at once."""
        sent = 0
        await asyncio.sleep(self._rng.uniform(0.0, EVERY_S))
        begin_s = time.monotonic()
        delay_s = 1.0
        while self.acknowledged < rows:
            try:
                reader, writer = await asyncio.open_connection("127.0.0.1", self._port)
            except OSError:
                await asyncio.sleep(delay_s * self._rng.uniform(0.5, 1.0))
                delay_s = min(120.0, 2.0 * delay_s)
                continue
            try:
                self.connections += 1
                await self._connect(reader, writer)
                delay_s = 1.0
                sent = self.acknowledged
                while self.acknowledged < rows:
                    due = burst + int((time.monotonic() - begin_s) / EVERY_S)
                    while sent < min(due, rows, self.acknowledged + 20):
                        writer.write(self._publish(sent))
                        sent += 1
                    if sent == self.acknowledged:
                        await asyncio.sleep(0.5)
                        continue
                    await reader.readexactly(4)
                    self.acknowledged += 1
            except (OSError, asyncio.IncompleteReadError):
                continue
            finally:
                writer.close()

    async def _connect(
        self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter
    ) -> None:
        client = self.name.encode()
        body = b"\x00\x04MQTT\x04\x02\x00\x3c" + len(client).to_bytes(2) + client
        writer.write(b"\x10" + bytes([len(body)]) + body)
        await reader.readexactly(4)

    def _publish(self, number: int) -> bytes:
        topic = f"imu-tracker/{self.name}/position".encode()
        payload = json_row(self.name, row(number))
        # The instant of sending stands behind the row: of this process alone.
        payload = payload[:-1] + b',"sent_ns":%d}' % time.monotonic_ns()
        mid = (number % 65_535 + 1).to_bytes(2)
        body = len(topic).to_bytes(2) + topic + mid + payload
        length = len(body)
        return b"\x33" + bytes([length & 127 | 128, length >> 7]) + body


async def _hear(port: int, late_s: list[float], keys: set[str]) -> None:
    """Subscribe to every tracker and note how late each row is."""
    process = await asyncio.create_subprocess_exec(
        *("mosquitto_sub", "-h", "127.0.0.1", "-p", str(port), "-q", "0"),
        *("-t", "imu-tracker/+/position"),
        stdout=asyncio.subprocess.PIPE,
    )
    assert process.stdout is not None
    try:
        while text := await process.stdout.readline():
            found = json.loads(text)
            late_s.append((time.monotonic_ns() - found["sent_ns"]) / 1e9)
            keys.add(f"{found['id']} {found['time_utc']}")
    finally:
        process.kill()
        await process.wait()


async def fleet(trackers: int, rows: int, burst: int) -> None:
    """Print what was delivered and how late; `burst` rows wait at the begin."""
    late_s: list[float] = []
    keys: set[str] = set()
    port = 18_842
    with TemporaryDirectory() as name, broker(Path(name), port) as process:
        hearing = asyncio.create_task(_hear(port, late_s, keys))
        await asyncio.sleep(1.0)
        all_of_them = [Tracker(n, port, Random(n)) for n in range(trackers)]
        begin_s = time.monotonic()
        await asyncio.gather(*(each.run(rows, burst) for each in all_of_them))
        took_s = time.monotonic() - begin_s
        for _ in range(100):
            if len(keys) >= trackers * rows:
                break
            await asyncio.sleep(0.1)
        load, memory = cpu_s(process.pid) / took_s, peak_mb(process.pid)
        hearing.cancel()
        await asyncio.gather(hearing, return_exceptions=True)
    acknowledged = sum(each.acknowledged for each in all_of_them)
    print(
        f"fleet: {trackers} trackers, {burst} rows waiting each, {rows} in all: "
        f"{acknowledged} acknowledged, {len(keys)} delivered of {trackers * rows}, "
        f"{acknowledged / took_s:.0f} rows/s, late by {median(late_s) * 1e3:.1f} ms, "
        f"{quantiles(late_s, n=100)[98] * 1e3:.0f} ms (99 %), "
        f"{max(late_s) * 1e3:.0f} ms (worst); broker {load:.1%} of a core, "
        f"{memory:.1f} MB"
    )


def main() -> None:
    """Print what was measured."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.publishing",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("parts", nargs="*", metavar="PART", help=f"of {PARTS}; or all")
    parts = parser.parse_args().parts or PARTS
    load = " ".join(f"{average:.2f}" for average in os.getloadavg())
    print(f"{os.cpu_count()} processors, load {load}")
    if "backlog" in parts:
        backlog()
    if "steady" in parts:
        steady(1)
        steady(5)
    if "fleet" in parts:
        asyncio.run(fleet(1000, 12, 1))
        asyncio.run(fleet(1000, 66, 60))


if __name__ == "__main__":
    main()
