"""The picture of a still sensor: histograms, Allan deviation, temperature."""

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator

from imu_tracker.calibration.measures import AxisMeasures
from imu_tracker.plots.drawing import (
    BLACK,
    BLUE,
    GREEN,
    ORANGE,
    Array,
    envelope,
    legend_above,
    save,
)
from imu_tracker.recording.sensor_report import Report

_COLOURS = (BLUE, ORANGE, GREEN)

MINUS = "\N{MINUS SIGN}"  # as the axes have it

SHORT_CURVE = 100.0  # the longest average over the shortest

LEAST_SPAN_DEGC = 0.2
"""Less is the thermometer's own noise: a picture of it would show a slope."""


def plot_noise(report: Report, name: str, output: Path) -> None:
    """Draw what `characterise` measured.

    Raises
    ------
    OutputError
        When the picture cannot be written.
    """
    figure = Figure(figsize=(13, 14), layout="constrained")
    grid = figure.add_gridspec(4, 6)
    figure.suptitle(
        f"{name}: {report.chip}, {report.still_s:.0f} s without motion", fontsize=14
    )
    for number, axis in enumerate(report.axes):
        row, column = divmod(number, 3)
        panel = figure.add_subplot(grid[row, 2 * column : 2 * column + 2])
        _draw_histogram(panel, axis, _COLOURS[column])
    _draw_curves(figure.add_subplot(grid[2, :3]), report.axes[:3], 1.0, "m/s²")
    degrees = math.degrees(1.0)
    _draw_curves(figure.add_subplot(grid[2, 3:]), report.axes[3:], degrees, "°/s")
    temp_degc, means = report.temperature
    accel, gyro = figure.add_subplot(grid[3, :3]), figure.add_subplot(grid[3, 3:])
    _draw_temperature(accel, temp_degc, 1e3 * means[:, :3], "specific force, mm/s²")
    _draw_temperature(
        gyro, temp_degc, np.degrees(1e3 * means[:, 3:]), "angular rate, 0.001 °/s"
    )
    save(figure, output)


def _draw_histogram(panel: Axes, axis: AxisMeasures, colour: str) -> None:
    is_gyro = axis.name.startswith("gyro")
    k = math.degrees(1.0) if is_gyro else 1.0
    edges, counts = axis.histogram
    edges = edges * k
    std = axis.std * k
    panel.stairs(counts, edges, fill=True, color=colour, alpha=0.5, label="samples")
    if std > 0:
        x = np.linspace(edges[0], edges[-1], 200)
        height = counts.sum() * (edges[1] - edges[0]) / (std * math.sqrt(2 * math.pi))
        gauss = height * np.exp(-0.5 * (x / std) ** 2)
        panel.plot(x, gauss, color=BLACK, lw=1.2, label="Gauss")
    unit = "°/s" if is_gyro else "m/s²"
    panel.set_title(
        f"{axis.name}: {axis.mean * k:+.4f} ± {std:.4f} {unit}".replace("-", MINUS),
        fontsize=11,
    )
    panel.set_xlabel(f"deviation from the mean of its second, {unit}")
    panel.set_ylabel("samples")
    panel.legend(loc="upper right", fontsize=8, frameon=False)


def _draw_curves(
    panel: Axes, axes: Sequence[AxisMeasures], k: float, unit: str
) -> None:
    for axis, colour in zip(axes, _COLOURS, strict=True):
        seen = axis.curve.deviation > 0
        tau_s, deviation = axis.curve.tau_s[seen], axis.curve.deviation[seen] * k
        panel.loglog(tau_s, deviation, ".", color=colour, ms=5, label=axis.name)
        if axis.noise is not None:
            fitted = np.sqrt(axis.noise.variance(tau_s)) * k
            panel.loglog(tau_s, fitted, color=colour, lw=1.2)
    if any(axis.noise is not None for axis in axes):
        panel.plot([], [], color=BLACK, lw=1.2, label="fit")
    panel.set_xlabel("averaging time τ, s")
    panel.set_ylabel(f"Allan deviation, {unit}")
    tau_s = axes[0].curve.tau_s
    if len(tau_s) and tau_s[-1] < SHORT_CURVE * tau_s[0]:  # hardly a power of ten
        panel.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    panel.xaxis.set_major_formatter("{x:g}")
    panel.xaxis.set_minor_formatter("")
    panel.yaxis.set_minor_formatter("")
    panel.grid(alpha=0.3, which="both")
    legend_above(panel)


def _draw_temperature(panel: Axes, temp_degc: Array, values: Array, label: str) -> None:
    span_degc = float(np.ptp(temp_degc))
    if span_degc < LEAST_SPAN_DEGC:
        middle_degc = float(np.mean(temp_degc))
        panel.text(
            0.5,
            0.5,
            f"{middle_degc:.1f} °C all the time: nothing to tell of temperature",
            ha="center",
            va="center",
            transform=panel.transAxes,
        )
        panel.set_axis_off()
        return
    order = np.argsort(temp_degc, kind="stable")
    for column, colour in enumerate(_COLOURS):
        sorted_values = values[order, column] - values[:, column].mean()
        shown = envelope(sorted_values)
        panel.plot(
            temp_degc[order][shown],
            sorted_values[shown],
            ".",
            ms=2.5,
            color=colour,
            label="xyz"[column],
        )
    panel.set_xlabel("temperature, °C")
    panel.set_ylabel(f"{label}, less its mean")
    panel.grid(alpha=0.3)
    legend_above(panel)
