"""The six-state filter: its algebra, its signs, its places, its honesty."""

import math

import numpy as np
import pytest
from filterpy.kalman import KalmanFilter
from numpy.typing import NDArray

from imu_tracker.estimation.estimate import R95_PER_SIGMA, r95_of
from imu_tracker.estimation.receiver.gate import AGREEING_FIXES, FixOutcome
from imu_tracker.estimation.six_state.estimator import SixState
from imu_tracker.geometry.geodesy import FRAME_RADIUS_M, LocalFrame
from imu_tracker.geometry.rotation import conjugate, from_euler, rotate
from imu_tracker.motion.preintegration import ImuStep, gap_step
from imu_tracker.motion.standstill import Rest
from imu_tracker.samples import GpsFix, Vec3
from support.body import DPS, G

STEP_S = 0.04
STEP_NS = 40_000_000
HOME = (math.radians(52.0), math.radians(4.37))
ZERO: Vec3 = (0.0, 0.0, 0.0)


class Journey:
    """A level body that keeps its heading, and a perfect receiver on it."""

    def __init__(
        self,
        profile: str = "free",
        *,
        lat_lon: tuple[float, float] = HOME,
        yaw: float = 0.0,
        speed: float = 0.0,
        lever_m: Vec3 = ZERO,
        sigma_m: float = 2.0,
        has_velocity: bool = True,
        alt_m: float | None = 10.0,
    ) -> None:
        self.filter = SixState(profile, lever_m)
        self.frame = LocalFrame.at(*lat_lon)
        self.north = self.east = 0.0
        self.yaw, self.speed = yaw, speed
        self.lever_m, self.sigma_m = lever_m, sigma_m
        self.has_velocity, self.alt_m = has_velocity, alt_m
        self.t_ns = 0
        self.filter.start(*lat_lon, 10.0 * sigma_m)

    def step(self, accel: float = 0.0, clipped_turn: Vec3 | None = None) -> None:
        self.t_ns += STEP_NS
        q_nb = from_euler(0.0, 0.0, self.yaw)
        f_b = rotate(conjugate(q_nb), (0.0, 0.0, -G))
        way = self.speed * STEP_S + 0.5 * accel * STEP_S**2
        self.north += way * math.cos(self.yaw)
        self.east += way * math.sin(self.yaw)
        self.speed += accel * STEP_S
        dv_b = ((f_b[0] + accel) * STEP_S, f_b[1] * STEP_S, f_b[2] * STEP_S)
        is_clipped, turn = clipped_turn is not None, clipped_turn or ZERO
        step = ImuStep(
            *(self.t_ns, STEP_S, turn, dv_b, 4, ZERO, ZERO, 0.0, 0.0, 25.0),
            is_saturated=is_clipped,
            is_gap=False,
        )
        self.filter.propagate(step, None)

    def fix(self, north_off: float = 0.0, east_off: float = 0.0) -> GpsFix:
        ahead, right, _ = self.lever_m
        cos, sin = math.cos(self.yaw), math.sin(self.yaw)
        north = self.north + north_off + ahead * cos - right * sin
        east = self.east + east_off + ahead * sin + right * cos
        vel = (self.speed * cos, self.speed * sin) if self.has_velocity else None
        lat, lon = self.frame.to_lat_lon(north, east)
        return GpsFix(self.t_ns, 0.0, lat, lon, self.alt_m, vel, self.sigma_m, 1)

    def go(self, seconds: float, accel: float = 0.0) -> FixOutcome:
        """Travel with a fix each second; return what became of the last one."""
        outcome = FixOutcome.OUTLIER
        for _ in range(round(seconds)):
            for _ in range(25):
                self.step(accel)
            outcome = self.filter.update(self.fix(), 0.0)
        return outcome

    def dark(self, seconds: float, accel: float = 0.0) -> None:
        for _ in range(round(seconds / STEP_S)):
            self.step(accel)

    def rest(self, seconds: float) -> None:
        for _ in range(round(seconds / STEP_S)):
            self.t_ns += STEP_NS
            step = ImuStep(
                *(self.t_ns, STEP_S, ZERO, (0.0, 0.0, -G * STEP_S), 4, ZERO, ZERO),
                *(0.0, 0.0, 25.0, False, False),
            )
            self.filter.propagate(step, Rest(ZERO, (0.0, 0.0, -G), 9.0))

    def gap(self, seconds: float) -> None:
        for _ in range(round(seconds / 0.1)):
            self.t_ns += 100_000_000
            self.north += self.speed * 0.1 * math.cos(self.yaw)
            self.east += self.speed * 0.1 * math.sin(self.yaw)
            self.filter.propagate(gap_step(self.t_ns, 0.1), None)

    def miss_m(self) -> float:
        """From where the antenna is to where the filter says it is."""
        estimate, truth = self.filter.estimate(), self.fix()
        here = LocalFrame.at(truth.lat_rad, truth.lon_rad)
        return math.hypot(*here.to_ne(estimate.lat_rad, estimate.lon_rad))

    def covariance(self) -> NDArray[np.float64]:
        return np.array(self.filter._kf.P)

    def yaw_sigma_deg(self) -> float:
        return float(str(self.filter.report()["yaw_sigma_deg"]))


# ------------------------------------------------------------------- the algebra


def test_a_kalman_step_of_filterpy_is_the_textbooks() -> None:
    rng = np.random.default_rng(4)
    dt, I3 = 0.04, np.eye(3)
    A = np.block([[I3, dt * I3], [np.zeros((3, 3)), I3]])
    B = np.vstack([0.5 * dt**2 * I3, dt * I3])
    root = rng.normal(size=(6, 6))
    x, P, Q = rng.normal(size=6), root @ root.T, 0.1 * np.eye(6)
    u, z, H, R = rng.normal(size=3), rng.normal(size=2), np.eye(6)[:2], 4.0 * np.eye(2)

    kf = KalmanFilter(dim_x=6, dim_z=2, dim_u=3)
    kf.x, kf.P = x, P
    kf.predict(u, B, A, Q)
    kf.update(z, R=R, H=H)

    x, P = A @ x + B @ u, A @ P @ A.T + Q
    S = H @ P @ H.T + R
    K = P @ H.T @ np.linalg.inv(S)
    x = x + K @ (z - H @ x)
    P = (np.eye(6) - K @ H) @ P
    assert kf.x.shape == (6,)
    assert np.allclose(kf.x, x)
    assert np.allclose(kf.P, P)


def test_a_step_moves_by_the_mean_acceleration() -> None:
    # Known yaw and level: p = v t + a t^2 / 2 and v = a t, and nothing else.
    journey = Journey(yaw=0.5, speed=8.0)
    journey.go(30)
    before = journey.filter.estimate()
    journey.dark(2.0, accel=1.5)
    after = journey.filter.estimate()
    gained = math.hypot(*after.v_n_mps[:2]) - math.hypot(*before.v_n_mps[:2])
    assert gained == pytest.approx(3.0, abs=0.05)
    assert journey.miss_m() < 1.0


@pytest.mark.parametrize(("sigma_1", "sigma_2"), [(1, 1), (3, 1), (5, 0.5), (2, 0)])
def test_r95_holds_95_percent_of_a_normal_distribution(
    sigma_1: float, sigma_2: float
) -> None:
    rng = np.random.default_rng(6)
    turn = np.array([[0.8, -0.6], [0.6, 0.8]])
    points = rng.normal(size=(200_000, 2)) * [sigma_1, sigma_2] @ turn.T
    cov = turn @ np.diag([sigma_1**2, sigma_2**2]) @ turn.T
    inside = np.mean(np.hypot(*points.T) <= r95_of(cov))
    assert inside == pytest.approx(0.95, abs=0.003)


def test_r95_of_nothing_is_zero() -> None:
    assert r95_of(np.zeros((2, 2))) == 0.0
    assert r95_of(np.eye(2)) == pytest.approx(R95_PER_SIGMA, rel=0.01)


def test_the_covariance_stays_one_whatever_happens() -> None:
    journey = Journey("vehicle", yaw=1.0, speed=10.0)
    for happen in (
        lambda: journey.go(20),
        lambda: journey.dark(60.0),
        lambda: journey.gap(5.0),
        lambda: journey.go(20),
        lambda: journey.rest(20.0),
        lambda: journey.gap(600.0),
        lambda: journey.go(12),
    ):
        happen()
        P = journey.covariance()
        assert np.allclose(P, P.T)
        assert np.linalg.eigvalsh(P).min() > -1e-9 * np.trace(P)


# ------------------------------------------------------------ places of the Earth


@pytest.mark.parametrize("lat_deg", [0.0, 52.0, -33.0, 85.0])
def test_the_frame_goes_along(lat_deg: float) -> None:
    journey = Journey(
        lat_lon=(math.radians(lat_deg), 0.2), yaw=0.7, speed=30.0, sigma_m=0.5
    )
    journey.go(170)  # five kilometres
    assert math.hypot(journey.north, journey.east) > 4.9 * FRAME_RADIUS_M
    # The test's own straight line is one of its frame at the start: true to 1e-3.
    assert journey.miss_m() < 3.0


@pytest.mark.parametrize("yaw", [math.pi / 2, -math.pi / 2])
def test_the_antimeridian_is_nothing_special(yaw: float) -> None:
    side = math.copysign(math.radians(179.999), yaw)
    journey = Journey(lat_lon=(0.3, side), yaw=yaw, speed=20.0)
    journey.go(60)
    assert math.copysign(1.0, journey.filter.estimate().lon_rad) == -math.copysign(
        1.0, yaw
    )
    assert journey.miss_m() < 1.0
    journey.dark(20.0)
    assert journey.miss_m() < 25.0


@pytest.mark.parametrize("lat_deg", [89.97, -89.97])
def test_near_a_pole_it_still_follows(lat_deg: float) -> None:
    journey = Journey(lat_lon=(math.radians(lat_deg), 1.0), yaw=2.0, speed=2.0)
    journey.go(120)
    assert journey.miss_m() < 5.0
    assert math.isfinite(journey.filter.estimate().r95_m)


def test_the_height_may_lie_below_the_sea() -> None:
    journey = Journey(alt_m=-427.5, speed=5.0)
    journey.go(20)
    assert journey.filter.estimate().alt_m == pytest.approx(-427.5, abs=0.5)


def test_a_height_that_was_never_sent_is_unknown() -> None:
    journey = Journey(alt_m=None, speed=5.0)
    journey.go(20)
    assert journey.filter.estimate().alt_m is None
    assert abs(journey.filter.estimate().v_n_mps[2]) < 0.5


# ------------------------------------------------------------- signs and lever arm


@pytest.mark.parametrize("yaw", [0.0, 2.0, -1.0])
def test_the_antenna_is_where_the_lever_arm_says(yaw: float) -> None:
    journey = Journey(yaw=yaw, speed=10.0, lever_m=(2.0, -1.0, -1.5), sigma_m=0.02)
    journey.go(60)
    assert journey.miss_m() < 0.05  # of the antenna
    chip_north, chip_east = journey.filter._kf.x[:2]
    home = LocalFrame.at(*HOME)
    frame = journey.filter._frame
    off_north, off_east = home.to_ne(frame.lat_rad, frame.lon_rad)
    assert chip_north + off_north == pytest.approx(journey.north, abs=0.2)
    assert chip_east + off_east == pytest.approx(journey.east, abs=0.2)


def test_a_fix_that_is_ahead_of_the_step_is_taken_back_to_it() -> None:
    journey = Journey(speed=20.0, sigma_m=0.02)
    journey.go(20)
    journey.dark(1.0)
    early = journey.fix()
    journey.north += 20.0 * 0.02
    assert journey.filter.update(journey.fix(), 0.02) is FixOutcome.ACCEPTED
    north, east = LocalFrame.at(early.lat_rad, early.lon_rad).to_ne(
        *journey.filter.estimate()[:2]
    )
    assert math.hypot(north, east) < 0.05


def test_rest_keeps_the_place_and_its_radius() -> None:
    journey = Journey(speed=0.0)
    journey.go(20)
    before = journey.filter.estimate()
    journey.rest(600.0)
    after = journey.filter.estimate()
    moved = LocalFrame.at(*before[:2]).to_ne(*after[:2])
    assert math.hypot(*moved) < 0.2
    assert after.r95_m < before.r95_m + 2.0


def test_a_vehicle_does_not_drift_sideways_and_others_may() -> None:
    lateral = {}
    for profile in ("vehicle", "free"):
        journey = Journey(profile, speed=15.0)
        journey.go(40)
        journey.dark(20.0)
        lateral[profile] = math.sqrt(journey.covariance()[4, 4])
    assert lateral["vehicle"] < 0.5 * lateral["free"]


# --------------------------------------------------------------- what goes wrong


def test_one_wild_fix_changes_nothing() -> None:
    journey = Journey(speed=10.0)
    journey.go(20)
    journey.dark(1.0)
    before = journey.filter.estimate()
    saved = journey.filter.snapshot()
    assert journey.filter.update(journey.fix(300.0), 0.0) is FixOutcome.OUTLIER
    journey.filter.restore(saved)  # as the tracker does
    assert journey.filter.estimate() == before
    assert journey.go(1) is FixOutcome.ACCEPTED


@pytest.mark.parametrize("has_velocity", [True, False])
def test_a_receiver_that_is_right_wins_within_eight_fixes(has_velocity: bool) -> None:
    journey = Journey(speed=10.0, has_velocity=has_velocity)
    journey.go(20)
    journey.north += 400.0  # we were carried there, say
    outcomes = [journey.go(1) for _ in range(AGREEING_FIXES)]
    assert outcomes[-1] in (FixOutcome.REACQUIRED, FixOutcome.ACCEPTED)
    journey.go(5)
    assert journey.miss_m() < 5.0


def test_two_wild_fixes_that_agree_make_the_radius_honest() -> None:
    journey = Journey(speed=10.0)
    journey.go(20)
    journey.north += 400.0
    journey.go(2)
    assert journey.filter.estimate().r95_m > journey.miss_m()


def test_a_position_that_stands_while_its_receiver_moves_is_not_taken() -> None:
    journey = Journey(speed=10.0)
    journey.go(20)
    stuck = journey.fix()
    for _ in range(60):
        journey.dark(1.0)
        late = stuck._replace(t_ns=journey.t_ns)
        assert journey.filter.update(late, 0.0) is FixOutcome.FROZEN


def test_a_parked_receiver_without_speed_is_not_locked_out() -> None:
    # GGA alone, and a receiver that holds its position when parked. After a tunnel
    # the filter still believes in its speed: the same place again and again is then
    # no fault of the receiver.
    journey = Journey(speed=10.0, has_velocity=False)
    journey.go(30)
    journey.speed = 0.0
    for _ in range(30):
        journey.dark(1.0)
    outcomes = []
    for _ in range(AGREEING_FIXES + 2):
        journey.dark(1.0)
        outcomes.append(journey.filter.update(journey.fix(), 0.0))
    assert FixOutcome.REACQUIRED in outcomes or FixOutcome.ACCEPTED in outcomes
    assert journey.miss_m() < 10.0


def test_a_restart_takes_the_receivers_height() -> None:
    for has_velocity in (True, False):
        journey = Journey(speed=10.0, has_velocity=has_velocity)
        journey.go(20)
        journey.north += 2000.0
        journey.alt_m = 700.0  # a cable car
        outcome = FixOutcome.OUTLIER
        while outcome is not FixOutcome.REACQUIRED:
            outcome = journey.go(1)
        assert journey.filter.estimate().alt_m == pytest.approx(700.0)


def test_clipped_readings_are_doubted() -> None:
    # The box is thrown about at 1400 deg/s, of which the gyro shows 500.
    journey = Journey(speed=10.0)
    journey.go(40)
    assert journey.yaw_sigma_deg() < 5.0
    spin = (0.0, 0.0, 500.0 * DPS * STEP_S)
    for _ in range(12):
        journey.step(clipped_turn=spin)
    assert journey.yaw_sigma_deg() > 30.0
    for _ in range(12):  # and back
        journey.step(clipped_turn=(0.0, 0.0, -spin[2] * 0.4))
    journey.go(10)
    assert journey.yaw_sigma_deg() < 10.0
    assert journey.miss_m() < 5.0


def test_a_single_clipped_bump_costs_little() -> None:
    journey = Journey(speed=10.0)
    journey.go(40)
    journey.step(clipped_turn=ZERO)
    assert journey.yaw_sigma_deg() < 5.0
    journey.go(5)
    assert journey.miss_m() < 2.0


def test_without_an_imu_it_follows_the_receiver() -> None:
    journey = Journey(yaw=2.5, speed=14.0)
    journey.go(10)
    for _ in range(60):
        journey.gap(1.0)
        assert journey.filter.update(journey.fix(), 0.0) is FixOutcome.ACCEPTED
    assert journey.miss_m() < 3.0


def test_in_the_dark_the_radius_grows_and_stays_a_number() -> None:
    journey = Journey(speed=14.0)
    journey.go(20)
    radii = []
    for _ in range(4):
        journey.gap(200.0)
        radii.append(journey.filter.estimate().r95_m)
    assert radii == sorted(radii)
    assert radii[-1] <= 2e7
    assert all(map(math.isfinite, journey.filter.estimate().v_n_mps))


def test_a_snapshot_brings_everything_back() -> None:
    journey = Journey(speed=10.0)
    journey.go(20)
    saved, before = journey.filter.snapshot(), journey.filter.estimate()
    journey.dark(10.0, accel=1.0)
    journey.go(3)
    journey.filter.restore(saved)
    assert journey.filter.estimate() == before


def test_nothing_is_said_before_the_start_but_attitude_and_bias() -> None:
    journey = Journey()
    journey.filter = SixState("free")
    bias = (1 * DPS, 0.0, 0.0)
    for _ in range(400):
        journey.t_ns += STEP_NS
        dtheta = (bias[0] * STEP_S, 0.0, 0.0)
        step = ImuStep(
            *(journey.t_ns, STEP_S, dtheta, (0.0, 0.0, -G * STEP_S), 4, ZERO, ZERO),
            *(0.0, 0.0, 25.0, False, False),
        )
        journey.filter.propagate(step, Rest(bias, (0.0, 0.0, -G), 9.0))
    found, sigma = journey.filter.gyro_bias()
    assert found == pytest.approx(bias, abs=0.02 * DPS)
    # Updates at 5 Hz, correlated over a second: 16 independent ones of 0.05 deg/s.
    assert sigma == pytest.approx(0.05 * DPS / 4.0, rel=0.5)
