"""Rows by MQTT, by paho-mqtt: each is done with when the broker has acknowledged it.

What a newcomer gets wrong: paho's queue is in memory, so nothing is left to it. Each
connection has a client of its own, and what was not acknowledged is sent again by who
sent it. MQTT 5 says when a broker refuses a message; MQTT 3.1.1, for brokers that know
no other, acknowledges it all the same.
"""

import socket
import time
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from ssl import SSLContext
from typing import Any, Final

from paho.mqtt.client import Client, MQTTMessage, MQTTv5, MQTTv311
from paho.mqtt.enums import CallbackAPIVersion, MQTTErrorCode
from paho.mqtt.reasoncodes import ReasonCode

from imu_tracker.config.publishing import Endpoint
from imu_tracker.publish.senders.dialects import ONLINE, Dialect, Message
from imu_tracker.publish.senders.security import Credentials, explain
from imu_tracker.publish.senders.sender import (
    ANSWER_S,
    CONNECT_S,
    DestinationError,
    Item,
)

WINDOW: Final = 20
"""Rows that are sent twice at most when a connection is lost: five seconds of a log."""

KEEP_ALIVE_S: Final = 60
GOODBYE_S: Final = 2.0
IDLE_S: Final = 0.5

_OK: Final = MQTTErrorCode.MQTT_ERR_SUCCESS
_UNSUPPORTED: Final = 132  # protocol version
_DENIED: Final = {134, 135, 138}  # bad user or password, not authorized, banned


def _send_at_once(connection: Any) -> None:
    """Let small messages not wait for one another; paho calls a socket by less."""
    connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)


class MqttSender:
    """One broker.

    Parameters
    ----------
    endpoint : Endpoint
    client_id : str
        Of nobody else at this broker: it would disconnect the older of two.
    dialect : Dialect
    credentials : callable
        Reads them; asked at each connection.
    tls : callable or None
        Returns how the broker is verified; None: unencrypted.
    """

    def __init__(
        self,
        endpoint: Endpoint,
        client_id: str,
        dialect: Dialect,
        credentials: Callable[[], Credentials],
        tls: Callable[[], SSLContext] | None,
    ) -> None:
        self._endpoint, self._client_id, self._dialect = endpoint, client_id, dialect
        self._credentials, self._tls = credentials, tls
        self._protocol = MQTTv5
        self._client: Client | None = None
        self._mids: deque[int] = deque()  # of rows, in order; 0: nothing was sent
        self._acknowledged: set[int] = set()
        self._others: set[int] = set()  # of messages that are no rows
        self._window = WINDOW
        self._connack: ReasonCode | None = None
        self._refusal = ""
        self._is_asked = False
        self._answer_due_s = self._health_due_s = 0.0

    @property
    def window(self) -> int:
        """Rows that may be on their way at once."""
        return self._window

    def open(self) -> None:
        """Connect, log in, and say hello."""
        self._forget()
        client = self._make_client()
        self._client = client
        try:
            client.connect(
                self._endpoint.host, self._endpoint.port, keepalive=KEEP_ALIVE_S
            )
        except (OSError, ValueError) as error:
            raise explain(error, str(self._endpoint)) from error
        if (connection := client.socket()) is not None:
            _send_at_once(connection)
        self._await_connack(client)
        if self._dialect.asks:
            client.subscribe(self._dialect.asks, qos=1)
        self._publish(self._dialect.hello())
        self._health_due_s = time.monotonic()

    def send(self, items: Sequence[Item]) -> None:
        """Publish rows; those that say nothing new are done with at once."""
        if not self._mids:
            self._answer_due_s = time.monotonic() + ANSWER_S
        for item in items:
            message = self._dialect.message(item)
            self._mids.append(0 if message is None else self._publish_one(message))

    def wait(self, timeout_s: float) -> tuple[int, int]:
        """Let the broker answer, and keep the connection alive."""
        now_s = time.monotonic()
        if self._dialect.health_s and now_s >= self._health_due_s:
            self._health_due_s = now_s + self._dialect.health_s
            self._publish(self._dialect.health())
        if self._mids and not self._mids[0]:
            timeout_s = 0.0
        try:
            self._loop(timeout_s)
        except DestinationError:
            # It may have acknowledged some before it went.
            if taken := self._take_acknowledged():
                return taken, 0
            raise
        if self._is_asked:
            self._is_asked = False
            self._publish(self._dialect.hello())
        taken = self._take_acknowledged()
        now_s = time.monotonic()
        if taken or not self._mids:
            self._answer_due_s = now_s + ANSWER_S
        elif now_s >= self._answer_due_s:
            raise self._unanswered()
        return taken, 0

    def probe(self) -> str:
        """Tell what the broker said to the login."""
        version = "5" if self._protocol == MQTTv5 else "3.1.1"
        return f"logged in, MQTT {version}{', TLS' if self._tls else ''}"

    def close(self) -> None:
        """Say goodbye and disconnect; without it the broker publishes the will."""
        client = self._client
        if client is not None and client.is_connected() and not self._refusal:
            with suppress(DestinationError):
                self._publish(self._dialect.goodbye(), GOODBYE_S)
                client.disconnect()
        self._forget()

    def _loop(self, timeout_s: float) -> None:
        """Let paho send and receive."""
        assert self._client is not None
        result = self._client.loop(timeout_s)
        if self._refusal:
            raise DestinationError(self._refusal)
        if result != _OK:
            raise DestinationError(f"{self._endpoint}: the connection was lost")

    def _unanswered(self) -> DestinationError:
        return DestinationError(
            f"{self._endpoint}: no acknowledgement within {ANSWER_S:.0f} s"
        )

    def _take_acknowledged(self) -> int:
        taken = 0
        while self._mids and (not self._mids[0] or self._mids[0] in self._acknowledged):
            self._acknowledged.discard(self._mids.popleft())
            taken += 1
        return taken

    def _publish(
        self, messages: Iterable[Message], timeout_s: float = ANSWER_S
    ) -> None:
        """Publish what is no row, one after the other: brokers want few at once."""
        until_s = time.monotonic() + timeout_s
        for message in messages:
            self._others.add(self._publish_one(message))
            while self._others:
                if time.monotonic() >= until_s:
                    raise self._unanswered()
                self._loop(IDLE_S)

    def _publish_one(self, message: Message) -> int:
        assert self._client is not None
        found = self._client.publish(
            message.topic, message.payload, qos=1, retain=message.is_retained
        )
        if found.rc != _OK:
            raise DestinationError(f"{self._endpoint}: the connection was lost")
        return found.mid

    # ------------------------------------------------------------------ a connection

    def _make_client(self) -> Client:
        client = Client(
            CallbackAPIVersion.VERSION2,
            self._client_id,
            protocol=self._protocol,
            reconnect_on_failure=False,
        )
        client.connect_timeout = CONNECT_S
        client.max_inflight_messages_set(WINDOW)
        credentials = self._credentials()
        if credentials.user:
            client.username_pw_set(credentials.user, credentials.password or None)
        if self._tls is not None:
            client.tls_set_context(self._tls())
        if (will := self._dialect.will()) is not None:
            client.will_set(will.topic, will.payload, qos=1, retain=will.is_retained)
        client.on_connect = self._on_connect
        client.on_publish = self._on_publish
        client.on_message = self._on_message
        return client

    def _await_connack(self, client: Client) -> None:
        until_s = time.monotonic() + CONNECT_S
        code = self._connack
        while code is None:
            is_lost = client.loop(IDLE_S) != _OK or time.monotonic() >= until_s
            code = self._connack
            if code is None and is_lost:
                self._try_the_other_protocol()
                raise DestinationError(
                    f"{self._endpoint}: it does not answer as a broker does; is this "
                    f"the port for {'MQTT over TLS' if self._tls else 'plain MQTT'}?"
                )
        if code.is_failure:
            if code.value == _UNSUPPORTED:
                self._try_the_other_protocol()
            advice = "; see credentials_file" if code.value in _DENIED else ""
            raise DestinationError(
                f"{self._endpoint}: the broker refuses the connection: "
                f"{str(code).lower()}{advice}"
            )

    def _try_the_other_protocol(self) -> None:
        self._protocol = MQTTv311 if self._protocol == MQTTv5 else MQTTv5

    def _forget(self) -> None:
        """Let a connection go as it is, and what was not acknowledged with it."""
        client, self._client = self._client, None
        if client is not None:
            client.on_connect = client.on_publish = client.on_message = None
            if (connection := client.socket()) is not None:
                with suppress(OSError):
                    connection.close()
        self._mids.clear()
        self._acknowledged.clear()
        self._others.clear()
        self._connack, self._refusal, self._is_asked = None, "", False

    # ------------------------------------------- called by paho, in this same thread

    def _on_connect(
        self, _client: Client, _data: Any, _flags: Any, code: ReasonCode, found: Any
    ) -> None:
        self._connack = code
        if found is not None and hasattr(found, "ReceiveMaximum"):
            self._window = max(1, min(WINDOW, found.ReceiveMaximum - 1))

    def _on_publish(
        self, _client: Client, _data: Any, mid: int, code: ReasonCode, _found: Any
    ) -> None:
        if code.is_failure:
            self._refusal = (
                f"{self._endpoint}: the broker refuses a message: {str(code).lower()}; "
                "may this user write to this topic?"
            )
            return
        if mid in self._others:
            self._others.remove(mid)
        else:
            self._acknowledged.add(mid)

    def _on_message(self, _client: Client, _data: Any, message: MQTTMessage) -> None:
        if not message.retain and message.payload.lower() == ONLINE:
            self._is_asked = True
