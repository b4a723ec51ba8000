"""The error-state filter: its algebra, its constraints, its judgement.

Oracles are outside of it: finite differences of the strapdown itself, the simulator's
truth, and what anybody knows of cars.
"""

import math
from collections.abc import Callable
from functools import cache
from typing import NamedTuple

import numpy as np
import pytest

from imu_tracker.estimation.error_state.constraints import vehicle
from imu_tracker.estimation.error_state.constraints.schedule import gravity_levelling
from imu_tracker.estimation.error_state.estimator import ErrorState
from imu_tracker.estimation.error_state.filter import Eskf, Measurement
from imu_tracker.estimation.error_state.hypotheses.yaw_bank import (
    CONVERGED_SIGMA_RAD,
    YawBank,
)
from imu_tracker.estimation.error_state.mechanisation import Nominal
from imu_tracker.estimation.error_state.states import (
    GYRO_GAIN,
    N_ERRORS,
    YAW,
    Array,
    NoiseLevel,
    transition,
)
from imu_tracker.estimation.receiver.gate import AGREEING_FIXES, FixOutcome
from imu_tracker.estimation.settings import TrackerSettings
from imu_tracker.estimation.tuning import SOFT_GATE_SIGMAS
from imu_tracker.geometry.geodesy import LocalFrame
from imu_tracker.geometry.rotation import (
    from_euler,
    multiply,
    rotate,
    to_euler,
    to_rotation_vector,
)
from imu_tracker.motion.preintegration import ImuStep
from imu_tracker.motion.standstill import Rest
from imu_tracker.pipeline import Pipeline
from imu_tracker.samples import Frame, GpsFix, Mode, NavState, Source
from imu_tracker.simulation import Simulated, simulate

NOISE = NoiseLevel(gyro_share=0.1, accel_share=0.1)
EPSILON = 1e-6


def an_eskf() -> Eskf:
    """Make a filter in the midst of a turn, uphill, with all its values set."""
    eskf = Eskf(NOISE, is_vehicle=True)
    eskf.nominal = Nominal(
        0, (10.0, -5.0, 2.0), (9.0, 4.0, -0.3), from_euler(0.05, 0.1, 0.6)
    )
    eskf.gyro_bias_radps = (0.01, -0.02, 0.005)
    eskf.accel_bias_mps2 = (0.1, -0.2, 0.05)
    eskf.gyro_gain = (0.01, 0.002, -0.004, 0.003, -0.02, 0.005, -0.006, 0.001, 0.015)
    eskf.q_vb = from_euler(0.0, -0.1, 0.08)
    eskf.rate_n = (0.01, 0.0, 0.3)
    eskf.a_n, eskf._mean_f_b = (0.4, 2.5, 0.1), (0.8, 2.6, -9.7)
    return eskf


def a_step(dt_s: float = 0.04) -> ImuStep:
    return ImuStep(
        40_000_000,
        dt_s,
        (0.004, -0.002, 0.012),
        (0.03, 0.11, -9.7 * dt_s),
        4,
        (0.4, -0.2, 1.2),
        (3.0, 11.0, -38.8),
        0.41,
        410.0,
        25.0,
        False,
        False,
    )


def shifted(eskf: Eskf, i: int, by: float) -> Eskf:
    """Inject one error."""
    other = eskf.clone(NOISE)
    x = np.zeros(N_ERRORS)
    x[i] = by
    other._inject(x)
    return other


def error_between(a: Nominal, b: Nominal) -> Array:
    """Position, velocity and attitude error that makes b of a."""
    conjugate = (a.q_nb[0], -a.q_nb[1], -a.q_nb[2], -a.q_nb[3])
    theta = to_rotation_vector(multiply(b.q_nb, conjugate))
    return np.array([*np.subtract(b.p_n, a.p_n), *np.subtract(b.v_n, a.v_n), *theta])


@pytest.mark.parametrize("i", [*range(15), *range(GYRO_GAIN.start, GYRO_GAIN.stop)])
def test_the_transition_is_the_derivative_of_the_strapdown(i: int) -> None:
    eskf, step = an_eskf(), a_step()
    base = eskf.mechanise(eskf.nominal, step, use_force=True)
    other = shifted(eskf, i, EPSILON)
    moved = other.mechanise(other.nominal, step, use_force=True)
    dt = step.dt_s
    f_b = tuple(
        v - b * dt for v, b in zip(step.dv_b_mps, eskf.accel_bias_mps2, strict=True)
    )
    turn_b = eskf._turn_b(step)
    dv_n = rotate(eskf.nominal.q_nb, f_b)  # type: ignore[arg-type]
    turn = rotate(eskf.nominal.q_nb, turn_b)
    F = transition(eskf.nominal.q_nb, dt, dv_n, turn)

    found = error_between(base, moved) / EPSILON

    if 9 <= i < 12:  # within a step the increment was summed with the old bias
        found[:6] = F[:6, i]
    # F holds the attitude over the step: it is true to the angle of a step.
    assert found == pytest.approx(F[:9, i], abs=0.02 * dt + 1e-6)


@pytest.mark.parametrize(
    "measure",
    [
        lambda e: vehicle.non_holonomic(e, 1.0),
        lambda e: vehicle.road_slope_prior(e, 0.1, 10.0),
        lambda e: vehicle.longitudinal_accel_prior(e, 1.0, 10.0),
        lambda e: vehicle.zero_velocity(
            e, Rest((0.01, 0.0, 0.0), (0.0, 0.0, -9.8), 2.0), 1.0
        ),
    ],
)
def test_each_constraint_measures_what_its_jacobian_says(
    measure: Callable[[Eskf], Measurement],
) -> None:
    eskf = an_eskf()
    z, H, _ = measure(eskf)
    for i in range(N_ERRORS):
        moved = measure(shifted(eskf, i, EPSILON)).z
        # An estimate that takes an error in leaves so much less of the innovation.
        assert (z - moved) / EPSILON == pytest.approx(H[:, i], abs=1e-4), i


def test_the_mean_force_tells_of_tilt_and_bias_what_its_jacobian_says() -> None:
    z, H, _ = gravity_levelling(an_eskf(), 1.0)
    for i in range(N_ERRORS):
        if i == YAW.start:
            continue  # who does not know his heading learns none from this
        moved = gravity_levelling(shifted(an_eskf(), i, EPSILON), 1.0).z
        assert (z - moved) / EPSILON == pytest.approx(H[:, i], abs=1e-4), i


def test_a_car_that_slides_is_believed_to_slide() -> None:
    eskf = an_eskf()
    eskf.P = np.eye(N_ERRORS) * 1e-6
    sliding = eskf.clone(NOISE)
    sliding.nominal = sliding.nominal._replace(v_n=(-9.0, 14.0, 0.0))
    calm, wild = vehicle.non_holonomic(eskf, 1.0), vehicle.non_holonomic(sliding, 1.0)
    assert abs(wild.z[0]) > 10.0
    assert wild.R[0, 0] >= (wild.z[0] / SOFT_GATE_SIGMAS) ** 2 * 0.99
    assert calm.R[0, 0] < 1.0


def test_reversing_is_no_side_slip() -> None:
    eskf = an_eskf()
    ahead_n = eskf.C_vn()[0]
    eskf.axle_m = 0.0
    for speed in (8.0, -3.0):
        vn, ve, vd = (speed * ahead_n).tolist()
        eskf.nominal = eskf.nominal._replace(v_n=(vn, ve, vd))
        assert vehicle.non_holonomic(eskf, 1.0).z == pytest.approx([0.0, 0.0], abs=1e-9)


def test_front_and_back_can_be_exchanged_without_moving_the_box() -> None:
    eskf = an_eskf()
    before, q_nb = eskf.C_vn(), eskf.nominal.q_nb
    eskf.turn_mounting_half()
    assert eskf.nominal.q_nb == q_nb
    assert eskf.C_vn()[0] == pytest.approx(-before[0])
    assert eskf.C_vn()[2] == pytest.approx(before[2])


def test_the_covariance_stays_symmetric_and_positive() -> None:
    eskf = an_eskf()
    for k in range(300):
        eskf.propagate(a_step(), use_force=True)
        if k % 3 == 2:
            eskf.predict(use_force=True)
            eskf.update(vehicle.non_holonomic(eskf, 0.12))
    assert np.abs(eskf.P - eskf.P.T).max() < 1e-9
    assert np.linalg.eigvalsh(eskf.P).min() > -1e-9


@pytest.mark.parametrize("yaw_deg", [-170.0, -60.0, 25.0, 100.0])
@pytest.mark.parametrize("has_velocity", [True, False])
def test_the_bank_finds_any_yaw_from_accelerations(
    yaw_deg: float, has_velocity: bool
) -> None:
    bank, yaw = YawBank(), math.radians(yaw_deg)
    rng = np.random.default_rng(5)
    R = np.array([[math.cos(yaw), -math.sin(yaw)], [math.sin(yaw), math.cos(yaw)]])
    p, v = np.zeros(2), np.array([0.0, 0.0])
    for k in range(60):
        for _ in range(10):
            t = k + _ / 10.0
            a = np.array([1.5 * math.sin(t / 3.0), 1.5 * math.cos(t / 4.0)])
            bank.add_stretch(0.1, (a[0] * 0.1, a[1] * 0.1))
            a_n = R @ a
            p = p + v * 0.1 + 0.005 * a_n
            v = v + 0.1 * a_n
        z_v = v + 0.1 * rng.standard_normal(2) if has_velocity else None
        z_p = p + 0.5 * rng.standard_normal(2)
        bank.update(z_p, 0.5, z_v, 0.1, 0.01, 0.02, (0.0, 1e-8))
    found, sigma = bank.yaw()
    assert sigma < CONVERGED_SIGMA_RAD
    assert abs((found - yaw + math.pi) % (2 * math.pi) - math.pi) < 3.0 * sigma


def test_a_yaw_that_drifts_is_still_found_by_the_bank() -> None:
    # The gyro's bias is not known yet: the attitude turns by half a degree a second.
    bank, drift = YawBank(), math.radians(0.5)
    p, v = np.zeros(2), np.zeros(2)
    for k in range(80):
        for _ in range(10):
            t = k + _ / 10.0
            yaw = 0.7 + drift * t
            a = np.array([1.5 * math.sin(t / 3.0), 1.5 * math.cos(t / 4.0)])
            bank.add_stretch(0.1, (a[0] * 0.1, a[1] * 0.1))
            cosine, sine = math.cos(yaw), math.sin(yaw)
            a_n = np.array([[cosine, -sine], [sine, cosine]]) @ a
            p = p + v * 0.1 + 0.005 * a_n
            v = v + 0.1 * a_n
        bank.update(p, 0.5, v, 0.1, 0.01, 0.02, (0.0, math.radians(1.0) ** 2))
    found, sigma = bank.yaw()
    assert sigma < CONVERGED_SIGMA_RAD
    assert abs(found - (0.7 + drift * 80.0)) < max(3.0 * sigma, math.radians(5.0))


def test_a_receiver_that_proves_worse_takes_back_what_it_gave() -> None:
    eskf = an_eskf()
    eskf.P, eskf.receiver_var = np.diag(np.full(N_ERRORS, 0.1)), 0.25
    before = eskf.P
    eskf.set_receiver_var(4.0)
    H = np.zeros(N_ERRORS)
    H[0] = H[17] = 1.0  # a fix sees the sum of position and lasting error
    assert pytest.approx(H @ before @ H) == H @ eskf.P @ H
    assert eskf.P[0, 0] > 1.0
    assert eskf.P[17, 17] <= 4.0
    assert np.linalg.eigvalsh(eskf.P).min() > 0.0

    grown = eskf.P
    for variance in (4.0, 3.2, 4.0, 3.2, 4.0):  # no news is no reason to grow again
        eskf.set_receiver_var(variance)
    assert pytest.approx(grown) == eskf.P


def test_nothing_is_felt_in_a_gap() -> None:
    eskf = an_eskf()
    before = eskf.mean_a_n
    for _ in range(25):
        eskf.propagate(a_step()._replace(is_gap=True), use_force=True)
        eskf.predict(use_force=True)
    assert eskf.a_n == (0.0, 0.0, 0.0)
    assert eskf.mean_a_n == pytest.approx(before)


# ---------------------------------------------------------------- what goes wrong

STEP_NS = 40_000_000


class Ride:
    """A level car that goes north, and a perfect receiver on it."""

    def __init__(self, profile: str = "vehicle", *, has_velocity: bool = True) -> None:
        self.filter = ErrorState(profile)
        self.frame = LocalFrame.at(0.9, 0.08)
        self.north, self.speed, self.has_velocity = 0.0, 0.0, has_velocity
        self.t_ns = 0
        self.go(5, 2.0)
        self.go(40)

    def step(self, accel: float = 0.0, clipped_turn_rad: float | None = None) -> None:
        self.t_ns += STEP_NS
        self.north += self.speed * 0.04 + 0.5 * accel * 0.04**2
        self.speed += accel * 0.04
        dv_b, turn = (accel * 0.04, 0.0, -9.81 * 0.04), clipped_turn_rad or 0.0
        zero = (0.0, 0.0, 0.0)
        step = ImuStep(
            *(self.t_ns, 0.04, (0.0, 0.0, turn), dv_b, 4, zero, zero, 0.0, 0.0, 25.0),
            is_saturated=clipped_turn_rad is not None,
            is_gap=False,
        )
        self.filter.add_step(step, None)

    def silence(self, seconds: float) -> None:
        zero = (0.0, 0.0, 0.0)
        for _ in range(round(seconds / 0.04)):
            self.t_ns += STEP_NS
            self.north += self.speed * 0.04
            step = ImuStep(
                *(self.t_ns, 0.04, zero, zero, 0, zero, zero, 0.0, 0.0, 25.0),
                is_saturated=False,
                is_gap=True,
            )
            self.filter.add_step(step, None)

    def fix(self) -> FixOutcome:
        lat, lon = self.frame.to_lat_lon(self.north, 0.0)
        vel = (self.speed, 0.0) if self.has_velocity else None
        fix = GpsFix(self.t_ns, 0.0, lat, lon, 10.0, vel, 2.0, 1)
        return self.filter.update(fix, self.t_ns, 20.0 if self.t_ns <= 10**9 else 0.0)

    def go(self, seconds: int, accel: float = 0.0) -> list[FixOutcome]:
        outcomes = []
        for _ in range(seconds):
            for _ in range(25):
                self.step(accel)
            outcomes.append(self.fix())
        return outcomes

    def sigma_deg(self, i: int) -> float:
        return math.degrees(self.filter._eskf.sigma(i))

    def miss_m(self) -> float:
        estimate = self.filter.estimate_after(0.0)
        north, east = self.frame.to_ne(estimate.lat_rad, estimate.lon_rad)
        return math.hypot(north - self.north, east)


def test_clipped_readings_are_doubted() -> None:
    # The box is thrown about at 1400 deg/s, of which the gyro shows 500.
    ride = Ride()
    assert ride.sigma_deg(8) < 8.0
    speed_sigma = ride.filter.speed()[1]
    for _ in range(12):
        ride.step(clipped_turn_rad=math.radians(20.0))
    ride.fix()
    assert ride.sigma_deg(6) > 20.0
    assert ride.filter.speed()[1] > speed_sigma
    ride.go(1)
    for _ in range(12):  # and back
        ride.step(clipped_turn_rad=math.radians(-8.0))
    assert set(ride.go(40)[5:]) == {FixOutcome.ACCEPTED}
    assert ride.sigma_deg(8) < 10.0
    assert ride.miss_m() < 5.0


def test_a_single_clipped_bump_costs_little() -> None:
    ride = Ride()
    ride.step(clipped_turn_rad=0.0)
    ride.go(5)
    assert ride.sigma_deg(8) < 8.0
    assert ride.miss_m() < 2.0


def test_one_silence_loses_the_orientation_once() -> None:
    ride = Ride("free")
    ride.filter.take_notices()
    ride.silence(20.0)
    for _ in range(15):
        ride.step(clipped_turn_rad=math.radians(2.0))
        ride.go(1)
    told = [n for n in ride.filter.take_notices() if "orientation was lost" in n]
    assert len(told) == 1
    assert ride.miss_m() < 10.0


def test_a_parked_receiver_without_speed_is_not_locked_out() -> None:
    # GGA alone, and a receiver that holds its position when parked. After a tunnel the
    # filter still believes in its speed: the same place again and again is then no
    # fault of the receiver.
    ride = Ride(has_velocity=False)
    ride.speed = 0.0
    for _ in range(30 * 25):
        ride.step()
    outcomes = ride.go(AGREEING_FIXES + 2)
    assert outcomes[1] is FixOutcome.FROZEN
    assert FixOutcome.REACQUIRED in outcomes
    assert ride.miss_m() < 10.0


def test_a_position_that_stands_while_its_receiver_moves_is_not_taken() -> None:
    ride = Ride()
    for _ in range(20):
        for _ in range(25):
            ride.step()
        ride.north -= ride.speed  # the receiver repeats its place, not its speed
        outcome = ride.fix()
    assert outcome is FixOutcome.FROZEN


# ------------------------------------------------------------------- whole drives


class Drive(NamedTuple):
    """Rows of a simulated drive against its truth."""

    t_s: Array
    error_m: Array
    r95_m: Array
    rows: list[NavState]
    pipeline: Pipeline


@cache
def simulated(seed: int) -> tuple[Simulated, list[Frame], Array]:
    """Simulate a drive of 400 s, once for all tests; its truth as a table."""
    made = simulate("drive", seed=seed, duration_s=400.0)
    frames = list(made.frames)
    return made, frames, np.array([(r.utc_s, r.lat_rad, r.lon_rad) for r in made.truth])


@cache
def plain_drive(seed: int) -> Drive:
    """Track a whole drive with the defaults, once for all tests."""
    return drive(seed)


def drive(
    seed: int = 0,
    until_s: float = math.inf,
    keep: Callable[[Frame, float], bool] = lambda frame, t_s: True,
    edit: Callable[[Frame, float], Frame] = lambda frame, t_s: frame,
    **settings: object,
) -> Drive:
    """Track a simulated drive with the error-state filter."""
    made, frames, truth = simulated(seed)
    chosen = {"estimator": "error-state", "profile": "vehicle", **settings}
    pipeline = Pipeline(made.header, TrackerSettings(**chosen))  # type: ignore[arg-type]
    rows: list[NavState] = []
    for frame in frames:
        t_s = (frame.t_ns - 1_000_000_000) * 1e-9
        if t_s < until_s and keep(frame, t_s):
            rows += pipeline.feed(edit(frame, t_s))
    utc = np.array([row.utc_s for row in rows])
    north = np.array([r.lat_rad for r in rows]) - np.interp(
        utc, truth[:, 0], truth[:, 1]
    )
    east = np.array([r.lon_rad for r in rows]) - np.interp(
        utc, truth[:, 0], truth[:, 2]
    )
    error_m = 6.37e6 * np.hypot(north, east * math.cos(truth[0, 1]))
    r95_m = np.array([row.r95_m for row in rows])
    return Drive(utc - truth[0, 0], error_m, r95_m, rows, pipeline)


def no_gps(start_s: float, end_s: float) -> Callable[[Frame, float], bool]:
    return lambda frame, t_s: (
        frame.source is not Source.GPS or not start_s <= t_s < end_s
    )


def test_a_drive_is_followed_within_its_radius() -> None:
    result = plain_drive(seed=1)
    late = result.t_s > 30.0
    assert np.all(np.isfinite(result.error_m))
    assert result.error_m[late].max() < 30.0
    assert (result.error_m <= result.r95_m)[late].mean() > 0.85


def test_a_tunnel_of_half_a_minute_costs_a_house_not_a_street() -> None:
    result = drive(seed=2, keep=no_gps(200.0, 230.0))
    end = np.searchsorted(result.t_s, 229.5)
    assert result.error_m[end] < 25.0
    assert result.error_m[end] < result.r95_m[end]
    assert result.rows[end].mode in (Mode.DR, Mode.STILL)


def test_the_mounting_and_the_biases_are_found() -> None:
    report = plain_drive(seed=4).pipeline.report()
    mounting_deg = report["mounting_deg"]
    assert isinstance(mounting_deg, list)
    _, pitch_deg, yaw_deg = mounting_deg
    chip = simulated(4)[0].chip
    _, true_pitch, true_yaw = (math.degrees(a) for a in to_euler(chip.q_vb))
    assert pitch_deg == pytest.approx(true_pitch, abs=1.5)
    assert yaw_deg == pytest.approx(true_yaw, abs=1.5)
    biases = report["gyro_bias_dps"]
    assert biases == pytest.approx(np.degrees(chip.gyro_bias_radps), abs=0.4)


@pytest.mark.parametrize(
    "mount", [("+y", "+x", "-z"), ("-x", "+y", "-z"), ("+x", "+z", "-y")]
)
def test_a_box_may_sit_turned_or_on_its_side(mount: tuple[str, str, str]) -> None:
    result = drive(seed=3, mount=mount)
    settled = result.t_s > 150.0
    assert result.error_m[settled].max() < 35.0


def test_a_latency_of_a_second_is_measured() -> None:
    result = drive(seed=1, latency_s=0.9)
    delay_s = result.pipeline.report()["delay_s"]
    # Told 0.9 s, but it is 0.2 s: fixes describe an instant 0.7 s later.
    assert delay_s == pytest.approx(0.7, abs=0.15)


def test_a_wild_fix_changes_nothing() -> None:
    def wild(frame: Frame, t_s: float) -> Frame:
        if frame.source is not Source.GPS or not 150.0 <= t_s < 150.9:
            return frame
        body = frame.data.decode()[1:].split("*")[0].replace("5200.", "5205.")
        body = body.replace("5159.", "5154.")
        check = 0
        for c in body.encode():
            check ^= c
        return frame._replace(data=f"${body}*{check:02X}".encode())

    calm, hit = plain_drive(seed=1), drive(seed=1, until_s=170.0, edit=wild)
    calm_error_m = calm.error_m[: len(hit.error_m)]
    assert hit.error_m.max() < calm_error_m.max() + 5.0


def test_an_imu_that_dies_leaves_the_receiver() -> None:
    dead = drive(
        seed=1,
        until_s=200.0,
        keep=lambda f, t: f.source is not Source.IMU or not 80.0 < t < 120.0,
    )
    assert np.all(np.isfinite(dead.r95_m))
    assert any(row.mode is Mode.GPSONLY for row in dead.rows)
    assert dead.error_m[(dead.t_s > 85.0) & (dead.t_s < 115.0)].max() < 60.0
    assert dead.error_m[dead.t_s > 150.0].max() < 40.0


def test_what_was_learnt_is_a_better_start() -> None:
    learnt = plain_drive(seed=4)
    prior = learnt.pipeline._tracker.learned_parameters()
    report = drive(seed=4, until_s=60.0, prior=prior).pipeline.report()
    fresh = drive(seed=4, until_s=60.0).pipeline.report()
    warm_sigma, fresh_sigma = report["mounting_sigma_deg"], fresh["mounting_sigma_deg"]
    assert warm_sigma[1] < fresh_sigma[1]


def test_the_profile_is_found() -> None:
    result = drive(seed=2, profile="auto")
    assert result.pipeline.report()["profile"] == "vehicle"


def test_the_same_stream_gives_the_same_rows() -> None:
    again = drive(seed=1, until_s=120.0).rows
    assert again == plain_drive(seed=1).rows[: len(again)]
    assert len(again) > 400


def test_a_stream_that_is_cut_gives_a_prefix() -> None:
    whole = plain_drive(seed=4).rows
    for until_s in (31.7, 70.0):
        cut = drive(seed=4, until_s=until_s).rows
        assert whole[: len(cut)] == cut


def test_a_receiver_that_tells_places_alone_will_do() -> None:
    inside: list[bool] = []
    worst = 0.0
    for seed in range(4):  # a receiver's lasting error is one draw a drive
        result = drive(
            seed=seed,
            keep=lambda frame, _: (
                frame.source is not Source.GPS or b"GGA" in frame.data
            ),
        )
        late = result.t_s > 60.0
        assert np.all(np.isfinite(result.r95_m))
        inside += (result.error_m <= result.r95_m)[late].tolist()
        worst = max(worst, (result.error_m / result.r95_m)[late].max())
    assert np.mean(inside) > 0.9
    assert worst < 2.0
