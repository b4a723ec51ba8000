"""The algorithm of the thesis, with its faults.

"Navigation using Inertial Sensors", TU Delft 2022: dead reckoning and a Kalman filter
of six states, position in earth axes and velocity *in the device's*. Two faults make
it diverge, and both are kept: the velocity does not turn when the device does, and the
covariance is propagated only when a fix comes, and then by the time of one sample.
"""

from typing import Final, NamedTuple

import numpy as np

from benchmarks.seeds.measure import Array, Indices
from benchmarks.seeds.samples import Samples
from imu_tracker.simulation.imu.ideal import attitude_matrix

Q: Final = 0.001 * np.eye(6)
P0: Final = np.diag([1.0, 1.0, 0.0, 0.1, 0.1, 0.1])
H: Final = np.eye(2, 6)


class Track(NamedTuple):
    """Where it believes to be."""

    ne_m: Array  # at all instants, shape (S, n, 2)
    at_fixes_ne_m: Array  # just after each fix, shape (S, m, 2)


def run(
    samples: Samples,
    fixes_ne_m: Array | None = None,
    fix_at: Indices | None = None,
    R: float = 1.0,
) -> Track:
    """Reckon, and correct by the fixes if there are any.

    Parameters
    ----------
    samples : Samples
    fixes_ne_m : ndarray, shape (S, n, 2), optional
        What the receiver says at all instants.
    fix_at : ndarray of int
        At which instants it does.
    R : float, m^2
        Variance of a fix: 1 or 0 in the thesis.

    Notes
    -----
    p' = p + t C v + t^2/2 a,  v' = v + t C' a,  a = C f - mean at rest;
    A = [[I, t C], [0, I]], P = A P A' + Q at fixes only, t the time of one sample,
    K = P H' (H P H' + R)^-1, P = (I - K H) P (I - K H)' + K R K'.
    """
    t = samples.h_s
    n_seeds, n, _ = samples.f_b.shape
    C = attitude_matrix(samples.rpy_rad.reshape(-1, 3)).reshape(n_seeds, n, 3, 3)
    a_n = np.einsum("skij,skj->ski", C, samples.f_b) - samples.rest_mean
    a_b = np.einsum("skji,skj->ski", C, a_n)
    p = np.tile([*samples.ne_m[0], 0.0], (n_seeds, 1))
    v = np.einsum("sji,j->si", C[:, 0], samples.start_v_n)
    P = np.tile(P0, (n_seeds, 1, 1))
    is_fix = set() if fix_at is None else set(fix_at.tolist())
    ne_m, at_fixes = np.empty((n_seeds, n, 2)), []
    ne_m[:, 0] = p[:, :2]
    for k in range(n - 1):
        p = p + t * np.einsum("sij,sj->si", C[:, k], v) + 0.5 * t * t * a_n[:, k]
        v = v + t * a_b[:, k]
        if k + 1 in is_fix and fixes_ne_m is not None:
            A = np.tile(np.eye(6), (n_seeds, 1, 1))
            A[:, :3, 3:] = t * C[:, k + 1]
            P = A @ P @ A.transpose(0, 2, 1) + Q
            S = P[:, :2, :2] + R * np.eye(2)
            K = P[:, :, :2] @ np.linalg.inv(S)
            x = np.hstack([p, v])
            x = x + np.einsum("sij,sj->si", K, fixes_ne_m[:, k + 1] - p[:, :2])
            p, v = x[:, :3], x[:, 3:]
            I_KH = np.eye(6) - K @ H
            P = I_KH @ P @ I_KH.transpose(0, 2, 1) + R * K @ K.transpose(0, 2, 1)
            at_fixes.append(p[:, :2])
        ne_m[:, k + 1] = p[:, :2]
    return Track(ne_m, np.array(at_fixes).reshape(-1, n_seeds, 2).swapaxes(0, 1))
