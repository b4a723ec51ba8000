"""Many samples of a chip at once, as arrays in its own axes and at its nominal scale.

What measuring a sensor needs, in contrast to tracking with it: nothing is corrected
or turned here, and a second of samples is summed up as a `Window`.
"""

from collections.abc import Sequence
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from imu_tracker.calibration.counts import (
    COUNTS_PER_DPS,
    COUNTS_PER_G,
    STANDARD_GRAVITY_MPS2,
    TEMP_COUNTS_PER_DEGC,
    TEMP_OFFSET_DEGC,
)

Array: TypeAlias = NDArray[np.float64]

WINDOW_S = 1.0
"""Long enough for a mean, short enough to see a hand."""

_MAX_GAP = 5.0  # median intervals between two samples of one window or stretch


class Readings(NamedTuple):
    """Samples in the chip's own axes; times grow."""

    t_s: Array  # shape (n,)
    accel_mps2: Array  # shape (n, 3)
    gyro_radps: Array  # shape (n, 3)
    temp_degc: Array  # shape (n,)
    is_clipped: NDArray[np.bool_]  # shape (n, 6): accelerometer, then gyro

    def part(self, start: int, stop: int) -> "Readings":
        """Return the samples from one number to before another."""
        t_s, accel, gyro, temp_degc, is_clipped = self
        return Readings(
            t_s[start:stop],
            accel[start:stop],
            gyro[start:stop],
            temp_degc[start:stop],
            is_clipped[start:stop],
        )

    @property
    def n(self) -> int:
        """How many samples there are."""
        return len(self.t_s)

    @property
    def interval_s(self) -> float:
        """The usual time from sample to sample; 1 without two samples."""
        return float(np.median(np.diff(self.t_s))) if self.n > 1 else 1.0


class Window(NamedTuple):
    """A second of samples summed up, chip axes."""

    t_s: float  # of the first sample
    start: int  # number of the first sample
    stop: int  # number behind the last one
    accel_mps2: Array
    accel_std_mps2: Array
    gyro_radps: Array
    gyro_std_radps: Array
    temp_degc: float
    is_clipped: bool


def decode(
    t_s: Sequence[float], bursts: Sequence[bytes], accel_g: int, gyro_dps: int
) -> Readings:
    """Decode bursts of one session.

    Parameters
    ----------
    t_s : sequence of float
        Instants of the samples.
    bursts : sequence of bytes
        14 bytes each.
    accel_g, gyro_dps : int
        The ranges of the chip.
    """
    counts = np.frombuffer(b"".join(bursts), ">i2").reshape(-1, 7)
    axes = counts[:, [0, 1, 2, 4, 5, 6]]
    return Readings(
        np.array(t_s, float),
        axes[:, :3] * (STANDARD_GRAVITY_MPS2 / COUNTS_PER_G[accel_g]),
        np.radians(axes[:, 3:] / COUNTS_PER_DPS[gyro_dps]),
        counts[:, 3] / TEMP_COUNTS_PER_DEGC + TEMP_OFFSET_DEGC,
        (axes == np.iinfo(np.int16).max) | (axes == np.iinfo(np.int16).min),
    )


def joined(parts: Sequence[Readings]) -> Readings:
    """Put sessions behind one another; their times must grow."""
    return Readings(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))


def windows(readings: Readings, size: int | None = None) -> list[Window]:
    """Sum up each second; what has a hole, or is too short at its end, is left out.

    Parameters
    ----------
    readings : Readings
    size : int, optional
        Samples of a second. By default what their own rate says, which the chip's
        clock makes 1 % more or less than nominal.
    """
    if readings.n < 2:
        return []
    interval_s = readings.interval_s
    size = size or max(2, round(WINDOW_S / interval_s))
    holes = np.flatnonzero(np.diff(readings.t_s) > _MAX_GAP * interval_s) + 1
    return [
        _window(readings, first, first + size)
        for start, stop in zip([0, *holes], [*holes, readings.n], strict=True)
        for first in range(int(start), int(stop) - size + 1, size)
    ]


def _window(readings: Readings, start: int, stop: int) -> Window:
    t_s, accel, gyro, temp_degc, is_clipped = readings.part(start, stop)
    return Window(
        float(t_s[0]),
        start,
        stop,
        accel.mean(axis=0),
        accel.std(axis=0),
        gyro.mean(axis=0),
        gyro.std(axis=0),
        float(temp_degc.mean()),
        bool(is_clipped.any()),
    )
