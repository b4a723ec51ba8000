"""What a way to a destination can do, and how it fails.

Everything happens in the thread of the destination: nothing in here is shared.
"""

from collections.abc import Sequence
from typing import NamedTuple, Protocol

from imu_tracker.errors import TrackerError
from imu_tracker.storage.latlong import LogRow

CONNECT_S = 15.0
"""A connection, TLS included, takes no longer, or it is tried again."""

ANSWER_S = 30.0
"""The other side says within so long that it has a row, or the connection is bad."""


class DestinationError(TrackerError):
    """A destination cannot be reached, or does not want what it gets.

    Parameters
    ----------
    text : str
        For the user: what is wrong and how to mend it; never a secret.
    again_s : float, optional
        When to try again; by default later each time.
    """

    exit_code = 69

    def __init__(self, text: str, again_s: float | None = None) -> None:
        super().__init__(text)
        self.again_s = again_s


class Item(NamedTuple):
    """A row, and whether it is the newest there is."""

    row: LogRow
    is_newest: bool


class Sender(Protocol):
    """A way to a destination."""

    @property
    def window(self) -> int:
        """Rows that may be on their way at once."""
        ...

    def open(self) -> None:
        """Connect and log in; raises DestinationError."""
        ...

    def send(self, items: Sequence[Item]) -> None:
        """Send rows; raises DestinationError."""
        ...

    def wait(self, timeout_s: float) -> tuple[int, int]:
        """Wait for answers.

        Returns
        -------
        taken : int
            So many of the oldest rows that were sent are done with.
        refused : int
            So many of them the other side will never take.
        """
        ...

    def probe(self) -> str:
        """Try, once it is open, what can be tried without a row; say how it went.

        Raises DestinationError.
        """
        ...

    def close(self) -> None:
        """Say goodbye, if the other side still listens; never raises."""
        ...
