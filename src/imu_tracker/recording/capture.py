"""A whole recording, or a minute of a live sensor, as arrays for `calibration`."""

import math
from collections.abc import Iterable
from typing import NamedTuple

from imu_tracker.calibration.readings import Readings, decode, joined
from imu_tracker.errors import CalibrationError
from imu_tracker.recording.edit import Stopwatch
from imu_tracker.samples import Frame, GpsFix, SessionHeader, Source
from imu_tracker.sensors.gnss.epoch_reader import EpochReader


class Capture(NamedTuple):
    """Samples in chip axes, and what a receiver said meanwhile.

    Times are seconds since the first frame; those of fixes are their arrival's.
    """

    header: SessionHeader
    readings: Readings
    fixes: list[tuple[float, GpsFix]]
    start_utc_s: float | None

    @property
    def speeds(self) -> list[tuple[float, float]]:
        """Seconds and speed over ground of the fixes that have one."""
        return [
            (t_s, math.hypot(*fix.vel_ne_mps))
            for t_s, fix in self.fixes
            if fix.vel_ne_mps is not None
        ]


def capture(stream: Iterable[SessionHeader | Frame]) -> Capture:
    """Collect a stream; sessions follow one another.

    Raises
    ------
    CalibrationError
        When it holds no samples, or those of two kinds of chip.
    """
    stopwatch = Stopwatch()
    first: SessionHeader | None = None
    header: SessionHeader | None = None
    epochs = EpochReader()
    t_s: list[float] = []
    bursts: list[bytes] = []
    parts: list[Readings] = []
    fixes: list[tuple[float, GpsFix]] = []

    def end_session() -> None:
        if header is not None and t_s:
            ranges = header.accel_range_g, header.gyro_range_dps
            parts.append(decode(t_s, bursts, *ranges))
            t_s.clear()
            bursts.clear()

    for item in stream:
        elapsed_s = stopwatch.read(item)
        if isinstance(item, SessionHeader):
            end_session()
            header, first = item, first or item
            epochs = EpochReader(reference_utc_s=item.start_utc_s)
            if item.chip != first.chip:
                raise CalibrationError(
                    f"two chips in one recording, {first.chip} and {item.chip}"
                )
        elif item.source is Source.IMU:
            t_s.append(elapsed_s)
            bursts.append(item.data)
        elif item.source is Source.GPS:
            told = epochs.feed(item.t_ns, item.data)
            fixes += [(elapsed_s, fix) for fix in told if isinstance(fix, GpsFix)]
    end_session()
    if first is None or not parts:
        raise CalibrationError("no samples of the IMU")
    readings = joined(parts)
    return Capture(first, readings, fixes, _start_utc_s(first, fixes))


def _start_utc_s(
    header: SessionHeader, fixes: list[tuple[float, GpsFix]]
) -> float | None:
    """Return when it began, to the second or so: by its header, else by a fix."""
    if header.start_utc_s is not None:
        return header.start_utc_s
    dated = (fix.utc_s - t_s for t_s, fix in fixes if fix.utc_s is not None)
    return next(dated, None)
