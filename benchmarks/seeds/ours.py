"""The filters of imu-tracker on the thesis's samples.

They get what the thesis's algorithm gets: the accelerometer, the orientation that the
tablet tells, the place and the speed at the start. So these are the filters alone, the
algebra of six-state and of error-state: what the tracker learns on its way (heading,
biases, standstill, trust in the receiver) takes longer than a round of six seconds. The
walks run through the whole program.
"""

import math
from typing import Final

import numpy as np

from benchmarks.seeds.measure import Array
from benchmarks.seeds.samples import (
    GRAVITY_MPS2,
    NOISE_SIGMA_MPS2,
    NOISE_SIGMA_RAD,
    Samples,
)
from imu_tracker.estimation.error_state.filter import Eskf, Measurement
from imu_tracker.estimation.error_state.mechanisation import Nominal
from imu_tracker.estimation.error_state.states import N_ERRORS, NoiseLevel
from imu_tracker.estimation.six_state.position_filter import PositionFilter
from imu_tracker.geometry.rotation import (
    conjugate,
    from_euler,
    multiply,
    rotate,
    to_rotation_vector,
)
from imu_tracker.motion.preintegration import ImuStep

EXACT_SIGMA_M: Final = 1e-3
"""What says of a fix that it is exact."""

_START_SIGMA: Final = (*(1e-3,) * 3, *(1e-3,) * 3, *NOISE_SIGMA_RAD.tolist())
"""Place, speed and orientation are known at the start."""

_STRETCH: Final = 10  # samples between predictions of the error-state's covariance


def six_state(
    samples: Samples, seed: int, fixes_ne_m: Array | None = None, sigma_m: float = 1.0
) -> Array:
    """Track by the six-state filter; shape (n, 2)."""
    kf = PositionFilter()
    kf.x = np.array([*samples.ne_m[0], 0.0, *samples.start_v_n])
    kf.P = np.diag(np.square(_START_SIGMA[:6]))
    psd = float(NOISE_SIGMA_MPS2[0] ** 2) * samples.h_s
    fix_at = set(samples.fix_at.tolist()) if fixes_ne_m is not None else set()
    track = [kf.x[:2]]
    readings = zip(
        samples.f_b[seed, :-1].tolist(),
        samples.rpy_rad[seed, :-1].tolist(),
        strict=True,
    )
    for k, (f_b, rpy_rad) in enumerate(readings, 1):
        fn, fe, fd = rotate(from_euler(*rpy_rad), f_b)
        kf.predict(samples.h_s, (fn, fe, fd + GRAVITY_MPS2), (psd, psd, psd))
        if k in fix_at and fixes_ne_m is not None:
            kf.update(fixes_ne_m[k], slice(0, 2), sigma_m**2)
        track.append(kf.x[:2])
    return np.array(track)


def error_state(
    samples: Samples, seed: int, fixes_ne_m: Array | None = None, sigma_m: float = 1.0
) -> Array:
    """Track by the error-state filter; shape (n, 2)."""
    eskf = Eskf(NoiseLevel(0.0, 0.0), is_vehicle=False)
    north, east = samples.ne_m[0].tolist()
    vn, ve, vd = samples.start_v_n.tolist()
    orientations = [from_euler(*rpy) for rpy in samples.rpy_rad[seed].tolist()]
    eskf.nominal = Nominal(1, (north, east, 0.0), (vn, ve, vd), orientations[0])
    eskf.gravity_mps2 = GRAVITY_MPS2
    P = np.zeros((N_ERRORS, N_ERRORS))
    P[range(9), range(9)] = np.square(_START_SIGMA)
    eskf.P = P
    H = np.eye(2, N_ERRORS)
    fix_at = set(samples.fix_at.tolist()) if fixes_ne_m is not None else set()
    track = [(north, east)]
    for k, step in enumerate(_steps(samples, seed, orientations), 1):
        eskf.propagate(step, use_force=True)
        if k in fix_at and fixes_ne_m is not None:
            eskf.predict(use_force=True)
            z = fixes_ne_m[k] - eskf.nominal.p_n[:2]
            eskf.update(Measurement(z, H, np.eye(2) * sigma_m**2))
        elif fix_at and k % _STRETCH == 0:
            eskf.predict(use_force=True)
        track.append(eskf.nominal.p_n[:2])
    return np.array(track)


def _steps(
    samples: Samples, seed: int, orientations: list[tuple[float, float, float, float]]
) -> list[ImuStep]:
    """Make a step of each sample; the gyro is the change of the orientation told."""
    zero, h_s = (0.0, 0.0, 0.0), samples.h_s
    return [
        ImuStep(
            1 + round((k + 1) * h_s * 1e9),
            h_s,
            to_rotation_vector(
                multiply(conjugate(orientations[k]), orientations[k + 1])
            ),
            (fx * h_s, fy * h_s, fz * h_s),
            1,
            zero,
            zero,
            0.0,
            0.0,
            math.nan,
            False,
            False,
        )
        for k, (fx, fy, fz) in enumerate(samples.f_b[seed, :-1].tolist())
    ]
