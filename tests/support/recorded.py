"""Streams on their way into a recording."""

from collections.abc import Iterable, Iterator

from imu_tracker.recording.files import FrameWriter
from imu_tracker.samples import Frame, SessionHeader


def tee(
    stream: Iterable[SessionHeader | Frame], writer: FrameWriter
) -> Iterator[SessionHeader | Frame]:
    """Record a stream as it passes."""
    for item in stream:
        if isinstance(item, SessionHeader):
            writer.write_header(item)
        else:
            writer.write(item)
        yield item
