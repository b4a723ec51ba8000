"""What keeps the attitude true, on bodies whose attitude the tests know."""

import math

import numpy as np
import pytest

from imu_tracker.estimation.six_state.attitude import AttitudeFilter
from imu_tracker.estimation.six_state.attitude_aiding import AttitudeAiding
from imu_tracker.estimation.tuning import REVERSE_FIXES
from imu_tracker.geometry.rotation import (
    conjugate,
    from_euler,
    from_rotation_vector,
    multiply,
    rotate,
    to_euler,
    wrap_pi,
)
from imu_tracker.motion.preintegration import ImuStep, gap_step
from imu_tracker.motion.standstill import Rest
from imu_tracker.samples import Quat, Vec3
from support.body import DPS, SECOND_NS, G

STEP_S = 0.04
STEP_NS = 40_000_000
SIGMA_MPS = 0.15


class Ride:
    """A body with a true attitude and velocity, and the filter that looks on."""

    def __init__(
        self,
        profile: str = "vehicle",
        true_rpy: Vec3 = (0.0, 0.0, 0.0),
        believed_rpy: Vec3 = (0.0, 0.0, 0.0),
        tilt_sigma: float = 0.1,
        gyro_bias: Vec3 = (0.0, 0.0, 0.0),
        gyro_bias_sigma: float = 0.05 * DPS,
    ) -> None:
        self.q_nb: Quat = from_euler(*true_rpy)
        self.v_n = np.zeros(3)
        self.gyro_bias = gyro_bias
        self.t_ns = 0
        self.attitude = AttitudeFilter()
        roll, pitch, yaw = believed_rpy
        up = rotate(conjugate(from_euler(roll, pitch, 0.0)), (0.0, 0.0, -G))
        self.attitude.start(up, tilt_sigma)
        self.attitude.update_yaw(yaw, 0.05)
        self.attitude.update_gyro_bias((0.0, 0.0, 0.0), gyro_bias_sigma)
        self.aiding = AttitudeAiding(self.attitude, profile)

    def go(
        self, seconds: float, accel_b: Vec3 = (0.0, 0.0, 0.0), rate_down: float = 0.0
    ) -> None:
        """Accelerate in body axes and turn about down."""
        for _ in range(round(seconds / STEP_S)):
            self.t_ns += STEP_NS
            turn_b = rotate(conjugate(self.q_nb), (0.0, 0.0, rate_down * STEP_S))
            a_n = np.array(rotate(self.q_nb, accel_b))
            f_b = rotate(conjugate(self.q_nb), tuple((a_n - [0, 0, G]).tolist()))
            self.q_nb = multiply(self.q_nb, from_rotation_vector(turn_b))
            self.v_n += a_n * STEP_S
            step = ImuStep(
                self.t_ns,
                STEP_S,
                tuple(np.add(turn_b, np.multiply(self.gyro_bias, STEP_S)).tolist()),
                (f_b[0] * STEP_S, f_b[1] * STEP_S, f_b[2] * STEP_S),
                *(4, (0.0,) * 3, (0.0,) * 3, 0.0, 0.0, 25.0, False, False),
            )
            f_n = rotate(self.attitude.q_nb, f_b)
            self.attitude.propagate(step)
            self.aiding.propagate(step, (f_n[0], f_n[1], f_n[2] + G))

    @property
    def vel_ne(self) -> tuple[float, float]:
        return float(self.v_n[0]), float(self.v_n[1])

    def errors_deg(self) -> tuple[float, float, float]:
        """Roll, pitch and yaw, less true."""
        found, truth = to_euler(self.attitude.q_nb), to_euler(self.q_nb)
        off = [math.degrees(wrap_pi(a - b)) for a, b in zip(found, truth, strict=True)]
        return off[0], off[1], off[2]


@pytest.mark.parametrize("yaw", [0.0, 2.0])
@pytest.mark.parametrize("tilt_deg", [(5.0, 0.0), (0.0, -5.0), (-3.0, 4.0)])
def test_the_receivers_velocity_finds_a_tilt(
    yaw: float, tilt_deg: tuple[float, float]
) -> None:
    roll, pitch = np.radians(tilt_deg).tolist()
    ride = Ride(true_rpy=(roll, pitch, yaw), believed_rpy=(0.0, 0.0, yaw))
    rng = np.random.default_rng(2)
    for _ in range(60):
        push = rng.normal(0.0, 0.5, 2)
        ride.go(1.0, accel_b=(float(push[0]), float(push[1]), 0.0))
        ride.aiding.update_from_velocity(ride.vel_ne, SIGMA_MPS, G)
    assert max(map(abs, ride.errors_deg()[:2])) < 0.7


def test_a_receiver_whose_velocity_does_not_fit_is_distrusted() -> None:
    # Its latency is off by seconds: in traffic its velocity is noise to the tilt.
    ride = Ride(tilt_sigma=0.02)
    rng = np.random.default_rng(3)
    late = [(0.0, 0.0)] * 3
    for k in range(120):
        sign = 1.0 if (k // 8) % 2 else -1.0
        ride.go(1.0, accel_b=(sign * (1.5 + 0.3 * float(rng.normal())), 0.0, 0.0))
        late.append(ride.vel_ne)
        ride.aiding.update_from_velocity(late[-4], SIGMA_MPS, G)
    assert max(map(abs, ride.errors_deg()[:2])) < 6.0


def test_without_a_yaw_velocities_tell_nothing() -> None:
    ride = Ride(true_rpy=(0.1, 0.0, 0.0))
    ride.attitude.reset_yaw()
    for _ in range(20):
        ride.go(1.0)
        ride.aiding.update_from_velocity(ride.vel_ne, SIGMA_MPS, G)
    assert ride.errors_deg()[0] == pytest.approx(-math.degrees(0.1), abs=0.01)


def test_rest_tells_tilt_gyro_bias_and_the_excess_of_gravity() -> None:
    bias = (0.5 * DPS, -1.0 * DPS, 2.0 * DPS)
    ride = Ride(
        true_rpy=(0.05, 0.0, 1.0),
        believed_rpy=(0.0, 0.0, 1.0),
        gyro_bias=bias,
        gyro_bias_sigma=3 * DPS,
    )
    heavy = 10.1  # a chip whose z axis reads 3 % too much
    f_b = rotate(conjugate(ride.q_nb), (0.0, 0.0, -heavy))
    for k in range(60):
        ride.go(0.2)
        ride.aiding.update_from_rest(Rest(bias, f_b, 0.5 + 0.2 * k), G)
    assert ride.attitude.gyro_bias_radps == pytest.approx(bias, abs=0.02 * DPS)
    assert abs(ride.errors_deg()[0]) < 0.2
    assert math.hypot(*ride.aiding.accel_bias_mps2) == pytest.approx(heavy - G)
    kept = np.subtract(f_b, ride.aiding.accel_bias_mps2)
    assert np.linalg.norm(kept) == pytest.approx(G)


def test_gravity_alone_finds_the_tilt_in_minutes() -> None:
    ride = Ride(true_rpy=(0.1, -0.08, 0.0), tilt_sigma=0.2)
    for _ in range(180):
        ride.go(1.0)
        ride.aiding.update_from_gravity((0.0, 0.0, 0.0), G)
    assert max(map(abs, ride.errors_deg()[:2])) < 2.0


@pytest.mark.parametrize("rate", [0.2, -0.2])
def test_a_roundabout_is_not_taken_for_a_tilt(rate: float) -> None:
    # 10 m/s round a circle of 50 m: 2 m/s^2 to one side for minutes.
    ride = Ride(tilt_sigma=0.05)
    ride.v_n[:] = [10.0, 0.0, 0.0]
    for _ in range(120):
        ride.go(1.0, accel_b=(0.0, 10.0 * rate, 0.0), rate_down=rate)
        ride.aiding.update_from_gravity((*ride.vel_ne, 0.0), G)
    assert max(map(abs, ride.errors_deg()[:2])) < 1.5


def test_a_hard_push_is_not_taken_for_gravity() -> None:
    ride = Ride(tilt_sigma=0.05)
    for _ in range(60):
        ride.go(1.0, accel_b=(4.0, 0.0, 0.0))
        ride.aiding.update_from_gravity((0.0, 0.0, 0.0), G)
    assert max(map(abs, ride.errors_deg()[:2])) < 0.1


@pytest.mark.parametrize("yaw", [0.3, -3.0])
def test_the_course_tells_the_yaw(yaw: float) -> None:
    ride = Ride(true_rpy=(0.0, 0.0, yaw), believed_rpy=(0.0, 0.0, yaw + 0.4))
    ride.v_n[:] = [15.0 * math.cos(yaw), 15.0 * math.sin(yaw), 0.0]
    for _ in range(60):
        ride.go(1.0)
        ride.aiding.update_from_course(ride.vel_ne, SIGMA_MPS, 1.0)
    assert abs(ride.errors_deg()[2]) < 1.5


def test_ten_fixes_a_second_tell_no_more_than_one() -> None:
    sigmas = []
    for period_s in (1.0, 0.2):
        ride = Ride()
        ride.v_n[:] = [15.0, 0.0, 0.0]
        for _ in range(round(30.0 / period_s)):
            ride.go(period_s)
            ride.aiding.update_from_course(ride.vel_ne, SIGMA_MPS, period_s)
        sigmas.append(ride.attitude.yaw_sigma_rad)
    assert sigmas[0] == pytest.approx(sigmas[1], rel=0.2)


@pytest.mark.parametrize(("profile", "speed"), [("vehicle", 1.5), ("walker", 0.5)])
def test_who_is_slow_has_no_course(profile: str, speed: float) -> None:
    ride = Ride(profile, believed_rpy=(0.0, 0.0, 1.0))
    for _ in range(20):
        ride.go(1.0)
        ride.aiding.update_from_course((speed, 0.0), 0.05, 1.0)
    assert ride.errors_deg()[2] == pytest.approx(math.degrees(1.0), abs=1e-6)


def test_reversing_does_not_turn_the_heading_round() -> None:
    ride = Ride(true_rpy=(0.0, 0.0, 0.7), believed_rpy=(0.0, 0.0, 0.7))
    back = (-3.0 * math.cos(0.7), -3.0 * math.sin(0.7))
    for _ in range(60):
        ride.go(1.0)
        ride.aiding.update_from_course(back, SIGMA_MPS, 1.0)
    assert abs(ride.errors_deg()[2]) < 1.0


def test_a_heading_that_was_the_wrong_way_round_is_given_up() -> None:
    # It reversed out of the garage and so began with the yaw turned round.
    ride = Ride(believed_rpy=(0.0, 0.0, math.pi))
    ride.v_n[:] = [15.0, 0.0, 0.0]
    for _ in range(REVERSE_FIXES + 1):
        ride.go(1.0)
        ride.aiding.update_from_course(ride.vel_ne, SIGMA_MPS, 1.0)
    assert abs(ride.errors_deg()[2]) < 3.0


def test_a_body_in_motion_is_levelled_by_its_mean_force() -> None:
    ride = Ride(true_rpy=(0.1, 0.2, 0.0))
    ride.attitude.is_level = False
    ride.go(1.2)
    assert ride.attitude.is_level
    assert max(map(abs, ride.errors_deg()[:2])) < 0.1


def test_what_was_begun_before_a_gap_is_dropped() -> None:
    ride = Ride(true_rpy=(0.05, 0.0, 0.0))
    ride.go(1.0)
    ride.aiding.update_from_velocity(ride.vel_ne, SIGMA_MPS, G)
    ride.go(2.5)
    ride.t_ns += 2 * SECOND_NS
    ride.aiding.propagate(gap_step(ride.t_ns, 2.0), (0.0, 0.0, 0.0))
    before = ride.attitude.q_nb
    ride.aiding.update_from_velocity(
        (9.0, 9.0), SIGMA_MPS, G
    )  # whatever happened meanwhile
    assert ride.attitude.q_nb == before


def test_a_snapshot_brings_everything_back() -> None:
    ride = Ride()
    ride.go(3.3)
    saved = ride.aiding.snapshot()
    ride.go(5.0, accel_b=(1.0, 0.0, 0.0))
    ride.aiding.update_from_rest(Rest((0.0, 0.0, 0.0), (0.0, 0.0, -10.0), 1.0), G)
    ride.aiding.restore(saved)
    assert ride.aiding.snapshot() == saved
