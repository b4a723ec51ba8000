"""A gate that keeps wild fixes out and cannot lock out."""

import math

import pytest

from imu_tracker.estimation.receiver.gate import (
    AGREEING_FIXES,
    AGREEING_S,
    NIS_LIMIT,
    Gate,
)
from imu_tracker.geometry.geodesy import LocalFrame
from imu_tracker.samples import GpsFix

HERE = LocalFrame.at(0.9, 0.1)


def fix(
    t_s: float,
    north_m: float = 0.0,
    east_m: float = 0.0,
    vel: tuple[float, float] | None = (0.0, 0.0),
    sigma_m: float = 2.0,
) -> GpsFix:
    lat, lon = HERE.to_lat_lon(north_m, east_m)
    return GpsFix(round(t_s * 1e9), 1e9 + t_s, lat, lon, None, vel, sigma_m, 1)


def rejections_until_restart(gate: Gate, fixes: list[GpsFix]) -> int | None:
    for n, one in enumerate(fixes, 1):
        if gate.reject(one):
            return n
    return None


def test_what_fits_passes() -> None:
    gate = Gate("free")
    assert gate.passes(0.0)
    assert gate.passes(NIS_LIMIT)
    assert not gate.passes(NIS_LIMIT + 1e-9)
    assert not gate.passes(math.nan)


@pytest.mark.parametrize("period_s", [0.1, 0.2, 1.0, 2.0, 5.0])
@pytest.mark.parametrize("has_velocity", [True, False])
def test_a_receiver_that_is_right_is_not_ignored_for_long(
    period_s: float, has_velocity: bool
) -> None:
    gate = Gate("vehicle")
    fixes = [
        fix(
            k * period_s, 12.0 * k * period_s, vel=(12.0, 0.0) if has_velocity else None
        )
        for k in range(40)
    ]
    n = rejections_until_restart(gate, fixes)
    assert n is not None
    waited_s = (n - 1) * period_s
    assert n <= AGREEING_FIXES
    assert waited_s <= max(AGREEING_S, 2 * period_s)


def test_a_slow_receiver_needs_three() -> None:
    gate = Gate("free")
    assert rejections_until_restart(gate, [fix(60.0 * k) for k in range(9)]) == 3


def test_wild_fixes_that_do_not_agree_are_never_believed() -> None:
    gate = Gate("vehicle")
    fixes = [fix(k, 500.0 * (k % 2), vel=(0.0, 0.0)) for k in range(100)]
    assert rejections_until_restart(gate, fixes) is None


def test_a_jump_that_nothing_can_travel_is_no_agreement() -> None:
    gate = Gate("walker")
    fixes = [fix(k, 100.0 * k, vel=None) for k in range(50)]
    assert rejections_until_restart(gate, fixes) is None


def test_a_cluster_of_seven_does_not_capture_the_filter() -> None:
    gate = Gate("vehicle")
    for k in range(AGREEING_FIXES - 1):
        assert not gate.reject(fix(k, 300.0))
    assert gate.passes(1.0)  # the good ones are back
    assert gate.n_agreeing == 0
    for k in range(AGREEING_FIXES - 1):
        assert not gate.reject(fix(20 + k, 300.0))


def test_one_that_disagrees_begins_a_new_run() -> None:
    gate = Gate("vehicle")
    for k in range(5):
        gate.reject(fix(k, 300.0))
    gate.reject(fix(5, -300.0))
    assert gate.n_agreeing == 1


def test_a_position_that_stands_while_the_receiver_moves_is_frozen() -> None:
    gate = Gate("vehicle")
    assert not gate.is_frozen(fix(0, 10.0), 12.0)
    assert gate.is_frozen(fix(1, 10.0), 12.0)
    assert not gate.is_frozen(fix(2, 10.0), 0.2)
    assert not gate.is_frozen(fix(3, 22.0), 12.0)


def test_a_place_that_was_driven_away_from_is_still_frozen_at_the_stop() -> None:
    gate = Gate("vehicle")
    speeds = [16.0] * 5 + [0.0] * 60
    frozen = [gate.is_frozen(fix(k, vel=(v, 0.0)), v) for k, v in enumerate(speeds)]
    assert frozen == [False] + [True] * 64
    assert not gate.is_frozen(fix(65, north_m=80.0), 0.0)


def test_a_place_that_is_held_while_braking_is_believed_at_the_stop() -> None:
    gate = Gate("vehicle")
    speeds = [3.0, 2.0, 1.0] + [0.0] * 60
    frozen = [gate.is_frozen(fix(k, vel=(v, 0.0)), v) for k, v in enumerate(speeds)]
    assert frozen == [False, True] + [False] * 61
