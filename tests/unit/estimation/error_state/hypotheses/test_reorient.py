"""Changes of a filter outright: each against what its errors must mean together."""

import math

import numpy as np
import pytest

from imu_tracker.estimation.error_state.hypotheses.reorient import (
    COURSE_SIGMA_MPS,
    COURSE_SIGMA_RAD,
    mount,
    mount_along_course,
    off_course,
    separate_delays,
    set_bank_heading,
    set_delay_covariance,
)
from imu_tracker.estimation.error_state.states import (
    DELAY,
    DELAYS,
    MOUNT_YAW,
    N_ERRORS,
    P_E,
    P_N,
    POSITION,
    YAW_D,
)
from support.error_state import moving


def test_a_place_of_a_late_receiver_leaves_the_bodys_as_uncertain_as_the_delay() -> (
    None
):
    # A filter once took the receiver's place for its own: 0.1 s of delay after 5 s.
    eskf = moving((12.0, -5.0, 0.0))
    eskf.set_variances(POSITION, [0.25, 0.25, 1.0])
    set_delay_covariance(eskf, np.diag([0.4**2, 0.5**2]))
    separate_delays(eskf)
    variances = eskf.P.diagonal()
    assert variances[P_N] == pytest.approx(0.25 + (12.0 * 0.4) ** 2)
    assert variances[P_E] == pytest.approx(0.25 + (5.0 * 0.4) ** 2)
    # What the receiver reports, p + v delay, is as well known as it was.
    H = np.zeros((2, N_ERRORS))
    H[0, P_N] = H[1, P_E] = 1.0
    H[:, DELAY] = (12.0, -5.0)
    np.testing.assert_allclose(H @ eskf.P @ H.T, 0.25 * np.eye(2), atol=1e-9)


def test_a_known_delay_moves_the_place_back_along_the_way() -> None:
    eskf = moving((12.0, -5.0, 0.0))
    eskf.delay_s = 0.5
    separate_delays(eskf)
    assert eskf.nominal.p_n == pytest.approx((-6.0, 2.5, 0.0))


def test_delays_begin_together() -> None:
    eskf = moving((0.0, 0.0, 0.0))
    D = eskf.P[DELAYS, DELAYS]
    apart_var = D[0, 0] + D[1, 1] - 2.0 * D[0, 1]
    assert 0.1 <= math.sqrt(apart_var) <= 0.4 < math.sqrt(D[1, 1]) < 0.6


@pytest.mark.parametrize("yaw_sigma_deg", [5.0, 25.0])
def test_a_mounting_by_the_course_is_as_wrong_as_the_yaw_with_the_other_sign(
    yaw_sigma_deg: float,
) -> None:
    eskf = moving((10.0, 0.0, 0.0), yaw_rad=math.radians(-90.0))
    eskf.set_variances(YAW_D, math.radians(yaw_sigma_deg) ** 2)
    mount_along_course(eskf)
    assert off_course(eskf, 0.0) == pytest.approx(0.0, abs=1e-9)
    P = eskf.P
    heading_var = P[YAW_D, YAW_D] + P[MOUNT_YAW, MOUNT_YAW] + 2.0 * P[YAW_D, MOUNT_YAW]
    expected = math.hypot(COURSE_SIGMA_RAD, COURSE_SIGMA_MPS / 10.0)
    assert math.sqrt(heading_var) == pytest.approx(expected)
    assert np.linalg.eigvalsh(P).min() > -1e-9


def test_a_vehicle_never_goes_sideways_at_walking_pace() -> None:
    # At 2.4 m/s a turned box was once left mounted ahead: 200 m off in an outage.
    eskf = moving((2.4, 0.0, 0.0))
    set_bank_heading(eskf, math.radians(-93.0), math.radians(25.0), is_vehicle=True)
    assert off_course(eskf, 0.0) == pytest.approx(0.0, abs=1e-9)


def test_a_turned_mount_turns_the_vehicle_and_not_the_box() -> None:
    eskf = moving((10.0, 0.0, 0.0))
    before = eskf.nominal.q_nb
    mount(eskf, math.radians(90.0), math.radians(15.0))
    assert eskf.nominal.q_nb == before
    assert abs(off_course(eskf, 0.0)) == pytest.approx(math.radians(90.0))
    assert eskf.sigma(MOUNT_YAW) == pytest.approx(math.radians(15.0))
