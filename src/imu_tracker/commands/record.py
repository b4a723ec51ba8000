"""`imu-tracker record`: keep what the sensors say, and estimate nothing."""

import argparse
import contextlib
import logging
import queue
import signal
import sys
from collections import Counter
from collections.abc import Iterator
from threading import Event
from typing import TYPE_CHECKING, Final

from imu_tracker.commands.common import (
    Subparsers,
    add_command,
    add_config,
    config_of,
    new_file,
    positive,
)
from imu_tracker.errors import ConfigError, OutputError

if TYPE_CHECKING:
    from imu_tracker.config import Config
    from imu_tracker.recording.files import RecordingWriter
    from imu_tracker.samples import Frame
    from imu_tracker.sensors.clock import Clock
    from imu_tracker.sensors.gnss.reader import GpsReader
    from imu_tracker.sensors.imu.reader import ImuReader

log = logging.getLogger(__name__)

TURN_NS: Final = 100_000_000
FLUSH_NS: Final = 5_000_000_000
FOREVER_NS: Final = 2**63 - 1
SHOW_EVERY: Final = 100  # frames, on a terminal

_DESCRIPTION = """\
Write down what the chip and the receiver say and when, until Ctrl-C: for `replay`, for
a bug report, or to measure the sensors. Nothing is estimated. The chip must be there
at the start; a receiver may come later."""

_EXAMPLES = """\
  imu-tracker record --config /etc/imu-tracker/imu-tracker.toml --output drive.rec.gz
  imu-tracker record --output still.rec --duration 7200"""


def add_record(subparsers: Subparsers) -> None:
    """Add the command."""
    parser = add_command(
        subparsers, "record", "keep what the sensors say", _DESCRIPTION, _EXAMPLES
    )
    add_config(parser)
    parser.add_argument(
        "--output",
        type=new_file,
        required=True,
        metavar="REC",
        help="the recording, a new file; compressed when it ends in .gz",
    )
    parser.add_argument(
        "--duration",
        type=positive,
        metavar="S",
        help="end after so many seconds; default: at Ctrl-C",
    )
    parser.set_defaults(run=run_record)


def run_record(args: argparse.Namespace) -> int:
    """Record until SIGINT, SIGTERM or the end of the duration."""
    config = config_of(args)
    if config.source.kind != "hardware":
        raise ConfigError(
            f'source.kind = "{config.source.kind}": must be "hardware" to record; '
            "see `imu-tracker simulate`"
        )
    if args.output.exists():
        raise OutputError(f"{args.output}: exists; a recording is a new file")

    from imu_tracker.recording.files import RecordingWriter
    from imu_tracker.sensors.clock import MonotonicClock
    from imu_tracker.sources import factory as hardware

    clock = MonotonicClock()
    with contextlib.closing(hardware.open_imu_bus(config)) as bus:
        chip = hardware.imu_driver(config, bus, clock).probe()
    end_ns = FOREVER_NS
    if args.duration is not None:
        end_ns = clock.now_ns() + round(args.duration * 1e9)
    with RecordingWriter(args.output) as writer, _told_to_end() as stop:
        writer.write_header(hardware.live_header(config, chip.name))
        counts = _record(config, writer, clock, stop, end_ns)
    log.info("%s: %d samples, %d lines of GPS", args.output, counts["I"], counts["G"])
    return 0


def _record(
    config: "Config",
    writer: "RecordingWriter",
    clock: "Clock",
    stop: Event,
    end_ns: int,
) -> Counter[str]:
    from imu_tracker.sources import factory as hardware

    frames: queue.SimpleQueue[Frame] = queue.SimpleQueue()
    counts: Counter[str] = Counter()
    imu = hardware.imu_reader(config, frames.put, clock)
    gps = hardware.gps_reader(config, frames.put, clock)
    flush_ns = now_ns = clock.now_ns()
    imu.start()
    gps.start()
    try:
        while now_ns < end_ns:
            is_told = clock.sleep_until_ns(min(now_ns + TURN_NS, end_ns), stop)
            now_ns = end_ns if is_told else clock.now_ns()
            _drain(frames, writer, counts)
            if now_ns >= flush_ns:
                flush_ns = now_ns + FLUSH_NS
                writer.flush()
            _raise_bugs(imu, gps)
    finally:
        for reader in (imu, gps):
            reader.stop()
        for reader in (imu, gps):
            reader.join()
    _drain(frames, writer, counts)
    return counts


def _drain(
    frames: "queue.SimpleQueue[Frame]", writer: "RecordingWriter", counts: Counter[str]
) -> None:
    while not frames.empty():
        frame = frames.get()
        writer.write(frame)
        counts[frame.source] += 1
        if frame.source == "E":
            log.info("%s", frame.data.decode("ascii", "replace"))
        elif counts.total() % SHOW_EVERY == 0 and sys.stderr.isatty():
            sys.stderr.write(f"\r{counts['I']} samples, {counts['G']} lines of GPS ")


def _raise_bugs(imu: "ImuReader", gps: "GpsReader") -> None:
    for reader in (imu, gps):
        if reader.error is not None:
            raise reader.error


@contextlib.contextmanager
def _told_to_end() -> Iterator[Event]:
    """Turn SIGINT and SIGTERM into an event, for as long as it lasts."""
    stop = Event()
    before = {
        number: signal.signal(number, lambda *_: stop.set())
        for number in (signal.SIGINT, signal.SIGTERM)
    }
    try:
        yield stop
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
