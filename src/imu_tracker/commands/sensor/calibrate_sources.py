"""What `imu-tracker calibrate` measures: the live chip, or a recording."""

import argparse
import contextlib
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

from imu_tracker.commands.common import progress
from imu_tracker.errors import CalibrationError

if TYPE_CHECKING:
    from imu_tracker.calibration.readings import Window
    from imu_tracker.config import Config
    from imu_tracker.recording.capture import Capture
    from imu_tracker.samples import Frame, SessionHeader


@contextlib.contextmanager
def live_stream(
    config: "Config", *, with_gps: bool = False
) -> Iterator["tuple[SessionHeader, Iterator[Frame]]"]:
    """Open the chip, and the receiver if it is asked for; close both at the end."""
    from imu_tracker.samples import Frame, SessionHeader
    from imu_tracker.sensors.clock import MonotonicClock
    from imu_tracker.sources.polled import live_frames

    with contextlib.closing(
        live_frames(config, MonotonicClock(), with_gps=with_gps)
    ) as live:
        header = next(live)
        assert isinstance(header, SessionHeader)  # a live stream begins with it
        yield header, (item for item in live if isinstance(item, Frame))


def captured(args: argparse.Namespace, config: "Config", live_s: float) -> "Capture":
    """Take the recording as a whole, or so many seconds of the live chip."""
    from imu_tracker.recording.capture import capture
    from imu_tracker.recording.files import read_recording
    from imu_tracker.sources.polled import for_seconds

    if args.recording is not None:
        return capture(read_recording(args.recording))
    total = round(live_s * config.imu.rate_hz)
    with live_stream(config) as (header, frames):
        shown = progress(for_seconds(frames, live_s), args, " samples", total)
        return capture(item for part in ([header], shown) for item in part)


def live_windows(
    header: "SessionHeader", frames: "Iterator[Frame]"
) -> Iterator["tuple[Window, list[Frame]]"]:
    """Sum up each second as it comes, and hand on the samples that it is made of."""
    from imu_tracker.calibration.readings import WINDOW_S, decode, windows
    from imu_tracker.samples import Source

    size = round(WINDOW_S * header.imu_rate_hz)
    second: list[Frame] = []
    for frame in frames:
        if frame.source is not Source.IMU:
            continue
        second.append(frame)
        if len(second) < size:
            continue
        t_s, bursts = [f.t_ns / 1e9 for f in second], [f.data for f in second]
        ranges = header.accel_range_g, header.gyro_range_dps
        for window in windows(decode(t_s, bursts, *ranges), size):
            yield window, second
        second = []


def refuse_motion(seen: "list[Window]") -> None:
    """Hold that nothing moved at all.

    Raises
    ------
    CalibrationError
        When something did.
    """
    from imu_tracker.calibration.still import is_quiet, is_steady

    if not all(is_quiet(window) and is_steady(window, seen[0]) for window in seen):
        raise CalibrationError(
            "it moved: lay it on something firm, do not touch it, and try again"
        )


def plain(array: Any) -> Any:
    """Turn an array into nested lists, which is what the file holds."""
    return array.tolist()
