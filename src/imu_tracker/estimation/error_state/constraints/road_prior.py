"""Spreads of road slope and forward acceleration, learnt on this drive for outages.

The road ahead is as steep as the one behind, and the driver accelerates as before. Only
the spreads are used; the means are taken to be zero.
"""

import math

from imu_tracker.estimation.error_state.filter import Eskf
from imu_tracker.estimation.tuning import (
    LEAST_FORWARD_MPS2,
    LEAST_SLOPE_RAD,
    ROAD_MEMORY_S,
    ROAD_START_WEIGHT_S,
    ROLLING_MPS,
    START_FORWARD_MPS2,
    START_SLOPE_RAD,
)


class RoadPrior:
    """Learns the spreads of slope and of forward acceleration while there are fixes.

    Attributes
    ----------
    slope_sigma_rad : float
    forward_sigma_mps2 : float

    Notes
    -----
    sigma^2 = (w_0 sigma_0^2 + sum x^2 dt) / (w_0 + t): the mean of an inverse gamma
    distribution that begins with the weight w_0.
    """

    def __init__(self) -> None:
        self._slope_var = START_SLOPE_RAD**2
        self._forward_var = START_FORWARD_MPS2**2
        self._weight_s = ROAD_START_WEIGHT_S

    @property
    def slope_sigma_rad(self) -> float:
        """Standard deviation of the slope."""
        return max(math.sqrt(self._slope_var), LEAST_SLOPE_RAD)

    @property
    def forward_sigma_mps2(self) -> float:
        """Standard deviation of the forward acceleration, mean of a second."""
        return max(math.sqrt(self._forward_var), LEAST_FORWARD_MPS2)

    def learn(self, eskf: Eskf, period_s: float) -> None:
        """Take a stretch of a drive whose velocity and attitude are known."""
        if math.hypot(*eskf.nominal.v_n[:2]) < ROLLING_MPS:
            return
        ahead = eskf.C_vn()[0]
        slope_rad = math.asin(max(-1.0, min(1.0, -float(ahead[2]))))
        forward_mps2 = float(ahead @ eskf.mean_a_n)
        self._weight_s = min(self._weight_s + period_s, ROAD_MEMORY_S)
        share = period_s / self._weight_s
        self._slope_var += share * (slope_rad**2 - self._slope_var)
        self._forward_var += share * (forward_mps2**2 - self._forward_var)
