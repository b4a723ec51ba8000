"""The filters with an IMU and the receiver alone, compared on the same fixes."""

from collections import deque

import numpy as np

from imu_tracker.estimation.error_state.filter import Eskf, Measurement
from imu_tracker.estimation.error_state.hypotheses.mixture import Odds, Verdict
from imu_tracker.estimation.error_state.hypotheses.receiver_alone import (
    FixNoise,
    KeptFix,
    ReceiverAlone,
)
from imu_tracker.estimation.error_state.platform import Platform
from imu_tracker.estimation.error_state.receiver_model import log_likelihood
from imu_tracker.estimation.receiver.gate import MAX_SPEED_MPS
from imu_tracker.samples import GpsFix


class Comparison:
    """Holds the receiver's own filter, and the odds of the IMU against it.

    Parameters
    ----------
    platform : Platform

    Attributes
    ----------
    alone : ReceiverAlone
    odds : Odds
    kept_fixes : deque of KeptFix, or None
        For a smoother.
    """

    def __init__(self, platform: Platform) -> None:
        self._platform = platform
        self.alone = ReceiverAlone(MAX_SPEED_MPS[platform.profile])
        self.odds = Odds()
        self.kept_fixes: deque[KeptFix] | None = None

    def change_profile(self) -> None:
        """Bound the speed by what the platform may do now."""
        self.alone.max_speed_mps = MAX_SPEED_MPS[self._platform.profile]

    def weigh(
        self,
        fix: GpsFix,
        instant_ns: int,
        noise: FixNoise,
        imu: float | None,
        period_s: float,
    ) -> Verdict:
        """Update the receiver's filter with a fix; compare how well both predicted it.

        Parameters
        ----------
        fix : GpsFix
        instant_ns : int
            That it describes.
        noise : FixNoise
        imu : float or None
            Log-likelihood of its position and velocity under the filters with an IMU,
            weighted by their odds; None: they do not use it.
        period_s : float
            Between fixes.
        """
        psd = self._platform.unknown_accel_psd
        was_settled = self.alone.is_settled
        alone = self.alone.update(fix, instant_ns, noise, psd)
        if self.kept_fixes is not None:
            self.kept_fixes.append(
                KeptFix(
                    *(instant_ns, fix.lat_rad, fix.lon_rad, fix.vel_ne_mps),
                    *(noise.position_var, noise.velocity_var, noise.lasting_var, psd),
                )
            )
        if alone is None or not was_settled or imu is None:
            return Verdict.NONE
        return self.odds.compare(imu, alone, period_s)


def log_likelihood_of(
    eskf: Eskf, position: Measurement, velocity: Measurement | None, late_var: float
) -> float:
    """How well a filter predicted a fix of a receiver whose velocity may be late."""
    S = eskf.innovation_covariance(position)
    likelihood = log_likelihood(position.z, S)
    if velocity is not None:
        S = eskf.innovation_covariance(velocity) + late_var * np.eye(2)
        likelihood += log_likelihood(velocity.z, S)
    return likelihood
