"""The picture of a recording: the raw axes of the chip, and what the receiver knew."""

from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from imu_tracker.plots.drawing import (
    BLUE,
    GREEN,
    ORANGE,
    VERMILION,
    Array,
    envelope,
    legend_above,
    save,
)


class RecordingColumns(NamedTuple):
    """A recording as arrays; seconds count from its first record."""

    name: str
    imu_s: Array  # shape (n,)
    accel_mps2: Array  # shape (n, 3), chip axes
    gyro_radps: Array  # shape (n, 3), chip axes
    temp_degc: Array  # shape (n,)
    fix_s: Array  # shape (m,)
    fix_sigma_m: Array  # shape (m,)
    no_fix_s: Array  # shape (k,): when the receiver spoke, but knew no place


def plot_recording(recording: RecordingColumns, output: Path) -> None:
    """Draw the raw axes of the chip and the fixes of the receiver over time.

    Raises
    ------
    OutputError
        When the picture cannot be written.
    """
    figure = Figure(figsize=(11, 11), layout="constrained")
    panels = figure.subplots(4, 1, sharex=True, height_ratios=(2, 2, 1, 1))
    accel, gyro, temperature, gps = panels
    figure.suptitle(f"{recording.name}: the chip's own axes", fontsize=13)
    _draw_triad(accel, recording.imu_s, recording.accel_mps2)
    accel.set_ylabel("specific force, m/s²")
    _draw_triad(gyro, recording.imu_s, np.degrees(recording.gyro_radps))
    gyro.set_ylabel("angular rate, °/s")
    shown = envelope(recording.temp_degc)
    temperature.plot(recording.imu_s[shown], recording.temp_degc[shown], color=ORANGE)
    temperature.set_ylabel("temperature, °C")
    _draw_fixes(gps, recording)
    gps.set_xlabel("seconds since the first record")
    for panel in panels:
        panel.grid(alpha=0.3)
        panel.set_axisbelow(True)
        panel.margins(x=0.01)
    save(figure, output)


def _draw_triad(panel: Axes, t_s: Array, values: Array) -> None:
    columns: Iterable[Array] = values.T
    for axis, colour, column in zip("xyz", (BLUE, ORANGE, GREEN), columns, strict=True):
        shown = envelope(column)
        panel.plot(
            t_s[shown], column[shown], color=colour, lw=0.8, alpha=0.85, label=axis
        )
    legend_above(panel)


def _draw_fixes(panel: Axes, recording: RecordingColumns) -> None:
    if len(recording.fix_s):
        panel.plot(
            recording.fix_s, recording.fix_sigma_m, ".", color=BLUE, ms=3, label="fix"
        )
    if len(recording.no_fix_s):
        panel.plot(
            recording.no_fix_s,
            np.zeros(len(recording.no_fix_s)),
            "|",
            color=VERMILION,
            ms=12,
            label="no fix",
        )
    panel.set_ylabel("sigma of a fix, m")
    panel.set_ylim(bottom=0)
    if panel.lines:
        legend_above(panel)
    else:
        panel.text(0.5, 0.5, "no receiver", ha="center", transform=panel.transAxes)
