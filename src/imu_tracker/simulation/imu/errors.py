"""What an MPU-6050 makes of the truth.

`SensorErrors` says how large errors are, `ChipTraits` what one chip drew for life,
and `ChipErrors` adds both, and what changes with time, to ideal readings. Rounding
and clipping to the chip's counts is `CountsModel.encode`'s.

Sizes are the datasheet's (PS-MPU-6000A rev. 3.4). Its tolerances are read as three
standard deviations, so one chip in a few hundred is worse than they say; where real
boards are known to be much better than the tolerance, the comment says so. Left out:
nonlinearity (0.2 %) and the gyro's sensitivity to acceleration (0.1 deg/s per g).
"""

import math
from typing import Final, NamedTuple

import numpy as np

from imu_tracker.calibration.counts import STANDARD_GRAVITY_MPS2
from imu_tracker.geometry.rotation import from_euler, matrix
from imu_tracker.samples import Quat, Vec3
from imu_tracker.simulation.imu.noise import Flicker, GaussMarkov, Rumble
from imu_tracker.simulation.imu.rolling import Rolling
from imu_tracker.simulation.motion.paths import FloatArray

_MG: Final = 1e-3 * STANDARD_GRAVITY_MPS2
_DPS: Final = math.radians(1.0)

ROAD_SPEED_MPS: Final = 14.0
"""Speed at which the road shakes as much as `road_...` says."""


class SensorErrors(NamedTuple):
    """How large the errors of a chip and of its mounting are; none by default.

    A `sigma` of a constant is the spread between chips; of anything else, its spread
    in time. Noise densities are one-sided, as in the datasheet: as a random walk they
    show as 1/sqrt(2) of it. `idle` and `road` shaking need an engine.
    """

    accel_bias_sigma_mps2: Vec3 = (0.0, 0.0, 0.0)  # body axes, when switched on
    gyro_bias_sigma_radps: float = 0.0
    accel_scale_sigma: float = 0.0
    gyro_scale_sigma: float = 0.0
    cross_axis_sigma: float = 0.0
    accel_per_degc_sigma_mps2: Vec3 = (0.0, 0.0, 0.0)
    gyro_per_degc_sigma_radps: float = 0.0
    warm_up_degc: float = 0.0
    warm_up_tau_s: float = 600.0
    accel_noise_mps2_rthz: Vec3 | float = 0.0
    gyro_noise_radps_rthz: float = 0.0
    accel_drift_sigma_mps2: float = 0.0
    gyro_drift_sigma_radps: float = 0.0
    drift_tau_s: float = 300.0
    accel_flicker_mps2: float = 0.0  # bias instability, IEEE Std 952
    gyro_flicker_radps: float = 0.0
    mounting_sigma_rad: Vec3 = (0.0, 0.0, 0.0)  # roll, pitch, yaw
    idle_accel_sigma_mps2: float = 0.0
    idle_gyro_sigma_radps: float = 0.0
    road_accel_sigma_mps2: Vec3 = (0.0, 0.0, 0.0)  # at ROAD_SPEED_MPS
    road_gyro_sigma_radps: float = 0.0
    clock_limit: float = 0.0  # 0.01: the sample clock is up to 1 % fast or slow
    jitter_sigma_s: float = 0.0  # of the host's time stamps
    dropped_share: float = 0.0


IDEAL_CHIP: Final = SensorErrors()
"""Only rounds and clips; at rest it repeats itself exactly, as no real chip does."""

TYPICAL_CHIP: Final = SensorErrors(
    accel_bias_sigma_mps2=(17 * _MG, 17 * _MG, 27 * _MG),  # 6.2: 50, 50, 80 mg
    gyro_bias_sigma_radps=2 * _DPS,  # 6.1: 20 deg/s; most boards stay below 4
    accel_scale_sigma=0.01,  # 6.2: 3 %
    gyro_scale_sigma=0.01,  # 6.1: 3 %
    cross_axis_sigma=0.007,  # 6.1, 6.2: 2 %
    # 6.2: 35, 35, 60 mg over 70 K
    accel_per_degc_sigma_mps2=(0.17 * _MG, 0.17 * _MG, 0.29 * _MG),
    gyro_per_degc_sigma_radps=0.02 * _DPS,  # 6.1: 20 deg/s over 65 K; boards: less
    warm_up_degc=6.0,
    accel_noise_mps2_rthz=0.4 * _MG,  # 6.2: 400 ug/sqrt(Hz)
    gyro_noise_radps_rthz=0.005 * _DPS,  # 6.1: 0.005 deg/s/sqrt(Hz)
    accel_drift_sigma_mps2=0.2 * _MG,
    gyro_drift_sigma_radps=0.003 * _DPS,
    mounting_sigma_rad=(1.0 * _DPS, 1.0 * _DPS, 1.5 * _DPS),
    idle_accel_sigma_mps2=0.03,
    idle_gyro_sigma_radps=0.05 * _DPS,
    road_accel_sigma_mps2=(0.25, 0.25, 0.45),
    road_gyro_sigma_radps=0.7 * _DPS,
    clock_limit=0.01,  # 6.6: 1 % on the gyro's PLL
    jitter_sigma_s=2e-4,
)
"""Not calibrated, glued into its box by hand."""

_TABLET_RATE_HZ: Final = 1000.0 / (2.0 * math.pi)

TABLET: Final = SensorErrors(
    accel_bias_sigma_mps2=(0.0094, 0.1601, 0.0381),
    # White noise of a sample with these variances, (m/s^2)^2.
    accel_noise_mps2_rthz=(
        math.sqrt(2.4572e-05 * 2.0 / _TABLET_RATE_HZ),
        math.sqrt(3.1813e-05 * 2.0 / _TABLET_RATE_HZ),
        math.sqrt(1.6963e-04 * 2.0 / _TABLET_RATE_HZ),
    ),
    gyro_noise_radps_rthz=0.005 * _DPS,
)
"""The tablet of the thesis whose simulations are among the scenarios: mean (0.0094,
0.1601, 9.7719) and variance of its accelerometer during two minutes at rest, sampled
as its simulations are. It tells its orientation and no rate; the gyro is an MPU-6050's
(PS-MPU-6000A section 6.1) without a bias."""

AMBIENT_DEGC: Final = 21.0


class ChipTraits(NamedTuple):
    """What one chip in one box is like for life; the truth of a calibration.

    A reading is `gain @ C_bv @ truth + bias`; `q_vb` takes the box to the vehicle.
    """

    accel_bias_mps2: FloatArray
    gyro_bias_radps: FloatArray
    accel_gain: FloatArray  # shape (3, 3): scale and cross-axis
    gyro_gain: FloatArray
    accel_mps2_per_degc: FloatArray
    gyro_radps_per_degc: FloatArray
    q_vb: Quat
    clock_error: float  # 0.01: samples come 1 % too early

    @classmethod
    def draw(cls, errors: SensorErrors, rng: np.random.Generator) -> "ChipTraits":
        """Take a chip from the reel and glue it into a box."""

        def gain(scale_sigma: float) -> FloatArray:
            sigma = np.full((3, 3), errors.cross_axis_sigma)
            np.fill_diagonal(sigma, scale_sigma)
            return np.eye(3) + sigma * rng.standard_normal((3, 3))

        def vector(sigma: Vec3 | float) -> FloatArray:
            return np.asarray(sigma) * rng.standard_normal(3)

        roll, pitch, yaw = vector(errors.mounting_sigma_rad).tolist()
        return cls(
            accel_bias_mps2=vector(errors.accel_bias_sigma_mps2),
            gyro_bias_radps=vector(errors.gyro_bias_sigma_radps),
            accel_gain=gain(errors.accel_scale_sigma),
            gyro_gain=gain(errors.gyro_scale_sigma),
            accel_mps2_per_degc=vector(errors.accel_per_degc_sigma_mps2),
            gyro_radps_per_degc=vector(errors.gyro_per_degc_sigma_radps),
            q_vb=from_euler(roll, pitch, yaw),
            clock_error=float(rng.uniform(-1.0, 1.0)) * errors.clock_limit,
        )


class Readings(NamedTuple):
    """What the chip measured, before rounding; body axes, shape (n, 3) and (n,)."""

    accel_mps2: FloatArray
    gyro_radps: FloatArray
    temp_degc: FloatArray


class ChipErrors:
    """Adds the errors of one chip to ideal readings, stretch after stretch.

    Parameters
    ----------
    errors : SensorErrors
        Sizes of what changes with time.
    traits : ChipTraits
        What does not.
    rng : Generator
        Source of all its noise.
    rate_hz : float
        Nominal sample rate.
    has_engine, has_wheels : bool
        Whether the box sits in something that shakes, and whether its turning parts
        can be told from the rest.
    """

    def __init__(
        self,
        errors: SensorErrors,
        traits: ChipTraits,
        rng: np.random.Generator,
        rate_hz: float,
        *,
        has_engine: bool,
        has_wheels: bool = False,
    ) -> None:
        self._errors, self._traits = errors, traits
        C_bv = matrix(traits.q_vb).T
        self._accel_gain_T = (traits.accel_gain @ C_bv).T
        self._gyro_gain_T = (traits.gyro_gain @ C_bv).T
        self._rng, drift_rng, rumble_rng = (rng, *rng.spawn(2))
        drift = _six(errors.accel_drift_sigma_mps2, errors.gyro_drift_sigma_radps)
        self._drift = GaussMarkov(drift_rng, drift, errors.drift_tau_s)
        flicker = _six(errors.accel_flicker_mps2, errors.gyro_flicker_radps)
        self._flicker = Flicker(rng.spawn(1)[0], flicker) if flicker.any() else None
        density = _six(errors.accel_noise_mps2_rthz, errors.gyro_noise_radps_rthz)
        self._white_sigma = density * math.sqrt(0.5 * rate_hz)
        self._rumble = Rumble(rumble_rng, 6, rate_hz) if has_engine else None
        self.rolling = Rolling(rng.spawn(1)[0], rate_hz) if has_wheels else None
        self._idle = _six(errors.idle_accel_sigma_mps2, errors.idle_gyro_sigma_radps)
        self._road = _six(errors.road_accel_sigma_mps2, errors.road_gyro_sigma_radps)

    def spoil(
        self, t_s: FloatArray, speed_mps: FloatArray, f_v: FloatArray, w_v: FloatArray
    ) -> Readings:
        """Turn the truth in the vehicle's axes into readings in the box's.

        Parameters
        ----------
        t_s : ndarray, shape (n,)
            Instants, growing from call to call.
        speed_mps : ndarray, shape (n,)
            Speed over ground: the road shakes in proportion.
        f_v, w_v : ndarray, shape (n, 3), m/s^2 and rad/s
            Specific force and angular rate, vehicle axes.
        """
        errors, traits = self._errors, self._traits
        warmth = errors.warm_up_degc * (1.0 - np.exp(-t_s / errors.warm_up_tau_s))
        noise = self._drift.at(t_s)
        if self._flicker:
            noise += self._flicker.at(t_s)
        noise += self._white_sigma * self._rng.standard_normal((len(t_s), 6))
        if self._rumble:
            pace = speed_mps[:, None] / ROAD_SPEED_MPS
            rumble, road = self._rumble.draw(len(t_s)), pace * self._road
            if self.rolling:
                wheels, engine, surface = self.rolling.at(t_s, speed_mps, w_v[:, 2])
                noise += road * wheels + self._idle * engine
                road = surface * road
            noise += (self._idle + road) * rumble
        accel = f_v @ self._accel_gain_T + traits.accel_bias_mps2 + noise[:, :3]
        gyro = w_v @ self._gyro_gain_T + traits.gyro_bias_radps + noise[:, 3:]
        accel += np.outer(warmth, traits.accel_mps2_per_degc)
        gyro += np.outer(warmth, traits.gyro_radps_per_degc)
        return Readings(accel, gyro, AMBIENT_DEGC + warmth)


def _six(accel: Vec3 | float, gyro: float) -> FloatArray:
    """One number for each axis of the accelerometer, then of the gyro."""
    return np.concatenate([np.broadcast_to(accel, 3), np.broadcast_to(gyro, 3)])
