"""Laws that hold for any rotation, any place, any counts, and any stream."""

import math
from functools import cache
from itertools import pairwise, permutations, product
from struct import pack

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from imu_tracker.calibration.counts import CountsModel, parse_mount
from imu_tracker.errors import ConfigError
from imu_tracker.estimation.estimate import r95_of
from imu_tracker.estimation.receiver.utc import UtcClock
from imu_tracker.estimation.settings import TrackerSettings
from imu_tracker.estimation.six_state.constraints import non_holonomic
from imu_tracker.estimation.six_state.estimator import SixState
from imu_tracker.estimation.tracker import Tracker
from imu_tracker.geometry.geodesy import LocalFrame, radii_m
from imu_tracker.geometry.rotation import (
    IDENTITY,
    conjugate,
    from_euler,
    from_rotation_vector,
    matrix,
    multiply,
    normalise,
    rotate,
    to_euler,
    to_rotation_vector,
    wrap_pi,
)
from imu_tracker.motion.preintegration import Preintegrator
from imu_tracker.motion.standstill import Rest
from imu_tracker.pipeline import Pipeline
from imu_tracker.samples import (
    Frame,
    GpsFix,
    ImuSample,
    Mount,
    Quat,
    SessionHeader,
    Source,
    Vec3,
)
from imu_tracker.simulation import simulate
from imu_tracker.storage.latlong import format_row
from support.strategies import (
    angles,
    bursts,
    int16,
    latitudes,
    longitudes,
    metres,
    unit_quaternions,
    vectors,
)

MOUNTS: list[Mount] = []
for order in permutations("xyz"):
    for sx, sy, sz in product("+-", repeat=3):
        try:
            parse_mount(mount := (sx + order[0], sy + order[1], sz + order[2]))
        except ConfigError:
            continue
        MOUNTS.append(mount)


def close(a: Quat, b: Quat) -> bool:
    """Whether two quaternions are the same rotation."""
    return np.allclose(matrix(a), matrix(b), atol=1e-9)


# ------------------------------------------------------------------------ rotations


@given(unit_quaternions, unit_quaternions, unit_quaternions)
def test_rotations_are_a_group(a: Quat, b: Quat, c: Quat) -> None:
    assert close(multiply(multiply(a, b), c), multiply(a, multiply(b, c)))
    assert close(multiply(a, IDENTITY), a)
    assert close(multiply(a, conjugate(a)), IDENTITY)


@given(unit_quaternions, vectors)
def test_rotations_keep_lengths(q: Quat, v: Vec3) -> None:
    assert math.isclose(math.hypot(*rotate(q, v)), math.hypot(*v), abs_tol=1e-9)


@given(unit_quaternions, unit_quaternions, vectors)
def test_products_rotate_one_after_the_other(a: Quat, b: Quat, v: Vec3) -> None:
    assert np.allclose(rotate(multiply(a, b), v), rotate(a, rotate(b, v)), atol=1e-9)


@given(unit_quaternions)
def test_all_notations_mean_the_same_rotation(q: Quat) -> None:
    assert close(from_rotation_vector(to_rotation_vector(q)), q)
    if abs(matrix(q)[2, 0]) < 1.0 - 1e-9:  # straight up, roll and yaw are one
        assert np.allclose(matrix(from_euler(*to_euler(q))), matrix(q), atol=1e-6)
    assert np.allclose(matrix(q) @ matrix(q).T, np.eye(3), atol=1e-12)
    assert math.isclose(np.linalg.det(matrix(q)), 1.0)
    assert math.isclose(math.hypot(*normalise(q)), 1.0)


@given(angles)
def test_wrapped_angles_are_the_same_direction(angle: float) -> None:
    wrapped = wrap_pi(angle)
    assert -math.pi <= wrapped <= math.pi
    turns = (angle - wrapped) / (2.0 * math.pi)
    assert math.isclose(turns, round(turns), abs_tol=1e-9)


# ------------------------------------------------------------------------ the Earth


@given(latitudes, longitudes, metres, metres)
def test_metres_come_back_from_degrees(
    lat: float, lon: float, north: float, east: float
) -> None:
    frame = LocalFrame.at(lat, lon)
    reached = frame.to_lat_lon(north, east)
    if abs(reached[0]) < 0.5 * math.pi:
        assert np.allclose(frame.to_ne(*reached), (north, east), atol=1e-6)
    assert -0.5 * math.pi <= reached[0] <= 0.5 * math.pi
    assert -math.pi <= reached[1] <= math.pi


@given(latitudes)
def test_the_earth_is_nearly_a_ball(lat: float) -> None:
    meridian, prime_vertical = radii_m(lat)
    assert 6.33e6 < meridian < 6.40e6
    assert 6.378e6 < prime_vertical < 6.40e6
    assert meridian <= prime_vertical * (1.0 + 1e-12)


# ------------------------------------------------------------------------ the counts


@given(
    st.sampled_from([2, 4, 8, 16]),
    st.sampled_from([250, 500, 1000, 2000]),
    st.sampled_from(MOUNTS),
    st.lists(int16, min_size=7, max_size=7),
)
def test_any_burst_comes_back(
    accel: int, gyro: int, mount: Mount, counts: list[int]
) -> None:
    raw = pack(">7h", *counts)
    model = CountsModel(accel, gyro, mount)
    sample = model.decode(0, raw)
    again = model.encode(sample.accel_mps2, sample.gyro_radps, sample.temp_degc)
    assert again == raw


# -------------------------------------------------------------------------- filters

fixes = st.tuples(
    st.floats(-300, 300), st.floats(-300, 300), st.floats(0.02, 30), st.booleans()
)
events = st.lists(
    st.one_of(st.tuples(vectors, vectors), fixes, st.just("gap"), st.just("rest")),
    max_size=60,
)


@settings(max_examples=60)
@given(events, st.sampled_from(["free", "vehicle", "walker"]))
def test_whatever_happens_the_filter_keeps_its_head(
    happened: list[object], profile: str
) -> None:
    # Any samples, fixes, gaps and rests, in any order: P stays symmetric and not
    # negative, the state stays finite.
    home = LocalFrame.at(0.9, 0.1)
    estimator, sums, t_ns = SixState(profile), Preintegrator(), 0
    estimator.start(0.9, 0.1, 10.0)
    for what in happened:
        if what == "gap":
            t_ns += 400_000_000
            continue
        if isinstance(what, tuple) and len(what) == 4:
            north, east, sigma, has_velocity = what
            place = home.to_lat_lon(north, east)
            vel = (0.1 * north, 0.1 * east) if has_velocity else None
            estimator.update(GpsFix(t_ns, 0.0, *place, 3.0, vel, sigma, 1), 0.01)
            continue
        accel, gyro = what if isinstance(what, tuple) else ((0.0, 0.1, -9.8),) * 2
        for _ in range(10):
            t_ns += 10_000_000
            scaled = (gyro[0] / 10, gyro[1] / 10, gyro[2] / 10)
            step = sums.add_sample(ImuSample(t_ns, accel, scaled, 20.0))
            if step is not None:
                rest = Rest(scaled, (0.0, 0.1, -9.8), 1.0) if what == "rest" else None
                estimator.propagate(step, rest)
    estimate = estimator.estimate()
    assert all(map(math.isfinite, (*estimate[:2], *estimate.v_n_mps, *estimate.q_nb)))
    assert estimate.r95_m >= 0.0
    assert math.isfinite(estimate.r95_m)
    for P in (estimator._kf.P, estimator._attitude.snapshot().P):
        assert np.allclose(P, P.T, rtol=1e-6)
        assert np.linalg.eigvalsh(P).min() > -1e-7 * np.trace(P)


@given(
    st.floats(-math.pi, math.pi), vectors, st.floats(0.001, 3.0), st.floats(-2.0, 2.0)
)
def test_the_vehicle_constraint_is_always_a_measurement(
    yaw: float, v_n: Vec3, sigma: float, rate: float
) -> None:
    z, H, R = non_holonomic(v_n, np.eye(3) * sigma**2, yaw, 0.1, rate)
    assert R[0, 0] > 0.0
    assert abs(z[0]) <= math.hypot(v_n[0], v_n[1]) + 1e-9
    assert math.isclose((H @ H.T)[0, 0], 1.0)


@given(
    st.floats(0.0, 1e6), st.floats(0.0, 1e6), st.floats(-1.0, 1.0), st.floats(1.0, 9.0)
)
def test_r95_lies_between_a_line_and_a_circle(
    a: float, b: float, correlation: float, factor: float
) -> None:
    cross = correlation * math.sqrt(a * b)
    cov = np.array([[a, cross], [cross, b]])
    largest = math.sqrt(max(np.linalg.eigvalsh(cov).max(), 0.0))
    r95 = r95_of(cov)
    assert 1.959 * largest - 1e-6 <= r95 <= 2.452 * largest + 1e-6
    assert math.isclose(r95_of(cov * factor**2), factor * r95, abs_tol=1e-6)


# ------------------------------------------------------------------------------ time


@given(
    st.lists(
        st.tuples(st.integers(0, 3_000), st.integers(0, 60_000), st.integers(-5, 5)),
        min_size=1,
        max_size=80,
    )
)
def test_rows_always_go_forward(epochs: list[tuple[int, int, int]]) -> None:
    # However epochs come (wait, lateness in ms, off by whole seconds), rows grow.
    clock, t_ns, period_ns = UtcClock(200_000_000), 0, 250_000_000
    clock.add_epoch(200_000_000, 1e9)
    clock.start_rows()
    utc_ns = clock.row_utc_ns(0)
    last_ns = clock.row_instant_ns(utc_ns)
    for wait_ms, late_ms, off_s in epochs:
        t_ns += wait_ms * 1_000_000
        clock.add_epoch(t_ns + late_ms * 1_000_000, 1e9 + t_ns * 1e-9 + off_s)
        utc_ns += period_ns
        clock.slew(period_ns)
        row_ns = clock.row_instant_ns(utc_ns)
        assert 0.85 * period_ns <= row_ns - last_ns <= 1.15 * period_ns
        last_ns = row_ns


@cache
def short_drive() -> tuple[SessionHeader, tuple[Frame, ...], tuple[str, ...]]:
    simulated = simulate("drive", seed=12, duration_s=35.0, rate_hz=50.0)
    frames = tuple(simulated.frames)
    return simulated.header, frames, tuple(rows_of(simulated.header, frames))


def rows_of(header: SessionHeader, frames: tuple[Frame, ...]) -> list[str]:
    pipeline = Pipeline(header, TrackerSettings(profile="vehicle"))
    return [format_row(row) for frame in frames for row in pipeline.feed(frame)]


@settings(max_examples=8)
@given(st.integers(0, 10**6))
def test_a_stream_cut_anywhere_makes_a_prefix(where: int) -> None:
    header, frames, rows = short_drive()
    cut = where % len(frames)
    found = rows_of(header, frames[:cut])
    assert found == list(rows[: len(found)])


@settings(max_examples=8)
@given(st.lists(st.integers(0, 10**6), max_size=40), st.booleans())
def test_being_told_the_time_changes_no_row(told: list[int], is_imu_dead: bool) -> None:
    header, frames, rows = short_drive()
    expected = list(rows)
    if is_imu_dead:
        half = frames[len(frames) // 2].t_ns
        frames = tuple(f for f in frames if f.source is not Source.IMU or f.t_ns < half)
        expected = rows_of(header, frames)
    pipeline = Pipeline(header, TrackerSettings(profile="vehicle"))
    ticks = {where % len(frames) for where in told}
    found, now_ns = [], 0
    for k, frame in enumerate(frames):
        if k in ticks and frame.t_ns > now_ns > 0:
            found += pipeline.advance(now_ns + (frame.t_ns - now_ns) * (k % 7) // 7)
        now_ns = max(now_ns, frame.t_ns)
        found += pipeline.feed(frame)
    assert [format_row(row) for row in found] == expected


@settings(max_examples=40)
@given(
    st.lists(
        st.tuples(st.integers(-50, 800), st.one_of(bursts, st.just(b""))), max_size=150
    )
)
def test_any_bursts_at_any_times_make_rows_that_grow(
    drawn: list[tuple[int, bytes]],
) -> None:
    # Bit flips, holes and backward time on the bus, with a receiver beside it.
    model = CountsModel(4, 500)
    tracker, t_ns, rows = Tracker(TrackerSettings(rate_hz=10)), 10**9, []
    for wait_ms, raw in drawn:
        t_ns += wait_ms * 1_000_000
        if raw:
            rows += tracker.on_imu(model.decode(t_ns, raw))
        else:
            rows += tracker.advance(t_ns)
            tracker.on_fix(
                GpsFix(t_ns, 1e9 + t_ns * 1e-9, 0.9, 0.1, None, (0.0, 0.0), 2.0, 1)
            )
    assert all(b.utc_s > a.utc_s for a, b in pairwise(rows))
    for row in rows:
        assert math.isfinite(row.lat_rad + row.lon_rad + row.r95_m)
        assert math.isfinite(sum(row.v_n_mps) + sum(row.q_nb))
