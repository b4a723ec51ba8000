"""The whole of what `characterise` tells of a capture: timing, axes, mounting."""

from typing import NamedTuple

import numpy as np

from imu_tracker.calibration.counts import parse_mount
from imu_tracker.calibration.measures import AxisMeasures, measure
from imu_tracker.calibration.readings import Array, Readings, windows
from imu_tracker.calibration.still import Stretch, still_stretches
from imu_tracker.errors import CalibrationError
from imu_tracker.recording.capture import Capture
from imu_tracker.samples import DEFAULT_MOUNT, Mount

MOUNTS_BY_UP: dict[str, Mount] = {
    "+z": ("+x", "-y", "-z"),
    "-z": ("+x", "+y", "+z"),
    "+x": ("+z", "+y", "-x"),
    "-x": ("+z", "-y", "+x"),
    "+y": ("+x", "+z", "-y"),
    "-y": ("+x", "-z", "+y"),
}
"""One mount for each chip axis that may point up; which way is forward is a guess."""


class Report(NamedTuple):
    """What was measured.

    `rate_hz` is by the host's clock; `jitter_s` the spread of sample times about an
    even grid; `temperature` is (temp_degc, means of seconds, shape (n,) and (n, 6)).
    """

    chip: str
    accel_range_g: int
    gyro_range_dps: int
    length_s: float
    still_s: float
    stretches: int
    temps_degc: tuple[float, float]
    rate_hz: float
    rate_error: float
    jitter_s: float
    missing: int
    mount: Mount
    mount_comment: str
    axes: list[AxisMeasures]
    temperature: tuple[Array, Array]


def report_of(taken: Capture) -> Report:
    """Measure what lay still.

    Raises
    ------
    CalibrationError
        When nothing did, for long enough.
    """
    readings, header = taken.readings, taken.header
    seen = windows(readings)
    stretches = still_stretches(seen, taken.speeds)
    if not stretches:
        raise CalibrationError(
            "moves all the time: at least 5 s without motion are needed, better some "
            "minutes; lay it on something firm"
        )
    rate_hz, jitter_s, missing = _timing(readings, stretches)
    still = [window for stretch in stretches for window in stretch.windows]
    named = header.mount or DEFAULT_MOUNT
    mount, comment = mount_by_gravity(named, still[0].accel_mps2)
    temp_degc = np.array([window.temp_degc for window in still])
    return Report(
        header.chip,
        header.accel_range_g,
        header.gyro_range_dps,
        float(len(seen)),
        sum(stretch.length_s for stretch in stretches),
        len(stretches),
        (float(temp_degc.min()), float(temp_degc.max())),
        rate_hz,
        rate_hz / header.imu_rate_hz - 1.0,
        jitter_s,
        missing,
        mount,
        comment,
        measure(readings, stretches),
        (temp_degc, np.array([[*w.accel_mps2, *w.gyro_radps] for w in still])),
    )


def _timing(readings: Readings, stretches: list[Stretch]) -> tuple[float, float, int]:
    """Rate, jitter about an even grid, and missing samples of the longest stretch."""
    longest = max(stretches, key=lambda stretch: stretch.length_s)
    t_s = readings.t_s[longest.start : longest.stop]
    steps = np.rint(np.diff(t_s) / np.median(np.diff(t_s)))
    numbers = np.concatenate([[0.0], np.cumsum(np.maximum(steps, 1.0))])
    interval_s, start_s = np.polyfit(numbers, t_s - t_s[0], 1)
    left = t_s - t_s[0] - (start_s + interval_s * numbers)
    missing = int(numbers[-1]) - (len(t_s) - 1)
    return 1.0 / float(interval_s), float(left.std()), missing


def mount_by_gravity(mount: Mount, accel_mps2: Array) -> tuple[Mount, str]:
    """Return the mount, or one that agrees with gravity where it does not."""
    axis = int(np.argmax(np.abs(accel_mps2)))
    up = f"{'+' if accel_mps2[axis] > 0 else '-'}{'xyz'[axis]}"
    chip, sign = parse_mount(mount)[2]
    is_right = chip == axis and (sign < 0) == (accel_mps2[axis] > 0)
    if is_right:
        return mount, ""
    return MOUNTS_BY_UP[up], f"  # the chip's {up} points up; turn forward as it lies"
