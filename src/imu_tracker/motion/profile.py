"""The profile of the platform, found from how it moves.

Until the evidence is in, the body is free: no constraint is ever applied to what might
be a drone. A gait betrays a walker. A vehicle is what goes faster than anybody walks
and takes its turns upright: aeroplanes, bicycles and motorcycles lean into them until
nothing is felt across. A boat rolls on its way. The angle itself
is no evidence, since it is small in a wide turn; its share of what would balance the
turn is.
"""

import math
from typing import Final

WALKING_MPS: Final = (0.6, 3.0)

DRIVING_MPS: Final = 3.5
RUNNING_MPS: Final = 6.0
FLYING_MPS: Final = 75.0
"""Faster than a walker; who shakes may still run. Faster than any car on any road."""

UPRIGHT_SHARE: Final = 0.4
LEANING_SHARE: Final = 0.6
"""Lean into the turn over what balances it: a car leans out by a twentieth, who must
balance leans by all of it. Slopes and camber add some tenths, both ways."""

TURNED: Final = 40.0
"""Sum of the squares of the acceleration across, m^2/s^3: two corners of a town. Slopes
of 3 deg, 0.5 m/s^2, then weigh little."""

TURNED_MOST: Final = 400.0
"""So much is remembered: somebody may take the box from the car to the bicycle."""

ROLLING_RAD: Final = math.radians(2.0)
ROLLING_S: Final = 20.0
STRAIGHT_MPS2: Final = 0.5
"""Change of the lean from second to second while going straight, rms: no road does
that for so long, and waves do it always."""

WALKED_S: Final = 20.0
"""From the door to the car takes less; in all, since he was last seen to drive."""

_GRAVITY_MPS2: Final = 9.81


class ProfileClassifier:
    """Collects evidence, and sets the profile once it is clear."""

    def __init__(self) -> None:
        self.profile = "free"
        self._walked_s = self._turned = self._leaned = 0.0
        self._rolling_var = 0.0
        self._lean_rad: float | None = None

    def add_motion(
        self,
        period_s: float,
        speed_mps: float,
        turn_rad: float,
        lean_rad: float | None,
        *,
        is_stepping: bool,
    ) -> None:
        """Take a stretch.

        Parameters
        ----------
        period_s : float
            A second or so.
        speed_mps : float
        turn_rad : float
            Turned to the right meanwhile.
        lean_rad : float or None
            To the right, against how it lay when it was levelled; None: not known, and
            the turn neither.
        is_stepping : bool
            Whether the force comes and goes as it does with steps.
        """
        if lean_rad is None or speed_mps < DRIVING_MPS:
            self._lean_rad = None
        if speed_mps > FLYING_MPS:
            self._turned = self._leaned = 0.0
            self.profile = "free"
        elif speed_mps > (RUNNING_MPS if is_stepping else DRIVING_MPS):
            self._walked_s = 0.0
            if self.profile == "walker":
                self.profile = "free"  # he has got in
            if lean_rad is not None:
                self._add_turn(period_s, speed_mps * turn_rad / period_s, lean_rad)
        elif is_stepping and WALKING_MPS[0] < speed_mps < WALKING_MPS[1]:
            self._walked_s += period_s
            if self._walked_s > WALKED_S:
                self._turned = self._leaned = 0.0
                self.profile = "walker"

    def _add_turn(self, period_s: float, across_mps2: float, lean_rad: float) -> None:
        """Compare the lean with what would balance the turn.

        Notes
        -----
        share = sum(a g tan(lean) dt) / sum(a^2 dt), a the acceleration across.
        """
        if self._lean_rad is not None and abs(across_mps2) < STRAIGHT_MPS2:
            square = (lean_rad - self._lean_rad) ** 2
            share = min(period_s / ROLLING_S, 1.0)
            self._rolling_var += share * (square - self._rolling_var)
        self._lean_rad = lean_rad
        balanced_mps2 = _GRAVITY_MPS2 * math.tan(min(max(lean_rad, -1.2), 1.2))
        self._turned += across_mps2**2 * period_s
        self._leaned += across_mps2 * balanced_mps2 * period_s
        if self._turned > TURNED_MOST:
            self._leaned *= TURNED_MOST / self._turned
            self._turned = TURNED_MOST
        if self._turned > TURNED:
            share = self._leaned / self._turned
            is_rolling = self._rolling_var > ROLLING_RAD**2
            if share > LEANING_SHARE or is_rolling:
                self.profile = "free"
            elif share < UPRIGHT_SHARE:
                self.profile = "vehicle"
