"""Bins of a value over time."""

import pytest

from imu_tracker.report.measures.series import Series


def test_the_bins_stay_few_and_hold_every_extreme() -> None:
    series = Series(limit=10)
    for i in range(1000):
        series.add(float(i), 5.0 if i == 777 else float(i % 2))
    bins = series.bins()
    assert len(bins) <= 10
    assert series.width_s == 128.0
    assert max(one.greatest for one in bins) == 5.0
    assert {one.least for one in bins} == {0.0}


def test_the_mean_is_that_of_the_values_however_often_the_bins_widened() -> None:
    series = Series(limit=4)
    for i in range(16):
        series.add(float(i), float(i))
    means = [one.mean for one in series.bins()]
    assert means == pytest.approx([1.5, 5.5, 9.5, 13.5])
    assert [one.t_s for one in series.bins()] == [2.0, 6.0, 10.0, 14.0]


def test_a_time_without_values_has_no_bin() -> None:
    series = Series()
    series.add(1.0, 1.0)
    series.add(50.0, 2.0)
    assert [one.t_s for one in series.bins()] == [1.5, 50.5]
