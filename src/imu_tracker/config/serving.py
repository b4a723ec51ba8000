"""`[serve]` and `[guide]`: what others see, and the route that they follow."""

import ipaddress
from pathlib import Path
from typing import Annotated, Any, NamedTuple

from pydantic import AfterValidator, BeforeValidator, field_validator

from imu_tracker.config.table import Table, key
from imu_tracker.config.values import OptionalPath


class Address(NamedTuple):
    """Where a server listens."""

    host: str
    port: int

    @property
    def is_loopback(self) -> bool:
        """Whether only this computer reaches it."""
        try:
            return ipaddress.ip_address(self.host).is_loopback
        except ValueError:
            return self.host == "localhost"

    def __str__(self) -> str:
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"{host}:{self.port}"


def address_of(text: str) -> Address | None:
    """Read `HOST:PORT`, `[IPv6]:PORT`; None for ""."""
    if not text:
        return None
    host, colon, port = text.rpartition(":")
    if host.startswith("[") and host.endswith("]"):
        host = str(ipaddress.IPv6Address(host[1:-1]))
    elif ":" in host or any(c.isspace() or c in "/@[]" for c in host):
        raise ValueError
    if not (host and colon and port.isascii() and port.isdigit()):
        raise ValueError
    if not 0 <= int(port) <= 65535:
        raise ValueError
    return Address(host, int(port))


def _address(text: str) -> str:
    address_of(text)
    return text


ListenOn = Annotated[str, AfterValidator(_address)]
Names = Annotated[
    tuple[str, ...],
    BeforeValidator(lambda value: tuple(value) if isinstance(value, list) else value),
]

_ADDRESS = 'an address like "127.0.0.1:8086", or "" for off'


class ServeConfig(Table):
    """`[serve]`: the live page, gpsd JSON and NMEA of `imu-tracker serve`."""

    page: ListenOn = key("127.0.0.1:8086", _ADDRESS)
    gpsd: ListenOn = key("127.0.0.1:2948", _ADDRESS)
    nmea: ListenOn = key("127.0.0.1:10110", _ADDRESS)
    token_file: OptionalPath = key(None, 'the path of a file, or "" for none')
    hosts: Names = key((), 'a list of names, like ["pi.example.org"]')
    tiles: OptionalPath = key(None, 'the path of an .mbtiles file, or "" for none')
    history_h: float = key(6.0, "from 0 to 168 h", ge=0, le=168)
    nmea_limit_m: float = key(100.0, "from 1 to 1000000 m", ge=1, le=1e6)

    @field_validator("token_file", mode="after")
    @classmethod
    def _others_need_a_token(cls, path: Path | None, info: Any) -> Path | None:
        page = address_of(info.data.get("page", ""))
        if page and not page.is_loopback and path is None:
            raise ValueError(
                "must name a file that holds a token, because serve.page = "
                f'"{page}" is open to other computers'
            )
        return path


class GuideConfig(Table):
    """`[guide]`: a route to follow."""

    route: OptionalPath = key(None, 'the path of a .gpx file, or "" for none')
    arrival_m: float = key(30.0, "from 1 to 100000 m", ge=1, le=1e5)
    limit_m: float = key(100.0, "from 1 to 1000000 m", ge=1, le=1e6)
