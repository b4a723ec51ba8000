"""Requests over HTTP/1.1 on one connection, kept open, by the standard library.

Redirects are not followed: a password must not be led elsewhere.
"""

from collections.abc import Callable, Mapping
from http.client import (
    HTTPConnection,
    HTTPException,
    HTTPSConnection,
    RemoteDisconnected,
)
from ssl import SSLContext
from typing import Final

from imu_tracker.config.publishing import Endpoint
from imu_tracker.publish.senders.security import explain
from imu_tracker.publish.senders.sender import CONNECT_S, DestinationError

_MAX_ANSWER: Final = 10_000
_STALE: Final = (RemoteDisconnected, BrokenPipeError, ConnectionResetError)
"""How a connection ends that the other side closed because nothing was said."""


class HttpLink:
    """A connection to one server, opened when it is needed.

    Parameters
    ----------
    endpoint : Endpoint
    tls : callable or None
        Returns how the server is verified; None: unencrypted.
    """

    def __init__(
        self, endpoint: Endpoint, tls: Callable[[], SSLContext] | None
    ) -> None:
        self._endpoint, self._tls = endpoint, tls
        self._connection: HTTPConnection | None = None
        self._was_used = False

    def open(self) -> None:
        """Connect anew."""
        self.close()
        host, port = self._endpoint.host, self._endpoint.port
        if self._tls is not None:
            self._connection = HTTPSConnection(
                host, port, timeout=CONNECT_S, context=self._tls()
            )
        else:
            self._connection = HTTPConnection(host, port, timeout=CONNECT_S)
        try:
            self._connection.connect()
        except OSError as error:
            self.close()
            raise explain(error, str(self._endpoint)) from error

    def request(
        self, method: str, target: str, body: bytes, headers: Mapping[str, str]
    ) -> tuple[int, str]:
        """Return the status of the answer, and the beginning of its text.

        Raises
        ------
        DestinationError
            When there is no answer. The other side may have taken what was sent.
        """
        try:
            return self._request(method, target, body, headers)
        except _STALE as error:
            if not self._was_used:
                raise explain(error, str(self._endpoint)) from error
        except HTTPException as error:
            self.close()
            raise DestinationError(
                f"{self._endpoint}: its answer is no HTTP; is this the right port?"
            ) from error
        except OSError as error:
            self.close()
            raise explain(error, str(self._endpoint)) from error
        self.open()
        return self.request(method, target, body, headers)

    def close(self) -> None:
        """Close the connection."""
        if self._connection is not None:
            self._connection.close()
        self._connection, self._was_used = None, False

    def _request(
        self, method: str, target: str, body: bytes, headers: Mapping[str, str]
    ) -> tuple[int, str]:
        if self._connection is None:
            self.open()
        connection = self._connection
        assert connection is not None
        connection.request(method, target, body, dict(headers))
        response = connection.getresponse()
        text = response.read(_MAX_ANSWER).decode("utf-8", "replace")
        self._was_used = True
        if not response.isclosed():  # more than anybody has to say
            self.close()
        return response.status, " ".join(text.split())
