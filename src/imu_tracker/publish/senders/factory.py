"""A sender for a `[[publish]]`: what is to be known before anything is sent."""

import hashlib
import hmac
from functools import partial
from pathlib import Path
from typing import Final

from imu_tracker.config.publishing import PublishConfig
from imu_tracker.errors import ConfigError
from imu_tracker.publish.senders.dialects import (
    Dialect,
    HomeAssistant,
    Json,
    OwnTracks,
    Silent,
    Status,
)
from imu_tracker.publish.senders.influx import InfluxSender
from imu_tracker.publish.senders.security import read_credentials, tls_context
from imu_tracker.publish.senders.sender import Sender
from imu_tracker.publish.senders.traccar import TraccarSender
from imu_tracker.storage.latlong import LogRow

MACHINE_ID: Final = Path("/etc/machine-id")


def sender_of(
    config: PublishConfig,
    status: Status,
    last: LogRow | None,
    *,
    is_trial: bool = False,
) -> Sender:
    """Return the way to a destination; it is not opened.

    Parameters
    ----------
    config : PublishConfig
    status : callable
        Returns the status of the daemon, None while none runs.
    last : LogRow or None
        What the destination has already.
    is_trial : bool
        Whether it only looks if it would do, beside one that is in use perhaps.

    Raises
    ------
    ConfigError
        When a package is missing that it needs.
    """
    endpoint, device = config.endpoint, device_of(config)
    credentials = partial(read_credentials, config.credentials_file)
    tls = partial(tls_context, config) if endpoint.is_tls else None
    if config.kind == "traccar":
        return TraccarSender(endpoint, device, credentials, tls)
    if config.kind == "influx":
        return InfluxSender(endpoint, device, credentials, tls)
    try:
        from imu_tracker.publish.senders.mqtt import MqttSender
    except ImportError as error:
        raise ConfigError(
            f'publish.{config.name}.kind = "mqtt": needs paho-mqtt 2.1 or newer: '
            "pip install 'imu-tracker[mqtt]'"
        ) from error
    client_id = f"imu-tracker-{device}-{config.name}"
    dialect = _dialect_of(config, device, status, last)
    if is_trial:  # one of the same name would disconnect it
        client_id, dialect = f"{client_id}-check", Silent()
    return MqttSender(endpoint, client_id, dialect, credentials, tls)


def device_of(config: PublishConfig) -> str:
    """Return what the tracker is called over there."""
    return config.device or _name_of_this_computer()


def _dialect_of(
    config: PublishConfig, device: str, status: Status, last: LogRow | None
) -> Dialect:
    match config.format:
        case "json":
            return Json(device, config.topic or f"imu-tracker/{device}", status)
        case "home-assistant":
            base = config.topic or f"imu-tracker/{device}/home-assistant"
            return HomeAssistant(device, base, status)
        case "owntracks":
            return OwnTracks(
                device, config.topic or f"owntracks/imu-tracker/{device}", last
            )


def _name_of_this_computer() -> str:
    """Return twelve digits that tell this installation from others, and nothing else.

    The number itself should not be told to others: machine-id(5).
    """
    try:
        number = MACHINE_ID.read_bytes().strip()
    except OSError as error:
        raise ConfigError(
            f"{MACHINE_ID}: {error.strerror or error}: give each [[publish]] a device"
        ) from error
    return hmac.new(number, b"imu-tracker publish", hashlib.sha256).hexdigest()[:12]
