"""A receiver that holds its place while it stands, and follows late."""

import math

from imu_tracker.estimation.error_state.receiver_model import ReceiverModel
from imu_tracker.estimation.receiver.fix_period import FixPeriod
from imu_tracker.estimation.tuning import CATCHING_UP_S, HOLDING_S
from imu_tracker.samples import GpsFix


def fix_at(t_s: float, lat_deg: float) -> GpsFix:
    return GpsFix(
        t_ns=round(t_s * 1e9),
        utc_s=None,
        lat_rad=math.radians(lat_deg),
        lon_rad=0.1,
        alt_m=None,
        vel_ne_mps=(0.0, 0.0),
        sigma_h_m=3.0,
        quality=1,
    )


def held(seconds: float) -> ReceiverModel:
    receiver = ReceiverModel(FixPeriod())
    for t_s in range(round(seconds) + 1):
        receiver.add_fix(fix_at(t_s, 50.0))
    return receiver


def test_a_place_that_is_repeated_is_held_while_the_body_moves() -> None:
    receiver = held(HOLDING_S + 2.0)
    assert receiver.is_catching_up
    receiver.is_resting = True
    assert not receiver.is_catching_up


def test_a_place_that_is_repeated_for_some_seconds_is_not_held() -> None:
    assert not held(HOLDING_S - 1.0).is_catching_up


def test_a_receiver_that_moves_again_has_caught_up_after_some_seconds() -> None:
    start_s = HOLDING_S + 2.0
    receiver = held(start_s)
    caught_up = []
    for k in range(1, round(CATCHING_UP_S) + 2):
        receiver.add_fix(fix_at(start_s + k, 50.0 + 1e-5 * k))
        caught_up.append(not receiver.is_catching_up)
    assert caught_up == [False] * (round(CATCHING_UP_S) - 1) + [True, True]
