"""The gyroscope's bias, from a chip that lies still, and how it follows temperature."""

import math
from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np

from imu_tracker.calibration.readings import Array, Window
from imu_tracker.calibration.still import Stretch
from imu_tracker.errors import CalibrationError

SHORTEST_S: Final = 10.0

LARGEST_RADPS: Final = math.radians(40.0)
"""Zero-rate output, 20 deg/s, and as much over temperature (PS-MPU-6000A 6.1)."""

LARGEST_STEP_RADPS: Final = math.radians(1.0)
"""Between the stretches of one recording: more is a slow turn, no bias."""

SLOPE_SPAN_DEGC: Final = 3.0
"""Over less, a drift looks like a slope."""

SLOPE_SIGMAS: Final = 3.0

_PART_WINDOWS: Final = 30
_INDEPENDENT: Final = 2

_BLOCKS: Final = 8  # what the means of so many parts differ by is the uncertainty


class GyroFit(NamedTuple):
    """The bias at a temperature; chip axes.

    Attributes
    ----------
    bias_radps : ndarray, shape (3,)
    covariance : ndarray, shape (3, 3)
        Of the bias, from how the means of parts of the time differ.
    temp_degc : float
        The mean temperature, at which the bias holds.
    temps_degc : (float, float)
        The lowest and the highest temperature.
    per_degc : ndarray, shape (3,), or None
        Slope in rad/s per degree; None when the temperature did not tell one.
    per_degc_sigma : ndarray, shape (3,), or None
    length_s : float
    """

    bias_radps: Array
    covariance: Array
    temp_degc: float
    temps_degc: tuple[float, float]
    per_degc: Array | None
    per_degc_sigma: Array | None
    length_s: float


def fit_gyro(stretches: Sequence[Stretch]) -> GyroFit:
    """Find the bias in stretches of stillness.

    Raises
    ------
    CalibrationError
        When there is too little of it, or it was none.
    """
    windows = [window for stretch in stretches for window in stretch.windows]
    if len(windows) < SHORTEST_S:
        raise CalibrationError(
            f"only {len(windows)} s without motion: hold it still for "
            f"{SHORTEST_S:.0f} s at least"
        )
    gyro = np.array([window.gyro_radps for window in windows])
    temp_degc = np.array([window.temp_degc for window in windows])
    slope = slope_of(temp_degc, gyro)
    middle_degc = float(np.clip(temp_degc.mean(), temp_degc.min(), temp_degc.max()))
    level = gyro
    if slope is not None:
        level = gyro - np.outer(temp_degc - middle_degc, slope[0])
    bias = level.mean(axis=0)
    axis = int(np.argmax(np.abs(bias)))
    if abs(bias[axis]) > LARGEST_RADPS:
        raise CalibrationError(
            f"gyro {'xyz'[axis]} turns at {math.degrees(bias[axis]):.0f} deg/s while "
            "it lies still: it is broken, or lies on something that turns"
        )
    if np.abs(level - np.median(level, axis=0)).max() > LARGEST_STEP_RADPS:
        raise CalibrationError(
            "the bias is not the same all the time: something turned slowly; lay it on "
            "a table and hold still"
        )
    return GyroFit(
        bias,
        _covariance(level, windows),
        middle_degc,
        (float(temp_degc.min()), float(temp_degc.max())),
        None if slope is None else slope[0],
        None if slope is None else slope[1],
        float(len(windows)),
    )


def slope_of(temp_degc: Array, values: Array) -> tuple[Array, Array] | None:
    """Fit a straight line against temperature, if there is one to see.

    Parameters
    ----------
    temp_degc : ndarray, shape (n,)
    values : ndarray, shape (n, k)
        Means of windows.

    Returns
    -------
    (slope, sigma) or None
        Shape (k,) each, per degree. None when the temperature hardly changed, or the
        line explains nothing on any axis.

    Notes
    -----
    A bias drifts as slowly as a chip warms up, and the line takes the drift for its
    own. So the residuals, in means of half a minute, count as two independent values
    however many there are: on simulated chips the slope is then as far off as it says.
    """
    if np.ptp(temp_degc) < SLOPE_SPAN_DEGC:
        return None
    warmth = temp_degc - temp_degc.mean()
    slope: Array = warmth @ (values - values.mean(axis=0)) / (warmth @ warmth)
    left = values - values.mean(axis=0) - np.outer(warmth, slope)
    n_parts = max(1, len(left) // _PART_WINDOWS)
    parts = np.array([part.mean(axis=0) for part in np.array_split(left, n_parts)])
    drift = np.sqrt(np.mean(parts**2, axis=0))
    sigma: Array = drift / warmth.std() / math.sqrt(_INDEPENDENT)
    return (slope, sigma) if np.any(np.abs(slope) > SLOPE_SIGMAS * sigma) else None


def _covariance(level: Array, windows: Sequence[Window]) -> Array:
    """Covariance of the mean: never better than the chip's noise over the time."""
    n_blocks = min(_BLOCKS, len(level))
    means = np.array([b.mean(axis=0) for b in np.array_split(level, n_blocks)])
    covariance: Array = np.cov(means.T) / n_blocks
    white = np.mean([w.gyro_std_radps**2 / (w.stop - w.start) for w in windows], axis=0)
    floor = white / len(windows)
    lacking = np.maximum(0.0, floor - np.diag(covariance))
    return covariance + np.diag(lacking)
