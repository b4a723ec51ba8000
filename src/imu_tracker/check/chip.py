"""Whether samples of a chip that should lie still are those of a sound one.

In: samples. Out: their means, and what no motion explains. No bus, no clock.
"""

import math
from typing import Final

from imu_tracker.calibration.counts import STANDARD_GRAVITY_MPS2
from imu_tracker.samples import ImuSample

GRAVITY_G: Final = (0.85, 1.15)  # ranges are good to 3 %, zero-g to 80 mg
STILL_SPREAD_G: Final = 0.1  # peak to peak of a chip that lies: 400 ug/sqrt(Hz)
STILL_DPS: Final = 30.0  # PS-MPU-6000A section 6.1: zero-rate 20, and some


def why_broken(samples: list[ImuSample], stuck: tuple[str, ...] = ()) -> str:
    """Name what no motion explains; empty when motion may.

    `stuck` are the axes that stood while the others did not (`motion/stuck_axes`).
    """
    if stuck:
        return f"{', '.join(stuck)} stands, the chip is broken"
    if not any(any((*s.accel_mps2, *s.gyro_radps)) for s in samples):
        return "all axes give exactly zero, the chip is broken"
    for sensor, axes in (
        ("accelerometer", [s.accel_mps2 for s in samples]),
        ("gyroscope", [s.gyro_radps for s in samples]),
    ):
        if len(set(axes)) == 1:  # noise alone moves a sound one by some counts
            return f"the {sensor} never changes its values, the chip is broken"
    gravity_g, rate_dps, _ = means(samples)
    for axis, name in enumerate("xyz"):
        values = {sample.accel_mps2[axis] for sample in samples}
        end_g = abs(samples[0].accel_mps2[axis]) / STANDARD_GRAVITY_MPS2
        if len(values) == 1 and end_g > GRAVITY_G[1]:
            return f"accel {name} is stuck at {end_g:.2f} g, the chip is broken"
    is_still = rate_dps <= STILL_DPS and _spread_g(samples) < STILL_SPREAD_G
    for factor, low_g, high_g in ((0.5, 0.45, 0.55), (2.0, 1.85, 2.15)):
        if is_still and low_g <= gravity_g <= high_g:
            return f"it lies still and has {factor:g} times the scale of its name"
    return ""


def _spread_g(samples: list[ImuSample]) -> float:
    """Return the largest range of an accelerometer axis."""
    axes = ([sample.accel_mps2[i] for sample in samples] for i in range(3))
    return max(max(axis) - min(axis) for axis in axes) / STANDARD_GRAVITY_MPS2


def means(samples: list[ImuSample]) -> tuple[float, float, float]:
    """Return the norms of the mean specific force (g) and rate (deg/s), and degC."""
    n = len(samples)
    accel = [sum(s.accel_mps2[i] for s in samples) / n for i in range(3)]
    gyro = [sum(s.gyro_radps[i] for s in samples) / n for i in range(3)]
    temp_degc = sum(sample.temp_degc for sample in samples) / n
    gravity_g = math.hypot(*accel) / STANDARD_GRAVITY_MPS2
    return gravity_g, math.degrees(math.hypot(*gyro)), temp_degc
