"""A receiver that sends more than its line carries."""

import math
from collections.abc import Callable

import numpy as np
import pytest

from imu_tracker.estimation.receiver.backlog import Backlog
from imu_tracker.samples import UtcTime
from support.fixes import fix

S = 1_000_000_000


def relieved(lags: Callable[[float], float], seconds: int, hz: int) -> Backlog:
    """Hear epochs with a lag that depends on time; each is dated right or left."""
    backlog = Backlog()
    rng = np.random.default_rng(3)
    for number in range(seconds * hz):
        t_s = number / hz
        lag_s = lags(t_s) + rng.normal(0.0, 0.02)
        (told,) = backlog.relieved([fix(t_s, lag_s=lag_s)])
        if backlog.counters["overdue_epochs"]:
            assert told.t_ns / S - t_s == pytest.approx(0.2, abs=0.1)
    return backlog


def test_epochs_that_come_later_and_later_are_dated_by_the_freshest() -> None:
    backlog = relieved(lambda t_s: 0.2 + max(0.0, t_s - 10.0) * 0.5, 40, 10)
    assert backlog.counters["overdue_epochs"] > 270
    (notice,) = backlog.take_notices()
    assert "more than its line carries" in notice


def test_a_backlog_that_is_worked_off_is_told() -> None:
    def lag_s(t_s: float) -> float:
        return 0.2 + min(max(0.0, t_s - 10.0), max(0.0, 30.0 - t_s)) * 0.3

    backlog = relieved(lag_s, 60, 5)
    assert len(backlog.take_notices()) == 2


@pytest.mark.parametrize(
    "lag_s",
    [
        lambda t_s: 0.2,
        lambda t_s: 0.2 + 1e-4 * t_s,
        lambda t_s: 0.2 + (1.0 if t_s > 20 else 0.0),
        lambda t_s: 0.2 + (3600.0 if t_s > 20 else 0.0),
        lambda t_s: 0.8 + 0.4 * math.sin(t_s / 9.0),
        lambda t_s: max(0.2, 5.2 - t_s * 0.5),
    ],
    ids=["none", "a clock", "leap second", "an hour", "moody", "an old buffer"],
)
def test_other_reasons_to_come_late_are_left_alone(
    lag_s: Callable[[float], float],
) -> None:
    backlog = relieved(lag_s, 120, 1)
    assert backlog.counters["overdue_epochs"] == 0


def test_a_time_without_a_place_counts_as_well() -> None:
    backlog = Backlog()
    for number in range(20):
        t_ns = round((0.1 * number + 0.06 * number) * S)
        backlog.relieved([UtcTime(t_ns, 1.8e9 + 0.1 * number)])
    assert backlog.counters["overdue_epochs"] > 8


def test_a_fix_without_a_date_passes() -> None:
    undated = fix(1.0)._replace(utc_s=None)
    assert Backlog().relieved([undated]) == [undated]
