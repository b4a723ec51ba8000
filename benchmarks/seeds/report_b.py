"""The filter of the project report, with its faults.

"Target Tracking using Kalman Filter", CBIT 2019: constant matrices, a sample every
0.25 s, no attitude and no gravity. Its measurement is the same accelerometer once more,
integrated by trapezoids with a wrong time step, over the whole history each time. Left
out is that it adds the gyro to the latitude, which has no unit that could be repeated.
"""

from typing import Final

import numpy as np

from benchmarks.seeds.measure import Array, Indices
from benchmarks.seeds.samples import Samples

DT_S: Final = 0.25
WRONG_DT_S: Final = 1.0
"""What a trapezoid sum takes the step for when nobody tells it."""

_I: Final = np.eye(3)
A: Final = np.block([[_I, DT_S * _I], [0.0 * _I, _I]])
B: Final = np.vstack([0.5 * DT_S**2 * _I, DT_S * _I])
P0: Final = 4.0 * np.eye(6)
R: Final = np.diag([4.0, 1.0, 1.0, 4.0, 1.0, 1.0])


def run(samples: Samples, seed: int) -> tuple[Indices, Array]:
    """Track by the report's filter.

    Returns
    -------
    at : ndarray of int, shape (m,)
        The instants that it speaks of.
    ne_m : ndarray, shape (m, 2)
    """
    step = max(1, round(DT_S / samples.h_s))
    at = np.arange(0, len(samples.ne_m), step, dtype=np.intp)
    u = samples.f_b[seed, at]
    start = np.array([*samples.ne_m[0], 0.0, *samples.start_v_n])
    x, P = start, P0
    told = [x[:2]]
    for k in range(1, len(at)):
        v_m = _trapezoids(u[: k + 1]) + start[3:]
        p_m = _trapezoids(v_m) + start[:3]
        x, P = A @ x + B @ u[k], A @ P @ A.T
        K = P @ np.linalg.inv(P + R)
        x = x + K @ (np.concatenate([p_m[-1], v_m[-1]]) - x)
        P = (np.eye(6) - K) @ P
        told.append(x[:2])
    return at, np.array(told)


def _trapezoids(values: Array) -> Array:
    """Sum up the whole history, once more."""
    steps = 0.5 * (values[1:] + values[:-1]) * WRONG_DT_S
    return np.vstack([np.zeros(3), np.cumsum(steps, axis=0)])
