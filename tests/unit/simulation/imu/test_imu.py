"""The ideal IMU against strapdown, and the chip's errors against their sizes."""

import math

import numpy as np
import pytest

from imu_tracker.calibration.counts import CountsModel
from imu_tracker.geometry.geodesy import gravity_mps2
from imu_tracker.geometry.rotation import (
    from_euler,
    from_rotation_vector,
    matrix,
    multiply,
    rotate,
    to_euler,
)
from imu_tracker.motion.preintegration import Preintegrator
from imu_tracker.samples import ImuSample, Vec3
from imu_tracker.simulation import SCENARIOS
from imu_tracker.simulation.imu.chip import Imu
from imu_tracker.simulation.imu.errors import (
    IDEAL_CHIP,
    TYPICAL_CHIP,
    ChipErrors,
    ChipTraits,
    SensorErrors,
)
from imu_tracker.simulation.imu.ideal import (
    angular_rate,
    attitude_matrix,
    specific_force,
)
from imu_tracker.simulation.imu.noise import GaussMarkov, Rumble
from imu_tracker.simulation.motion.paths import FloatArray, Path
from imu_tracker.simulation.motion.trajectory import Ride, Trajectory
from imu_tracker.simulation.scenarios import DELFT

GRAVITY = gravity_mps2(DELFT.lat_rad, DELFT.alt_m)
DPS = math.radians(1.0)
MG = 9.80665e-3
STILL = Ride(Path(()))


def trajectory(scenario: str) -> Trajectory:
    return SCENARIOS[scenario].trajectory(np.random.default_rng(4))


def skew(v: FloatArray) -> FloatArray:
    out = np.zeros((len(v), 3, 3))
    out[:, 2, 1], out[:, 0, 2], out[:, 1, 0] = v.T
    return out - np.swapaxes(out, 1, 2)


def exponential(angles: FloatArray) -> FloatArray:
    """Rotation matrices of small rotation vectors, by the power series."""
    turn = skew(angles)
    total = np.broadcast_to(np.eye(3), turn.shape).copy()
    term = total.copy()
    for order in range(1, 9):
        term = term @ turn / order
        total += term
    return total


def strapdown(scenario: str, begin_s: float, end_s: float, h: float) -> float:
    """Largest velocity error of a fourth-order strapdown of the ideal readings.

    Attitude by a Magnus step at two Gauss points each half step, velocity by
    Simpson's rule: neither is how the product integrates.
    """
    ride = trajectory(scenario)
    half = 0.5 * h
    t_s = np.arange(begin_s, end_s, half)
    t_s = t_s[: len(t_s) // 2 * 2 - 1]
    offset = half * math.sqrt(3.0) / 6.0
    rates = [
        angular_rate(ride.at(t_s[:-1] + half / 2 + sign * offset)) for sign in (-1, 1)
    ]
    mixed = np.cross(rates[0], rates[1]) * (math.sqrt(3.0) / 12.0 * half**2)
    steps = exponential((rates[0] + rates[1]) * half / 2 + mixed)
    motion = ride.at(t_s)
    C_nb = [attitude_matrix(motion.rpy_rad[:1])[0]]
    for step in steps:
        C_nb.append(C_nb[-1] @ step)
    f_n = np.einsum("kij,kj->ki", np.array(C_nb), specific_force(motion, GRAVITY))
    a_n = f_n + np.array([0.0, 0.0, GRAVITY])
    gained = (a_n[:-2:2] + 4.0 * a_n[1:-1:2] + a_n[2::2]) * (h / 6.0)
    v_n = motion.v_n[0] + np.cumsum(gained, axis=0)
    return float(np.abs(v_n - motion.v_n[2::2]).max())


@pytest.mark.parametrize("scenario", SCENARIOS)
def test_strapdown_of_ideal_readings_returns_to_the_truth(scenario: str) -> None:
    assert strapdown(scenario, 15.0, 215.0, 0.01) < 1e-6


@pytest.mark.parametrize(
    ("scenario", "rate_hz", "bound_mps"),
    [
        ("roundabout", 100, 1e-4),
        ("drive", 100, 1e-3),
        ("walk-line", 100, 1e-2),
        ("walk-line", 200, 2.5e-3),  # an error of second order
    ],
)
def test_the_products_strapdown_stays_near_the_truth_for_two_minutes(
    scenario: str, rate_hz: int, bound_mps: float
) -> None:
    t_s = 20.0 + np.arange(120 * rate_hz) / rate_hz  # what follows the standstill
    motion = trajectory(scenario).at(t_s)
    f_b, w_b = specific_force(motion, GRAVITY), angular_rate(motion)
    q_nb = from_euler(*motion.rpy_rad[0].tolist())
    v_n = motion.v_n[0].copy()
    integrator = Preintegrator()
    worst_mps = 0.0
    for i, ((fx, fy, fz), (wx, wy, wz)) in enumerate(
        zip(f_b.tolist(), w_b.tolist(), strict=True)
    ):
        t_ns = 1 + round(i * 1e9 / rate_hz)
        step = integrator.add_sample(ImuSample(t_ns, (fx, fy, fz), (wx, wy, wz), 20.0))
        if step is None:
            continue
        assert not step.is_gap
        v_n += rotate(q_nb, step.dv_b_mps)
        v_n[2] += GRAVITY * step.dt_s
        q_nb = multiply(q_nb, from_rotation_vector(step.dtheta_b_rad))
        worst_mps = max(worst_mps, float(np.abs(v_n - motion.v_n[i]).max()))

    assert worst_mps < bound_mps


def test_a_body_at_rest_feels_gravity_and_nothing_turns() -> None:
    motion = STILL.at(np.array([0.0, 1.0]))

    np.testing.assert_allclose(
        specific_force(motion, GRAVITY), [[0.0, 0.0, -GRAVITY]] * 2
    )
    assert not angular_rate(motion).any()


def test_attitude_matrices_are_those_of_the_quaternions() -> None:
    rpy = np.random.default_rng(7).uniform(-1.4, 1.4, (20, 3))
    expected = [matrix(from_euler(*row)) for row in rpy.tolist()]

    np.testing.assert_allclose(attitude_matrix(rpy), expected, atol=1e-14)


def chips(errors: SensorErrors, n: int = 2000) -> list[ChipTraits]:
    rng = np.random.default_rng(11)
    return [ChipTraits.draw(errors, rng) for _ in range(n)]


def test_chips_spread_as_the_datasheet_says() -> None:
    drawn = chips(TYPICAL_CHIP)
    accel_bias = np.std([chip.accel_bias_mps2 for chip in drawn], axis=0)
    gyro_bias = np.std([chip.gyro_bias_radps for chip in drawn])
    gains = np.std([chip.accel_gain for chip in drawn], axis=0)
    tilt = np.array([to_euler(chip.q_vb) for chip in drawn])

    np.testing.assert_allclose(accel_bias / MG, [17.0, 17.0, 27.0], rtol=0.06)
    assert gyro_bias / DPS == pytest.approx(2.0, rel=0.05)
    np.testing.assert_allclose(np.diag(gains), 0.01, rtol=0.06)
    assert gains[0, 1] == pytest.approx(0.007, rel=0.06)
    np.testing.assert_allclose(np.std(tilt, axis=0) / DPS, [1.0, 1.0, 1.5], rtol=0.06)
    clocks = [chip.clock_error for chip in drawn]
    assert -0.01 <= min(clocks) < -0.0099
    assert 0.0099 < max(clocks) <= 0.01


def spoilt(
    errors: SensorErrors,
    *,
    seconds: float = 200.0,
    speed_mps: float = 0.0,
    has_engine: bool = False,
    rate_hz: float = 100.0,
) -> tuple[FloatArray, FloatArray]:
    """Accelerometer and gyro errors of a chip at constant speed, in stretches."""
    chip = ChipErrors(
        errors,
        ChipTraits.draw(errors, np.random.default_rng(5)),
        np.random.default_rng(6),
        rate_hz,
        has_engine=has_engine,
    )
    accel, gyro = [], []
    for t_s in np.split(np.arange(int(seconds * rate_hz)) / rate_hz, 10):
        zero = np.zeros((len(t_s), 3))
        readings = chip.spoil(t_s, np.full(len(t_s), speed_mps), zero, zero)
        accel.append(readings.accel_mps2)
        gyro.append(readings.gyro_radps)
    return np.concatenate(accel), np.concatenate(gyro)


@pytest.mark.parametrize("rate_hz", [50.0, 100.0, 400.0])
def test_white_noise_has_the_density_of_the_datasheet_at_any_rate(
    rate_hz: float,
) -> None:
    errors = SensorErrors(
        accel_noise_mps2_rthz=0.4 * MG, gyro_noise_radps_rthz=0.005 * DPS
    )
    accel, gyro = spoilt(errors, rate_hz=rate_hz)

    band = math.sqrt(rate_hz / 2.0)
    np.testing.assert_allclose(accel.std(axis=0), 0.4 * MG * band, rtol=0.05)
    np.testing.assert_allclose(gyro.std(axis=0), 0.005 * DPS * band, rtol=0.05)
    assert abs(np.corrcoef(accel[1:, 0], accel[:-1, 0])[0, 1]) < 0.03


def test_bias_follows_the_temperature() -> None:
    errors = SensorErrors(
        accel_per_degc_sigma_mps2=(1.0, 1.0, 1.0),
        gyro_per_degc_sigma_radps=1.0,
        warm_up_degc=6.0,
        warm_up_tau_s=20.0,
    )
    chip = ChipTraits.draw(errors, np.random.default_rng(5))
    accel, gyro = spoilt(errors)

    np.testing.assert_allclose(accel[0], 0.0, atol=1e-9)
    np.testing.assert_allclose(accel[-1], 6.0 * chip.accel_mps2_per_degc, rtol=1e-3)
    np.testing.assert_allclose(gyro[-1], 6.0 * chip.gyro_radps_per_degc, rtol=1e-3)


def test_the_road_shakes_in_proportion_to_speed_and_only_with_an_engine() -> None:
    errors = SensorErrors(
        road_accel_sigma_mps2=(0.2, 0.2, 0.4), road_gyro_sigma_radps=0.01
    )
    slow, _ = spoilt(errors, speed_mps=7.0, has_engine=True)
    fast, gyro = spoilt(errors, speed_mps=14.0, has_engine=True)
    walking, _ = spoilt(errors, speed_mps=14.0)

    np.testing.assert_allclose(fast.std(axis=0), [0.2, 0.2, 0.4], rtol=0.1)
    np.testing.assert_allclose(slow.std(axis=0), [0.1, 0.1, 0.2], rtol=0.1)
    np.testing.assert_allclose(gyro.std(axis=0), 0.01, rtol=0.1)
    assert not walking.any()


def test_what_rumbles_does_not_travel() -> None:
    shaking = Rumble(np.random.default_rng(1), 1, 100.0)
    accel = np.concatenate([shaking.draw(n) for n in (1, 999, 29_000)])
    velocity = np.cumsum(accel) * 0.01

    assert accel.std() == pytest.approx(1.0, rel=0.05)
    # White noise of the same size would wander to 1.7 m/s in these 300 s.
    assert np.abs(velocity).max() < 0.1


def test_gauss_markov_keeps_its_size_and_forgets_at_its_pace() -> None:
    process = GaussMarkov(np.random.default_rng(2), (3.0,), tau_s=20.0)
    x = np.concatenate(
        [process.at(start + np.arange(100.0)) for start in range(0, 100_000, 100)]
    )[:, 0]

    assert x.std() == pytest.approx(3.0, rel=0.05)
    for lag in (5, 20, 60):
        expected = math.exp(-lag / 20.0)
        assert np.corrcoef(x[lag:], x[:-lag])[0, 1] == pytest.approx(expected, abs=0.05)


def test_gauss_markov_does_not_depend_on_how_it_is_asked() -> None:
    t_s = np.arange(0.0, 100.0, 0.25)
    whole = GaussMarkov(np.random.default_rng(2), (1.0, 2.0), 20.0).at(t_s)
    parts = GaussMarkov(np.random.default_rng(2), (1.0, 2.0), 20.0)

    np.testing.assert_array_equal(
        whole, np.concatenate([parts.at(part) for part in np.split(t_s, 16)])
    )


def bursts(errors: SensorErrors, n: int, seed: int = 3) -> list[tuple[int, bytes]]:
    traits = ChipTraits.draw(errors, np.random.default_rng(seed))
    imu = Imu(errors, traits, np.random.default_rng(seed), 100.0, has_engine=False)
    source = imu.bursts(STILL, GRAVITY, CountsModel(4, 500))
    return [next(source) for _ in range(n)]


def test_samples_come_at_the_chips_own_rate_and_stay_in_order() -> None:
    errors = SensorErrors(clock_limit=0.01, jitter_sigma_s=0.002)
    clock_error = ChipTraits.draw(errors, np.random.default_rng(3)).clock_error
    t_ns = np.array([t_ns for t_ns, _ in bursts(errors, 5000)])

    assert np.diff(t_ns).min() > 0
    slope = np.polyfit(np.arange(5000), t_ns * 1e-9, 1)[0]
    assert 0.01 / slope - 1.0 == pytest.approx(clock_error, abs=5e-6)
    assert abs(clock_error) > 1e-3
    assert 0.001 < np.std(np.diff(t_ns)) * 1e-9 < 0.003


def test_dropped_samples_leave_gaps_of_whole_intervals() -> None:
    t_ns = [t_ns for t_ns, _ in bursts(SensorErrors(dropped_share=0.1), 2000)]

    intervals = np.diff(t_ns) / 10_000_000
    np.testing.assert_array_equal(intervals, np.rint(intervals))
    assert np.mean(intervals) == pytest.approx(1.0 / 0.9, rel=0.03)


def test_an_ideal_chip_only_rounds() -> None:
    counts = CountsModel(4, 500)
    samples = [counts.decode(t_ns, raw) for t_ns, raw in bursts(IDEAL_CHIP, 3)]

    half_a_count = 0.5 * 9.80665 / 8192
    assert [sample.t_ns for sample in samples] == [0, 10_000_000, 20_000_000]
    for sample in samples:
        assert sample.accel_mps2[2] == pytest.approx(-GRAVITY, abs=half_a_count)
        assert sample.gyro_radps == (0.0, 0.0, 0.0)


def test_more_than_the_range_saturates() -> None:
    overload: Vec3 = (5 * 9.80665,) * 3
    errors = SensorErrors(accel_bias_sigma_mps2=overload)
    counts = CountsModel(2, 250)
    traits = ChipTraits.draw(errors, np.random.default_rng(3))
    imu = Imu(errors, traits, np.random.default_rng(3), 100.0, has_engine=False)
    t_ns, raw = next(imu.bursts(STILL, GRAVITY, counts))

    assert counts.decode(t_ns, raw).is_saturated
