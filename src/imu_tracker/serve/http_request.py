"""One HTTP request: what it asks for, and whether it may.

Pure. GET and HEAD alone; a name in `Host` that is not ours is refused, since a page of
somebody else could point its own name at this address (DNS rebinding): addresses,
localhost and names in .local cannot be had by others.
"""

import hmac
import ipaddress
import re
from collections.abc import Collection
from typing import Final, NamedTuple
from urllib.parse import parse_qs, urlsplit

MAX_HEAD: Final = 8192
COOKIE: Final = "imu-tracker"

_REQUEST_LINE: Final = re.compile(r"([A-Z]{1,10}) (\S{1,2000}) HTTP/1\.[01]")
_FIELD: Final = re.compile(r"([A-Za-z0-9-]{1,64}):[ \t]*([\x20-\x7e\t]*)")


class Refused(Exception):  # noqa: N818
    """The request is not answered; the number is HTTP's."""

    def __init__(self, code: int, reason: str) -> None:
        self.code, self.reason = code, reason
        super().__init__(f"{code} {reason}")


class Request(NamedTuple):
    """What a browser asks for."""

    path: str
    token: str  # from the query; "" without
    cookie: str
    is_head: bool


def parse(head: bytes, hosts: Collection[str]) -> Request:
    """Read the head of a request.

    Parameters
    ----------
    head : bytes
        Up to the empty line.
    hosts : collection of str
        Names in lower case that are ours beside the safe ones.

    Raises
    ------
    Refused
        When it makes no sense, or may not be asked.
    """
    first, *lines = head.decode("latin-1").split("\r\n")
    match = _REQUEST_LINE.fullmatch(first)
    if match is None:
        raise Refused(400, "Bad Request")
    if match[1] not in ("GET", "HEAD"):
        raise Refused(405, "Method Not Allowed")
    fields: dict[str, str] = {}
    for line in lines:
        if not line:
            break
        field = _FIELD.fullmatch(line)
        if field is None or (field[1].lower() == "host" and "host" in fields):
            raise Refused(400, "Bad Request")
        fields.setdefault(field[1].lower(), field[2].strip())
    if not _is_ours(fields.get("host", ""), hosts):
        raise Refused(421, "Misdirected Request")
    try:
        url = urlsplit(match[2])
        token = parse_qs(url.query, max_num_fields=10).get("token", [""])[0]
    except ValueError as error:
        raise Refused(400, "Bad Request") from error
    return Request(
        url.path, token, _cookie(fields.get("cookie", "")), match[1] == "HEAD"
    )


def is_same(given: str, token: str) -> bool:
    """Compare in a time that tells nothing."""
    return hmac.compare_digest(given.encode("utf-8", "replace"), token.encode())


def _is_ours(field: str, hosts: Collection[str]) -> bool:
    match = re.fullmatch(r"(\[[0-9a-fA-F:.]+\]|[^:/@\s]+)(?::\d{1,5})?", field)
    if match is None:
        return False
    host = match[1].lower().rstrip(".")
    if host == "localhost" or host.endswith(".local") or host in hosts:
        return True
    try:
        ipaddress.ip_address(host.strip("[]"))
    except ValueError:
        return False
    return True


def _cookie(field: str) -> str:
    for pair in field.split(";"):
        name, _, value = pair.strip().partition("=")
        if name == COOKIE:
            return value
    return ""
