"""What carries the box: found from how it moves, when nobody has said.

Until the evidence is in, the body is free: no constraint is ever applied to what might
be a drone. A gait betrays a walker. A vehicle is what goes faster than anybody runs and
takes its turns upright: an aeroplane or a motorcycle leans into them.
"""

import math
from typing import Final

GAIT_ACCEL_STD_MPS2: Final = 1.5
"""Scatter of the force while walking: 2 to 5 m/s^2; a car on cobbles shakes so too,
but not at walking pace."""

WALKING_MPS: Final = (0.6, 3.0)

DRIVING_MPS: Final = 6.0
FLYING_MPS: Final = 75.0
"""Faster than a sprinter, slower than any car on any road."""

UPRIGHT_RAD: Final = math.radians(12.0)
"""Slope, camber and roll of a road vehicle together stay below this nearly always."""

TURNED_RAD: Final = math.radians(180.0)
"""Turns in sum that were taken upright: a mile of any town."""

LEANING_SHARE: Final = 0.1
"""Of the fixes in turns, that may look leaning nevertheless."""

WALKED_FIXES_S: Final = 20.0


class ProfileJudge:
    """Collects evidence; says the profile once it is clear, and keeps to it."""

    def __init__(self) -> None:
        self.profile = "free"
        self._walked_s = self._turned_rad = self._leaning_rad = 0.0

    def observe(
        self,
        period_s: float,
        speed_mps: float,
        turn_rad: float,
        tilt_rad: float,
        accel_std_mps2: float,
    ) -> bool:
        """Take one fix; return whether the profile has changed.

        Parameters
        ----------
        period_s : float
        speed_mps : float
        turn_rad : float
            Turned about down since the last fix.
        tilt_rad : float
            Between the box now and as it lay when it was levelled.
        accel_std_mps2 : float
        """
        before = self.profile
        if speed_mps > FLYING_MPS:
            self._turned_rad = self._leaning_rad = 0.0
            self.profile = "free"
        elif speed_mps > DRIVING_MPS:
            turn = abs(turn_rad)
            self._turned_rad += turn
            self._leaning_rad += turn if tilt_rad > UPRIGHT_RAD else 0.0
            self._walked_s = 0.0
            is_upright = self._leaning_rad < LEANING_SHARE * self._turned_rad
            if self.profile != "free" and self.profile != "vehicle":
                self.profile = "free"  # whoever walked has got in
            if self._turned_rad > TURNED_RAD:
                self.profile = "vehicle" if is_upright else "free"
        elif (
            WALKING_MPS[0] < speed_mps < WALKING_MPS[1]
            and accel_std_mps2 > GAIT_ACCEL_STD_MPS2
        ):
            self._walked_s += period_s
            if self._walked_s > WALKED_FIXES_S:
                self._turned_rad = self._leaning_rad = 0.0
                self.profile = "walker"
        return self.profile != before
