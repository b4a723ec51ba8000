"""The thesis's figures: the path, and the errors in x and y over time.

x is north and y east. One picture for each figure and each walk; the rows are what the
thesis varies. Where its algorithm diverges, its path leaves the frame, which is drawn
round the truth, and the errors are on a scale that is linear up to a metre only.
"""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Picture

from benchmarks.seeds import ours, samples, thesis, walks
from benchmarks.seeds.measure import Array, its_measure, mean_distance_m
from imu_tracker.exports.palette import BLACK, BLUE, ORANGE, VERMILION
from imu_tracker.simulation.scenarios import START_STILL_S

_DPI: Final = 100
_COLOURS: Final = {
    "the thesis's algorithm": VERMILION,
    "six-state": ORANGE,
    "error-state": BLUE,
}

Tracks = Mapping[str, tuple[Array, Array, Array]]
"""By contestant: seconds, track and truth of the same instants, shape (n, 2)."""


def draw_all(folder: Path) -> Iterator[Path]:
    """Draw everything with seed 0; yield the pictures as they are written."""
    folder.mkdir(parents=True, exist_ok=True)
    for name in samples.FIGURES:
        rows = {case: _figure_tracks(name, case) for case in _CASES}
        title = f"{name} of unit size: square root of the mean distance in brackets"
        path = folder / f"figure-{name.lower()}.png"
        yield _draw(rows, title, path, is_unit=True)
    for course in walks.COURSES:
        rows = {
            f"a fix every {every_s} s": _walk_tracks(course, every_s)
            for every_s in walks.EVERY_S
        }
        title = f"{course}, fixes 1 m off: mean distance in metres in brackets"
        path = folder / f"walk-{course.replace(', ', '-').replace(' ', '-')}.png"
        yield _draw(rows, title, path, is_unit=False)


_CASES: Final = ("without noise, turning", "with noise", "with filter", "R = 0")


def _figure_tracks(name: str, case: str) -> Tracks:
    turns = case == "without noise, turning"
    told = samples.figure(name, 1, has_noise=not turns, turns=turns)
    t_s: Array = told.h_s * np.arange(len(told.ne_m), dtype=np.float64)
    fixes = samples.fixes(told, 0.0) if case in ("with filter", "R = 0") else None
    alone = None if fixes is None else fixes[0]
    is_exact = case == "R = 0"
    fix_at = None if fixes is None else told.fix_at
    sigma_m = ours.EXACT_SIGMA_M if is_exact else 1.0
    its = thesis.run(told, fixes, fix_at, 0.0 if is_exact else 1.0).ne_m[0]
    return {
        "the thesis's algorithm": (t_s, its, told.ne_m),
        "six-state": (t_s, ours.six_state(told, 0, alone, sigma_m), told.ne_m),
        "error-state": (t_s, ours.error_state(told, 0, alone, sigma_m), told.ne_m),
    }


def _walk_tracks(course: str, every_s: int) -> Tracks:
    told = walks.by_tablet(course, 1)
    its, _ = walks.by_the_thesis(told, every_s, 1.0)
    t_s: Array = (
        START_STILL_S + np.arange(len(told.ne_m), dtype=np.float64) / walks.RATE_HZ
    )
    tracks = {"the thesis's algorithm": (t_s, its.ne_m[0], told.ne_m)}
    for estimator in ("six-state", "error-state"):
        walked = walks.by_imu_tracker(course, every_s, estimator, 0)
        tracks[estimator] = walked.t_s, walked.ne_m, walked.truth_ne_m
    return tracks


def _draw(rows: Mapping[str, Tracks], title: str, path: Path, *, is_unit: bool) -> Path:
    picture = Picture(figsize=(14, 4.8 * len(rows)), layout="constrained")
    panels = picture.subplots(len(rows), 3, squeeze=False)
    picture.suptitle(title, fontsize=13)
    for (case, tracks), (place, *errors) in zip(rows.items(), panels, strict=True):
        _draw_place(place, tracks, is_unit=is_unit)
        place.set_title(case)
        for axis, (name, panel) in enumerate(zip("xy", errors, strict=True)):
            _draw_error(panel, tracks, axis, is_unit=is_unit)
            panel.set_title(f"error in {name}")
    picture.savefig(path, dpi=_DPI)
    return path


def _draw_place(panel: Axes, tracks: Tracks, *, is_unit: bool) -> None:
    truth = next(iter(tracks.values()))[2]
    panel.plot(truth[:, 1], truth[:, 0], color=BLACK, lw=3, alpha=0.3, label="truth")
    for name, (_, ne_m, truth_ne_m) in tracks.items():
        off = (its_measure if is_unit else mean_distance_m)(ne_m, truth_ne_m)
        label = f"{name} ({off:.2g})"
        shown = np.clip(ne_m, -1e4, 1e4)
        panel.plot(shown[:, 1], shown[:, 0], color=_COLOURS[name], lw=1, label=label)
    middle = 0.5 * (truth.min(axis=0) + truth.max(axis=0))
    half = 0.75 * max(np.ptp(truth, axis=0).max(), 1.0)
    panel.set_xlim(middle[1] - half, middle[1] + half)
    panel.set_ylim(middle[0] - half, middle[0] + half)
    panel.set_aspect("equal")
    panel.set(xlabel="y (east), m", ylabel="x (north), m")
    panel.grid(alpha=0.3)
    panel.legend(
        fontsize="small",
        loc="upper center",
        bbox_to_anchor=(0.5, -0.16),
        ncols=2,
        frameon=False,
    )


def _draw_error(panel: Axes, tracks: Tracks, axis: int, *, is_unit: bool) -> None:
    largest = 0.0
    for name, (t_s, ne_m, truth_ne_m) in tracks.items():
        off_m = ne_m[:, axis] - truth_ne_m[:, axis]
        largest = max(largest, float(np.abs(off_m).max()))
        panel.plot(t_s, off_m, color=_COLOURS[name], lw=1, label=name)
    linear_m = 0.01 if is_unit else 1.0
    if largest > 20.0 * linear_m:
        panel.set_yscale("symlog", linthresh=linear_m)
    panel.set(xlabel="time, s", ylabel="error, m")
    panel.grid(alpha=0.3)
