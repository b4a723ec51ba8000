"""The covariance algebra, against filterpy's."""

import numpy as np
import pytest
from filterpy.kalman import KalmanFilter

from imu_tracker.estimation.error_state.kalman import predicted, updated

N = 31


@pytest.mark.parametrize("n_measured", [1, 2, 3])
def test_a_hundred_updates_agree_with_filterpy(n_measured: int) -> None:
    rng = np.random.default_rng(n_measured)
    oracle = KalmanFilter(dim_x=N, dim_z=n_measured)
    oracle.P = np.diag(rng.uniform(0.1, 10.0, N))
    P = oracle.P.copy()
    for _ in range(100):
        F = np.eye(N) + 0.02 * rng.standard_normal((N, N))
        Q = np.diag(rng.uniform(0.0, 0.1, N))
        z, H = rng.standard_normal(n_measured), rng.standard_normal((n_measured, N))
        R = np.diag(rng.uniform(0.01, 1.0, n_measured))
        oracle.x = np.zeros(N)
        oracle.predict(F=F, Q=Q)
        oracle.update(z, R=R, H=H)
        errors, P = updated(predicted(P, F, Q), z, H, R)
        np.testing.assert_allclose(errors, oracle.x, rtol=1e-6, atol=1e-8)
        np.testing.assert_allclose(P, oracle.P, rtol=1e-6, atol=1e-8)


def test_the_covariance_stays_symmetric_and_positive_through_sharp_measurements() -> (
    None
):
    rng, P = np.random.default_rng(9), np.eye(N) * 100.0
    for k in range(2000):
        P = predicted(P, np.eye(N), np.eye(N) * 1e-9)
        H = np.zeros((2, N))
        H[0, k % N], H[1, (7 * k) % N] = 1.0, rng.uniform(0.5, 2.0)
        _, P = updated(P, np.zeros(2), H, np.eye(2) * 1e-6)
        np.testing.assert_array_less(np.abs(P - P.T), 1e-12)
    assert np.linalg.eigvalsh(P).min() > 0.0
