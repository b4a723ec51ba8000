"""The picture of the wheels' lines: spectrum over time, and the circumference."""

from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from imu_tracker.plots.drawing import (
    BLUE,
    VERMILION,
    Array,
    legend_above,
    runs,
    save,
)
from imu_tracker.wheels.orders import CIRCUMFERENCES_M
from imu_tracker.wheels.speed import LEAST_SPEED_MPS
from imu_tracker.wheels.windows import ORDERS, WINDOW_S, spectrum

EVERY_S: Final = 1.0
"""From window to window."""

MOST_HZ: Final = 40.0
SMOOTHED: Final = 9  # windows: one alone is noise


class OrderColumns(NamedTuple):
    """A recording and its track as arrays; seconds count from its first record."""

    name: str
    imu_s: Array  # shape (n,)
    values: Array  # shape (n, 6): specific force, angular rate
    row_s: Array  # shape (m,)
    speed_mps: Array  # shape (m,)
    has_gps: NDArray[np.bool_]  # shape (m,)
    state: str  # "heard", "faint" or "not heard"
    circumference_m: float | None
    circumference_sigma_m: float | None


class _Survey(NamedTuple):
    """Spectra of all windows; power over its neighbourhood, 1 without a line."""

    end_s: Array  # shape (w,)
    power: Array  # shape (w, bins)
    bin_hz: float
    by_circumference: Array  # shape (w, circumferences); nan below the least speed


def plot_orders(columns: OrderColumns, output: Path) -> None:
    """Draw where the lines are, and where the speed says that they are.

    Raises
    ------
    OutputError
        When the picture cannot be written.
    """
    figure = Figure(figsize=(12, 9), layout="constrained")
    lines, circumference = figure.subplots(2, 1, sharex=True, height_ratios=(3, 2))
    figure.suptitle(f"{columns.name}: {_summary(columns)}", fontsize=13)
    survey = _survey(columns)
    _draw_lines(lines, columns, survey)
    _draw_circumference(circumference, columns, survey)
    circumference.set_xlabel("seconds since the first record")
    save(figure, output)


def _summary(columns: OrderColumns) -> str:
    text = f"wheels {columns.state}"
    if columns.circumference_m is None or columns.circumference_sigma_m is None:
        return text
    size, sigma = columns.circumference_m, columns.circumference_sigma_m
    return f"{text}, {size:.3f} ± {sigma:.3f} m round"


def _survey(columns: OrderColumns) -> _Survey:
    imu_s, values = columns.imu_s, columns.values
    period_s = float(np.median(np.diff(imu_s)))
    n = round(WINDOW_S / period_s)
    ends_s, power, by_circumference, bin_hz = [], [], [], 1.0
    for last in range(n, len(imu_s), max(round(EVERY_S / period_s), 1)):
        t_s = imu_s[last - n : last] - imu_s[last - 1]
        if t_s[0] < -1.1 * WINDOW_S:  # samples are missing
            continue
        speed = np.interp(imu_s[last - n : last], columns.row_s, columns.speed_mps)
        steps_m = (speed[1:] - speed[-1]) * np.diff(t_s)
        extra_m = np.concatenate([[0.0], np.cumsum(steps_m)])
        found = spectrum(
            t_s, values[last - n : last], 1.0 / period_s, extra_m - extra_m[-1]
        )
        bin_hz = found.bin_hz
        shown = found.ratio[0].mean(axis=1)
        power.append(shown[: round(MOST_HZ / bin_hz)])
        turns = found.at(speed[-1] / CIRCUMFERENCES_M).mean(axis=(1, 2))
        is_fast = speed.min() >= LEAST_SPEED_MPS
        by_circumference.append(turns if is_fast else np.full(len(turns), np.nan))
        ends_s.append(imu_s[last - 1])
    return _Survey(
        np.array(ends_s), np.array(power), bin_hz, np.array(by_circumference)
    )


def _draw_lines(panel: Axes, columns: OrderColumns, survey: _Survey) -> None:
    if len(survey.end_s) > 1:
        f_hz = np.arange(survey.power.shape[1]) * survey.bin_hz
        panel.pcolormesh(
            survey.end_s,
            f_hz,
            survey.power.T,
            cmap="Greys",
            vmin=1.0,
            vmax=3.5,
            rasterized=True,
        )
    size_m = columns.circumference_m
    for has_gps, colour, label in (
        (True, BLUE, "by the speed with GPS"),
        (False, VERMILION, "without GPS"),
    ):
        for order in ORDERS if size_m else ():
            line_hz = order * columns.speed_mps / (size_m or 1.0)
            shown = np.where(columns.has_gps == has_gps, line_hz, np.nan)
            name = label if order == 1 else None
            panel.plot(
                columns.row_s, shown, color=colour, lw=0.7, alpha=0.6, label=name
            )
    panel.set_ylabel("frequency, Hz")
    top_hz = survey.power.shape[1] * survey.bin_hz if len(survey.end_s) else MOST_HZ
    panel.set_ylim(0.0, top_hz)
    if panel.lines:
        legend_above(panel)


def _draw_circumference(panel: Axes, columns: OrderColumns, survey: _Survey) -> None:
    """Smear over time what each circumference would have had under its lines."""
    panel.set_ylabel("circumference, m")
    panel.set_ylim(CIRCUMFERENCES_M[0], CIRCUMFERENCES_M[-1])
    if len(survey.end_s) > SMOOTHED:
        known = np.nan_to_num(survey.by_circumference)
        weight = np.isfinite(survey.by_circumference[:, 0]).astype(float)
        kernel = np.ones(SMOOTHED)
        total = np.apply_along_axis(np.convolve, 0, known, kernel, "same")
        count = np.maximum(np.convolve(weight, kernel, "same"), 1.0)
        panel.pcolormesh(
            survey.end_s,
            CIRCUMFERENCES_M,
            (total / count[:, None]).T,
            cmap="Greys",
            vmin=0.9,
            vmax=2.0,
            rasterized=True,
        )
    if columns.circumference_m is not None:
        panel.axhline(columns.circumference_m, color=BLUE, lw=0.8, label="learnt")
        legend_above(panel)
    for start, stop in runs(~columns.has_gps):
        panel.axvspan(
            *(columns.row_s[start], columns.row_s[stop - 1]), color=VERMILION, alpha=0.1
        )
