"""The attitude filter: signs by finite differences, honesty by its own sigmas."""

import math

import numpy as np
import pytest

from imu_tracker.estimation.six_state.attitude import GYRO_BIAS_VAR, AttitudeFilter
from imu_tracker.geometry.rotation import (
    conjugate,
    from_euler,
    from_rotation_vector,
    multiply,
    rotate,
    to_euler,
    to_rotation_vector,
)
from imu_tracker.motion.preintegration import ImuStep, gap_step
from imu_tracker.samples import Quat, Vec3
from support.body import DPS, G

UP: Vec3 = (0.0, 0.0, -G)
TILTS = [(0.0, 0.0), (0.1, 0.0), (0.0, -0.1), (-0.05, 0.08)]
YAWS = [0.0, 1.0, -2.5]


def turning(gyro: Vec3, t_ns: int = 0, dt_s: float = 0.04) -> ImuStep:
    x, y, z = gyro
    dtheta = (x * dt_s, y * dt_s, z * dt_s)
    zero = (0.0, 0.0, 0.0)
    return ImuStep(
        t_ns, dt_s, dtheta, zero, 4, zero, zero, 0.0, 0.0, 25.0, False, False
    )


def run(attitude: AttitudeFilter, seconds: float, gyro: Vec3 = (0.0, 0.0, 0.0)) -> None:
    for _ in range(round(seconds / 0.04)):
        attitude.propagate(turning(gyro))


def at(
    roll: float, pitch: float, yaw: float, tilt_sigma: float = 0.01
) -> AttitudeFilter:
    """Make a filter that believes in this attitude."""
    attitude = AttitudeFilter()
    attitude.start(rotate(conjugate(from_euler(roll, pitch, 0.0)), UP), tilt_sigma)
    attitude.update_yaw(yaw, 0.01)
    return attitude


def error_n(truth: Quat, attitude: AttitudeFilter) -> Vec3:
    """What `theta_n` should be: true = exp(theta_n) * estimate."""
    return to_rotation_vector(multiply(truth, conjugate(attitude.q_nb)))


def covariance(attitude: AttitudeFilter) -> np.ndarray:
    return attitude.snapshot().P


@pytest.mark.parametrize(("roll", "pitch"), TILTS)
def test_levelling_takes_the_tilt_from_the_mean_force(
    roll: float, pitch: float
) -> None:
    assert AttitudeFilter().is_level is False
    attitude = AttitudeFilter()
    truth = from_euler(roll, pitch, 0.0)
    attitude.start(rotate(conjugate(truth), UP), 0.2)
    assert attitude.is_level
    assert to_euler(attitude.q_nb)[:2] == pytest.approx((roll, pitch))
    assert attitude.tilt_sigma_rad == pytest.approx(0.2)
    assert not attitude.is_yaw_usable


def test_the_gyro_turns_the_attitude_without_its_bias() -> None:
    attitude = at(0.0, 0.0, 0.0)
    attitude.gyro_bias_radps = (0.01, -0.02, 0.03)
    run(attitude, 2.0, (0.01, -0.02, 0.03 + 0.4))
    assert to_euler(attitude.q_nb) == pytest.approx((0.0, 0.0, 0.8))


@pytest.mark.parametrize("yaw", YAWS)
@pytest.mark.parametrize("axis", [0, 1])
def test_what_a_tilt_does_to_the_force_is_what_the_filter_expects(
    yaw: float, axis: int
) -> None:
    # Finite differences: turn the truth by a little about north or east; the force
    # that the filter then sees must lead it to that very turn.
    attitude = at(0.02, -0.03, yaw, tilt_sigma=0.2)
    small = (1e-3, 0.0, 0.0) if axis == 0 else (0.0, 1e-3, 0.0)
    truth = multiply(from_rotation_vector(small), attitude.q_nb)
    f_b = rotate(conjugate(truth), UP)  # at rest
    attitude.update_level(rotate(attitude.q_nb, f_b), (0.0, 0.0), 1e-4)
    assert error_n(truth, attitude)[:2] == pytest.approx((0.0, 0.0), abs=2e-6)


def test_a_known_acceleration_is_not_taken_for_a_tilt() -> None:
    attitude = at(0.02, -0.03, 0.7, tilt_sigma=0.2)
    before = attitude.q_nb
    a_n = (1.5, -2.0)
    nis = attitude.update_level((a_n[0], a_n[1], -G), a_n, 0.01)
    assert nis == pytest.approx(0.0, abs=1e-12)
    assert attitude.q_nb == pytest.approx(before)


def test_the_first_heading_sets_the_yaw_outright() -> None:
    attitude = AttitudeFilter()
    attitude.start(rotate(conjugate(from_euler(0.1, -0.2, 0.0)), UP), 0.02)
    attitude.update_yaw(3.0, 0.05)
    assert to_euler(attitude.q_nb) == pytest.approx((0.1, -0.2, 3.0))
    assert attitude.yaw_sigma_rad == pytest.approx(0.05)
    assert attitude.is_yaw_usable


@pytest.mark.parametrize("yaw", YAWS)
def test_a_heading_turns_the_yaw_the_right_way(yaw: float) -> None:
    attitude = at(0.0, 0.0, yaw)
    attitude.update_yaw(yaw + 0.1, 1e-4)
    assert to_euler(attitude.q_nb)[2] == pytest.approx(yaw + 0.1, abs=1e-4)


def test_a_heading_beyond_south_wraps() -> None:
    attitude = at(0.0, 0.0, math.pi - 0.05)
    innovation = attitude.update_yaw(-math.pi + 0.05, 0.01)
    assert innovation == pytest.approx(0.1)
    assert abs(to_euler(attitude.q_nb)[2]) == pytest.approx(math.pi, abs=1e-3)


def test_rest_tells_the_gyro_bias() -> None:
    attitude = at(0.0, 0.0, 0.0)
    bias = (2 * DPS, -3 * DPS, 1 * DPS)
    for _ in range(50):
        run(attitude, 0.2, bias)
        attitude.update_gyro_bias(bias, 0.05 * DPS)
    assert attitude.gyro_bias_radps == pytest.approx(bias, abs=0.02 * DPS)
    assert attitude.gyro_bias_sigma_radps < 0.05 * DPS


@pytest.mark.parametrize("yaw", YAWS)
def test_headings_that_keep_leading_tell_the_bias_about_down(yaw: float) -> None:
    # The cross-covariance has the right sign: a yaw that drifts off means a bias.
    attitude = at(0.0, 0.0, yaw)
    bias = 0.5 * DPS
    for _ in range(240):
        run(attitude, 1.0, (0.0, 0.0, bias))
        attitude.update_yaw(yaw, 3 * DPS)
    assert attitude.gyro_bias_radps[2] == pytest.approx(bias, rel=0.1)


@pytest.mark.parametrize("axis", [0, 1])
def test_a_level_that_keeps_turning_tells_the_bias_about_level_axes(axis: int) -> None:
    attitude = at(0.0, 0.0, 2.0)
    bias = [0.0, 0.0, 0.0]
    bias[axis] = 0.3 * DPS
    for _ in range(600):
        run(attitude, 0.2, (bias[0], bias[1], bias[2]))
        attitude.update_level(rotate(attitude.q_nb, UP), (0.0, 0.0), 0.3)
    assert attitude.gyro_bias_radps[axis] == pytest.approx(0.3 * DPS, rel=0.1)


def test_the_covariance_is_that_of_its_own_errors() -> None:
    # Filters started with errors drawn from P, under gyros with drawn biases: the
    # mean square of the error in sigmas must be its dimension.
    rng = np.random.default_rng(7)
    truth = from_euler(0.0, 0.0, 0.4)
    nees = []
    for _ in range(200):
        bias = rng.normal(0.0, math.sqrt(GYRO_BIAS_VAR), 3)
        theta = rng.normal(0.0, [0.01, 0.01, 0.01])
        wrong = from_rotation_vector((-theta[0], -theta[1], -theta[2]))
        attitude = at(0.0, 0.0, 0.4)
        attitude.q_nb = multiply(wrong, attitude.q_nb)
        run(attitude, 0.2, tuple(bias.tolist()))
        measured = rng.normal(bias, 0.1 * DPS)
        attitude.update_gyro_bias(tuple(measured.tolist()), 0.1 * DPS)
        run(attitude, 2.0, tuple(bias.tolist()))
        error = np.array(
            [*error_n(truth, attitude), *np.subtract(bias, attitude.gyro_bias_radps)]
        )
        nees.append(error @ np.linalg.solve(covariance(attitude), error))
    assert 5.0 < np.mean(nees) < 7.0


def test_a_gap_costs_the_yaw_and_then_the_level() -> None:
    attitude = at(0.0, 0.0, 1.0)
    attitude.update_gyro_bias((0.0, 0.0, 0.0), 0.01 * DPS)
    attitude.propagate_gap(1.0)
    assert (attitude.is_level, attitude.is_yaw_usable) == (True, True)
    for _ in range(100):
        attitude.propagate_gap(1.0)
    assert (attitude.is_level, attitude.is_yaw_usable) == (False, False)
    attitude.update_yaw(-2.0, 0.05)  # any yaw again: the next heading sets it
    assert attitude.yaw_rad == pytest.approx(-2.0)


def test_what_is_unknown_stays_a_covariance() -> None:
    # Yaw and bias grow together while nobody looks; the bound on an angle's variance
    # must not leave a correlation beyond one.
    attitude = at(0.0, 0.0, 0.0)
    run(attitude, 120.0)
    attitude.propagate_gap(10.0)
    run(attitude, 60.0)
    attitude.propagate_gap(0.3)
    P = covariance(attitude)
    assert np.allclose(P, P.T)
    assert np.linalg.eigvalsh(P).min() > -1e-9
    attitude.start(UP, 0.2)
    attitude.update_gyro_bias((0.0, 0.0, 0.0), 0.1 * DPS)
    assert np.linalg.eigvalsh(covariance(attitude)).min() > -1e-9


def test_a_snapshot_brings_everything_back() -> None:
    attitude = at(0.05, 0.02, 1.0)
    run(attitude, 0.1, (0.1, 0.2, 0.3))
    saved, before = attitude.snapshot(), covariance(attitude).copy()
    run(attitude, 3.0, (0.3, 0.2, 0.1))
    attitude.update_gyro_bias((0.1, 0.1, 0.1), 0.01)
    attitude.propagate_gap(50.0)
    attitude.restore(saved)
    assert attitude.snapshot() == saved
    assert np.array_equal(covariance(attitude), before)


def test_a_gap_step_is_no_turn() -> None:
    attitude = at(0.0, 0.0, 1.0)
    before = attitude.q_nb
    attitude.propagate_gap(gap_step(0, 0.5).dt_s)
    assert attitude.q_nb == before
