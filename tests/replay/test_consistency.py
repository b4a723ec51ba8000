"""The radius keeps its promise over many simulated drives, whose path is known exactly.

Rows of one drive are not independent, and bounds follow from what is: with GPS one
error in twice the time over which the simulated receiver's errors last (the integral
of their correlation, both ways), in the dark one in each outage.
"""

from collections.abc import Sequence
from functools import cache
from math import sqrt
from statistics import NormalDist
from typing import Final

import numpy as np
import pytest
from benchmarks.consistency import FIRST_SEED, Drive, nees, pooled, run

from imu_tracker.simulation.receiver.receiver import TYPICAL_RECEIVER

ROWS_PER_S: Final = 4.0
ONE_IN_A_THOUSAND: Final = -NormalDist().inv_cdf(0.001)

MAX_ERROR_PER_R95: Final = NormalDist().inv_cdf(1.0 - 0.5e-6) / 1.96
"""Along a line r95 is 1.96 sigma: a normal error is beyond this once in a million."""


def chi_square_mean(n: float, z: float) -> float:
    """Quantile of a mean of `n` squares of normal numbers (Wilson, Hilferty 1931)."""
    return (1.0 - 2.0 / (9.0 * n) + z * sqrt(2.0 / (9.0 * n))) ** 3


def independent_errors(drives: Sequence[Drive], *, is_dark: bool) -> float:
    if is_dark:
        return sum(len(drive.outages) for drive in drives)
    n_rows = sum(int((~drive.is_dark).sum()) for drive in drives)
    return n_rows / ROWS_PER_S / (2.0 * TYPICAL_RECEIVER.slow_tau_s)


def assert_inside(drives: Sequence[Drive], *, is_dark: bool, least: float) -> None:
    error_m, r95_m = pooled(drives, is_dark=is_dark)
    assert np.mean(error_m <= r95_m) >= least


def assert_nees(drives: Sequence[Drive], *, is_dark: bool) -> None:
    # A covariance that is true has 2 when it is round and 6 / 3.84 = 1.56 when it is a
    # line; a round one has two squares in each error.
    n_squares = independent_errors(drives, is_dark=is_dark) * (1 if is_dark else 2)
    least = 1.56 * chi_square_mean(n_squares, -ONE_IN_A_THOUSAND)
    most = 2.0 * chi_square_mean(n_squares, ONE_IN_A_THOUSAND)
    assert least <= nees(*pooled(drives, is_dark=is_dark)) <= most


def assert_nis(drives: Sequence[Drive]) -> None:
    """Two, as long as it moves; at rest fixes count for less, on purpose.

    Real antennas at rest repeat their errors, the simulated one does not: there the
    filter expects more than comes, and the mean lies below 2 by at most the share of
    time at rest.
    """
    n_fixes = sum(drive.n_fixes for drive in drives)
    mean = np.average(
        [drive.nis_mean for drive in drives], weights=[d.n_fixes for d in drives]
    )
    moving = 1.0 - np.mean([drive.resting for drive in drives])
    least = 2.0 * moving * chi_square_mean(2.0 * n_fixes, -ONE_IN_A_THOUSAND)
    assert least <= mean <= 2.0 * chi_square_mean(2.0 * n_fixes, ONE_IN_A_THOUSAND)


def assert_none_diverges(drives: Sequence[Drive]) -> None:
    for drive in drives:
        worst = np.max(drive.error_m / drive.r95_m)
        assert worst <= MAX_ERROR_PER_R95, f"seed {drive.seed}: {worst:.2f} r95 off"
        assert drive.answered > 0.99, f"seed {drive.seed}"


def least_inside(drives: Sequence[Drive], *, is_dark: bool) -> float:
    """What a true radius falls below with as many errors once in a thousand times."""
    n = independent_errors(drives, is_dark=is_dark)
    return 0.95 - ONE_IN_A_THOUSAND * sqrt(0.95 * 0.05 / n)


def with_radii(drives: Sequence[Drive], factor: float) -> list[Drive]:
    return [drive._replace(r95_m=factor * drive.r95_m) for drive in drives]


def test_over_ten_drives_the_radius_is_true() -> None:
    drives = [run(seed, 400.0) for seed in range(FIRST_SEED, FIRST_SEED + 10)]

    for is_dark in (False, True):
        least = least_inside(drives, is_dark=is_dark)
        assert_inside(drives, is_dark=is_dark, least=least)
        assert_nees(drives, is_dark=is_dark)
        # The bounds see a radius that is wrong by two; in the dark, where it is wider
        # than need be (below), by three downwards.
        narrow = with_radii(drives, 1.0 / 3.0 if is_dark else 0.5)
        with pytest.raises(AssertionError):
            assert_inside(narrow, is_dark=is_dark, least=least)
        with pytest.raises(AssertionError):
            assert_nees(with_radii(drives, 2.0), is_dark=is_dark)
    assert_nis(drives)
    assert_none_diverges(drives)


@cache
def hundred() -> list[Drive]:
    return [run(seed) for seed in range(FIRST_SEED, FIRST_SEED + 100)]


@pytest.mark.acceptance
def test_over_a_hundred_drives_the_radius_is_true_with_gps() -> None:
    error_m, r95_m = pooled(hundred(), is_dark=False)
    assert 0.93 <= np.mean(error_m <= r95_m) <= 0.97
    assert_nees(hundred(), is_dark=False)
    assert_nis(hundred())


@pytest.mark.acceptance
def test_over_a_hundred_drives_the_radius_is_wide_enough_in_the_dark() -> None:
    assert_inside(hundred(), is_dark=True, least=0.93)
    assert all(drive.answered > 0.99 for drive in hundred())


@pytest.mark.acceptance
@pytest.mark.xfail(strict=True, reason="99.5 % are inside, NEES 0.7: too cautious")
def test_over_a_hundred_drives_the_radius_is_no_wider_than_need_be_in_the_dark() -> (
    None
):
    assert_nees(hundred(), is_dark=True)
    error_m, r95_m = pooled(hundred(), is_dark=True)
    assert np.mean(error_m <= r95_m) <= 0.97


@pytest.mark.acceptance
def test_over_a_hundred_drives_none_diverges() -> None:
    assert_none_diverges(hundred())
