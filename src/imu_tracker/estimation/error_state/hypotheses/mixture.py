"""Weights of the hypotheses with an IMU and without, and the radius of both.

Each fix moves the weight towards the hypothesis that predicted it better. The change
per fix and the total are bounded, so that no single fix decides and a fault shows
within seconds.
"""

import math
from enum import Enum
from typing import Final

from imu_tracker.estimation.estimate import R95_PER_SIGMA

START_NATS: Final = 2.0
"""Odds of 7 to 1 for an IMU before anything was compared."""

MOST_NATS: Final = 5.0
"""150 to 1: the largest odds for an IMU. From here it loses within seconds."""

FIX_NATS: Final = 2.0
"""Largest change by the fixes of one second: errors of a receiver are correlated."""

LOST_NATS: Final = -4.0
"""50 to 1 against the IMU."""

TRIAL_NATS: Final = 0.3
"""Largest gain per second while on trial: a straight road proves no heading."""

AGAIN_NATS: Final = 2.0
DOUBT_NATS: Final = 6.0
MOST_DOUBTS: Final = 4
"""An IMU that was wrong comes back at `AGAIN_NATS`, and begins its trial so far below
zero, for each time that it was wrong."""

_BISECTIONS: Final = 30
_NEGLIGIBLE: Final = 0.01  # a weight that moves the radius by less than a tenth


class Verdict(Enum):
    """What a comparison decided."""

    NONE = "none"
    IMU_LOST = "imu lost"
    IMU_BACK = "imu back"


class Odds:
    """Log odds of the IMU's hypothesis against the receiver alone.

    Attributes
    ----------
    nats : float
    is_imu_out : bool
        Whether the IMU is being relearnt and its rows do not count.
    is_proved : bool
        Whether it predicted the fixes better for long enough, with this heading.
    """

    def __init__(self) -> None:
        self.nats = START_NATS
        self.is_imu_out = self.is_proved = False
        self._n_lost = 0

    @property
    def imu_weight(self) -> float:
        """Probability of the hypothesis with an IMU."""
        return 1.0 / (1.0 + math.exp(-self.nats))

    @property
    def has_imu_lead(self) -> bool:
        """Whether rows are the IMU's."""
        return not self.is_imu_out and self.nats >= 0.0

    def compare(self, imu: float, alone: float, period_s: float) -> Verdict:
        """Update with the log-likelihoods of the same fix under both."""
        most = FIX_NATS if self.is_proved else TRIAL_NATS
        better = min(max(imu - alone, -FIX_NATS), most)
        self.nats = min(self.nats + better * min(period_s, 1.0), MOST_NATS)
        self.is_proved = self.is_proved or self.nats >= MOST_NATS
        if self.is_imu_out:
            self.nats = max(self.nats, self._floor)
            if self.nats > AGAIN_NATS:
                self.is_imu_out = False
                return Verdict.IMU_BACK
        elif self.nats < LOST_NATS:
            self._n_lost = min(self._n_lost + 1, MOST_DOUBTS)
            self.is_imu_out, self.nats = True, self._floor
            self.is_proved = False
            return Verdict.IMU_LOST
        return Verdict.NONE

    def undo_loss(self) -> None:
        """Undo the last loss: the heading was wrong, not the IMU."""
        self._n_lost -= 1
        self.is_imu_out, self.nats = False, 0.0

    def restart_trial(self) -> None:
        """Put the IMU on trial again, with another heading or after a restart."""
        self.nats, self.is_proved = min(self.nats, START_NATS), False

    @property
    def _floor(self) -> float:
        return -DOUBT_NATS * self._n_lost


def radius_m(parts: list[tuple[float, float, float]]) -> float:
    """Radius about the leading position that holds 95 % of a mixture.

    Parameters
    ----------
    parts : list of (weight, distance_m, r95_m)
        The leader first; distances are from its position.

    Notes
    -----
    A circular normal at distance d has at least 1 - exp(-(r - d)^2 / 2 sigma^2) within
    r, which is exact for the leader (d = 0).
    """
    alive = [part for part in parts if part[0] >= _NEGLIGIBLE]
    if len(alive) < 2:
        return parts[0][2]
    total = sum(weight for weight, _, _ in alive)
    low, high = 0.0, max(distance + r95 for _, distance, r95 in alive)
    for _ in range(_BISECTIONS):
        middle = 0.5 * (low + high)
        held = sum(w * _held(middle - d, r95) for w, d, r95 in alive)
        low, high = (middle, high) if held < 0.95 * total else (low, middle)
    return high


def _held(reach_m: float, r95_m: float) -> float:
    if reach_m <= 0.0:
        return 0.0
    sigma_m = max(r95_m / R95_PER_SIGMA, 1e-6)
    return 1.0 - math.exp(-0.5 * (reach_m / sigma_m) ** 2)
