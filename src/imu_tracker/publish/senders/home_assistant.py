"""What Home Assistant must be told so that a tracker and its sensors appear.

Source: Home Assistant's MQTT integration, discovery by component; the attributes of its
device_tracker. What a newcomer gets wrong: the tracker has no availability, so that a
car out of coverage stays where it was last; and its place comes from attributes alone.
"""

import json
import math
from collections.abc import Iterator
from typing import Any, Final, NamedTuple

from imu_tracker import __version__
from imu_tracker.samples import Mode
from imu_tracker.storage.latlong import LogRow, format_utc

PREFIX: Final = "homeassistant"
STATUS_TOPIC: Final = f"{PREFIX}/status"
EXPIRE_S: Final = 900
"""After three times the silence of a tracker at rest its sensors are unknown."""


class _Sensor(NamedTuple):
    """One entity beside the tracker."""

    key: str
    name: str
    topic: str
    about: dict[str, Any]


_MEASURED: Final = {"state_class": "measurement"}
_SENSORS: Final = (
    _Sensor(
        "mode",
        "Mode",
        "position",
        {"device_class": "enum", "options": [str(mode) for mode in Mode]},
    ),
    _Sensor(
        "r95",
        "Radius (95 %)",
        "position",
        {"device_class": "distance", "unit_of_measurement": "m", **_MEASURED},
    ),
    _Sensor(
        "speed",
        "Speed",
        "position",
        {"device_class": "speed", "unit_of_measurement": "m/s", **_MEASURED},
    ),
    _Sensor(
        "fix_age",
        "Fix age",
        "health",
        {"device_class": "duration", "unit_of_measurement": "s", **_MEASURED},
    ),
    _Sensor("health", "Health", "health", {}),
)
_VALUES: Final = {
    "mode": "mode",
    "r95": "gps_accuracy",
    "speed": "speed_mps",
    "fix_age": "fix_age_s",
    "health": "health",
}


def attributes(row: LogRow) -> bytes:
    """Return the attributes of the tracker: numbers, the radius always with them."""
    found: dict[str, Any] = {
        "latitude": row.lat_deg,
        "longitude": row.lon_deg,
        "gps_accuracy": row.r95_m,
        "mode": row.mode,
        "speed_mps": row.speed_mps,
        "time_utc": format_utc(row.utc_s),
    }
    if not math.isnan(row.alt_m):
        found["altitude"] = row.alt_m
    if not math.isnan(row.course_deg):
        found["course"] = row.course_deg
    return _json(found)


def health(status: dict[str, Any] | None) -> bytes:
    """Return what the sensors of health show."""
    if status is None:
        return _json({"health": "not running", "fix_age_s": None})
    return _json(
        {
            "health": str(status.get("state", "unknown")),
            "fix_age_s": status.get("fix_age_s"),
        }
    )


def discovery(device: str, base: str) -> Iterator[tuple[str, bytes]]:
    """Yield topic and message of each entity; to be retained.

    Parameters
    ----------
    device : str
        What it is called; letters, digits, - and _.
    base : str
        Topic below which `position`, `health` and `availability` are.
    """
    shared = {
        "device": {
            "identifiers": [f"imu-tracker-{device}"],
            "name": device,
            "manufacturer": "imu-tracker",
            "model": "MPU-6050 and GPS",
            "sw_version": __version__,
        },
        "origin": {"name": "imu-tracker", "sw_version": __version__},
        "qos": 1,
    }
    tracker = {
        "name": None,  # that of the device
        "unique_id": f"imu-tracker-{device}",
        "json_attributes_topic": f"{base}/position",
        "source_type": "gps",
    }
    yield (
        f"{PREFIX}/device_tracker/imu-tracker-{device}/config",
        _json({**tracker, **shared}),
    )
    for sensor in _SENSORS:
        entity = {
            "name": sensor.name,
            "unique_id": f"imu-tracker-{device}-{sensor.key}",
            "state_topic": f"{base}/{sensor.topic}",
            "value_template": f"{{{{ value_json.{_VALUES[sensor.key]} }}}}",
            "availability_topic": f"{base}/availability",
            "expire_after": EXPIRE_S,
            **sensor.about,
        }
        if sensor.topic == "health":
            entity["entity_category"] = "diagnostic"
        yield (
            f"{PREFIX}/sensor/imu-tracker-{device}/{sensor.key}/config",
            _json({**entity, **shared}),
        )


def _json(found: dict[str, Any]) -> bytes:
    return json.dumps(found, separators=(",", ":"), allow_nan=False).encode("ascii")
