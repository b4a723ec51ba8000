"""What was learnt, as `replay --json` and the status show it."""

import math
from typing import TypedDict

from imu_tracker.estimation.error_state.filter import Eskf
from imu_tracker.estimation.error_state.states import (
    ACCEL_BIAS,
    DELAY,
    MOUNT_PITCH,
    MOUNT_YAW,
    YAW_D,
)
from imu_tracker.geometry.rotation import to_euler


class WheelReport(TypedDict):
    """Learnt by `wheels/`; null: not known yet."""

    state: str  # "heard", "faint" or "not heard"
    circumference_m: float | None
    circumference_sigma_m: float | None
    clarity: float | None
    heard_share: float | None


class EstimatorReport(TypedDict, total=False):
    """Of either estimator, with what the tracker and the pipeline add.

    Keys that an estimator does not know are absent. Lists are in body axes.
    """

    estimator: str
    profile: str
    mounting_deg: list[float]
    mounting_sigma_deg: list[float]
    gyro_bias_dps: list[float]
    gyro_bias_sigma_dps: float
    accel_bias_mps2: list[float]
    accel_bias_sigma_mps2: list[float]
    tilt_sigma_deg: float
    yaw_sigma_deg: float
    gyro_gain: list[float]
    axle_m: float
    delay_s: float
    delay_sigma_s: float
    velocity_delay_s: float
    velocity_sigma_mps: float
    fix_noise_level: float
    fix_period_s: float
    lag_s: float
    nis_mean: float | None
    fix_log_likelihood: float
    noise_level: int
    wheels: WheelReport | None
    hypotheses: dict[str, float]  # probability of each that is alive, by its name
    still_gyro_threshold_dps: float
    still_accel_threshold_mps2: float
    utc_jumps: int
    utc_holes: int
    counters: dict[str, int]


def figures_of(eskf: Eskf, gyro_bias_sigma_radps: float) -> EstimatorReport:
    """Return what the error-state filter itself estimates."""
    return {
        "mounting_deg": [math.degrees(angle) for angle in to_euler(eskf.q_vb)],
        "mounting_sigma_deg": [
            math.degrees(eskf.sigma(i)) for i in (MOUNT_PITCH, MOUNT_YAW)
        ],
        "gyro_bias_dps": [math.degrees(b) for b in eskf.gyro_bias_radps],
        "gyro_bias_sigma_dps": math.degrees(gyro_bias_sigma_radps),
        "accel_bias_mps2": list(eskf.accel_bias_mps2),
        "accel_bias_sigma_mps2": [
            eskf.sigma(i) for i in range(ACCEL_BIAS.start, ACCEL_BIAS.stop)
        ],
        "yaw_sigma_deg": math.degrees(eskf.sigma(YAW_D)),
        "gyro_gain": list(eskf.gyro_gain),
        "axle_m": eskf.axle_m,
        "delay_s": eskf.delay_s,
        "delay_sigma_s": eskf.sigma(DELAY),
        "velocity_delay_s": eskf.velocity_delay_s,
    }
