"""What a still sensor says about itself, axis by axis, and a verdict on it.

Held against the datasheet of the MPU-6050 (PS-MPU-6000A rev. 3.4, sections 6.1 and
6.2). What a newcomer gets wrong: an accelerometer at rest reads gravity, so its mean
is no bias; only `faces` tells that.
"""

import math
from collections.abc import Sequence
from enum import StrEnum
from typing import Final, NamedTuple

import numpy as np

from imu_tracker.calibration.allan import Curve, Noise, allan_curve, fit_noise
from imu_tracker.calibration.bias import slope_of
from imu_tracker.calibration.counts import STANDARD_GRAVITY_MPS2
from imu_tracker.calibration.readings import Array, Readings
from imu_tracker.calibration.still import Stretch

AXES: Final = ("accel x", "accel y", "accel z", "gyro x", "gyro y", "gyro z")

ACCEL_DENSITY_MPS2_RTHZ: Final = 400e-6 * STANDARD_GRAVITY_MPS2  # 6.2
GYRO_DENSITY_RADPS_RTHZ: Final = math.radians(0.005)  # 6.1

NOISY: Final = 2.0
"""Times the datasheet's figure, which is a typical one."""

MAX_GYRO_BIAS_RADPS: Final = math.radians(40.0)  # 6.1: 20 deg/s, and over temperature
GRAVITY_LIMITS_G: Final = (0.85, 1.15)  # 6.2: 80 mg, 60 mg over temperature, 3 %

MAX_CLIPPED: Final = 1e-3

SHAKEN_MISFIT: Final = 5.0
"""A curve so unlike any noise shows an engine, or steps on the floor."""

MOST_BINS: Final = 81
HALF_WIDTH: Final = 5.0  # of a histogram, in standard deviations
"""A bin is never narrower than one count of the chip: it would draw a comb."""


class Verdict(StrEnum):
    """What is to be thought of an axis."""

    GOOD = "good"
    NOISY = "noisy"
    BROKEN = "broken axis"


class AxisMeasures(NamedTuple):
    """One axis, in m/s^2 or rad/s.

    Attributes
    ----------
    mean, std, variance : float
        Over all stretches; the spread is about the mean of each second, so that a
        drift does not count as noise.
    excess_kurtosis : float
        0 for a Gaussian.
    histogram : (edges, counts)
        About the mean, of shape (k + 1,) and (k,).
    clipped : float
        Share of the samples at the end of the range.
    slope, slope_sigma : float or None
        Per degree; None when the temperature does not tell.
    curve : Curve
    noise : Noise or None
        None when the stretches are too short, or the axis is dead.
    verdict : Verdict
    reason : str
        Why it is not good, or "".
    """

    name: str
    mean: float
    std: float
    variance: float
    excess_kurtosis: float
    histogram: tuple[Array, Array]
    clipped: float
    slope: float | None
    slope_sigma: float | None
    curve: Curve
    noise: Noise | None
    verdict: Verdict
    reason: str


def measure(readings: Readings, stretches: Sequence[Stretch]) -> list[AxisMeasures]:
    """Measure all axes over the stretches in which nothing moved, at least one.

    Notes
    -----
    Where an axis follows the temperature, that line is taken out before the Allan
    deviation, which else shows the warming-up of the chip for its random walk.
    """
    parts = [readings.part(stretch.start, stretch.stop) for stretch in stretches]
    windows = [window for stretch in stretches for window in stretch.windows]
    temp_degc = np.array([window.temp_degc for window in windows])
    means = np.array([[*w.accel_mps2, *w.gyro_radps] for w in windows])
    slopes = slope_of(temp_degc, means[:, 3:])
    accel_slopes = slope_of(temp_degc, means[:, :3])
    gravity_g = float(
        np.median(np.linalg.norm(means[:, :3], axis=1)) / STANDARD_GRAVITY_MPS2
    )
    upright = int(np.argmax(np.abs(means[:, :3].mean(axis=0))))
    found = []
    for number, name in enumerate(AXES):
        column = number % 3
        line = (accel_slopes, slopes)[number // 3]
        slope = (
            None if line is None else (float(line[0][column]), float(line[1][column]))
        )
        axis = _measure(name, number, parts, temp_degc, means[:, number], slope)
        if (
            number == upright
            and axis.verdict is not Verdict.BROKEN
            and not GRAVITY_LIMITS_G[0] <= gravity_g <= GRAVITY_LIMITS_G[1]
        ):
            axis = axis._replace(
                verdict=Verdict.BROKEN,
                reason=f"feels {gravity_g:.2f} g at rest, not 1 g",
            )
        found.append(axis)
    return found


def _measure(
    name: str,
    number: int,
    parts: Sequence[Readings],
    temp_degc: Array,
    means: Array,
    slope: tuple[float, float] | None,
) -> AxisMeasures:
    column = number % 3
    is_gyro = number >= 3
    values = [
        (part.gyro_radps if is_gyro else part.accel_mps2)[:, column] for part in parts
    ]
    clipped = float(
        np.mean(np.concatenate([part.is_clipped[:, number] for part in parts]))
    )
    spread = _spread_about_each_second(values, parts[0].interval_s)
    std = float(spread.std())
    kurtosis = float(np.mean((spread / std) ** 4)) - 3.0 if std > 0 else 0.0
    half = max(HALF_WIDTH * std, 1e-12)
    steps = np.diff(np.unique(values[0]))
    finest = 2.0 * half / steps.min() if len(steps) else 1.0
    n_bins = int(min(MOST_BINS, max(1.0, finest)))
    counts, edges = np.histogram(spread, n_bins, (-half, half))
    level = values
    if slope is not None:
        middle_degc = temp_degc.mean()
        level = [
            column_values - slope[0] * (_smooth_temp(part) - middle_degc)
            for column_values, part in zip(values, parts, strict=True)
        ]
    curve = allan_curve(level, 1.0 / parts[0].interval_s)
    noise = fit_noise(curve)
    verdict, reason = _judge(
        float(means.mean()), std, clipped, noise, curve.rate_hz, is_gyro=is_gyro
    )
    return AxisMeasures(
        name,
        float(np.concatenate(values).mean()),
        std,
        std**2,
        kurtosis,
        (edges, counts.astype(float)),
        clipped,
        None if slope is None else slope[0],
        None if slope is None else slope[1],
        curve,
        noise,
        verdict,
        reason,
    )


def _spread_about_each_second(values: Sequence[Array], interval_s: float) -> Array:
    """Values less the mean of their second."""
    size = max(2, round(1.0 / interval_s))
    whole = [part[: len(part) // size * size].reshape(-1, size) for part in values]
    spread: Array = np.concatenate([w - w.mean(axis=1, keepdims=True) for w in whole])
    return spread.ravel() * math.sqrt(size / (size - 1))


def _smooth_temp(part: Readings) -> Array:
    """Temperature without its own noise: straight lines between means of seconds."""
    size = max(2, round(1.0 / part.interval_s))
    whole = len(part.temp_degc) // size * size
    means = part.temp_degc[:whole].reshape(-1, size).mean(axis=1)
    middles = np.arange(len(means)) * size + size / 2
    smooth: Array = np.interp(np.arange(part.n), middles, means)
    return smooth


def _judge(
    mean: float,
    std: float,
    clipped: float,
    noise: Noise | None,
    rate_hz: float,
    *,
    is_gyro: bool,
) -> tuple[Verdict, str]:
    if std == 0.0:
        return Verdict.BROKEN, "always reads the same"
    if clipped > MAX_CLIPPED:
        return Verdict.BROKEN, f"{clipped:.1%} of the samples at the end of the range"
    if is_gyro and abs(mean) > MAX_GYRO_BIAS_RADPS:
        return Verdict.BROKEN, f"turns at {math.degrees(mean):.0f} deg/s while still"
    datasheet = GYRO_DENSITY_RADPS_RTHZ if is_gyro else ACCEL_DENSITY_MPS2_RTHZ
    density = std * math.sqrt(2.0 / rate_hz)
    is_shaken = False
    if noise is not None:
        density = noise.random_walk.value * math.sqrt(2.0)
        is_shaken = noise.misfit > SHAKEN_MISFIT
    if density > NOISY * datasheet:
        what = "vibration and noise" if is_shaken else "noise"
        return (
            Verdict.NOISY,
            f"{what} {density / datasheet:.1f} times the datasheet's noise",
        )
    return Verdict.GOOD, ""
