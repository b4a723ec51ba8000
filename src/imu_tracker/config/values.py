"""Kinds of values of the configuration that pydantic does not know.

A `ValueError` without a text means "not what is allowed", which the key itself says;
a text that begins with "must" says it better.
"""

from datetime import UTC, date, datetime, time
from pathlib import Path
from typing import Annotated, Literal, TypeVar

from pydantic import AfterValidator, BeforeValidator, Field

from imu_tracker.calibration.counts import parse_mount
from imu_tracker.errors import ConfigError
from imu_tracker.samples import FIRST_YEAR, LAST_YEAR, Mount

DateT = TypeVar("DateT", bound=date)


def _path(value: object) -> object:
    if not isinstance(value, str) or "\0" in value:
        return value
    try:
        return Path(value).expanduser() if value else None
    except RuntimeError as error:  # ~somebody, who has no home
        raise ValueError from error


def _date(value: object) -> object:
    if isinstance(value, str) and value:
        value = date.fromisoformat(value)
    return _in_reach(value).isoformat() if type(value) is date else value


def _instant(value: object) -> object:
    """Take what TOML or a string calls a time; without a zone it is UTC."""
    if isinstance(value, str) and value:
        value = datetime.fromisoformat(value)
    elif type(value) is date:
        value = datetime.combine(value, time())
    if not isinstance(value, datetime):
        return value
    value = _in_reach(value).replace(tzinfo=value.tzinfo or UTC)
    return value.astimezone(UTC).isoformat().replace("+00:00", "Z")


def _in_reach(day: DateT) -> DateT:
    if not FIRST_YEAR <= day.year <= LAST_YEAR:
        raise ValueError
    return day


def as_tuple(value: object) -> object:
    """Let a list of TOML be a tuple."""
    return tuple(value) if isinstance(value, list) else value


def _not_a_lookalike(value: object) -> object:
    """Refuse true for 1 and 4.0 for 4, which a Literal takes."""
    if isinstance(value, bool | float):
        raise ValueError
    return value


def _right_handed(mount: Mount) -> Mount:
    try:
        parse_mount(mount)
    except ConfigError as error:
        reason = str(error).rpartition(": ")[2]
        raise ValueError(f"must be a way to turn the chip: {reason}") from error
    return mount


def _position(value: str) -> str:
    if value:
        lat_deg, lon_deg = map(float, value.split(","))
        if not (abs(lat_deg) <= 90 and abs(lon_deg) <= 180):
            raise ValueError
    return value


Exact = BeforeValidator(_not_a_lookalike)
FilePath = Annotated[Path, BeforeValidator(_path)]
OptionalPath = Annotated[Path | None, BeforeValidator(_path)]
IsoDate = Annotated[str, BeforeValidator(_date)]
IsoInstant = Annotated[str, BeforeValidator(_instant)]
Position = Annotated[str, AfterValidator(_position)]
MountAxes = Annotated[Mount, BeforeValidator(as_tuple), AfterValidator(_right_handed)]
Offset = Annotated[float, Field(ge=-100, le=100)]
LeverArm = Annotated[tuple[Offset, Offset, Offset], BeforeValidator(as_tuple)]

Bandwidth = Literal[260, 256, 188, 184, 98, 94, 44, 42, 21, 20, 10, 5]
Latency = Annotated[float, Field(ge=0, le=2)] | Literal["auto"]
Baud = Literal["auto", 4800, 9600, 19200, 38400, 57600, 115200, 230400, 460800, 921600]
BAUDS = '"auto", 4800, 9600, 19200, 38400, 57600, 115200, 230400, 460800, 921600'
Scenario = Literal[
    "still",
    "walk-line",
    "walk-square",
    "roundabout",
    "drive",
    "square",
    "circle",
    "lissajous",
]
