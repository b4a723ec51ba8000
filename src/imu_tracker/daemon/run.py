"""Put the daemon together from its configuration, and run it."""

import logging
from contextlib import ExitStack, closing
from typing import TYPE_CHECKING

from imu_tracker.daemon.supervision import Notify, Signals, systemd_notify
from imu_tracker.errors import CalibrationError, InputMissingError
from imu_tracker.sensors.clock import Clock, MonotonicClock

if TYPE_CHECKING:
    from imu_tracker.calibration.corrected import Corrections
    from imu_tracker.config import Config
    from imu_tracker.sources.feed import Feed
    from imu_tracker.sources.live import GpsFactory, ImuFactory

log = logging.getLogger(__name__)


def run(
    config: "Config",
    *,
    clock: Clock | None = None,
    signals: Signals | None = None,
    notify: Notify | None = None,
    imu_reader: "ImuFactory | None" = None,
    gps_reader: "GpsFactory | None" = None,
) -> int:
    """Track until SIGTERM or SIGINT, or until what is played is over.

    Parameters
    ----------
    config : Config
    clock, signals, notify : optional
        For tests: the time, who says when to end, and who hears of it.
    imu_reader, gps_reader : callable, optional
        Make the sensor threads, with a bus or a port of the caller's own.

    Returns
    -------
    int
        The exit code: 0.

    Raises
    ------
    OutputError
        When the log or the raw capture cannot be opened, or another daemon has it.
    ConfigError
        When the recording that is to be played is missing or malformed.
    """
    with signals or Signals() as told, ExitStack() as outputs:
        # From here on SIGTERM ends it with 0; these take a second or two on a Pi.
        from imu_tracker.daemon.loop import Loop
        from imu_tracker.recording.files import LiveRecordingWriter
        from imu_tracker.storage.append_file import Limits
        from imu_tracker.storage.latlong import LatLongLog

        told.defer()
        limits = Limits(config.log.sync_s, config.log.max_mb, config.log.min_free_mb)
        latlong = outputs.enter_context(
            closing(LatLongLog(config.log.path, **limits._asdict()))
        )
        recorder = None
        if config.record.path is not None:
            recorder = outputs.enter_context(
                LiveRecordingWriter(config.record.path, limits)
            )
        for advice in config.advice():
            log.warning("%s", advice)
        clock = clock or MonotonicClock()
        notify = notify or systemd_notify()
        log.info("begun: %s to %s", config.source.kind, config.log.path)
        feed = _open_feed(config, clock, imu_reader, gps_reader)
        known = _corrections(config)
        Loop(config, feed, latlong, recorder, told, clock, notify, known).run()
    return 0


def _corrections(config: "Config") -> "Corrections | None":
    """Read what is known of this machine's chip; whatever is wrong with it is told.

    A played stream is another chip's: it gets a calibration only when one is named.
    """
    from imu_tracker.config.tables import CALIBRATION
    from imu_tracker.storage.calibration_file import read_calibration

    path = config.imu.calibration
    is_usual = path == CALIBRATION
    if path is None or (is_usual and config.source.kind != "hardware"):
        return None
    try:
        corrections = read_calibration(path).corrections()
    except InputMissingError as error:
        level = logging.DEBUG if is_usual else logging.WARNING
        log.log(level, "%s: goes on uncalibrated", error)
        return None
    except CalibrationError as error:
        log.warning("%s; goes on uncalibrated", error)
        return None
    log.info("calibrated by %s", path)
    return corrections


def _open_feed(
    config: "Config",
    clock: Clock,
    imu_reader: "ImuFactory | None",
    gps_reader: "GpsFactory | None",
) -> "Feed":
    """Return what the configuration asks for; the threads of sensors begin at once."""
    from imu_tracker.sources import factory as hardware
    from imu_tracker.sources import live, played

    if config.source.kind == "hardware":
        return live.HardwareFeed(
            config,
            clock,
            imu_reader or hardware.imu_reader,
            gps_reader or hardware.gps_reader,
        )
    is_simulation = config.source.kind == "simulation"
    stream = played.simulated(config) if is_simulation else played.recorded(config)
    return played.PlayedFeed(stream, config.source.speed, clock)
