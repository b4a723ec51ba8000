"""Rows to InfluxDB, or whatever takes its line protocol over HTTP: in gzip batches.

The same device and time replace one another: a batch that is sent again is harmless.
Sources: InfluxDB, "optimize writes", and the write endpoints of its versions 1 to 3.
"""

import gzip
import re
import time
from collections.abc import Callable, Sequence
from ssl import SSLContext
from typing import Final

from imu_tracker.config.publishing import Endpoint
from imu_tracker.errors import shown
from imu_tracker.publish.senders import payloads
from imu_tracker.publish.senders.http_link import HttpLink
from imu_tracker.publish.senders.security import Credentials, authorization
from imu_tracker.publish.senders.sender import DestinationError, Item

WINDOW: Final = 2000
"""Lines of a batch: 25 kB, which a thin link has sent within seconds."""

_HEADERS: Final = {
    "Content-Type": "text/plain; charset=utf-8",
    "Content-Encoding": "gzip",
}
_DROPPED: Final = re.compile(r"partial write: .*dropped=(\d+)")
"""What is older than the retention, or of another type than before: the rest is in."""

_TOO_LARGE: Final = 413


class InfluxSender:
    """One server.

    Parameters
    ----------
    endpoint : Endpoint
        Of writing, with the database or bucket in its query.
    device : str
        The tag `id` of each line.
    credentials : callable
        Reads them: a token, or user and password.
    tls : callable or None
        Returns how the server is verified; None: unencrypted.
    """

    def __init__(
        self,
        endpoint: Endpoint,
        device: str,
        credentials: Callable[[], Credentials],
        tls: Callable[[], SSLContext] | None,
    ) -> None:
        self._endpoint, self._device = endpoint, device
        self._credentials = credentials
        self._link = HttpLink(endpoint, tls)
        self._target = _with_precision(endpoint.target)
        self._headers: dict[str, str] = {}
        self._window = WINDOW
        self._taken = self._refused = 0

    @property
    def window(self) -> int:
        """Lines of a batch."""
        return self._window

    def open(self) -> None:
        """Connect."""
        self._taken = self._refused = 0
        self._headers = _HEADERS | authorization(self._credentials(), "Token")
        self._link.open()

    def send(self, items: Sequence[Item]) -> None:
        """Post the rows as one batch and wait for the answer."""
        lines = b"".join(payloads.influx_row(self._device, item.row) for item in items)
        status, text = self._post(lines)
        if 200 <= status < 300:
            self._taken += len(items)
            return
        if status == 400 and (match := _DROPPED.search(text)):
            self._taken += len(items)
            self._refused += min(int(match[1]), len(items))
            return
        if status == _TOO_LARGE and len(items) > 1:
            self._window = max(1, len(items) // 2)
            raise DestinationError(
                f"{self._endpoint}: answers {status}: a batch is too large for it", 0.0
            )
        self._refuse_useless(status, text)
        raise DestinationError(
            f"{self._endpoint}: answers {status} {shown(text)}".rstrip()
        )

    def _post(self, lines: bytes) -> tuple[int, str]:
        body = gzip.compress(lines, 6, mtime=0)
        return self._link.request("POST", self._target, body, self._headers)

    def _refuse_useless(self, status: int, text: str) -> None:
        where = f"{self._endpoint}: answers {status}"
        if status in (401, 403):
            raise DestinationError(f"{where}: see credentials_file")
        if status == 404:
            raise DestinationError(
                f"{where} {shown(text)}: is this the URL of writing, and the database "
                "there?"
            )

    def probe(self) -> str:
        """See whether it would take an empty batch."""
        status, text = self._post(b"")
        self._refuse_useless(status, text)
        return "answers, and lets us write"

    def wait(self, timeout_s: float) -> tuple[int, int]:
        """Return what was answered; without anything, pass the time."""
        if not self._taken:
            time.sleep(timeout_s)
        done = self._taken, self._refused
        self._taken = self._refused = 0
        return done

    def close(self) -> None:
        """Close the connection."""
        self._link.close()


def _with_precision(target: str) -> str:
    """Say that times are milliseconds, in the word of the endpoint's version."""
    path, _, query = target.partition("?")
    kept = [part for part in query.split("&") if part and part[:10] != "precision="]
    word = "millisecond" if path.endswith("/api/v3/write_lp") else "ms"
    return f"{path}?{'&'.join([*kept, f'precision={word}'])}"
