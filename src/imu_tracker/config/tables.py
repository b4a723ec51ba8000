"""One frozen model for each table of the TOML file, and what they mean for others.

What a newcomer gets wrong: a key that nobody wrote is not the same as a key that
holds the default. A recording knows its own mount and profile, and only what was
written overrules it, so `Config.tracker_settings` asks `model_fields_set`.
"""

import math
import re
from collections.abc import Iterator
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final, Literal

from pydantic import BeforeValidator, field_validator, model_validator

from imu_tracker.config.outputs import (
    LogConfig,
    RecordConfig,
    StateConfig,
    StatusConfig,
)
from imu_tracker.config.publishing import PublishConfig, refuse_doubles
from imu_tracker.config.serving import GuideConfig, ServeConfig
from imu_tracker.config.table import Table, key
from imu_tracker.config.values import (
    BAUDS,
    Bandwidth,
    Baud,
    Exact,
    IsoDate,
    IsoInstant,
    Latency,
    LeverArm,
    MountAxes,
    OptionalPath,
    Position,
    Scenario,
    as_tuple,
)
from imu_tracker.samples import DEFAULT_MOUNT, SessionHeader

if TYPE_CHECKING:
    from imu_tracker.estimation.settings import TrackerSettings

CALIBRATION: Final = Path("/var/lib/imu-tracker/calibration.json")

GYRO_RATE_HZ: Final = 1000
"""What the chip divides by a whole number, with its low-pass filter on."""


_HOST: Final = r"(?:[^/:\s\[\]]+|\[[0-9a-fA-F:.]+\])"
_NETWORK_PORTS: Final = {
    "socket": (
        rf"socket://{_HOST}:\d{{1,5}}/?",
        "socket://HOST:PORT, like socket://192.168.1.20:10110",
    ),
    "gpsd": (
        rf"gpsd://{_HOST}:\d{{1,5}}(?:/\S*)?",
        "gpsd://HOST:PORT or gpsd://HOST:PORT/DEVICE, like gpsd://localhost:2947",
    ),
    "udp": (rf"udp://{_HOST}?:\d{{1,5}}/?", "udp://:PORT, like udp://:10110"),
}


class SourceConfig(Table):
    """`[source]`: where the frames come from."""

    kind: Literal["hardware", "simulation", "recording"] = key(
        "hardware", '"hardware", "simulation" or "recording"'
    )
    scenario: Scenario = key(
        "drive",
        '"still", "walk-line", "walk-square", "roundabout", "drive", "square", '
        '"circle" or "lissajous"',
    )
    seed: int = key(0, "a whole number, 0 or more", ge=0)
    duration_s: float = key(
        0, "from 0 to 1000000 s; 0 is the scenario's own length", ge=0, le=1e6
    )
    wheels: Literal["on", "off"] = key("on", '"on" or "off"')
    path: OptionalPath = key(None, 'the path of a recording, or ""')
    speed: float = key(1.0, "from 0.01 to 1000 times real time", ge=0.01, le=1000)
    start_utc: IsoInstant = key(
        "", 'an instant like "2026-11-22T12:00:00Z", or "" for what the recording says'
    )

    @field_validator("path", mode="after")
    @classmethod
    def _a_recording_has_a_path(cls, path: Path | None, info: Any) -> Path | None:
        if path is None and info.data.get("kind") == "recording":
            raise ValueError('must name the recording when source.kind = "recording"')
        return path


class ImuConfig(Table):
    """`[imu]`: the MPU-6050, its bus and how it is mounted."""

    bus: int = key(1, "the number N of /dev/i2c-N", ge=0, le=255)
    address: int = key(0x68, "0x68 (pin AD0 low) or 0x69 (AD0 high)", ge=0x68, le=0x69)
    rate_hz: float = key(
        100.0, "1000 / n for a whole n from 1 to 125: 1000, 500, 250, 200, 125, 100 ..."
    )
    accel_range_g: Annotated[Literal[2, 4, 8, 16], Exact] = key(4, "2, 4, 8 or 16")
    gyro_range_dps: Annotated[Literal[250, 500, 1000, 2000], Exact] = key(
        500, "250, 500, 1000 or 2000"
    )
    bandwidth_hz: Annotated[Bandwidth, Exact] = key(
        42, "a bandwidth of the chip: 256, 188, 98, 42, 20, 10 or 5"
    )
    read: Literal["fifo", "burst"] = key("fifo", '"fifo" or "burst"')
    mount: MountAxes = key(
        DEFAULT_MOUNT, 'three chip axes, like ["+x", "-y", "-z"] or ["+y", "+x", "-z"]'
    )
    calibration: OptionalPath = key(CALIBRATION, 'a path, or "" for none')
    allow_unknown_chip: bool = key(False, "true or false")

    @property
    def chosen_rate_hz(self) -> float | None:
        """The rate when somebody wrote it; a simulation has one of its own."""
        return self.rate_hz if "rate_hz" in self.model_fields_set else None

    @field_validator("rate_hz", mode="after")
    @classmethod
    def _the_chip_can_divide(cls, rate_hz: float) -> float:
        divider = round(GYRO_RATE_HZ / rate_hz) if rate_hz > 0 else 0
        if not 1 <= divider <= 125:
            raise ValueError
        exact_hz = GYRO_RATE_HZ / divider
        if not math.isclose(rate_hz, exact_hz, rel_tol=1e-3):
            raise ValueError(
                f"must be 1000 / n for a whole n; the nearest is {exact_hz:.6g}"
            )
        return rate_hz


class GpsConfig(Table):
    """`[gps]`: the receiver, its port and its antenna."""

    port: str = key(
        "/dev/serial0",
        'a device, "socket://HOST:PORT", "gpsd://HOST:PORT/DEVICE" or "udp://:PORT"',
        pattern=r"^\S+$",
    )
    baud: Annotated[Baud, Exact] = key("auto", BAUDS)
    latency_s: Latency = key("auto", 'from 0 to 2 s, or "auto"')
    lever_arm_m: LeverArm = key(
        (0.0, 0.0, 0.0), "three numbers [forward, right, down] from -100 to 100 m"
    )
    date: IsoDate = key("", 'a date like "2026-11-22", or ""')

    @field_validator("port", mode="after")
    @classmethod
    def _a_port_on_the_network_is_whole(cls, port: str) -> str:
        scheme, slashes, _ = port.partition("://")
        if slashes and scheme not in _NETWORK_PORTS:
            raise ValueError
        if slashes:
            pattern, allowed = _NETWORK_PORTS[scheme]
            if not re.fullmatch(pattern, port):
                raise ValueError(f"must be {allowed}")
        return port


class FilterConfig(Table):
    """`[filter]`: the estimator and what it may assume."""

    estimator: Literal["six-state", "error-state"] = key(
        "error-state", '"error-state" or "six-state"'
    )
    profile: Literal["auto", "free", "vehicle", "walker"] = key(
        "auto", '"auto", "free", "vehicle" or "walker"'
    )
    wheels: Literal["auto", "off"] = key("auto", '"auto" or "off"')
    start: Position = key(
        "", 'a position "lat,lon" in degrees, like "51.99,4.37", or ""'
    )
    start_radius_m: float = key(50.0, "from 0.1 to 1000000 m", ge=0.1, le=1e6)


class Config(Table):
    """The whole file."""

    source: SourceConfig = SourceConfig()
    imu: ImuConfig = ImuConfig()
    gps: GpsConfig = GpsConfig()
    filter: FilterConfig = FilterConfig()
    log: LogConfig = LogConfig()
    record: RecordConfig = RecordConfig()
    status: StatusConfig = StatusConfig()
    state: StateConfig = StateConfig()
    serve: ServeConfig = ServeConfig()
    guide: GuideConfig = GuideConfig()
    publish: Annotated[tuple[PublishConfig, ...], BeforeValidator(as_tuple)] = ()

    @model_validator(mode="after")
    def _destinations_have_names_of_their_own(self) -> "Config":
        refuse_doubles(self.publish)
        return self

    @model_validator(mode="after")
    def _outputs_differ(self) -> "Config":
        outputs = {
            "log.path": self.log.path,
            "status.path": self.status.path,
            "status.publish": self.status.publish,
        }
        if self.status.publish_prometheus is not None:
            outputs["status.publish_prometheus"] = self.status.publish_prometheus
        if self.record.path is not None:
            outputs["record.path"] = self.record.path
        if self.status.prometheus is not None:
            outputs["status.prometheus"] = self.status.prometheus
        if self.state.path is not None:
            outputs["state.path"] = self.state.path
        seen: dict[Path, str] = {}
        for name, path in outputs.items():
            if path in seen:
                raise ValueError(f"{name} and {seen[path]}: must be different files")
            seen[path] = name
        return self

    def tracker_settings(
        self, header: SessionHeader | None = None
    ) -> "TrackerSettings":
        """Translate into what the estimator wants.

        A header's mount and profile hold unless others are written here; its absence
        is a live session.
        """
        from imu_tracker.estimation.settings import TrackerSettings

        mount, profile = self.imu.mount, str(self.filter.profile)
        if header is not None and "mount" not in self.imu.model_fields_set:
            mount = header.mount or mount
        if header is not None and "profile" not in self.filter.model_fields_set:
            profile = header.profile or profile
        lat_lon = [math.radians(float(x)) for x in self.filter.start.split(",") if x]
        return TrackerSettings(
            estimator=self.filter.estimator,
            profile=profile,
            latency_s=None if self.gps.latency_s == "auto" else self.gps.latency_s,
            lever_arm_m=self.gps.lever_arm_m,
            rate_hz=self.log.rate_hz,
            mount=mount,
            gps_date=self.gps.date,
            start=(lat_lon[0], lat_lon[1]) if lat_lon else None,
            start_radius_m=self.filter.start_radius_m,
            uses_wheels=self.filter.wheels == "auto",
        )

    @property
    def state_path(self) -> Path | None:
        """Where the daemon keeps what it learns; what is played has to name a file."""
        is_named = "path" in self.state.model_fields_set
        return self.state.path if is_named or self.source.kind == "hardware" else None

    def amended(self, header: SessionHeader) -> SessionHeader:
        """Return the header with the start that is written here, if one is."""
        if not self.source.start_utc:
            return header
        start_utc_s = datetime.fromisoformat(self.source.start_utc).timestamp()
        return header._replace(start_utc_s=start_utc_s)

    def advice(self) -> list[str]:
        """Say what is allowed and yet unwise, a line each."""
        if self.imu.bandwidth_hz < self.imu.rate_hz / 2:
            return []
        return [
            f"imu.bandwidth_hz = {self.imu.bandwidth_hz}: vibration above half of "
            f"imu.rate_hz = {self.imu.rate_hz:g} folds into the signal; "
            f"better below {self.imu.rate_hz / 2:g}"
        ]


def keys() -> Iterator[tuple[str, str, Any]]:
    """Yield table, key and default of everything that can be configured."""
    for table, field in Config.model_fields.items():
        for name, default in field.default:
            yield table, name, default
