"""Rows to Traccar, by the OsmAnd protocol over HTTP: one a request, oldest first.

Traccar computes distance and hours from the order in which positions come. Its answer
to a device that it does not know is 400 (404 in newer ones): that may be mended over
there at any time, so it is tried again, and told once.

Source: Traccar, OsmAndProtocolDecoder.
"""

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

_FORM: Final = {"Content-Type": "application/x-www-form-urlencoded"}


class TraccarSender:
    """One Traccar server.

    Parameters
    ----------
    endpoint : Endpoint
    device : str
        The identifier that the device has over there.
    credentials : callable
        Reads them: for a proxy in front of Traccar, which itself asks for none.
    tls : callable or None
        Returns how the server is verified; None: unencrypted.
    """

    window = 1

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
        self._headers: dict[str, str] = {}
        self._taken = 0

    def open(self) -> None:
        """Connect."""
        self._taken = 0
        self._headers = _FORM | authorization(self._credentials(), "Bearer")
        self._link.open()

    def send(self, items: Sequence[Item]) -> None:
        """Post each row and wait for the answer."""
        for item in items:
            self._post(payloads.traccar_row(self._device, item.row))
            self._taken += 1

    def wait(self, timeout_s: float) -> tuple[int, int]:
        """Return what was answered; without anything, pass the time."""
        if not self._taken:
            time.sleep(timeout_s)
        taken, self._taken = self._taken, 0
        return taken, 0

    def probe(self) -> str:
        """See whether anything answers; whether it knows the device, a row will tell.

        A request without an identifier is refused by Traccar, and changes nothing.
        """
        status, _ = self._link.request(
            "POST", self._endpoint.target, b"", self._headers
        )
        if status in (401, 403):
            raise DestinationError(
                f"{self._endpoint}: answers {status}: see credentials_file"
            )
        return f'answers; the device must be known there as "{self._device}"'

    def close(self) -> None:
        """Close the connection."""
        self._link.close()

    def _post(self, body: bytes) -> None:
        status, text = self._link.request(
            "POST", self._endpoint.target, body, self._headers
        )
        if 200 <= status < 300:
            return
        where = f"{self._endpoint}: answers {status}"
        if status in (400, 404):
            raise DestinationError(
                f'{where}: it does not know the device "{self._device}"; add one with '
                "that identifier there"
            )
        if status in (401, 403):
            raise DestinationError(f"{where}: see credentials_file")
        raise DestinationError(f"{where} {shown(text)}".rstrip())
