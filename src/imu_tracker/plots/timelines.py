"""Panels over time: speed, and the radius that was promised beside the error."""

from collections.abc import Sequence
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgba
from numpy.typing import ArrayLike

from imu_tracker.plots.drawing import (
    BLACK,
    BLUE,
    Array,
    Indices,
    envelope,
    legend_above,
    runs,
)
from imu_tracker.plots.logs import MAX_GAP_S, MODES, LogColumns, colours_of
from imu_tracker.recording.scoring import Track, answer
from imu_tracker.samples import Mode

_DAY_S: Final = 86400.0
_LOG_SCALE_FROM: Final = 20.0  # ratio of the largest to the smallest radius


def days_of(logs: Sequence[LogColumns]) -> tuple[float, float]:
    """Return first and last day of the logs with a margin, also for a single row."""
    begin_s = min(log.track.utc_s[0] for log in logs)
    end_s = max(log.track.utc_s[-1] for log in logs)
    margin_s = max(0.01 * (end_s - begin_s), 1.0)
    return (begin_s - margin_s) / _DAY_S, (end_s + margin_s) / _DAY_S


def draw_speed(panel: Axes, logs: Sequence[LogColumns]) -> None:
    """Draw the speed of each log, in m/s and in km/h."""
    for log, colour in zip(logs, colours_of(logs, alone=BLACK), strict=True):
        shown = envelope(log.speed_mps)
        values = _broken(log, log.speed_mps, shown)
        panel.plot(_days(log.track.utc_s[shown]), values, color=colour, lw=1.1)
    panel.set_ylim(0, max(1.0, *(1.15 * log.speed_mps.max() for log in logs)))
    panel.set_ylabel("speed, m/s")
    kmh = panel.secondary_yaxis("right", functions=(_to_kmh, _from_kmh))
    kmh.set_ylabel("km/h")


def draw_radius(panel: Axes, logs: Sequence[LogColumns], truth: Track | None) -> None:
    """Draw r95 and, where the truth is known, the error."""
    is_alone = len(logs) == 1
    for log, colour in zip(logs, colours_of(logs, alone=BLUE), strict=True):
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


def shade_modes(panel: Axes, log: LogColumns) -> None:
    """Draw the modes as a strip along the top, and dead reckoning all the way down."""
    utc_s = log.track.utc_s
    days = _days(utc_s)
    # A mode lasts until the next row, unless there is none for long.
    follows = np.append(np.diff(utc_s) <= MAX_GAP_S, False)
    ends = np.where(follows, np.append(days[1:], days[-1]), days)
    for mode, (colour, _) in MODES.items():
        bars = [
            (days[start], ends[stop - 1] - days[start])
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
    after_a_gap = np.flatnonzero(np.diff(log.track.utc_s) > MAX_GAP_S) + 1
    taken[np.searchsorted(shown, after_a_gap).clip(max=len(shown) - 1)] = np.nan
    return taken


def _days(utc_s: Array) -> Array:
    """Return matplotlib's dates: days since 1970."""
    return utc_s / _DAY_S


def _to_kmh(mps: ArrayLike) -> ArrayLike:
    return np.multiply(mps, 3.6)


def _from_kmh(kmh: ArrayLike) -> ArrayLike:
    return np.divide(kmh, 3.6)
