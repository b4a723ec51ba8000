"""What is said over MQTT: topics and messages of each format. No network here."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from typing import Any, Final, NamedTuple

from imu_tracker.publish.senders import home_assistant, payloads
from imu_tracker.publish.senders.sender import Item
from imu_tracker.storage.latlong import LogRow

HEALTH_S: Final = 300.0
HEALTH_AT_HOME_S: Final = 60.0

ONLINE: Final = b"online"
OFFLINE: Final = b"offline"

Status = Callable[[], dict[str, Any] | None]
"""Returns the status of the daemon; None while none runs."""


class Message(NamedTuple):
    """Something to publish."""

    topic: str
    payload: bytes
    is_retained: bool = False


class Dialect(ABC):
    """How rows are told to those who understand one format.

    Attributes
    ----------
    health_s : float
        How often `health` is asked for; 0: never.
    asks : str
        A topic on which others ask for `hello` again; "": none.
    """

    health_s = 0.0
    asks = ""

    @abstractmethod
    def message(self, item: Item) -> Message | None:
        """Return what to publish for a row; None when it has nothing new to say."""

    @abstractmethod
    def will(self) -> Message | None:
        """Return what the broker publishes when we are gone."""

    def hello(self) -> Iterator[Message]:
        """Yield what is published after connecting."""
        yield from ()

    def goodbye(self) -> Iterator[Message]:
        """Yield what is published before disconnecting."""
        yield from ()

    def health(self) -> Iterator[Message]:
        """Yield how the tracker is."""
        yield from ()


class _Available(Dialect):
    """What Json and HomeAssistant share: `availability`, which the broker mends."""

    health_s = HEALTH_S

    def __init__(self, device: str, base: str, status: Status) -> None:
        self._device, self._base, self._status = device, base, status

    def _availability(self, payload: bytes) -> Message:
        return Message(f"{self._base}/availability", payload, is_retained=True)

    def will(self) -> Message:
        return self._availability(OFFLINE)

    def hello(self) -> Iterator[Message]:
        yield self._availability(ONLINE)

    def goodbye(self) -> Iterator[Message]:
        yield self._availability(OFFLINE)


class Json(_Available):
    """Our own: `position` is the newest row and retained, `history` what waited."""

    def message(self, item: Item) -> Message:
        """Return a row under the topic that says whether it is the newest."""
        payload = payloads.json_row(self._device, item.row)
        if item.is_newest:
            return Message(f"{self._base}/position", payload, is_retained=True)
        return Message(f"{self._base}/history", payload)

    def health(self) -> Iterator[Message]:
        """Yield what the daemon says of itself."""
        payload = payloads.json_health(self._device, self._status())
        yield Message(f"{self._base}/health", payload, is_retained=True)


class HomeAssistant(_Available):
    """Entities that appear by themselves; the newest row alone."""

    health_s = HEALTH_AT_HOME_S
    asks = home_assistant.STATUS_TOPIC

    def message(self, item: Item) -> Message:
        """Return a row as attributes of the tracker."""
        payload = home_assistant.attributes(item.row)
        return Message(f"{self._base}/position", payload, is_retained=True)

    def hello(self) -> Iterator[Message]:
        """Yield the entities, and that they are available."""
        for topic, payload in home_assistant.discovery(self._device, self._base):
            yield Message(topic, payload, is_retained=True)
        yield from super().hello()

    def health(self) -> Iterator[Message]:
        """Yield what the sensors of health show."""
        payload = home_assistant.health(self._status())
        yield Message(f"{self._base}/health", payload, is_retained=True)


class OwnTracks(Dialect):
    """A location for each row, all on one topic; the newest is retained."""

    def __init__(self, device: str, topic: str, last: LogRow | None) -> None:
        self._tracker_id, self._topic, self._last = device[-2:], topic, last

    def message(self, item: Item) -> Message | None:
        """Return a row as a location, unless its second has been told."""
        second = payloads.owntracks_second(item.row)
        last, self._last = self._last, item.row
        # Its times are whole seconds: a second row of one would replace the first.
        if last is not None and second == payloads.owntracks_second(last):
            return None
        payload = payloads.owntracks_row(self._tracker_id, item.row)
        return Message(self._topic, payload, is_retained=item.is_newest)

    def will(self) -> Message:
        """Return their word for a connection that was lost."""
        return Message(self._topic, payloads.owntracks_will(self._last))


class Silent(Dialect):
    """Only logs in: to see whether that would do."""

    def message(self, item: Item) -> Message | None:  # noqa: ARG002
        """Return nothing."""
        return None

    def will(self) -> Message | None:
        """Return nothing."""
        return None
