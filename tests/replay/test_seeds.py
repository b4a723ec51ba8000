"""The seeds' experiments, small: ours within the bounds, theirs astray as printed."""

from concurrent.futures import Executor, Future
from typing import Any

import numpy as np
import pytest
from benchmarks.seeds import ahead, printed, samples, tables, thesis, walks
from benchmarks.seeds.measure import its_measure

SEEDS = 2
FIGURES = tuple(samples.FIGURES)
EXACT_BOUNDS = {"square": 0.03, "circle": 0.03, "Lissajous": 0.06}


class Here(Executor):
    """Runs everything at once, in this process."""

    def submit(self, fn: Any, /, *args: Any, **kwargs: Any) -> Future[Any]:
        done: Future[Any] = Future()
        done.set_result(fn(*args, **kwargs))
        return done


@pytest.mark.parametrize("name", FIGURES)
def test_without_noise_ours_return_to_the_thousand_points(name: str) -> None:
    for case in ("without noise", "without noise, turning"):
        _, _, *ours = tables.figure_cells(case, name, 1)
        assert max(cell for cell in ours if cell is not None) <= 0.001


@pytest.mark.parametrize("name", FIGURES)
def test_with_noise_ours_are_twice_as_near_as_printed(name: str) -> None:
    _, _, *ours = tables.figure_cells("with noise", name, SEEDS)

    bound = 0.5 * printed.FIGURES["with noise"][name]
    assert all(cell is not None and 0.0 < cell <= bound for cell in ours)


@pytest.mark.parametrize("name", FIGURES)
def test_exact_fixes_hold_our_filters(name: str) -> None:
    _, _, *ours = tables.figure_cells("R = 0", name, SEEDS)

    assert all(cell is not None and cell <= EXACT_BOUNDS[name] for cell in ours)


@pytest.mark.parametrize("name", FIGURES)
def test_the_samples_are_of_a_body_that_flies_through_the_points(name: str) -> None:
    told = samples.figure(name, 1, has_noise=False)

    # An oracle of its own: the formula of constant acceleration, interval by interval.
    a_ne, h_s = told.f_b[0, :, :2], told.h_s
    v_ne = told.start_v_n[:2] + h_s * np.cumsum(a_ne, axis=0)
    v_ne = np.vstack([told.start_v_n[:2], v_ne[:-1]])
    steps = h_s * v_ne + 0.5 * h_s**2 * a_ne
    np.testing.assert_allclose(steps[:-1], np.diff(told.ne_m, axis=0), atol=1e-12)
    # And smoothly: the accelerations are those of the path, not a saw.
    assert np.abs(np.diff(a_ne[:-1], n=2, axis=0)).max() < 0.02


@pytest.mark.parametrize(("name", "within"), [("circle", 0.15), ("Lissajous", 0.15)])
def test_the_thesis_on_its_own_samples_errs_as_it_prints(
    name: str, within: float
) -> None:
    told = samples.figure_as_in_the_thesis(name)
    found = its_measure(thesis.run(told).ne_m[0], told.ne_m)

    assert found == pytest.approx(printed.FIGURES["without noise"][name], rel=within)


def test_the_thesis_goes_astray_when_the_tablet_turns() -> None:
    its, *_ = tables.figure_cells("without noise, turning", "circle", 1)

    assert its is not None
    assert its > 1.0


def test_the_thesis_diverges_on_the_roundabout_as_it_prints() -> None:
    told = walks.by_tablet("roundabout, walked", 1)
    found = {
        (every_s, R): walks.against_gps_m(*walks.by_the_thesis(told, every_s, R))
        for every_s, R in ((3, 1.0), (1, 0.0), (3, 0.0))
    }

    assert found[3, 1.0] > 1e9  # printed: 1.6e16
    assert found[1, 0.0] < 1e-15  # 4e-17: it is where the fix says
    assert found[3, 0.0] > 1e50  # 1.1e89


@pytest.mark.parametrize("estimator", tables.ESTIMATORS)
def test_a_walk_with_white_errors_stays_within_its_bound(estimator: str) -> None:
    walked = walks.by_imu_tracker("straight line", 5, estimator, 0)

    assert walked.t_s[0] == walks.WARM_UP_S
    assert np.mean(walked.error_m) <= 1.5


def test_predictions_beat_the_polynomial_and_hold_their_radius() -> None:
    looks = ahead.look("walk-square", 0)

    for after_s in (5.0, 10.0, 30.0):
        _, error_m, r95_m, short_m, long_m = looks[looks[:, 0] == after_s].T
        assert np.median(error_m) < min(np.median(short_m), np.median(long_m))
        assert np.mean(error_m <= r95_m) >= 0.93


def test_the_table_of_the_figures_has_a_row_for_each_case() -> None:
    lines = list(tables.figure_table(1, Here()))
    rows = [line for line in lines if line.startswith("|")][2:]

    assert len(rows) == len(tables.CASES) * len(FIGURES)
    assert {line.count("|") for line in rows} == {8}
    assert "0.0303" in next(row for row in rows if row.startswith("| R = 0 | square"))


@pytest.mark.acceptance
@pytest.mark.parametrize("every_s", walks.EVERY_S)
@pytest.mark.parametrize("course", walks.COURSES)
def test_all_walks_with_white_errors_stay_within_their_bound(
    course: str, every_s: int
) -> None:
    found = [
        np.mean(walks.by_imu_tracker(course, every_s, "error-state", seed).error_m)
        for seed in range(10)
    ]

    assert np.mean(found) <= 1.5
