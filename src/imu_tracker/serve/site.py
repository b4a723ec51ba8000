"""What stands under which address of the page.

A fixed list of names: no path of a request ever becomes the path of a file.
"""

import json
import re
from collections.abc import Mapping
from importlib import resources
from typing import TYPE_CHECKING, Any, Final, NamedTuple

from imu_tracker.config import Config
from imu_tracker.config.serving import Address
from imu_tracker.errors import ConfigError
from imu_tracker.exports.page import asset
from imu_tracker.serve.http_request import COOKIE, Refused, Request, is_same, parse
from imu_tracker.serve.view import Shown, View

if TYPE_CHECKING:
    from imu_tracker.serve.tiles import Tiles

EVENTS: Final = "/events"
MIN_TOKEN: Final = 16

_HEADERS: Final = (
    "Content-Security-Policy: default-src 'none'; script-src 'self'; "
    "style-src 'self'; connect-src 'self'; img-src 'self' data:; base-uri 'none'; "
    "form-action 'none'; frame-ancestors 'none'",
    "X-Content-Type-Options: nosniff",
    "Referrer-Policy: no-referrer",
    "Cross-Origin-Resource-Policy: same-origin",
    "Connection: close",
)
_TILE: Final = re.compile(r"/tiles/(\d{1,2})/(\d{1,7})/(\d{1,7})")


class Response(NamedTuple):
    """An answer; `is_stream`: what follows are events."""

    data: bytes
    is_stream: bool = False


class Site:
    """Answers requests.

    Parameters
    ----------
    config : Config
    view : View

    Raises
    ------
    ConfigError
        When the token or the tiles cannot be used.
    """

    def __init__(self, config: Config, view: View) -> None:
        self._view = view
        self._hosts = {name.lower() for name in config.serve.hosts}
        self._token = _token_of(config)
        self.tiles = _tiles_of(config)
        self._files: Mapping[str, tuple[str, bytes]] = {
            "/": ("text/html; charset=utf-8", _static("live.html")),
            "/live.js": ("text/javascript; charset=utf-8", _static("live.js")),
            "/live.css": ("text/css; charset=utf-8", _static("live.css")),
            "/map.js": ("text/javascript; charset=utf-8", asset("map.js").encode()),
            "/map.css": ("text/css; charset=utf-8", asset("map.css").encode()),
        }

    def answer(self, head: bytes) -> Response:
        """Answer the head of a request."""
        try:
            request = parse(head, self._hosts)
            response = self._answer(request)
        except Refused as refused:
            text = f"{refused.reason}\n".encode()
            return Response(_http(f"{refused}", "text/plain", text))
        if request.is_head:
            return Response(response.data.partition(b"\r\n\r\n")[0] + b"\r\n\r\n")
        return response

    def _answer(self, request: Request) -> Response:
        if self._token:
            if request.token and is_same(request.token, self._token):
                cookie = f"{COOKIE}={self._token}; HttpOnly; SameSite=Strict; Path=/"
                more = ("Location: ./", f"Set-Cookie: {cookie}; Max-Age=31536000")
                return Response(_http("303 See Other", "text/plain", b"", *more))
            if not is_same(request.cookie, self._token):
                raise Refused(403, "Forbidden: open /?token=... once")
        if request.path == EVENTS:
            head = _head("200 OK", "text/event-stream", "Cache-Control: no-store")
            return Response(head + b"\r\n" + self.hello(), is_stream=True)
        if (found := self._files.get(request.path)) is not None:
            return Response(_http("200 OK", *found, "Cache-Control: no-cache"))
        if self.tiles is not None and (match := _TILE.fullmatch(request.path)):
            zoom, x, y = map(int, match.groups())
            if (tile := self.tiles.get(zoom, x, y)) is not None:
                return Response(_http("200 OK", *tile, "Cache-Control: max-age=86400"))
        raise Refused(404, "Not Found")

    def hello(self) -> bytes:
        """Return what a viewer hears first: everything."""
        tiles = None
        if self.tiles is not None:
            tiles = {
                "attribution": self.tiles.attribution,
                "zooms": self.tiles.zooms,
            }
        route = [[w.name, w.lat_deg, w.lon_deg] for w in self._view.route]
        hello = {"track": self._view.history.data(), "route": route, "tiles": tiles}
        told = event("hello", hello) + self.status()
        return told if self._view.last is None else told + row_event(self._view.last)

    def status(self) -> bytes:
        """Return how the daemon is, as an event."""
        return event("status", self._view.status())

    def close(self) -> None:
        """Close the tiles."""
        if self.tiles is not None:
            self.tiles.close()


def full() -> bytes:
    """Return what one viewer too many hears; its browser tries again by itself."""
    text = b"too many viewers\n"
    return _http("503 Service Unavailable", "text/plain", text, "Retry-After: 10")


def event(name: str, data: Any) -> bytes:
    """Write a server-sent event."""
    text = json.dumps(_finite(data), separators=(",", ":"), allow_nan=False)
    return f"event: {name}\ndata: {text}\n\n".encode()


def row_event(shown: Shown) -> bytes:
    """Write a row as an event."""
    row = shown.row._asdict() | {"has_fix": shown.has_fix, "guide": None}
    if (told := shown.guidance) is not None:
        row["guide"] = told.summary()
    return event("row", row)


def _finite(value: Any) -> Any:
    """Put null where JSON has no number; the status of others may hold anything."""
    if isinstance(value, dict):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(item) for item in value]
    if isinstance(value, float) and (value != value or abs(value) == float("inf")):
        return None
    return value


def _head(status: str, kind: str, *more: str) -> bytes:
    lines = (f"HTTP/1.1 {status}", f"Content-Type: {kind}", *more, *_HEADERS)
    return "".join(f"{line}\r\n" for line in lines).encode("latin-1")


def _http(status: str, kind: str, data: bytes, *more: str) -> bytes:
    return _head(status, kind, f"Content-Length: {len(data)}", *more) + b"\r\n" + data


def _static(name: str) -> bytes:
    return resources.files("imu_tracker.serve").joinpath("static", name).read_bytes()


def _tiles_of(config: Config) -> "Tiles | None":
    if config.serve.tiles is None:
        return None
    from imu_tracker.serve.tiles import Tiles

    return Tiles(config.serve.tiles)


def _token_of(config: Config) -> str:
    path = config.serve.token_file
    if path is None:
        return ""
    try:
        token = path.read_text("ascii")[:1000].strip()
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise ConfigError(f'serve.token_file = "{path}": {reason}') from error
    if len(token) < MIN_TOKEN or not re.fullmatch(r"[A-Za-z0-9._~-]+", token):
        raise ConfigError(
            f'serve.token_file = "{path}": must hold {MIN_TOKEN} or more letters and '
            "digits: openssl rand -hex 32"
        )
    return token


def where_to_look(address: Address) -> str:
    """Return the address of the page, for a person."""
    host = "localhost" if address.is_loopback else str(address).rpartition(":")[0]
    return f"http://{host}:{address.port}/"
