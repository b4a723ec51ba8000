"""What outlasts a run, and its uncertainty at the next start.

Biases and mounting outlast a run, but temperature, time and handling change them: each
value is kept with its standard deviation, which grows with the downtime. Whether the
box is still mounted as before is decided by `PriorTrial`, by the fixes.
"""

import math
from typing import Final, NamedTuple

import numpy as np

from imu_tracker.estimation.error_state.filter import Eskf, Measurement
from imu_tracker.estimation.error_state.mechanisation import GyroGain
from imu_tracker.estimation.error_state.states import (
    ACCEL_BIAS,
    ACCEL_DRIFT_PSD,
    AXLE,
    DELAY,
    GYRO_BIAS,
    GYRO_GAIN,
    MOUNT_DRIFT_PSD,
    MOUNT_PITCH,
    MOUNT_YAW,
    N_ERRORS,
    POSITION,
    RECEIVER,
    VELOCITY_DELAY,
    YAW,
)
from imu_tracker.estimation.tuning import GYRO_DRIFT_PSD, ODD_MOUNTING_RAD
from imu_tracker.geometry.geodesy import LocalFrame
from imu_tracker.geometry.rotation import conjugate, rotate
from imu_tracker.motion.vibration import Levels
from imu_tracker.samples import GpsFix, Quat, Vec3
from imu_tracker.wheels.orders import KeptWheels

DRIFTING_S: Final = 3600.0
"""The random walk of the biases counts for so long; beyond, temperature explains it."""

UNKNOWN_WARMER_K: Final = 10.0
"""Between two starts, when nobody knows the temperatures: night and noon."""

GYRO_PER_K: Final = math.radians(0.03)
"""PS-MPU-6000A section 6.1 allows 20 deg/s over 125 K; boards show a fifth of it."""

ACCEL_PER_K: Final = 0.006
"""m/s^2 per K. Section 6.2: 35 mg (60 mg along z) over 70 K."""

MOUNT_GROWTH_RAD: Final = math.radians(0.5)
MOUNT_MOST_RAD: Final = math.radians(1.5)
"""Somebody gets in or loads the boot; pushed, in the long run."""

DELAY_GROWTH_S: Final = 0.05
"""A receiver starts with a filter of its own."""

GYRO_GAIN_GROWTH: Final = 0.003
"""Section 6.1: 2 % over 125 K."""

AXLE_GROWTH_M: Final = 0.3
"""The seat, the shelf: where it was put down."""


FRESH_S: Final = 600.0
"""Within so short a downtime the box was not moved to another car."""

PARKED_TILT_RAD: Final = math.radians(1.0)
PARKED_SIGMAS: Final = 3.0
PARKED_YAW_SIGMA_RAD: Final = math.radians(3.0)
"""A car that was not moved lies as it lay, to what its load and springs change, where
it was; it may yet have been driven away and parked again."""

WHEELS_GROWTH: Final = 0.007
"""Of the circumference: cold tyres, pressure, load; worn or other tyres of the same
size. Wheels that differ by more are found to be others."""


class Place(NamedTuple):
    """Where the last run ended, and how the box lay there."""

    lat_rad: float
    lon_rad: float
    sigma_m: float
    q_nb: Quat
    yaw_sigma_rad: float
    is_at_rest: bool


class LearnedParameters(NamedTuple):
    """What a run learnt, in body axes; sigmas are standard deviations.

    Latencies are from the instant that a fix describes to its arrival. Inside the
    error-state estimator they are delays: how much later than assumed it describes.
    """

    profile: str
    noise_level: int
    gyro_bias_radps: Vec3
    gyro_bias_sigma_radps: Vec3
    accel_bias_mps2: Vec3
    accel_bias_sigma_mps2: Vec3
    gyro_gain: GyroGain
    gyro_gain_sigma: GyroGain
    q_vb: Quat | None  # None: nothing that has a mounting
    mounting_sigma_rad: tuple[float, float]  # pitch, yaw
    axle_m: float
    axle_sigma_m: float
    latency_s: float
    latency_sigma_s: float
    velocity_latency_s: float
    velocity_latency_sigma_s: float
    temp_degc: float | None = None
    utc_s: float | None = None
    place: Place | None = None
    still_levels: Levels = ()
    wheels: KeptWheels | None = None


class Downtime(NamedTuple):
    """What happened between two runs; None: nobody knows."""

    elapsed_s: float | None
    warmer_k: float | None


def learned_from(
    eskf: Eskf, *, profile: str, noise_level: int, shift_s: float
) -> LearnedParameters:
    """Collect what outlasts a run; `shift_s` is the delay that was folded away."""
    gx, gy, gz = (eskf.sigma(i) for i in range(GYRO_BIAS.start, GYRO_BIAS.stop))
    ax, ay, az = (eskf.sigma(i) for i in range(ACCEL_BIAS.start, ACCEL_BIAS.stop))
    gain = (eskf.sigma(i) for i in range(GYRO_GAIN.start, GYRO_GAIN.stop))
    xx, yx, zx, xy, yy, zy, xz, yz, zz = gain
    return LearnedParameters(
        profile=profile,
        noise_level=noise_level,
        gyro_bias_radps=eskf.gyro_bias_radps,
        gyro_bias_sigma_radps=(gx, gy, gz),
        accel_bias_mps2=eskf.accel_bias_mps2,
        accel_bias_sigma_mps2=(ax, ay, az),
        gyro_gain=eskf.gyro_gain,
        gyro_gain_sigma=(xx, yx, zx, xy, yy, zy, xz, yz, zz),
        q_vb=eskf.q_vb if profile == "vehicle" else None,
        mounting_sigma_rad=(eskf.sigma(MOUNT_PITCH), eskf.sigma(MOUNT_YAW)),
        axle_m=eskf.axle_m,
        axle_sigma_m=eskf.sigma(AXLE),
        latency_s=eskf.delay_s + shift_s,
        latency_sigma_s=eskf.sigma(DELAY),
        velocity_latency_s=eskf.velocity_delay_s + shift_s,
        velocity_latency_sigma_s=eskf.sigma(VELOCITY_DELAY),
    )


def place_of(eskf: Eskf, frame: LocalFrame, *, is_at_rest: bool) -> Place:
    """Return where the filter is, and its attitude, with their sigmas."""
    lat_rad, lon_rad = frame.to_lat_lon(*eskf.nominal.p_n[:2])
    sigma_m = math.hypot(eskf.sigma(POSITION.start), eskf.sigma(RECEIVER.start))
    yaw_sigma_rad = eskf.sigma(YAW.start)
    q_nb = eskf.nominal.q_nb
    return Place(lat_rad, lon_rad, sigma_m, q_nb, yaw_sigma_rad, is_at_rest)


def grown(learnt: LearnedParameters, since: Downtime) -> LearnedParameters:
    """Return the same with sigmas grown by time and temperature.

    Notes
    -----
    var' = var + psd min(t, 1 h) + (slope |dT|)^2
    """
    elapsed_s = math.inf if since.elapsed_s is None else abs(since.elapsed_s)
    warmer_k = UNKNOWN_WARMER_K if since.warmer_k is None else since.warmer_k
    drifting_s = min(elapsed_s, DRIFTING_S)
    gyro = math.hypot(
        math.sqrt(GYRO_DRIFT_PSD * drifting_s), GYRO_PER_K * abs(warmer_k)
    )
    accel = math.hypot(
        math.sqrt(ACCEL_DRIFT_PSD * drifting_s), ACCEL_PER_K * abs(warmer_k)
    )
    mounting = min(
        math.hypot(MOUNT_GROWTH_RAD, math.sqrt(MOUNT_DRIFT_PSD * elapsed_s)),
        MOUNT_MOST_RAD,
    )
    gx, gy, gz = learnt.gyro_bias_sigma_radps
    ax, ay, az = learnt.accel_bias_sigma_mps2
    gain = (math.hypot(sigma, GYRO_GAIN_GROWTH) for sigma in learnt.gyro_gain_sigma)
    xx, yx, zx, xy, yy, zy, xz, yz, zz = gain
    pitch, yaw = learnt.mounting_sigma_rad
    hypot = math.hypot
    wheels = learnt.wheels
    if wheels is not None:
        growth_m = WHEELS_GROWTH * wheels.circumference_m
        sigma_m = hypot(wheels.circumference_sigma_m, growth_m)
        wheels = wheels._replace(circumference_sigma_m=sigma_m)
    return learnt._replace(
        wheels=wheels,
        gyro_bias_sigma_radps=(hypot(gx, gyro), hypot(gy, gyro), hypot(gz, gyro)),
        accel_bias_sigma_mps2=(hypot(ax, accel), hypot(ay, accel), hypot(az, accel)),
        mounting_sigma_rad=(hypot(pitch, mounting), hypot(yaw, mounting)),
        gyro_gain_sigma=(xx, yx, zx, xy, yy, zy, xz, yz, zz),
        axle_sigma_m=hypot(learnt.axle_sigma_m, AXLE_GROWTH_M),
        latency_sigma_s=hypot(learnt.latency_sigma_s, DELAY_GROWTH_S),
        velocity_latency_sigma_s=hypot(learnt.velocity_latency_sigma_s, DELAY_GROWTH_S),
    )


def begin_with(eskf: Eskf, learnt: LearnedParameters, *, takes_mounting: bool) -> None:
    """Load what an earlier run learnt; its sigmas are grown already.

    Notes
    -----
    Biases and scale are measured by the memory, z = learnt - estimate, so that what
    the filter has found out since its start, and the tilt that goes with it, keeps its
    weight. The mounting is taken over outright: it may be turned by any angle.
    """
    where = [
        *range(GYRO_BIAS.start, ACCEL_BIAS.stop),
        *range(GYRO_GAIN.start, GYRO_GAIN.stop),
    ]
    H = np.zeros((len(where), N_ERRORS))
    H[range(len(where)), where] = 1.0
    z = np.array(
        [
            *np.subtract(learnt.gyro_bias_radps, eskf.gyro_bias_radps),
            *np.subtract(learnt.accel_bias_mps2, eskf.accel_bias_mps2),
            *np.subtract(learnt.gyro_gain, eskf.gyro_gain),
        ]
    )
    sigmas = (
        *learnt.gyro_bias_sigma_radps,
        *learnt.accel_bias_sigma_mps2,
        *learnt.gyro_gain_sigma,
    )
    eskf.update(Measurement(z, H, np.diag(np.square(sigmas))))
    if takes_mounting and learnt.q_vb is not None:
        eskf.q_vb, eskf.axle_m = learnt.q_vb, learnt.axle_m
        pitch, yaw = learnt.mounting_sigma_rad
        _set_sigmas(
            eskf, {MOUNT_PITCH: pitch, MOUNT_YAW: yaw, AXLE: learnt.axle_sigma_m}
        )
    # The instants of the fixes were moved by the position's delay already.
    eskf.velocity_delay_s = learnt.velocity_latency_s - learnt.latency_s
    delays = learnt.latency_sigma_s, learnt.velocity_latency_sigma_s
    _set_sigmas(eskf, dict(zip((DELAY, VELOCITY_DELAY), delays, strict=True)))


def _set_sigmas(eskf: Eskf, sigmas: dict[int, float]) -> None:
    """Make some errors known so well, and independent of all others."""
    for i, sigma in sigmas.items():
        eskf.set_variances(i, min(sigma**2, eskf.P[i, i]))


def is_remounted(learnt: LearnedParameters, level_q: Quat) -> bool:
    """Whether the vehicle would lie as no road does: gravity against the mounting."""
    if learnt.q_vb is None:
        return False
    down_b = rotate(conjugate(level_q), (0.0, 0.0, 1.0))
    return angle_to_down(rotate(learnt.q_vb, down_b)) > ODD_MOUNTING_RAD


def is_parked(
    learnt: LearnedParameters, since: Downtime, level_q: Quat, fix: GpsFix | None
) -> bool:
    """Whether everything looks as it was left: then the heading is known."""
    place = learnt.place
    if place is None or not place.is_at_rest or fix is None:
        return False
    if since.elapsed_s is None or since.elapsed_s < 0.0:
        return False  # a replay of what was before
    north, east = LocalFrame.at(place.lat_rad, place.lon_rad).to_ne(
        fix.lat_rad, fix.lon_rad
    )
    reach_m = PARKED_SIGMAS * math.hypot(place.sigma_m, fix.sigma_h_m)
    down_b = rotate(conjugate(place.q_nb), (0.0, 0.0, 1.0))
    tilt_rad = angle_to_down(rotate(level_q, down_b))
    return math.hypot(north, east) < reach_m and tilt_rad < PARKED_TILT_RAD


def angle_to_down(v: Vec3) -> float:
    """Angle between a vector and the third axis."""
    return math.atan2(math.hypot(v[0], v[1]), v[2])
