"""Paths, motions and positions against numerical oracles of their own."""

import math
from itertools import pairwise

import numpy as np
import pytest

from imu_tracker.geometry.geodesy import radii_m
from imu_tracker.simulation import SCENARIOS
from imu_tracker.simulation.motion.paths import (
    FloatArray,
    Leg,
    Path,
    change_speed,
    cruise,
    stand,
    turn,
)
from imu_tracker.simulation.motion.positions import Place, Whereabouts, whereabouts
from imu_tracker.simulation.motion.trajectory import Hills, Motion, Ride
from imu_tracker.simulation.scenarios import DELFT, line_walk, roundabout, square_walk

CLOSURE_M = 5e-3
"""Meridians converge, so that who keeps his heading towards north on a round of area
A comes back A tan(lat) / R to the side: 3 mm on these courses."""


def motion_of(scenario: str, t_s: FloatArray, seed: int = 4) -> Motion:
    return SCENARIOS[scenario].trajectory(np.random.default_rng(seed)).at(t_s)


def ticks_until(scenario: str, end_s: float) -> Whereabouts:
    plan = SCENARIOS[scenario]
    stretches = []
    for stretch in whereabouts(plan.trajectory(np.random.default_rng(4)), plan.start):
        stretches.append(stretch)
        if stretch.motion.t_s[-1] >= end_s:
            break
    parts = zip(*(stretch.motion for stretch in stretches), strict=True)
    motion = Motion(*map(np.concatenate, parts))
    return Whereabouts(
        motion,
        np.concatenate([s.lat_rad for s in stretches]),
        np.concatenate([s.lon_rad for s in stretches]),
        np.concatenate([s.alt_m for s in stretches]),
    )


def metres_from_start(place: Whereabouts) -> tuple[FloatArray, FloatArray]:
    """North and east on the start's tangent plane, good to 1e-6 within 100 m."""
    meridian_m, prime_vertical_m = radii_m(DELFT.lat_rad)
    return (
        (place.lat_rad - DELFT.lat_rad) * (meridian_m + DELFT.alt_m),
        (place.lon_rad - DELFT.lon_rad)
        * (prime_vertical_m + DELFT.alt_m)
        * math.cos(DELFT.lat_rad),
    )


@pytest.mark.parametrize("scenario", SCENARIOS)
def test_rates_are_the_derivatives_of_what_they_belong_to(scenario: str) -> None:
    t_s = np.linspace(15.0, 300.0, 20_000)
    h = 1e-4
    before, here, after = (motion_of(scenario, t_s + d) for d in (-h, 0.0, h))

    slope = (after.v_n - before.v_n) / (2 * h)
    np.testing.assert_allclose(here.a_n, slope, atol=2e-6)
    slope = (after.rpy_rad - before.rpy_rad) / (2 * h)
    np.testing.assert_allclose(here.rpy_rate_radps, slope, atol=2e-6)


@pytest.mark.parametrize("scenario", SCENARIOS)
def test_acceleration_and_angular_rate_have_no_jumps(scenario: str) -> None:
    h = 1e-3
    motion = motion_of(scenario, np.arange(0.0, 300.0, h))

    assert np.abs(np.diff(motion.a_n, axis=0)).max() < 60.0 * h  # m/s^3, a gait's
    assert np.abs(np.diff(motion.rpy_rate_radps, axis=0)).max() < 6.0 * h


@pytest.mark.parametrize("seed", range(10))
def test_a_drive_is_one_that_a_car_can_make(seed: int) -> None:
    t_s = np.arange(0.0, 1200.0, 0.1)
    motion = motion_of("drive", t_s, seed)
    yaw = motion.rpy_rad[:, 2]
    ahead = np.column_stack([np.cos(yaw), np.sin(yaw)])
    along = np.sum(motion.a_n[:, :2] * ahead, axis=1)
    across = motion.a_n[:, 1] * ahead[:, 0] - motion.a_n[:, 0] * ahead[:, 1]
    speed = np.linalg.norm(motion.v_n, axis=1)

    assert np.abs(along).max() < 3.0
    assert 1.5 < np.abs(across).max() < 3.0
    assert speed.max() < 20.0
    assert np.abs(motion.a_n[:, 2]).max() < 1.0
    assert 0.05 < np.mean(speed < 0.01) < 0.6
    # A car goes where its nose points, but for the little that its body leans.
    sideways = motion.v_n[:, 1] * ahead[:, 0] - motion.v_n[:, 0] * ahead[:, 1]
    assert np.abs(sideways).max() < 1e-9
    assert 55.0 < np.sum(motion.is_covered) * 0.1 < 65.0 * 2


@pytest.mark.parametrize("seed", range(3))
def test_a_long_drive_stays_in_town_and_differs_by_seed(seed: int) -> None:
    trajectory = SCENARIOS["drive"].trajectory(np.random.default_rng(seed))
    other = SCENARIOS["drive"].trajectory(np.random.default_rng(seed + 1))
    position_m = np.zeros(3)
    farthest_m = 0.0
    for hour_s in range(0, 36_000, 60):
        t_s = hour_s + np.arange(0.0, 60.0, 0.1)
        v_n = trajectory.at(t_s).v_n
        assert hour_s < 60 or not np.array_equal(v_n, other.at(t_s).v_n)
        position_m += v_n.sum(axis=0) * 0.1
        farthest_m = max(farthest_m, float(np.linalg.norm(position_m)))

    assert 1000.0 < farthest_m < 5000.0
    assert abs(position_m[2]) < 25.0


def test_scenarios_begin_with_twenty_seconds_at_rest() -> None:
    t_s = np.arange(0.0, 20.0, 0.01)
    for scenario in SCENARIOS:
        motion = motion_of(scenario, t_s)
        assert not motion.v_n.any()
        assert not motion.rpy_rate_radps.any()


@pytest.mark.parametrize(
    ("legs", "length_m", "turn_rad"),
    [
        (line_walk(), 500.0, 0.0),
        (square_walk(), 500.0, 2.0 * math.pi),
        (roundabout(), 1000.0, -10.0 * math.pi),
    ],
)
def test_courses_have_the_length_and_the_turns_they_are_named_for(
    legs: tuple[Leg, ...], length_m: float, turn_rad: float
) -> None:
    assert sum(leg.length_m for leg in legs) == pytest.approx(length_m, abs=1e-9)
    assert sum(leg.turn_rad for leg in legs) == pytest.approx(turn_rad, abs=1e-12)


def test_the_square_closes_and_has_four_equal_sides() -> None:
    place = ticks_until("walk-square", SCENARIOS["walk-square"].duration_s)
    north_m, east_m = metres_from_start(place)

    assert north_m[-1] == pytest.approx(0.0, abs=CLOSURE_M)
    assert east_m[-1] == pytest.approx(0.0, abs=CLOSURE_M)
    turned = math.radians(10.0)
    along = north_m * math.cos(turned) + east_m * math.sin(turned)
    across = east_m * math.cos(turned) - north_m * math.sin(turned)
    assert np.ptp(along) == pytest.approx(np.ptp(across), abs=CLOSURE_M)
    assert 125.0 < np.ptp(along) < 127.0  # corners are cut, so sides are longer


def test_the_roundabout_is_a_circle_of_200_m_driven_to_the_left() -> None:
    place = ticks_until("roundabout", SCENARIOS["roundabout"].duration_s)
    north_m, east_m = metres_from_start(place)
    radius_m = 200.0 / (2.0 * math.pi)

    from_centre_m = np.hypot(north_m, east_m + radius_m)
    np.testing.assert_allclose(from_centre_m, radius_m, atol=CLOSURE_M)
    assert north_m[-1] == pytest.approx(0.0, abs=CLOSURE_M)


def test_positions_agree_with_a_plain_integration_in_small_steps() -> None:
    end_s, h = 300.0, 0.005
    place = ticks_until("drive", end_s)
    v_n = motion_of("drive", np.arange(0.0, end_s, h) + h / 2).v_n
    lat, lon, alt = DELFT
    for north, east, down in v_n.tolist():
        meridian_m, prime_vertical_m = radii_m(lat)
        middle = lat + 0.5 * h * north / meridian_m
        lat += h * north / (meridian_m + alt)
        lon += h * east / ((prime_vertical_m + alt) * math.cos(middle))
        alt -= h * down

    i = int(np.searchsorted(place.motion.t_s, end_s))
    metre = 1.0 / 6.378e6
    assert place.lat_rad[i] == pytest.approx(lat, abs=1e-4 * metre)
    assert place.lon_rad[i] == pytest.approx(lon, abs=1e-4 * metre)
    assert place.alt_m[i] == pytest.approx(alt, abs=1e-4)


def test_whereabouts_tick_without_gap_or_overlap() -> None:
    stretches = whereabouts(Ride(Path(())), Place(0.9, 0.1, 0.0))
    t_s = np.concatenate([next(stretches).motion.t_s for _ in range(3)])

    np.testing.assert_allclose(t_s, np.arange(600) / 20.0, atol=1e-12)


def test_distance_and_heading_are_the_integrals_of_speed_and_turning() -> None:
    legs = (
        change_speed(0.0, 10.0, 2.0, 0.01),
        cruise(30.0, 10.0, 0.01),
        Leg(2.0, 10.0, 10.0, 0.01, 0.0),
        *turn(-1.2, 10.0, radius_m=40.0),
        change_speed(10.0, 0.0, 2.0),
    )
    t_s = np.linspace(0.0, 30.0, 300_001)
    k = Path(legs, heading_rad=0.3).at(t_s)

    def integral(rate: FloatArray) -> FloatArray:
        steps = 0.5 * (rate[1:] + rate[:-1]) * np.diff(t_s)
        return np.concatenate([[0.0], np.cumsum(steps)])

    np.testing.assert_allclose(k.distance_m, integral(k.speed_mps), atol=1e-7)
    turning = integral(k.speed_mps * k.curvature_per_m)
    np.testing.assert_allclose(k.heading_rad, 0.3 + turning, atol=1e-8)


def test_speed_changes_peak_at_the_acceleration_asked_for() -> None:
    leg = change_speed(3.0, 15.0, 2.0)
    k = Path((change_speed(0.0, 3.0, 2.0), leg, cruise(500.0, 15.0))).at(
        np.linspace(0.0, 20.0, 20_001)
    )

    assert k.accel_mps2.max() == pytest.approx(2.0, rel=1e-5)


def test_a_small_turn_takes_a_wider_bend_instead_of_a_shorter_one() -> None:
    legs = turn(0.05, 10.0, radius_m=20.0)

    assert sum(leg.turn_rad for leg in legs) == pytest.approx(0.05)
    assert max(leg.end_curvature_per_m for leg in legs) < 1.0 / 20.0


def test_a_path_that_ended_stands_still_for_ever() -> None:
    k = Path((stand(1.0),), heading_rad=0.7).at(np.array([0.5, 1e5, 1e6]))

    assert not k.speed_mps.any()
    np.testing.assert_array_equal(k.heading_rad, 0.7)


@pytest.mark.parametrize(
    ("legs", "complaint"),
    [
        ((cruise(10.0, 5.0),), "does not go on at 0.0 m/s"),
        (
            (change_speed(0.0, 5.0, 1.0), cruise(9.0, 5.0, 0.1)),
            "does not go on at 0.0/m",
        ),
        ((Leg(5.0, 0.0, 4.0, 0.0, 0.1),), "changes speed and curvature at once"),
    ],
)
def test_legs_that_nobody_can_drive_are_refused(
    legs: tuple[Leg, ...], complaint: str
) -> None:
    with pytest.raises(ValueError, match=complaint):
        Path(legs).at(np.array([100.0]))


def test_hills_lift_by_the_slope() -> None:
    hills = Hills(slope_rad=(0.05,), length_m=(400.0,), phase_rad=(0.0,))
    legs = (change_speed(0.0, 10.0, 2.0), cruise(2000.0, 10.0))
    t_s = np.arange(0.0, 180.0, 0.05)
    motion = Ride(Path(legs), hills=hills).at(t_s)
    climb_m = -np.cumsum(motion.v_n[:, 2]) * 0.05

    # Half a wave of a sine: 400 m / pi times the sine's amplitude.
    assert np.ptp(climb_m) == pytest.approx(0.05 * 400.0 / math.pi, rel=2e-3)
    assert np.abs(motion.rpy_rad[:, 1]).max() == pytest.approx(0.05, rel=1e-3)


def test_legs_are_forgotten_once_they_are_past() -> None:
    path = Path(stand(10.0) for _ in range(100_000))
    for start_s, end_s in pairwise(range(0, 100_000, 1000)):
        path.at(np.array([start_s, end_s], dtype=float))

    assert len(path._placed) < 120
