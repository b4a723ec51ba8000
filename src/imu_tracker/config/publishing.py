"""`[[publish]]`: where rows are sent, a table for each destination."""

import re
from pathlib import Path
from typing import Any, Final, Literal, NamedTuple
from urllib.parse import parse_qsl, urlsplit

from pydantic import field_validator, model_validator

from imu_tracker.config.table import Table, key
from imu_tracker.config.values import FilePath, OptionalPath

CURSORS: Final = Path("/var/lib/imu-tracker-publish")

_PORTS: Final = {
    "mqtt": {"mqtt": 1883, "mqtts": 8883},
    "traccar": {"http": 5055, "https": 443},
    "influx": {"http": 8086, "https": 443},
}
_EXAMPLES: Final = {
    "mqtt": "mqtts://broker.example.org:8883",
    "traccar": "https://traccar.example.org:5055",
    "influx": "https://influx.example.org:8086/write?db=track",
}
_SECRETS: Final = {"u", "p", "user", "username", "password", "token", "auth"}
_HOST: Final = re.compile(r"[A-Za-z0-9._-]+|[0-9A-Fa-f:.]+(?:%[A-Za-z0-9]+)?")


class Endpoint(NamedTuple):
    """A URL in its parts.

    Attributes
    ----------
    is_tls : bool
        Whether the connection is encrypted and the other side verified.
    target : str
        Path and query, as an HTTP request has them.
    """

    host: str
    port: int
    is_tls: bool
    target: str

    def __str__(self) -> str:
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"{host}:{self.port}"


def endpoint_of(kind: str, url: str) -> Endpoint:
    """Take a URL apart.

    Raises
    ------
    ValueError
        With what it must be; a password is never repeated.
    """
    wanted = f"must be a URL like {_EXAMPLES[kind]}"
    if not url.isascii() or not url.isprintable() or " " in url:
        raise ValueError(wanted)
    try:
        parts = urlsplit(url)
        port = parts.port
    except ValueError as error:
        raise ValueError(wanted) from error
    if parts.username is not None or parts.password is not None:
        raise ValueError("must hold no user and no password: use credentials_file")
    if any(name.lower() in _SECRETS for name, _ in parse_qsl(parts.query)):
        raise ValueError("must hold no password and no token: use credentials_file")
    default = _PORTS[kind].get(parts.scheme)
    host = parts.hostname or ""
    if default is None or not _HOST.fullmatch(host) or parts.fragment or port == 0:
        raise ValueError(wanted)
    if kind == "mqtt" and (parts.path not in ("", "/") or parts.query):
        raise ValueError(f"{wanted}, without a path")
    target = (parts.path or "/") + (f"?{parts.query}" if parts.query else "")
    return Endpoint(host, port or default, parts.scheme in ("mqtts", "https"), target)


class PublishConfig(Table):
    """One `[[publish]]`: a destination, how to get there, and which rows it gets."""

    name: str = key(
        ..., "1 to 40 letters, digits, - and _", pattern=r"^[A-Za-z0-9_-]{1,40}$"
    )
    kind: Literal["mqtt", "traccar", "influx"] = key(
        ..., '"mqtt", "traccar" or "influx"'
    )
    url: str = key(..., "a URL")
    tls: bool = key(False, "true, or false for what the URL begins with")
    format: Literal["json", "owntracks", "home-assistant"] = key(
        "json", '"json", "owntracks" or "home-assistant"'
    )
    device: str = key(
        "",
        '1 to 60 letters, digits, - and _, or "" for one of this computer',
        pattern=r"^[A-Za-z0-9_-]{0,60}$",
    )
    topic: str = key(
        "",
        'a topic like "cars/blue", or "" for the usual one',
        pattern=r"^([A-Za-z0-9_.-]+(/[A-Za-z0-9_.-]+)*)?$",
        max_length=200,
    )
    credentials_file: OptionalPath = key(None, 'the path of a file, or "" for none')
    ca_file: OptionalPath = key(None, 'the path of a file, or "" for the usual ones')
    cert_file: OptionalPath = key(None, 'the path of a file, or "" for none')
    key_file: OptionalPath = key(None, 'the path of a file, or "" for none')
    moving_s: float = key(10.0, "from 0 to 86400 s", ge=0, le=86_400)
    still_s: float = key(300.0, "from 0 to 86400 s", ge=0, le=86_400)
    turn_deg: float = key(15.0, "from 1 to 180 degrees", ge=1, le=180)
    backlog: bool = key(True, "true or false")
    max_age_h: float = key(0.0, "from 0 to 100000 h; 0 is any age", ge=0, le=1e5)
    cursor_dir: FilePath = key(CURSORS, "the path of a directory")

    @property
    def endpoint(self) -> Endpoint:
        """The URL in its parts."""
        scheme, separator, rest = self.url.partition("://")
        if self.tls and scheme in ("mqtt", "http"):
            scheme += "s"
        return endpoint_of(self.kind, f"{scheme}{separator}{rest}")

    @field_validator("url", mode="after")
    @classmethod
    def _leads_somewhere(cls, url: str, info: Any) -> str:
        if (kind := info.data.get("kind")) is not None:
            endpoint_of(kind, url)
        return url

    @model_validator(mode="after")
    def _formats_are_of_mqtt(self) -> "PublishConfig":
        for name in ("format", "topic"):
            if self.kind != "mqtt" and name in self.model_fields_set:
                raise ValueError(f'{name} must be left out unless kind = "mqtt"')
        return self

    @field_validator("key_file", mode="after")
    @classmethod
    def _has_a_certificate(cls, path: Path | None, info: Any) -> Path | None:
        if path is not None and info.data.get("cert_file") is None:
            raise ValueError("must stand beside a cert_file")
        return path


def refuse_doubles(tables: tuple[PublishConfig, ...]) -> None:
    """Raise ValueError for two destinations of one name: they would share a cursor."""
    seen: set[str] = set()
    for table in tables:
        if table.name in seen:
            raise ValueError(
                f'[[publish]]: two are named "{table.name}"; each needs a name of its '
                "own"
            )
        seen.add(table.name)
