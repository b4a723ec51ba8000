"""The filter with an IMU and the receiver alone, compared on the same fixes."""

import numpy as np

from imu_tracker.estimation.error_state.filter import Eskf, Measurement
from imu_tracker.estimation.error_state.hypotheses.mixture import Odds, Verdict
from imu_tracker.estimation.error_state.hypotheses.receiver_alone import ReceiverAlone
from imu_tracker.estimation.error_state.platform import Platform
from imu_tracker.estimation.error_state.receiver_model import (
    FixGeometry,
    ReceiverModel,
    log_likelihood,
)
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
    """

    def __init__(self, platform: Platform) -> None:
        self._platform = platform
        self.alone = ReceiverAlone(MAX_SPEED_MPS[platform.profile])
        self.odds = Odds()

    def change_profile(self) -> None:
        """Bound the speed by what the platform may do now."""
        self.alone.max_speed_mps = MAX_SPEED_MPS[self._platform.profile]

    def weigh(
        self,
        eskf: Eskf,
        receiver: ReceiverModel,
        fix: GpsFix,
        position: Measurement,
        geometry: FixGeometry,
        ahead_s: float,
        *,
        has_say: bool,
    ) -> Verdict:
        """Update the receiver's filter with a fix; compare how well both predicted it.

        Parameters
        ----------
        eskf : Eskf
            The filter with an IMU, at `ahead_s` before the fix.
        receiver : ReceiverModel
        fix : GpsFix
        position : Measurement
            The fix's position against the filter.
        geometry : FixGeometry
        ahead_s : float
        has_say : bool
            Whether the filter uses the IMU: it delivers, and the heading is known.
        """
        noise = receiver.noise(fix, position)
        instant_ns = eskf.nominal.t_ns + round((ahead_s + eskf.delay_s) * 1e9)
        psd = self._platform.unknown_accel_psd
        was_settled = self.alone.is_settled
        alone = self.alone.update(fix, instant_ns, noise, psd)
        if alone is None or not was_settled or not has_say:
            return Verdict.NONE
        imu = log_likelihood(position.z, eskf.innovation_covariance(position))
        velocity = receiver.velocity(eskf, fix, geometry, ahead_s)
        if velocity is not None:
            S = eskf.innovation_covariance(velocity) + noise.late_var * np.eye(2)
            imu += log_likelihood(velocity.z, S)
        return self.odds.compare(imu, alone, receiver.period_s)
