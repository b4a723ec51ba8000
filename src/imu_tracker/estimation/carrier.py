"""The body that carries the box: what it may do, as far as is known by now."""

import math
from typing import Final

from imu_tracker.estimation.eskf import Eskf
from imu_tracker.estimation.orientation import lean_right, yaw_between
from imu_tracker.estimation.pace import Pace
from imu_tracker.estimation.profile import ProfileJudge
from imu_tracker.estimation.rotation import wrap_pi
from imu_tracker.samples import Quat

UNKNOWN_ACCEL_PSD: Final = {"vehicle": 2.5**2, "walker": 0.5**2, "free": 2.5**2}
"""While the yaw or the IMU is unknown: a body's own acceleration, as (m/s^2)^2/Hz. A
vehicle's is 1 m/s^2 rms, and corners and stops last some six seconds; a walker turns
round within one."""


class Carrier:
    """A profile that is given, or that is found from how the body moves.

    Parameters
    ----------
    profile : {"auto", "free", "vehicle", "walker"}
        With "auto" it is free until the evidence is in.

    Attributes
    ----------
    profile : {"free", "vehicle", "walker"}
    pace : Pace
        Takes every step of the filters.
    """

    def __init__(self, profile: str) -> None:
        self._judge = ProfileJudge() if profile == "auto" else None
        self.profile = "free" if profile == "auto" else profile
        self._yaw_rad = 0.0
        self.pace = Pace()

    @property
    def is_vehicle(self) -> bool:
        """Whether it rolls on wheels, ahead."""
        return self.profile == "vehicle"

    @property
    def is_walker(self) -> bool:
        """Whether it is somebody on foot."""
        return self.profile == "walker"

    @property
    def unknown_accel_psd(self) -> float:
        """Its own acceleration, (m/s^2)^2/Hz, while nothing measures it."""
        return UNKNOWN_ACCEL_PSD[self.profile]

    def recall(self, profile: object) -> bool:
        """Take a vehicle that an earlier run found; return whether that is news."""
        if self._judge is None or profile != "vehicle":
            return False
        self._judge.profile = self.profile = "vehicle"
        return True

    def observe(self, eskf: Eskf, level_q: Quat, period_s: float) -> bool:
        """See how it moved since the last fix; return whether the profile changed.

        Parameters
        ----------
        eskf : Eskf
        level_q : Quat
            Attitude of the box when it was levelled.
        period_s : float
            Between fixes.
        """
        if self._judge is None:
            return False
        yaw_rad = yaw_between(eskf.nominal.q_nb, level_q)
        turn_rad = wrap_pi(yaw_rad - self._yaw_rad)
        self._yaw_rad = yaw_rad
        has_changed = self._judge.observe(
            period_s,
            math.hypot(*eskf.nominal.v_n[:2]),
            turn_rad,
            lean_right(eskf, level_q),
            is_stepping=self.pace.is_stepping,
        )
        self.profile = self._judge.profile
        return has_changed
