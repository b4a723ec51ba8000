"""The picture of lat/long logs: the map, and speed and error radius over time."""

from collections.abc import Sequence
from pathlib import Path

from matplotlib.dates import AutoDateLocator, ConciseDateFormatter
from matplotlib.figure import Figure

from imu_tracker.plots.chart import draw_map
from imu_tracker.plots.drawing import save
from imu_tracker.plots.logs import LogColumns, joined
from imu_tracker.plots.timelines import days_of, draw_radius, draw_speed, shade_modes
from imu_tracker.recording.scoring import Track

__all__ = ["LogColumns", "plot_tracks"]


def plot_tracks(
    logs: Sequence[LogColumns], output: Path, truth: Track | None = None
) -> None:
    """Draw logs: the map on top, speed and error radius over time below.

    Logs that follow one another are drawn as one, its modes in colours; logs of the
    same time are compared, each in a colour of its own.

    Raises
    ------
    OutputError
        When the picture cannot be written.
    """
    logs = joined(logs)
    figure = Figure(figsize=(11, 12.5), layout="constrained")
    chart, speed, radius = figure.subplots(3, 1, height_ratios=(3.2, 1, 1))
    radius.sharex(speed)
    draw_map(chart, logs, truth)
    draw_speed(speed, logs)
    draw_radius(radius, logs, truth)
    for panel in (speed, radius):
        if len(logs) == 1:
            shade_modes(panel, logs[0])
        panel.grid(alpha=0.3)
        panel.set_axisbelow(True)
    panel.set_xlim(*days_of(logs))
    locator = AutoDateLocator(minticks=4, maxticks=10)  # type: ignore[no-untyped-call]
    dates = ConciseDateFormatter(locator)  # type: ignore[no-untyped-call]
    radius.xaxis.set_major_locator(locator)
    radius.xaxis.set_major_formatter(dates)
    radius.set_xlabel("UTC")
    speed.tick_params(labelbottom=False)
    save(figure, output)
