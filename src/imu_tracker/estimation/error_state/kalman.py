"""The algebra of the error-state filter's covariance.

The errors themselves are zero between measurements: they are put into the solution at
once, so that a prediction moves the covariance alone.
"""

import numpy as np

from imu_tracker.estimation.error_state.states import Array


def predicted(P: Array, F: Array, Q: Array) -> Array:
    """Let the errors grow: F P F' + Q.

    Parameters
    ----------
    P, F, Q : ndarray, shape (n, n)
    """
    grown: Array = F @ P @ F.T
    grown += Q
    return grown


def updated(P: Array, z: Array, H: Array, R: Array) -> tuple[Array, Array]:
    """Fold an innovation `z = H errors + noise(R)` in.

    Parameters
    ----------
    P : ndarray, shape (n, n)
    z : ndarray, shape (m,)
    H : ndarray, shape (m, n)
    R : ndarray, shape (m, m)

    Returns
    -------
    errors : ndarray, shape (n,)
    P : ndarray, shape (n, n)

    Notes
    -----
    K = P H' S^-1, S = H P H' + R; P by Joseph's form, which stays symmetric and
    positive: (I - K H) P (I - K H)' + K R K'.
    Source: Bar-Shalom, Li, Kirubarajan 2001, Estimation with Applications to Tracking
    and Navigation, section 5.2.3.
    """
    PHT = P @ H.T
    K = np.linalg.solve(H @ PHT + R, PHT.T).T
    kept = np.eye(P.shape[0]) - K @ H
    return K @ z, kept @ P @ kept.T + K @ R @ K.T
