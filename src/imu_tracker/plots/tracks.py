"""The picture of a lat/long log: the map, and speed and error radius over time."""

import itertools
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import EllipseCollection, LineCollection
from matplotlib.colors import to_rgba
from matplotlib.dates import AutoDateLocator, ConciseDateFormatter
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from numpy.typing import ArrayLike, NDArray

from imu_tracker.plots.drawing import (
    BLACK,
    BLUE,
    GREEN,
    MAX_POINTS,
    ORANGE,
    PURPLE,
    SKY,
    VERMILION,
    Array,
    Indices,
    envelope,
    legend_above,
    runs,
    save,
)
from imu_tracker.samples import Mode
from imu_tracker.scoring import Track, answer, metres_per_degree

MODES: Final[Mapping[Mode, tuple[str, str]]] = {
    Mode.GPS: (BLUE, "with GPS"),
    Mode.DR: (VERMILION, "dead reckoning"),
    Mode.STILL: (GREEN, "standing still"),
    Mode.GPSONLY: (PURPLE, "GPS alone"),
}
"""Colour and name."""

_COMPARED: Final = (BLUE, VERMILION, GREEN, PURPLE, ORANGE, SKY)
_MAX_CIRCLES: Final = 60
_MAX_GAP_S: Final = 2.5  # rows further apart are not joined
_DAY_S: Final = 86400.0
_MIN_EXTENT_M: Final = 20.0  # however little a parked tracker moves
_LOG_SCALE_FROM: Final = 20.0  # ratio of the largest to the smallest radius


class LogColumns(NamedTuple):
    """A lat/long log as arrays, shape (n,), n > 0."""

    name: str
    track: Track
    speed_mps: Array
    r95_m: Array
    mode: NDArray[np.str_]


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
    logs = _joined(logs)
    figure = Figure(figsize=(11, 12.5), layout="constrained")
    chart, speed, radius = figure.subplots(3, 1, height_ratios=(3.2, 1, 1))
    radius.sharex(speed)
    _draw_map(chart, logs, truth)
    _draw_speed(speed, logs)
    _draw_radius(radius, logs, truth)
    for panel in (speed, radius):
        if len(logs) == 1:
            _shade_modes(panel, logs[0])
        panel.grid(alpha=0.3)
        panel.set_axisbelow(True)
    panel.set_xlim(*_span(logs))
    locator = AutoDateLocator(minticks=4, maxticks=10)  # type: ignore[no-untyped-call]
    dates = ConciseDateFormatter(locator)  # type: ignore[no-untyped-call]
    radius.xaxis.set_major_locator(locator)
    radius.xaxis.set_major_formatter(dates)
    radius.set_xlabel("UTC")
    speed.tick_params(labelbottom=False)
    save(figure, output)


def _joined(logs: Sequence[LogColumns]) -> Sequence[LogColumns]:
    """Join logs that follow one another; leave those that overlap in time alone."""
    ordered = sorted(logs, key=lambda log: log.track.utc_s[0])
    follows = all(
        before.track.utc_s[-1] < after.track.utc_s[0]
        for before, after in itertools.pairwise(ordered)
    )
    if len(logs) == 1 or not follows:
        return logs
    tracks, *columns = list(zip(*(log[1:] for log in ordered), strict=True))
    return [
        LogColumns(
            f"{ordered[0].name} to {ordered[-1].name}",
            Track(*map(np.concatenate, zip(*tracks, strict=True))),
            *map(np.concatenate, columns),
        )
    ]


def _colours(logs: Sequence[LogColumns], alone: str) -> list[str]:
    """Return one colour for each log; `alone` when there is nothing to compare."""
    if len(logs) == 1:
        return [alone]
    return list(itertools.islice(itertools.cycle(_COMPARED), len(logs)))


# ---- the map ----


def _draw_map(chart: Axes, logs: Sequence[LogColumns], truth: Track | None) -> None:
    origin = logs[0].track
    legend: list[Line2D | Patch] = []
    if truth is not None:
        chart.plot(*_east_north_m(truth, origin), color=BLACK, ls="--", lw=1, zorder=4)
        legend.append(Line2D([], [], color=BLACK, lw=1, ls="--", label="truth"))
    for log, colour in zip(logs, _colours(logs, alone=""), strict=True):
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
    chart.set_title(f"{name}: {_summary(logs[0])}", fontsize=13)
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
    is_joined = np.diff(log.track.utc_s[shown]) <= _MAX_GAP_S * step
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
    circles = _circles(log, points)
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
    # A circle may be larger than all that was driven: the track rules the limits.
    middle = (points.min(axis=0) + points.max(axis=0)) / 2
    half_m = np.maximum(np.ptp(points, axis=0), _MIN_EXTENT_M) / 2
    chart.update_datalim([middle - half_m, middle + half_m])


def _circles(log: LogColumns, points: Array) -> Indices:
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


def _summary(log: LogColumns) -> str:
    """Say when, how long and how far."""
    begin_s, end_s = log.track.utc_s[0], log.track.utc_s[-1]
    step_s = np.diff(log.track.utc_s)
    is_joined = step_s <= _MAX_GAP_S
    distance_m = float(np.sum((step_s * log.speed_mps[1:])[is_joined]))
    far = f"{distance_m:.0f} m" if distance_m < 1000 else f"{distance_m / 1000:.1f} km"
    minutes, seconds = divmod(round(end_s - begin_s), 60)
    hours, minutes = divmod(minutes, 60)
    day = datetime.fromtimestamp(begin_s, UTC).date()
    return f"{day}, {hours}:{minutes:02d}:{seconds:02d} h, {far}"


# ---- over time ----


def _span(logs: Sequence[LogColumns]) -> tuple[float, float]:
    """Return first and last day of the logs with a margin, also for a single row."""
    begin_s = min(log.track.utc_s[0] for log in logs)
    end_s = max(log.track.utc_s[-1] for log in logs)
    margin_s = max(0.01 * (end_s - begin_s), 1.0)
    return (begin_s - margin_s) / _DAY_S, (end_s + margin_s) / _DAY_S


def _draw_speed(panel: Axes, logs: Sequence[LogColumns]) -> None:
    for log, colour in zip(logs, _colours(logs, alone=BLACK), strict=True):
        shown = envelope(log.speed_mps)
        values = _broken(log, log.speed_mps, shown)
        panel.plot(_days(log.track.utc_s[shown]), values, color=colour, lw=1.1)
    panel.set_ylim(0, max(1.0, *(1.15 * log.speed_mps.max() for log in logs)))
    panel.set_ylabel("speed, m/s")
    kmh = panel.secondary_yaxis("right", functions=(_to_kmh, _from_kmh))
    kmh.set_ylabel("km/h")


def _draw_radius(panel: Axes, logs: Sequence[LogColumns], truth: Track | None) -> None:
    is_alone = len(logs) == 1
    for log, colour in zip(logs, _colours(logs, alone=BLUE), strict=True):
        shown = envelope(log.r95_m)
        label = "r95, the promise" if is_alone else log.name
        values = _broken(log, log.r95_m, shown)
        panel.plot(
            _days(log.track.utc_s[shown]), values, color=colour, lw=1.6, label=label
        )
        if truth is None:
            continue
        answers = answer(log.track, log.r95_m, truth)
        error_m = answers.error_m[answers.is_answered]
        days = _days(truth.utc_s[answers.is_answered])
        shown = envelope(error_m)
        panel.plot(
            days[shown],
            error_m[shown],
            color=BLACK if is_alone else colour,
            lw=0.9,
            ls="-" if is_alone else ":",
            label="the error" if is_alone else None,
        )
        if is_alone and len(error_m):
            share = np.mean(error_m <= answers.r95_m[answers.is_answered])
            title = f"{share:.1%} of the truth inside r95"
            panel.set_title(title, fontsize=10, loc="left")
    radii_m = np.concatenate([log.r95_m for log in logs])
    if radii_m.max() > _LOG_SCALE_FROM * radii_m.min():
        panel.set_yscale("log")
        panel.set_ylim(bottom=max(0.05, radii_m.min() / 10))
        panel.yaxis.set_major_formatter("{x:g}")
        panel.yaxis.set_minor_formatter("")
    else:
        panel.set_ylim(bottom=0)
    if truth is None:
        panel.set_ylabel("r95, m")
    else:
        panel.set_ylabel("metres" if is_alone else "r95 and (dots) error, m")
    if truth is not None or not is_alone:
        legend_above(panel)


def _shade_modes(panel: Axes, log: LogColumns) -> None:
    """Draw the modes as a strip along the top, and dead reckoning all the way down."""
    days = _days(log.track.utc_s)
    for mode, (colour, _) in MODES.items():
        bars = [
            (days[start], days[stop - 1] - days[start])
            for start, stop in runs(log.mode == mode)
        ]
        panel.broken_barh(
            bars, (0.95, 0.05), transform=panel.get_xaxis_transform(), color=colour
        )
        if mode is Mode.DR:
            panel.broken_barh(
                bars,
                (0, 0.95),
                transform=panel.get_xaxis_transform(),
                color=to_rgba(colour, 0.13),
                lw=0,
            )


def _broken(log: LogColumns, values: Array, shown: Indices) -> Array:
    """Take the values shown, with a hole where rows are missing."""
    taken = values[shown].copy()
    after_a_gap = np.flatnonzero(np.diff(log.track.utc_s) > _MAX_GAP_S) + 1
    taken[np.searchsorted(shown, after_a_gap).clip(max=len(shown) - 1)] = np.nan
    return taken


def _days(utc_s: Array) -> Array:
    """Return matplotlib's dates: days since 1970."""
    return utc_s / _DAY_S


def _to_kmh(mps: ArrayLike) -> ArrayLike:
    return np.multiply(mps, 3.6)


def _from_kmh(kmh: ArrayLike) -> ArrayLike:
    return np.divide(kmh, 3.6)
