"""Is everything there that tracking needs? What to do about what is not.

Each check returns findings and never raises for what it finds. They look at the real
things, with the code that the daemon uses.
"""

import contextlib
import os
import queue
import shutil
from collections.abc import Iterator
from enum import StrEnum
from pathlib import Path
from typing import Final, NamedTuple

from imu_tracker.calibration.counts import CountsModel
from imu_tracker.check import network_ports, serial_ports
from imu_tracker.check.chip import GRAVITY_G, STILL_DPS, means, why_broken
from imu_tracker.config import Config
from imu_tracker.errors import (
    BusError,
    DeviceNotFoundError,
    NmeaError,
    OutputError,
    TrackerError,
)
from imu_tracker.motion.stuck_axes import StuckAxes
from imu_tracker.recording.files import read_recording
from imu_tracker.recording.layout import layout_of
from imu_tracker.samples import Frame, Source
from imu_tracker.sensors import pi_advice as mending
from imu_tracker.sensors.clock import MILLISECOND_NS, SECOND_NS, Clock
from imu_tracker.sensors.gnss.calendar import release_utc_s
from imu_tracker.sensors.gnss.epoch_reader import EpochReader, Positions
from imu_tracker.sensors.gnss.lines import checked_text
from imu_tracker.sensors.gnss.reader import GpsHealth, GpsState
from imu_tracker.sensors.imu.i2c import explain
from imu_tracker.sources import factory as hardware
from imu_tracker.storage.append_file import FOREIGN, Layout, is_foreign
from imu_tracker.storage.latlong import BACK_S, LAYOUT, format_utc
from imu_tracker.storage.log_tail import newest_utc_s

SAMPLES: Final = 100  # a second: enough to see that an axis stands

LISTEN_NS: Final = 24 * SECOND_NS  # nine baud rates, 2.2 s each, and the bursts
SENTENCES_NS: Final = 3 * SECOND_NS  # from the first one on: all kinds, and a fix


class Verdict(StrEnum):
    """How a check ended."""

    OK = "ok"
    WARNING = "warning"
    FAILED = "FAILED"


class Finding(NamedTuple):
    """One line of the table."""

    verdict: Verdict
    what: str
    text: str
    exit_code: int = 0


def check_sensors(config: Config, clock: Clock) -> Iterator[Finding]:
    """Look for what the frames will come from."""
    match config.source.kind:
        case "hardware":
            yield check_imu(config, clock)
            yield from check_gps(config, clock)
        case "recording":
            yield check_recording(config)
        case "simulation":
            yield _ok("source", f"simulation: {config.source.scenario}")


def check_outputs(config: Config) -> Iterator[Finding]:
    """Look whether the files can be written."""
    free_mb = config.log.min_free_mb
    yield check_output("log", config.log.path, LAYOUT, free_mb)
    if (path := config.record.path) is not None:
        yield check_output("recording", path, layout_of(path), free_mb)


def check_imu(config: Config, clock: Clock) -> Finding:
    """Probe and configure the chip, and see that it feels gravity."""
    try:
        with contextlib.closing(hardware.open_imu_bus(config)) as bus:
            imu = hardware.imu_driver(config, bus, clock)
            imu.configure(hardware.imu_settings(config))
            counts = CountsModel(config.imu.accel_range_g, config.imu.gyro_range_dps)
            samples, axes = [], StuckAxes()
            for _ in range(SAMPLES):
                clock.sleep_until_ns(clock.now_ns() + 10 * MILLISECOND_NS)
                t_ns, burst = clock.now_ns(), imu.read_burst()
                axes.look(t_ns, burst)
                samples.append(counts.decode(t_ns, burst))
    except BusError as error:
        return _failed("IMU", explain(error), error)
    except TrackerError as error:
        return _failed("IMU", str(error), error)
    gravity_g, rate_dps, temp_degc = means(samples)
    text = (
        f"{imu.chip.name} at 0x{config.imu.address:02X} on /dev/i2c-{config.imu.bus}: "
        f"{gravity_g:.2f} g, {rate_dps:.1f} °/s, {temp_degc:.0f} °C"
    )
    if broken := why_broken(samples, axes.stuck):
        return _unavailable("IMU", f"{text}; {broken}: {_SELFTEST}")
    if GRAVITY_G[0] <= gravity_g <= GRAVITY_G[1] and rate_dps <= STILL_DPS:
        return _ok("IMU", text)
    return _warning(
        "IMU",
        f"{text}; at rest it feels 1 g and no rate: hold it still; if it was still, "
        "run imu-tracker selftest, and calibrate accel",
    )


def check_gps(config: Config, clock: Clock) -> Iterator[Finding]:
    """Listen to the receiver for as long as it takes to know, half a minute at most."""
    port = config.gps.port
    if (console := mending.console_on(port)) is not None:
        yield _unavailable(
            "GPS port",
            f"{port}: Linux uses it for its console ({console}): "
            f"{mending.switch_console_off()}",
        )
        return
    epochs = EpochReader(date=config.gps.date, earliest_utc_s=release_utc_s())
    health, kinds, utc_s = _listen(config, clock, epochs)
    if health.state is GpsState.CLOSED:
        ports = network_ports if "://" in port else serial_ports
        why = ports.why_closed(port, health.detail)
        yield _unavailable("GPS port", f"{port}: {why}" if "://" in port else why)
        return
    if health.state is not GpsState.OK:
        advice = network_ports.why_useless(port, health.state)
        advice = advice or serial_ports.WHY_USELESS[health.state]
        yield _unavailable("GPS port", f"{port}: {advice}")
        return
    speed = "" if "://" in port else f" at {health.baud} baud"
    yield _ok("GPS port", f"{port}{speed}: {' '.join(sorted(kinds))}")
    if worst := epochs.damaged.worst():
        yield _warning("GPS port", f"{port}: {worst}")
    if not kinds & {"RMC", "GGA", "GNS", "GLL"}:
        yield _unavailable("GPS", "no sentence has a position: it must send RMC or GGA")
    elif epochs.counters["fixes_without_date"]:
        yield _warning(
            "GPS",
            "a fix without a date, and so no log: make it send RMC, or set gps.date",
        )
    elif not epochs.counters["fixes"] and (worst := epochs.unread.worst()):
        yield _warning(
            "GPS",
            f"a fix, but it cannot be used: {worst}: set the receiver, or what "
            "relays it, to plain NMEA 0183",
        )
    elif not epochs.counters["fixes"]:
        yield _warning("GPS", "no fix yet: the antenna wants to see the sky")
    else:
        now = "" if utc_s is None else f", at {format_utc(utc_s)}"
        yield _ok("GPS", f"a fix{now}")
        if utc_s is not None:
            yield from _check_future(config.log.path, utc_s)
        if worst := epochs.unread.worst():
            yield _warning("GPS", f"sentences that cannot be used: {worst}")


_SELFTEST: Final = "run imu-tracker selftest; another chip if that fails too"


def _check_future(path: Path, utc_s: float) -> Iterator[Finding]:
    """See whether the log ends later than it is by the receiver."""
    last_utc_s = newest_utc_s(path)
    if last_utc_s > utc_s + BACK_S:
        yield _warning(
            "log",
            f"{path}: ends at {format_utc(last_utc_s)}, later than the receiver's "
            f"time, {format_utc(utc_s)}: run puts it aside and begins a new one within "
            "half a minute of fixes; if the receiver's time is wrong, wait with run "
            "until it has its almanac",
        )


def _listen(
    config: Config, clock: Clock, epochs: EpochReader
) -> tuple[GpsHealth, set[str], float | None]:
    """Return how the port is, the kinds of sentences that came, UTC of the last fix."""
    frames: queue.SimpleQueue[Frame] = queue.SimpleQueue()
    kinds: set[str] = set()
    utc_s: float | None = None
    reader = hardware.gps_reader(config, frames.put, clock)
    end_ns = clock.now_ns() + LISTEN_NS
    reader.start()
    try:
        while True:
            clock.sleep_until_ns(clock.now_ns() + 100 * MILLISECOND_NS)
            health = reader.health()
            positions: Positions = []
            while not frames.empty():
                frame = frames.get()
                kind = _kind(frame.data) if frame.source is Source.GPS else ""
                if kind and not kinds:
                    end_ns = clock.now_ns() + SENTENCES_NS
                kinds |= {kind} - {""}
                if kinds and frame.source is Source.GPS:
                    positions += epochs.feed(frame.t_ns, frame.data)
            positions += epochs.advance(clock.now_ns())
            for position in positions:
                utc_s = position.utc_s
            is_hopeless = health.state is GpsState.CLOSED and health.detail
            if is_hopeless or clock.now_ns() >= end_ns:
                return health, kinds, utc_s
    finally:
        reader.stop()
        reader.join()


def _kind(line: bytes) -> str:
    """Return the kind of an intact sentence, such as RMC; else ""."""
    try:
        return checked_text(line)[2:5]
    except NmeaError:
        return ""


def check_recording(config: Config) -> Finding:
    """Read the recording's header."""
    path = config.source.path
    if path is None:
        raise ValueError("a configuration without a path is refused")
    try:
        next(read_recording(path))
    except TrackerError as error:
        return _failed("source", str(error), error)
    return _ok("source", f"recording: {path}")


def check_output(what: str, path: Path, layout: Layout, min_free_mb: float) -> Finding:
    """See that a file can be made or appended to, and how much room there is."""
    place = path
    while not place.exists():
        place = place.parent
    is_file = place == path
    if place.is_dir() is is_file or not os.access(place, os.W_OK):
        advice = f": {mending.own_directory(path.parent)}" if place.is_dir() else ""
        error = OutputError(f"{path}: this user cannot write to {place}{advice}")
        return _failed(what, str(error), error)
    if is_file and is_foreign(path, layout):
        error = OutputError(f"{path}: {FOREIGN}")
        return _failed(what, str(error), error)
    free_mb = shutil.disk_usage(place).free / 1e6
    if free_mb < min_free_mb:
        return _warning(what, f"{path}: {free_mb:.0f} MB free: below log.min_free_mb")
    return _ok(what, f"{path}: {free_mb / 1000:.1f} GB free")


def _ok(what: str, text: str) -> Finding:
    return Finding(Verdict.OK, what, text)


def _warning(what: str, text: str) -> Finding:
    return Finding(Verdict.WARNING, what, text)


def _failed(what: str, text: str, error: TrackerError) -> Finding:
    return Finding(Verdict.FAILED, what, text, error.exit_code)


def _unavailable(what: str, text: str) -> Finding:
    return Finding(Verdict.FAILED, what, text, DeviceNotFoundError.exit_code)
