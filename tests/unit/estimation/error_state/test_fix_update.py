"""A fix before the heading is known: gate and correction measure the same thing."""

import math

import numpy as np

from imu_tracker.estimation.error_state.estimator import ErrorState
from imu_tracker.estimation.error_state.states import POSITION, VELOCITY
from imu_tracker.estimation.receiver.gate import FixOutcome
from imu_tracker.geometry.geodesy import LocalFrame
from imu_tracker.samples import GpsFix

HERE = LocalFrame.at(math.radians(52.0), math.radians(4.4))


def fix(north_m: float) -> GpsFix:
    lat_rad, lon_rad = HERE.to_lat_lon(north_m, 0.0)
    return GpsFix(10**9, None, lat_rad, lon_rad, None, (30.0, 0.0), 2.0, 1)


def fast_and_unaligned() -> ErrorState:
    """Make a filter at 30 m/s, sure of its position, whose heading is not known."""
    estimator = ErrorState("vehicle")
    estimator.start(*HERE.to_lat_lon(0.0, 0.0), 1.0)
    for eskf in estimator._bank.filters:
        eskf.nominal = eskf.nominal._replace(v_n=(30.0, 0.0, 0.0))
        eskf.set_variances(POSITION, [1.0, 1.0, 1.0])
        eskf.set_variances(VELOCITY, np.full(3, 0.01))
    return estimator


def test_before_alignment_an_unknown_delay_does_not_open_the_gate() -> None:
    # A delay of 0.4 s (one sigma) is 12 m at 30 m/s: the gate passed 30 m with it, and
    # the correction, which leaves it out, then trusts them to a metre.
    assert fast_and_unaligned()._fixes.update(fix(30.0), 0.0) is FixOutcome.OUTLIER
    assert fast_and_unaligned()._fixes.update(fix(3.0), 0.0) is FixOutcome.ACCEPTED
