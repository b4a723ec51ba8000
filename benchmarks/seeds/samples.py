"""What the tablet of the thesis would have told of a figure or of a walk.

The thesis computes the accelerations of a figure at a thousand instants, holds each
until the next, and so leaves the path by itself: without any noise it ends centimetres
off. `figure` gives samples of a body that is really there: it flies through the same
thousand points with an acceleration that is constant from one to the next, a spline of
second degree. Whoever integrates them rightly returns to the points.
"""

import math
from collections.abc import Callable
from typing import Final, NamedTuple

import numpy as np

from benchmarks.seeds.measure import Array, Indices
from imu_tracker.geometry.geodesy import gravity_mps2
from imu_tracker.simulation.imu.ideal import attitude_matrix, specific_force
from imu_tracker.simulation.motion.figures import (
    POINTS,
    ROUND_S,
    RUN_UP_S,
    Figure,
    circle,
    going_round,
    lissajous,
    side_by_side,
)
from imu_tracker.simulation.motion.trajectory import Trajectory
from imu_tracker.simulation.scenarios import DELFT

GRAVITY_MPS2: Final = gravity_mps2(DELFT.lat_rad, DELFT.alt_m)

FIX_EVERY: Final = 50
"""A fix with every 50th sample."""

ACCEL_VARIANCE: Final = np.array([2.4572e-05, 3.1813e-05, 1.6963e-04])  # (m/s^2)^2
ORIENTATION_VARIANCE: Final = np.array([1.9561e-05, 4.4958e-06, 0.0027])  # deg^2, rpy
ACCEL_BIAS_MPS2: Final = np.array([-0.0094, 0.1601, 9.81 - 9.7719])
"""The thesis's two minutes at rest: variances as in its code, and means."""

PRINTED_VARIANCE: Final = np.array([0.0050, 0.0056, 0.0130])
"""As its text prints them: they are the standard deviations of the same samples."""

NOISE_SIGMA_MPS2: Final = np.sqrt(ACCEL_VARIANCE)
NOISE_SIGMA_RAD: Final = np.radians(np.sqrt(ORIENTATION_VARIANCE))

FIGURES: Final[dict[str, Callable[[], tuple[Figure, float]]]] = {
    "square": lambda: (side_by_side(0.0), 0.0),
    "circle": lambda: (going_round(circle, 0.0), RUN_UP_S),
    "Lissajous": lambda: (going_round(lissajous, 0.0), RUN_UP_S),
}
"""Each figure, and when its round begins."""


class Samples(NamedTuple):
    """Readings of a tablet, of S tablets at once, and what is true.

    The acceleration of sample k holds from instant k to k + 1. Axes are those of
    imu-tracker, body FRD and NED: a name for the thesis's, nothing more.
    """

    h_s: float
    f_b: Array  # specific force, shape (S, n, 3), m/s^2
    rpy_rad: Array  # orientation, shape (S, n, 3)
    ne_m: Array  # where it is at the instants, shape (n, 2)
    start_v_n: Array  # shape (3,)
    rest_mean: Array  # mean of the accelerometer at rest, which is taken out: (3,)

    @property
    def fix_at(self) -> Indices:
        """Numbers of the instants with a fix, the start not among them."""
        return np.arange(FIX_EVERY, len(self.ne_m), FIX_EVERY, dtype=np.intp)


def figure(name: str, n_seeds: int, *, has_noise: bool, turns: bool = False) -> Samples:
    """Sample a figure as a body that is really there, S times.

    Parameters
    ----------
    name : one of FIGURES
    n_seeds : int
        S; seeds 0 to S - 1.
    has_noise : bool
        Whether with the tablet's noise.
    turns : bool
        Whether the tablet turns along the path, as it does in a hand. The thesis's
        simulations keep it pointing the same way.
    """
    make, begin_s = FIGURES[name]()
    t_s = begin_s + np.linspace(0.0, ROUND_S, POINTS)
    h_s = float(t_s[1] - t_s[0])
    ne_m = make.ne_m(t_s)
    v_ne, a_ne = _spline(ne_m, h_s)
    a_n = np.column_stack([a_ne, np.zeros(POINTS)])
    rpy_rad = np.zeros((POINTS, 3))
    if turns:
        ahead = np.diff(ne_m, axis=0, append=2.0 * ne_m[-1:] - ne_m[-2:-1])
        rpy_rad[:, 2] = np.arctan2(ahead[:, 1], ahead[:, 0])
    f_n = a_n - [0.0, 0.0, GRAVITY_MPS2]
    f_b = np.einsum("kij,ki->kj", attitude_matrix(rpy_rad), f_n)
    return Samples(
        h_s,
        *_noisy(f_b, rpy_rad, n_seeds, float(has_noise)),
        ne_m,
        np.array([*v_ne[0], 0.0]),
        np.array([0.0, 0.0, -GRAVITY_MPS2]),
    )


def figure_as_in_the_thesis(
    name: str, n_seeds: int = 1, *, has_noise: bool = False
) -> Samples:
    """Sample a figure as the thesis does: accelerations of instants, S times.

    Its noise has the variances that are printed, which is what its results look like.
    """
    make, begin_s = FIGURES[name]()
    t_s = begin_s + np.linspace(0.0, ROUND_S, POINTS)
    motion = make.at(t_s)
    f_b = motion.a_n - [0.0, 0.0, GRAVITY_MPS2]
    return Samples(
        float(t_s[1] - t_s[0]),
        *_noisy(
            f_b,
            np.zeros((POINTS, 3)),
            n_seeds,
            float(has_noise),
            np.sqrt(PRINTED_VARIANCE),
        ),
        make.ne_m(t_s),
        motion.v_n[0],
        np.array([0.0, 0.0, -GRAVITY_MPS2]),
    )


def walk(
    trajectory: Trajectory, begin_s: float, end_s: float, n_seeds: int, rate_hz: float
) -> Samples:
    """Sample a walk by a tablet with its bias, which was taken at rest facing north."""
    n = math.floor((end_s - begin_s) * rate_hz)
    t_s = begin_s + np.arange(n) / rate_hz
    chunks = [trajectory.at(part) for part in np.array_split(t_s, max(1, n // 1000))]
    v_n = np.concatenate([chunk.v_n for chunk in chunks])
    rpy_rad = np.concatenate([chunk.rpy_rad for chunk in chunks])
    f_b = np.concatenate([specific_force(chunk, GRAVITY_MPS2) for chunk in chunks])
    steps_m = 0.5 * (v_n[1:] + v_n[:-1]) / rate_hz
    ne_m = np.vstack([np.zeros(2), np.cumsum(steps_m, axis=0)[:, :2]])
    return Samples(
        1.0 / rate_hz,
        *_noisy(f_b + ACCEL_BIAS_MPS2, rpy_rad, n_seeds, 1.0),
        ne_m,
        v_n[0],
        ACCEL_BIAS_MPS2 - [0.0, 0.0, GRAVITY_MPS2],
    )


def fixes(samples: Samples, sigma_m: float) -> Array:
    """What a receiver says at all instants, shape (S, n, 2): the truth, or near it."""
    n_seeds, n, _ = samples.f_b.shape
    errors = np.zeros((n_seeds, n, 2))
    for seed in range(n_seeds):
        rng = np.random.default_rng([seed, 1])
        errors[seed] = sigma_m * rng.standard_normal((n, 2))
    return samples.ne_m + errors


def _noisy(
    f_b: Array,
    rpy_rad: Array,
    n_seeds: int,
    size: float,
    sigma_mps2: Array = NOISE_SIGMA_MPS2,
) -> tuple[Array, Array]:
    """Add the tablet's white noise, for each seed."""
    forces, angles = [], []
    for seed in range(n_seeds):
        rng = np.random.default_rng([seed, 0])
        noise = size * rng.standard_normal((len(f_b), 6))
        forces.append(f_b + sigma_mps2 * noise[:, :3])
        angles.append(rpy_rad + NOISE_SIGMA_RAD * noise[:, 3:])
    return np.array(forces), np.array(angles)


def _spline(ne_m: Array, h_s: float) -> tuple[Array, Array]:
    """Velocity at the points, and the accelerations between them, shape (n, 2).

    Notes
    -----
    p' = p + h v + h^2/2 a and v' = v + h a leave v(0) open: a = b - 2/h (-1)^k v(0).
    Taken is the one that makes the accelerations change least, in the mean square.
    """
    steps = np.diff(ne_m, axis=0)
    sign = (-1.0) ** np.arange(len(ne_m))[:, None]
    gained = 2.0 / h_s * np.cumsum(sign[1:] * steps, axis=0)
    v_from_zero = sign * np.vstack([np.zeros(2), gained])
    b = np.diff(v_from_zero, axis=0) / h_s
    start_v = -0.25 * h_s * np.mean(sign[: len(b) - 1] * np.diff(b, axis=0), axis=0)
    v = v_from_zero + sign * start_v
    a = np.diff(v, axis=0) / h_s
    return v, np.vstack([a, a[-1:]])
