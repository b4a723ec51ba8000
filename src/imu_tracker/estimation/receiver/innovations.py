"""Consistency of receiver and six-state filter, learnt from the innovations.

Innovations that scatter more than they should are the receiver's noise, as under trees:
R grows. Innovations that keep to one side are the filter's error: P grows (`fading`),
and it follows the receiver.
"""

import numpy as np
from numpy.typing import NDArray

from imu_tracker.estimation.receiver.fix_period import FixPeriod
from imu_tracker.estimation.tuning import SIX_MAX_FADING, SIX_MAX_NIS_LEVEL
from imu_tracker.samples import GpsFix

Array = NDArray[np.float64]


class InnovationMonitor:
    """Learns from fixes; of the whole run, and so never taken back.

    Attributes
    ----------
    period : FixPeriod
    sigma_h_m : float
        Mean of the claimed sigmas; 0: not yet known.
    nis_level : float
        Factor on the claimed variance.
    """

    def __init__(self, period: FixPeriod) -> None:
        self.period = period
        self._nis_sum, self._n_nis = 0.0, 0
        self.start()

    def start(self, sigma_h_m: float = 0.0) -> None:
        """Reset after a restart: the mean innovation belonged to the old position."""
        self.sigma_h_m = sigma_h_m
        self.nis_level, self._bias_nis = 1.0, 0.0
        self._mean = np.zeros(2)

    @property
    def fading(self) -> float:
        """Factor by which P grows at a fix, when innovations keep to one side."""
        return min(max(self._bias_nis, 1.0), SIX_MAX_FADING)

    @property
    def nis_mean(self) -> float | None:
        """Mean normalised innovation squared; 2 for a consistent filter."""
        return self._nis_sum / self._n_nis if self._n_nis else None

    def learn_noise(self, fix: GpsFix, innovation: Array, S: Array, nis: float) -> None:
        """Take the innovation of a fix that fits, and its covariance."""
        if self.sigma_h_m == 0.0:
            self.sigma_h_m = fix.sigma_h_m
        self._n_nis += 1
        self._nis_sum += nis
        forget = 0.2 * min(1.0, self.period.mean_s)
        self._mean = mean = self._mean + forget * (innovation - self._mean)
        scatter = innovation - mean
        ratio = 0.5 * float(scatter @ np.linalg.solve(S, scatter)) * self.nis_level
        level = self.nis_level + 0.5 * forget * (ratio - self.nis_level)
        self.nis_level = min(max(level, 1.0), SIX_MAX_NIS_LEVEL)
        self._bias_nis = float(mean @ np.linalg.solve(S, mean))
        self.sigma_h_m += 0.5 * forget * (fix.sigma_h_m - self.sigma_h_m)
