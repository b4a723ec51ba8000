"""The chip itself, read in the caller's own thread: for what measures a sensor.

The daemon's threads never give up; a calibration should. A transfer that fails is
tried again twice, then its error ends the command.
"""

import contextlib
import queue
from collections import Counter
from collections.abc import Generator, Iterator
from typing import Final, TypeVar

from imu_tracker.config import Config
from imu_tracker.errors import BusError, ConfigError
from imu_tracker.samples import Frame, SessionHeader
from imu_tracker.sensors.clock import SECOND_NS, Clock, Pacer
from imu_tracker.sensors.imu.sources import BurstSource, FifoSource, ImuSource
from imu_tracker.sources import factory as hardware

MOST_ERRORS: Final = 3  # in a row

Item = TypeVar("Item", bound=SessionHeader | Frame)


def live_frames(
    config: Config, clock: Clock, *, with_gps: bool = False
) -> Generator[SessionHeader | Frame, None, None]:
    """Yield a header and then frames, without end; close it to close the bus.

    Parameters
    ----------
    config : Config
    clock : Clock
    with_gps : bool
        Listen to the receiver, too.

    Raises
    ------
    BusError, DeviceNotFoundError
        When the chip does not answer, or no longer.
    ConfigError
        When the configuration is that of a played source.
    """
    if config.source.kind != "hardware":
        raise ConfigError(
            f'source.kind = "{config.source.kind}": must be "hardware" to measure the '
            "sensor; give a recording otherwise"
        )
    lines: queue.SimpleQueue[Frame] = queue.SimpleQueue()
    with contextlib.ExitStack() as stack:
        bus = stack.enter_context(contextlib.closing(hardware.open_imu_bus(config)))
        imu = hardware.imu_driver(config, bus, clock)
        chip = imu.probe()
        settings, counts = hardware.imu_settings(config), Counter[str]()
        source: ImuSource
        if config.imu.read == "fifo" and chip.fifo_bytes:
            source = FifoSource(imu, settings, counts)
        else:
            source = BurstSource(imu, settings, clock)
        if with_gps:
            gps = hardware.gps_reader(config, lines.put, clock)
            gps.start()
            stack.callback(gps.join)
            stack.callback(gps.stop)
        yield hardware.live_header(config, chip.name)
        pacer, errors = Pacer(clock, source.period_ns), 0
        while True:
            pacer.wait()
            try:
                frames, _ = source.read()
            except BusError:
                errors += 1
                if errors == MOST_ERRORS:
                    raise
                continue
            errors = 0
            yield from frames
            while not lines.empty():
                yield lines.get()
            pacer.period_ns = source.period_ns


def for_seconds(stream: Iterator[Item], seconds: float) -> Iterator[Item]:
    """Pass on so many seconds of a live stream."""
    start_ns: int | None = None
    for item in stream:
        if isinstance(item, Frame):
            start_ns = item.t_ns if start_ns is None else start_ns
            if item.t_ns - start_ns >= seconds * SECOND_NS:
                return
        yield item
