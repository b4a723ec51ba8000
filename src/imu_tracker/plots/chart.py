"""The map: where the track went, where the truth did, and circles of error."""

from collections.abc import Sequence
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import EllipseCollection, LineCollection
from matplotlib.colors import to_rgba
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from imu_tracker.plots.drawing import BLACK, MAX_POINTS, Array, Indices, runs
from imu_tracker.plots.logs import MAX_GAP_S, MODES, LogColumns, colours_of, summary
from imu_tracker.recording.scoring import Track, metres_per_degree
from imu_tracker.samples import Mode

_MAX_CIRCLES: Final = 60
_MIN_EXTENT_M: Final = 20.0  # however little a parked tracker moves
_WHOLE_PICTURE: Final = 2.5
"""Times half of what is shown: such a circle holds the whole picture, and would only
tint it; the radius over time, below, tells of it."""


def draw_map(chart: Axes, logs: Sequence[LogColumns], truth: Track | None) -> None:
    """Draw tracks in local metres, of the same length both ways."""
    origin = logs[0].track
    legend: list[Line2D | Patch] = []
    if truth is not None:
        chart.plot(*_east_north_m(truth, origin), color=BLACK, ls="--", lw=1, zorder=4)
        legend.append(Line2D([], [], color=BLACK, lw=1, ls="--", label="truth"))
    for log, colour in zip(logs, colours_of(logs, alone=""), strict=True):
        east_m, north_m = _east_north_m(log.track, origin)
        colours = [colour or MODES[Mode(mode)][0] for mode in log.mode]
        _draw_track(chart, log, east_m, north_m, colours)
        chart.plot(east_m[0], north_m[0], "o", mfc="white", mec=BLACK, ms=8, zorder=6)
        chart.plot(east_m[-1], north_m[-1], "s", mfc=BLACK, mec="white", ms=8, zorder=6)
        if colour:
            legend.append(Line2D([], [], color=colour, lw=2.5, label=log.name))
    if len(logs) == 1:
        legend += [
            Line2D([], [], color=colour, lw=2.5, label=name)
            for mode, (colour, name) in MODES.items()
            if mode in logs[0].mode
        ]
    legend += [
        Patch(fc=to_rgba(BLACK, 0.07), ec=to_rgba(BLACK, 0.5), label="r95"),
        Line2D([], [], marker="o", mfc="white", mec=BLACK, ls="", label="start"),
        Line2D([], [], marker="s", mfc=BLACK, mec="white", ls="", label="end"),
    ]
    chart.legend(handles=legend, loc="best", framealpha=0.9)
    chart.margins(0.08)
    chart.set_aspect("equal", adjustable="datalim")
    chart.autoscale_view()
    name = logs[0].name if len(logs) == 1 else f"{len(logs)} logs compared"
    chart.set_title(f"{name}: {summary(logs[0])}", fontsize=13)
    chart.set(xlabel="east, m", ylabel="north, m")
    chart.grid(alpha=0.3)
    chart.set_axisbelow(True)


def _east_north_m(track: Track, origin: Track) -> tuple[Array, Array]:
    """Return local metres; good for as far as a map is looked at."""
    north_m, east_m = metres_per_degree(origin.lat_deg[0])
    turned_deg = (track.lon_deg - origin.lon_deg[0] + 180.0) % 360.0 - 180.0
    return turned_deg * east_m, (track.lat_deg - origin.lat_deg[0]) * north_m


def _draw_track(
    chart: Axes, log: LogColumns, east_m: Array, north_m: Array, colours: Sequence[str]
) -> None:
    """Draw one track, each piece in the colour of the row it leads to, and circles."""
    step = -(-len(east_m) // MAX_POINTS)
    shown = np.unique(np.append(np.arange(0, len(east_m), step), len(east_m) - 1))
    points = np.column_stack([east_m, north_m])
    pieces = np.stack([points[shown[:-1]], points[shown[1:]]], axis=1)
    is_joined = np.diff(log.track.utc_s[shown]) <= MAX_GAP_S * step
    chart.add_collection(
        LineCollection(
            list(pieces[is_joined]),
            colors=[colours[row] for row in shown[1:][is_joined]],
            linewidths=1.8,
            capstyle="round",
            zorder=5,
        ),
        autolim=False,
    )
    # A circle may be larger than all that was driven: the track rules the limits.
    middle = (points.min(axis=0) + points.max(axis=0)) / 2
    half_m = np.maximum(np.ptp(points, axis=0), _MIN_EXTENT_M) / 2
    chart.update_datalim([middle - half_m, middle + half_m])
    circles = choose_circles(log, points)
    circles = circles[log.r95_m[circles] < _WHOLE_PICTURE * half_m.max()]
    diameters_m = 2 * log.r95_m[circles]
    chart.add_collection(
        EllipseCollection(
            diameters_m,
            diameters_m,
            np.zeros(len(circles)),
            units="xy",
            offsets=points[circles],
            offset_transform=chart.transData,
            facecolors=[to_rgba(colours[row], 0.07) for row in circles],
            edgecolors=[to_rgba(colours[row], 0.5) for row in circles],
            linewidths=0.7,
            zorder=2,
        ),
        autolim=False,
    )


def choose_circles(log: LogColumns, points: Array) -> Indices:
    """Choose the rows that get a circle: evenly in time, and the end of each outage.

    One that would lie on another of its size is left out: a parked car draws one.
    """
    even = np.linspace(0, len(points) - 1, min(_MAX_CIRCLES, len(points)))
    ends = [stop - 1 for _, stop in runs(log.mode == Mode.DR)]
    widest = sorted(ends, key=lambda row: log.r95_m[row])[-_MAX_CIRCLES:]
    chosen: list[int] = []
    for row in np.unique([*even.astype(int), *widest]):
        r95_m = log.r95_m[row]
        is_near = np.hypot(*(points[chosen] - points[row]).T) < r95_m / 3
        is_alike = np.abs(log.r95_m[chosen] / r95_m - 1) < 0.2
        if not (is_near & is_alike).any():
            chosen.append(int(row))
    return np.array(chosen, np.intp)
