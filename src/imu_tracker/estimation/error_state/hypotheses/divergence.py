"""Whether the inertial filter is any better than none: else its orientation is lost.

A filter whose attitude is wrong by tens of degrees rotates gravity into its velocity,
and no single innovation can mend that. It is found out by comparison with a filter
that feels nothing: one that lets the receiver's velocity go on as it was. Who foretells
the velocities worse than that, fix after fix, has lost its way.

The fact that a newcomer gets wrong: large innovations alone say nothing. A poor
receiver makes them too; but then the filter that feels nothing has them as well.
"""

import math
from typing import Final

from imu_tracker.estimation.error_state.states import Array

MOST_NATS: Final = 2.0
"""No single fix decides."""

LOST_NATS: Final = -10.0
"""Five fixes in a row, each seven times likelier without an IMU than with it."""

LATE_S: Final = 1.0
"""Receivers that smooth their velocities tell them late by a varying second: that is no
fault of the filter's."""

EVERY_S: Final = 0.8
"""Over less, nothing beats a receiver at foretelling itself."""

BEGIN_ANEW_S: Final = 5.0
"""After a longer silence there is nothing to go on from."""


class OrientationWatch:
    """Adds up how much better the filter foretells velocities than none.

    Notes
    -----
    Without an IMU v' = v, var' = var + q dt, one filter for north and east. The sum is
    cut off at zero: past merits excuse nothing (CUSUM, Page 1954).
    """

    def __init__(self) -> None:
        self._v_ne = (0.0, 0.0)
        self._var = math.inf
        self._t_ns = 0
        self.lead_nats = 0.0

    def forget(self) -> None:
        """Begin anew, with another orientation."""
        self.lead_nats = 0.0

    def observe(
        self,
        t_ns: int,
        vel_ne_mps: tuple[float, float],
        velocity_var: float,
        accel_mps2: float,
        accel_psd: float,
        innovation: Array,
        S: Array,
    ) -> bool:
        """Take a velocity of the receiver; return whether the orientation is lost.

        Parameters
        ----------
        t_ns : int
        vel_ne_mps : (north, east)
        velocity_var : float, (m/s)^2
            Of the receiver, per axis.
        accel_mps2 : float
            Change of those velocities.
        accel_psd : float, (m/s^2)^2/Hz
            What a body of this kind does of its own will.
        innovation, S : ndarray, shape (2,) and (2, 2)
            Of the same velocity under the inertial filter.
        """
        dt_s = (t_ns - self._t_ns) * 1e-9
        if 0.0 < dt_s < EVERY_S:
            return False
        self._t_ns = t_ns
        (north, east), (zn, ze) = self._v_ne, vel_ne_mps
        late_var = (LATE_S * accel_mps2) ** 2
        if not 0.0 < dt_s < BEGIN_ANEW_S or math.isinf(self._var):
            self._v_ne, self._var = vel_ne_mps, velocity_var
            self.lead_nats = 0.0
            return False
        var = self._var + accel_psd * dt_s
        s = var + velocity_var
        gain = var / s
        square = (zn - north) ** 2 + (ze - east) ** 2
        without = -0.5 * square / s - math.log(s)
        self._v_ne = (north + gain * (zn - north), east + gain * (ze - east))
        self._var = var * (1.0 - gain)

        (a, b), (_, c) = S.tolist()
        a, c = a + late_var, c + late_var
        x, y = innovation.tolist()
        det = a * c - b * b
        with_imu = -0.5 * (c * x * x - 2.0 * b * x * y + a * y * y) / det
        with_imu -= 0.5 * math.log(det)
        better = min(max(with_imu - without, -MOST_NATS), MOST_NATS)
        self.lead_nats = min(self.lead_nats + better, 0.0)
        return self.lead_nats < LOST_NATS
