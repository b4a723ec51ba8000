"""What a body cannot do, as measurements: signs, sizes, and the soft gate."""

import math

import numpy as np
import pytest

from imu_tracker.estimation.six_state import constraints
from imu_tracker.estimation.six_state.constraints import non_holonomic
from imu_tracker.estimation.tuning import SIX_LATERAL_SIGMA_MPS

SURE = np.eye(3) * 0.01


@pytest.mark.parametrize("yaw", [0.0, 1.0, -2.0, math.pi])
def test_only_the_velocity_across_the_heading_is_measured(yaw: float) -> None:
    along = (math.cos(yaw), math.sin(yaw))
    right = (-math.sin(yaw), math.cos(yaw))
    v_n = (10 * along[0] + 0.5 * right[0], 10 * along[1] + 0.5 * right[1], 0.3)
    measured = non_holonomic(v_n, SURE, yaw, 0.0, 0.0)
    assert measured.z == pytest.approx([-0.5])  # zero less what there is
    assert measured.H @ v_n == pytest.approx([0.5])
    assert measured.R[0, 0] == pytest.approx(SIX_LATERAL_SIGMA_MPS**2)


def test_turning_and_an_unsure_yaw_weaken_it() -> None:
    v_n = (10.0, 0.0, 0.0)
    plain = non_holonomic(v_n, SURE, 0.0, 0.0, 0.0).R[0, 0]
    turning = non_holonomic(v_n, SURE, 0.0, 0.0, 0.5).R[0, 0]
    unsure = non_holonomic(v_n, SURE, 0.0, 0.1, 0.0).R[0, 0]
    assert turning > plain
    assert unsure == pytest.approx(plain + 1.0)  # 10 m/s by 0.1 rad


def test_a_slide_is_believed() -> None:
    # Five metres a second sideways: whatever the constraint says, it is met at three
    # sigma, and moves the velocity by a fraction only.
    measured = non_holonomic((10.0, 5.0, 0.0), SURE, 0.0, 0.0, 0.0)
    S = (measured.H @ SURE @ measured.H.T + measured.R)[0, 0]
    assert abs(measured.z[0]) / math.sqrt(S) == pytest.approx(3.0)
    gain = 0.01 / S
    assert abs(gain * measured.z[0]) < 0.05


def test_rest_measures_all_of_the_velocity() -> None:
    v_n = (0.1, -0.2, 0.05)
    measured = constraints.zero_velocity(v_n)
    assert measured.z == pytest.approx([-v for v in v_n])
    assert np.array_equal(measured.H, np.eye(3))
    assert np.all(np.diag(measured.R) > 0)
