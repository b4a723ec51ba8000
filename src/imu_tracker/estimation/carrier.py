"""The body that carries the box: what it may do, as far as is known by now."""

import math
from typing import Final

from imu_tracker.estimation.eskf import Eskf
from imu_tracker.estimation.orientation import lean_right
from imu_tracker.estimation.pace import Pace
from imu_tracker.estimation.profile import ProfileJudge
from imu_tracker.samples import Quat

UNKNOWN_ACCEL_PSD: Final = {"vehicle": 2.5**2, "walker": 0.5**2, "free": 2.5**2}
"""While the yaw or the IMU is unknown: a body's own acceleration, as (m/s^2)^2/Hz. A
vehicle's is 1 m/s^2 rms, and corners and stops last some six seconds; a walker turns
round within one."""

LONGEST_S: Final = 2.0
"""Into a turn and out of it takes longer."""


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
        self._seen_ns, self._turned_rad = 0, 0.0
        self._has_changed = False
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

    def observe(self, eskf: Eskf, level_q: Quat) -> None:
        """See how it moved since the last call, a second ago.

        After a longer time, in the dark or at rest, nothing is said: the lean of an
        instant tells nothing of a turn that is over.

        Parameters
        ----------
        eskf : Eskf
        level_q : Quat
            Attitude of the box when it was levelled.
        """
        t_ns, turned_rad = eskf.nominal.t_ns, eskf.turned_rad
        period_s, turn_rad = (
            (t_ns - self._seen_ns) * 1e-9,
            turned_rad - self._turned_rad,
        )
        self._seen_ns, self._turned_rad = t_ns, turned_rad
        if self._judge is None or not 0.0 < period_s < LONGEST_S:
            return
        if self._judge.observe(
            period_s,
            math.hypot(*eskf.nominal.v_n[:2]),
            turn_rad,
            lean_right(eskf, level_q),
            is_stepping=self.pace.is_stepping,
        ):
            self._has_changed = True

    def take_change(self) -> bool:
        """Let what was found since the last call hold; return whether it is news."""
        has_changed, self._has_changed = self._has_changed, False
        if has_changed and self._judge is not None:
            self.profile = self._judge.profile
        return has_changed
