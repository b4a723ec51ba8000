"""The tables: every contestant on every figure and walk, beside what was printed."""

from collections.abc import Callable, Iterator
from concurrent.futures import Executor
from functools import partial

import numpy as np

from benchmarks.seeds import ahead, ours, printed, report_b, samples, thesis, walks
from benchmarks.seeds.measure import Array, its_measure, mean_distance_m

ESTIMATORS = ("six-state", "error-state")

# ------------------------------------------------------------------- the simulations


def figure_table(n_seeds: int, pool: Executor) -> Iterator[str]:
    """Errors on the figures in the thesis's measure, mean of the seeds."""
    yield f"Figures of unit size, square root of the mean distance, {n_seeds} seeds"
    yield ""
    yield (
        "| samples | figure | printed | the thesis's algorithm | the report's "
        "| six-state | error-state |"
    )
    yield f"|{' --- |' * 7}"
    rows = [(case, name) for case in CASES for name in samples.FIGURES]
    found = pool.map(partial(figure_cells, n_seeds=n_seeds), *zip(*rows, strict=True))
    for (case, name), cells in zip(rows, found, strict=True):
        told = printed.FIGURES.get(case.removeprefix("its own, "), {}).get(name)
        texts = ["" if cell is None else _measure_text(cell) for cell in (told, *cells)]
        yield f"| {case} | {name} | {' | '.join(texts)} |"


Cells = tuple[float | None, float | None, float | None, float | None]
"""The thesis's algorithm, the report's, six-state, error-state."""


def figure_cells(case: str, name: str, n_seeds: int) -> Cells:
    """Run all contestants on a figure."""
    return CASES[case](name, n_seeds)


def _own_samples(name: str, n_seeds: int, *, has_noise: bool) -> Cells:
    told = samples.figure_as_in_the_thesis(name, n_seeds, has_noise=has_noise)
    return _mean(thesis.run(told).ne_m, told.ne_m), None, None, None


def _reckoned(name: str, n_seeds: int, *, has_noise: bool, turns: bool) -> Cells:
    n_seeds = n_seeds if has_noise else 1
    told = samples.figure(name, n_seeds, has_noise=has_noise, turns=turns)
    by_b = []
    for seed in range(n_seeds):
        at, ne_m = report_b.run(told, seed)
        by_b.append(its_measure(ne_m, told.ne_m[at]))
    return (
        _mean(thesis.run(told).ne_m, told.ne_m),
        float(np.mean(by_b)),
        _mean([ours.six_state(told, seed) for seed in range(n_seeds)], told.ne_m),
        _mean([ours.error_state(told, seed) for seed in range(n_seeds)], told.ne_m),
    )


def _filtered(name: str, n_seeds: int, *, R: float, sigma_m: float) -> Cells:
    told = samples.figure(name, n_seeds, has_noise=True)
    fixes = samples.fixes(told, 0.0)

    def tracks(run: Callable[..., Array]) -> list[Array]:
        return [run(told, seed, fixes[seed], sigma_m) for seed in range(n_seeds)]

    return (
        _mean(thesis.run(told, fixes, told.fix_at, R).ne_m, told.ne_m),
        None,
        _mean(tracks(ours.six_state), told.ne_m),
        _mean(tracks(ours.error_state), told.ne_m),
    )


CASES: dict[str, Callable[[str, int], Cells]] = {
    "its own, without noise": partial(_own_samples, has_noise=False),
    "its own, with noise": partial(_own_samples, has_noise=True),
    "without noise": partial(_reckoned, has_noise=False, turns=False),
    "without noise, turning": partial(_reckoned, has_noise=False, turns=True),
    "with noise": partial(_reckoned, has_noise=True, turns=False),
    "with filter": partial(_filtered, R=1.0, sigma_m=1.0),
    "R = 0": partial(_filtered, R=0.0, sigma_m=ours.EXACT_SIGMA_M),
}


def _mean(tracks: Array | list[Array], truth_ne_m: Array) -> float:
    return float(np.mean([its_measure(track, truth_ne_m) for track in tracks]))


def _measure_text(value: float) -> str:
    return f"{value:.4f}" if value >= 1e-4 else f"{value:.0e}"


# ------------------------------------------------------------------------- the walks


def walk_table(n_seeds: int, pool: Executor) -> Iterator[str]:
    """Errors on the walks in metres, mean of the seeds."""
    yield f"Walks, average error in m, {n_seeds} seeds"
    yield ""
    yield (
        "| walk | a fix every | printed, R = 1 | the thesis's algorithm "
        "| printed, R = 0 | the thesis's algorithm | six-state | error-state |"
    )
    yield f"|{' --- |' * 8}"
    runs = [
        (course, every_s, estimator, seed)
        for course in walks.COURSES
        for every_s in walks.EVERY_S
        for estimator in ESTIMATORS
        for seed in range(n_seeds)
    ]
    walked = pool.map(_walk_figures, *zip(*runs, strict=True))
    by_its = pool.map(partial(_its_walks, n_seeds=n_seeds), walks.COURSES)
    figures = dict(zip(runs, walked, strict=True))
    for course, (alone_m, b_m, its) in zip(walks.COURSES, by_its, strict=True):
        for every_s, (r1, r0) in zip(walks.EVERY_S, its, strict=True):
            number = walks.EVERY_S.index(every_s)
            cells = [
                _metres(printed.WALKS_R1.get(course, ())[number : number + 1]),
                _metres((r1,)),
                _metres(printed.WALKS_R0.get(course, ())[number : number + 1]),
                _metres((r0,)),
            ]
            for estimator in ESTIMATORS:
                key = course, every_s, estimator
                mean_m, rms_m, inside = np.mean(
                    [figures[*key, seed] for seed in range(n_seeds)], axis=0
                )
                cells.append(f"{mean_m:.2f} (rms {rms_m:.2f}, {inside:.0%})")
            yield f"| {course} | {every_s} s | {' | '.join(cells)} |"
        yield (
            f"| {course} | never | | {_metres((alone_m,))} at the end "
            f"| | the report's: {_metres((b_m,))} | | |"
        )


def _walk_figures(
    course: str, every_s: int, estimator: str, seed: int
) -> tuple[float, float, float]:
    walked = walks.by_imu_tracker(course, every_s, estimator, seed)
    error_m = walked.error_m
    rms_m = float(np.sqrt(np.mean(error_m**2)))
    inside = float(np.mean(error_m <= walked.r95_m))
    return float(np.mean(error_m)), rms_m, inside


def _its_walks(
    course: str, n_seeds: int
) -> tuple[float, float, list[tuple[float, float]]]:
    """Without fixes, the report's, and by interval with R = 1 and R = 0."""
    told = walks.by_tablet(course, n_seeds)
    alone = thesis.run(told)
    found = []
    for every_s in walks.EVERY_S:
        r1, r0 = (
            walks.against_gps_m(*walks.by_the_thesis(told, every_s, R))
            for R in (1.0, 0.0)
        )
        found.append((r1, r0))
    end_m = mean_distance_m(alone.ne_m[:, -1], told.ne_m[-1])
    return end_m, walks.by_the_report(told), found


def _metres(values: tuple[float, ...]) -> str:
    if not values:
        return ""
    (value,) = values
    return f"{value:.0f}" if 10.0 <= value < 1e5 else f"{value:.2g}"


# ------------------------------------------------------------------ where will it be


def ahead_table(n_seeds: int, pool: Executor) -> Iterator[str]:
    """Errors of the predictions, and of a polynomial through the same rows."""
    yield f"Where will it be: median and 95 % of the error in m, {n_seeds} seeds"
    yield ""
    yield (
        "| course | after | imu-tracker | its median r95, share inside "
        "| polynomial of 5 s | of 10 s |"
    )
    yield f"|{' --- |' * 6}"
    runs = [(course, seed) for course in ahead.COURSES for seed in range(n_seeds)]
    found = list(pool.map(ahead.look, *zip(*runs, strict=True)))
    for course in ahead.COURSES:
        chosen = [f for (c, _), f in zip(runs, found, strict=True) if c == course]
        for after_s, row in ahead.summarise(np.concatenate(chosen)).items():
            yield (
                f"| {course} | {after_s:g} s | {row.error} "
                f"| {row.promise} | {row.short} | {row.long} |"
            )
