"""What the loop needs of a producer of frames, whichever it is.

A feed never waits: it hands over what has arrived since it was asked last, in order,
and says up to which time that is all. What a newcomer gets wrong: silence is news. The
loop may let time pass only as far as nothing can come from before it any more.
"""

from collections import Counter
from typing import Final, NamedTuple, Protocol, TypedDict

from imu_tracker.samples import Frame, SessionHeader

BATCH: Final = 1000
"""Items of one delivery at most: some 30 ms of work, then signals get their turn."""


class Delivery(NamedTuple):
    """What arrived; `complete_ns` is up to when that is all, None when more waits."""

    items: list[SessionHeader | Frame]
    complete_ns: int | None


class ImuStatus(TypedDict):
    """Whether the chip delivers, its name and its measured rate."""

    is_ready: bool
    chip: str
    rate_hz: float


class GpsStatus(TypedDict):
    """What the receiver's port does, in words, and its speed."""

    state: str
    detail: str
    baud: int | None


class SensorHealth(TypedDict, total=False):
    """Empty where there are no sensors."""

    imu: ImuStatus
    gps: GpsStatus


class Feed(Protocol):
    """Where the loop gets its frames."""

    @property
    def is_live(self) -> bool:
        """Whether the frames are of now."""
        ...

    @property
    def is_over(self) -> bool:
        """Whether everything was delivered that there will ever be."""
        ...

    def read(self) -> Delivery:
        """Return what arrived; raises what ended a thread."""
        ...

    def stalled_source(self) -> str:
        """Name a stalled source, or ""; the watchdog is not fed while there is one."""
        ...

    def health(self) -> SensorHealth:
        """Return how each sensor is, for the status."""
        ...

    @property
    def counters(self) -> Counter[str]:
        """What was counted on the way here."""
        ...

    def close(self) -> None:
        """End the threads, if there are any; what they left can still be taken."""
        ...
