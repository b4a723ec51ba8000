"""What is known of a body in the dark: gait, road, and a lost orientation."""

import math

import numpy as np
import pytest

from imu_tracker.estimation.behaviour import gravity_is_down
from imu_tracker.estimation.error_model import N_ERRORS, NoiseLevel
from imu_tracker.estimation.eskf import Eskf, Nominal
from imu_tracker.estimation.gait import LEARNING_S, START_SPEED_MPS, Gait
from imu_tracker.estimation.orientation_watch import LOST_NATS, OrientationWatch
from imu_tracker.estimation.road import (
    LEAST_FORWARD_MPS2,
    LEAST_SLOPE_RAD,
    START_SLOPE_RAD,
    Road,
)
from imu_tracker.estimation.rotation import IDENTITY, from_euler
from imu_tracker.samples import Vec3

NOISE = NoiseLevel(gyro_share=0.1, accel_share=0.1)


def moving(v_n: Vec3, yaw_rad: float = 0.0, pitch_rad: float = 0.0) -> Eskf:
    eskf = Eskf(NOISE, is_vehicle=True)
    q_nb = from_euler(0.0, pitch_rad, yaw_rad)
    eskf.nominal = Nominal(0, (0.0, 0.0, 0.0), v_n, q_nb)
    return eskf


# -------------------------------------------------------------------------- gait


def test_a_walker_goes_on_where_the_box_has_turned_to() -> None:
    # North at 1.4 m/s, the box in any pocket; then he turns right, and so does it.
    for pocket_rad in (0.0, 2.0, -1.3):
        gait = Gait()
        for _ in range(120):
            seen = moving((1.4, 0.0, 0.0), pocket_rad)
            gait.observe(seen, IDENTITY, 1.0, is_stepping=True)
        dark = moving((0.0, 0.0, 0.0), pocket_rad + 0.5 * math.pi)
        onward = gait.goes_on(dark, IDENTITY, 10.0, 1.0)
        assert onward is not None
        assert onward.z == pytest.approx([0.0, 1.4], abs=0.02)


def test_what_the_yaw_may_have_drifted_is_doubted_across_alone() -> None:
    gait = Gait()
    for _ in range(120):
        gait.observe(moving((1.4, 0.0, 0.0)), IDENTITY, 1.0, is_stepping=True)
    early = gait.goes_on(moving((1.4, 0.0, 0.0)), IDENTITY, 1.0, 1.0)
    late = gait.goes_on(moving((1.4, 0.0, 0.0)), IDENTITY, 300.0, 1.0)
    assert early is not None
    assert late is not None
    assert late.R[0, 0] == pytest.approx(early.R[0, 0])
    assert late.R[1, 1] > 2.0 * early.R[1, 1]


def test_how_somebody_walks_is_not_known_at_once() -> None:
    gait = Gait()
    for _ in range(int(LEARNING_S) - 1):
        gait.observe(moving((1.4, 0.0, 0.0)), IDENTITY, 1.0, is_stepping=True)
    for _ in range(100):  # standing about, and rolling along, teach nothing of it
        gait.observe(moving((0.1, 0.0, 0.0)), IDENTITY, 1.0, is_stepping=True)
        gait.observe(moving((0.0, 1.4, 0.0)), IDENTITY, 1.0, is_stepping=False)
    assert gait.goes_on(moving((1.4, 0.0, 0.0)), IDENTITY, 1.0, 1.0) is None


def test_the_speed_on_foot_is_bounded_by_what_was_seen() -> None:
    stroller, runner = Gait(), Gait()
    for _ in range(300):
        stroller.observe(moving((0.8, 0.0, 0.0)), IDENTITY, 1.0, is_stepping=True)
        runner.observe(moving((0.0, 4.0, 0.0)), IDENTITY, 1.0, is_stepping=True)
    lost = moving((10.0, 0.0, 0.0))
    slow, fast, unknown = (g.bounded(lost, 1.0) for g in (stroller, runner, Gait()))
    assert slow.z == pytest.approx([-10.0, 0.0])
    assert slow.R[0, 0] < unknown.R[0, 0] < fast.R[0, 0]
    # Two axes share the square of the speed; 30 s of it count as one.
    assert unknown.R[0, 0] == pytest.approx(30.0 * START_SPEED_MPS**2 / 2.0)


# -------------------------------------------------------------------------- road


def test_a_level_motorway_at_a_steady_speed_is_known_to_be_one() -> None:
    road = Road()
    for _ in range(1200):
        road.observe(moving((30.0, 0.0, 0.0)), 1.0)
    assert road.slope_sigma_rad < math.radians(2.0)
    assert road.forward_sigma_mps2 < 0.4
    assert road.slope_sigma_rad >= LEAST_SLOPE_RAD
    assert road.forward_sigma_mps2 >= LEAST_FORWARD_MPS2


def test_a_pass_road_is_steeper_than_one_had_thought() -> None:
    road = Road()
    for k in range(1200):
        pitch_rad = math.radians(8.0) * (1 if k // 300 % 2 else -1)
        road.observe(moving((10.0, 0.0, 0.0), 0.0, pitch_rad), 1.0)
    assert road.slope_sigma_rad == pytest.approx(math.radians(8.0), rel=0.1)


def test_who_stands_says_nothing_of_roads() -> None:
    road = Road()
    for _ in range(1000):
        road.observe(moving((0.1, 0.0, 0.0)), 1.0)
    assert road.slope_sigma_rad == START_SLOPE_RAD


# --------------------------------------------------------------------- levelling


def test_the_mean_force_of_a_free_body_is_gravity_by_its_jacobian() -> None:
    def measured(tilt: tuple[float, float], bias_mps2: float) -> Eskf:
        eskf = moving((0.0, 0.0, 0.0))
        eskf.nominal = eskf.nominal._replace(q_nb=from_euler(*tilt, 0.0))
        roll, pitch = tilt
        # At rest and level: what a box that believes in this tilt takes for motion.
        eskf.a_n = (
            -9.81 * math.sin(pitch) - bias_mps2,
            9.81 * math.sin(roll) * math.cos(pitch),
            0.0,
        )
        return eskf

    z0, H, _ = gravity_is_down(measured((0.0, 0.0), 0.0), 1.0)
    for i, moved in (
        (6, measured((1e-6, 0.0), 0.0)),
        (7, measured((0.0, 1e-6), 0.0)),
        (12, measured((0.0, 0.0), 1e-6)),
    ):
        z = gravity_is_down(moved, 1.0).z
        # z - z0 = -H e: the same, with what the estimate has taken in already.
        assert (z0 - z) / 1e-6 == pytest.approx(H[:, i], abs=1e-3), i
    assert H.shape == (2, N_ERRORS)


# ---------------------------------------------------------------- lost orientation


def watched(
    seconds: int, gyro_off_rad: float, noise_mps: float, seed: int = 3
) -> list[bool]:
    """Drive in circles; the filter believes in an acceleration that is turned."""
    watch, rng = OrientationWatch(), np.random.default_rng(seed)
    found, speed, believed = [], 15.0, np.array([15.0, 0.0])
    for k in range(1, seconds + 1):
        heading = k / 8.0
        truth = speed * np.array([math.cos(heading), math.sin(heading)])
        before = speed * np.array(
            [math.cos(heading - 0.125), math.sin(heading - 0.125)]
        )
        cosine, sine = math.cos(gyro_off_rad), math.sin(gyro_off_rad)
        turned = np.array([[cosine, -sine], [sine, cosine]]) @ (truth - before)
        believed = believed + turned
        z = truth + noise_mps * rng.standard_normal(2)
        S = np.eye(2) * (0.3**2 + noise_mps**2)
        found.append(
            watch.observe(
                k * 1_000_000_000,
                (float(z[0]), float(z[1])),
                noise_mps**2,
                float(math.dist(truth, before)),
                2.5**2,
                z - believed,
                S,
            )
        )
        believed = believed + 0.7 * (z - believed)
    return found


def test_a_filter_that_knows_its_way_is_left_alone() -> None:
    assert not any(watched(600, 0.0, 0.1))
    assert not any(watched(600, 0.3, 0.1))


def test_a_poor_receiver_is_no_fault_of_the_filter() -> None:
    assert not any(watched(600, 0.0, 3.0))


def test_a_filter_that_is_turned_over_is_found_out_within_a_minute() -> None:
    found = watched(60, math.pi, 0.1)
    assert any(found)
    assert not found[0]


def test_fixes_after_a_silence_say_nothing() -> None:
    watch = OrientationWatch()
    for k in range(200):
        sign = 1.0 if k % 2 else -1.0
        assert not watch.observe(
            k * 60_000_000_000,
            (20.0 * sign, 0.0),
            0.01,
            0.3,
            2.5**2,
            np.array([40.0 * sign, 0.0]),
            np.eye(2),
        )
    assert watch.lead_nats > LOST_NATS
