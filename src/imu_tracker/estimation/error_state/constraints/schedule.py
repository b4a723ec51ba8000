"""What is known of a body without being measured: when which constraint is applied.

Those of a vehicle are in `vehicle`, those of a walker in `pedestrian`; nothing is known
of a free body but that it rests at times, and that its mean force is gravity.
"""

import math
from typing import Final

import numpy as np

from imu_tracker.estimation.error_state.constraints import vehicle
from imu_tracker.estimation.error_state.constraints.pedestrian import Gait
from imu_tracker.estimation.error_state.constraints.road_prior import Road
from imu_tracker.estimation.error_state.filter import Eskf, Measurement
from imu_tracker.estimation.error_state.hypotheses.alignment import Alignment
from imu_tracker.estimation.error_state.hypotheses.noise_bank import NoiseBank
from imu_tracker.estimation.error_state.platform import Carrier
from imu_tracker.estimation.error_state.states import ACCEL_BIAS, N_ERRORS
from imu_tracker.geometry.rotation import matrix
from imu_tracker.motion.standstill import Rest

DARK_AFTER_S: Final = 2.0
WEAK_PERIOD_S: Final = 1.0
"""What lasts for seconds is applied once a second."""

LEVELLING_SIGMA_MPS2: Final = 3.0
"""Own acceleration of a body of which nothing is known, mean of a second."""

STEADY_MPS2: Final = 0.7
STEADY_SIGMA_MPS2: Final = 0.3
STEADY_LASTS_S: Final = 3.0
"""A body whose velocity changes by less is steady, so far as a second's fixes tell;
what is left of its own acceleration lasts. Who speeds up, or banks into a turn, does
not feel where down is."""


class Behaviour:
    """Applies what the body is known to do, and learns it while the receiver sees.

    Parameters
    ----------
    bank : NoiseBank
    alignment : Alignment
    carrier : Carrier

    Attributes
    ----------
    own_accel_mps2 : float or None
        Change of the receiver's velocity at the last fix; None: it tells none.
    """

    def __init__(self, bank: NoiseBank, alignment: Alignment, carrier: Carrier) -> None:
        self._bank, self._alignment, self._carrier = bank, alignment, carrier
        self._weak_s = 0.0
        self._road, self._gait = Road(), Gait()
        self.own_accel_mps2: float | None = None

    def forget_gait(self) -> None:
        """Discard the learnt gait, because the box may have been turned."""
        self._gait = Gait()

    def apply(self, rest: Rest | None, period_s: float, dark_s: float) -> None:
        """Let a stretch pass.

        Parameters
        ----------
        rest : Rest or None
            Whether the body stands still at its end.
        period_s : float
        dark_s : float
            Since the last fix that was used.
        """
        alignment = self._alignment
        if not alignment.is_level:
            return
        self._weak_s += period_s
        is_weak_due = self._weak_s >= WEAK_PERIOD_S
        if is_weak_due:
            self._weak_s = 0.0
        if rest is not None:
            self._rest(rest, period_s)
            return
        if alignment.is_aligned and self._carrier.is_vehicle:
            for eskf in self._bank.filters:
                eskf.apply(vehicle.no_side_slip(eskf, period_s))
        if is_weak_due:
            if not alignment.is_aligned:
                for eskf in self._bank.filters:
                    self._level(eskf, dark_s)
            if dark_s > DARK_AFTER_S:
                self._go_on(dark_s)
            else:
                self._learn()

    def _rest(self, rest: Rest, period_s: float) -> None:
        for eskf in self._bank.filters:
            eskf.apply(vehicle.rest(eskf, rest, period_s))

    def _learn(self) -> None:
        """See how the body goes while its velocity is known."""
        main, carrier, alignment = self._bank.main, self._carrier, self._alignment
        if alignment.level_q is not None:
            is_aligned = alignment.is_aligned
            carrier.observe(main, alignment.level_q, is_aligned=is_aligned)
        if carrier.is_vehicle and alignment.is_aligned:
            self._road.observe(main, WEAK_PERIOD_S)
        elif carrier.is_walker:
            v_ne, is_stepping = main.nominal.v_n[:2], carrier.pace.is_stepping
            turned_rad = carrier.turned_rad
            self._gait.observe(v_ne, turned_rad, WEAK_PERIOD_S, is_stepping=is_stepping)

    def _go_on(self, dark_s: float) -> None:
        """Take a body in the dark to go on as it did."""
        carrier = self._carrier
        for eskf in self._bank.filters:
            if carrier.is_vehicle and self._alignment.is_aligned:
                slope, haste = self._road.slope_sigma_rad, self._road.forward_sigma_mps2
                eskf.apply(vehicle.level_road(eskf, slope, WEAK_PERIOD_S))
                eskf.apply(vehicle.unhurried(eskf, haste, WEAK_PERIOD_S))
            elif carrier.is_walker:
                onward = None
                if carrier.pace.is_stepping:
                    turned_rad = carrier.turned_rad
                    onward = self._gait.goes_on(eskf, turned_rad, dark_s, WEAK_PERIOD_S)
                eskf.apply(onward or self._gait.bounded(eskf, WEAK_PERIOD_S))

    def _level(self, eskf: Eskf, dark_s: float) -> None:
        """Take the mean force for gravity, as far as the body is steady."""
        own_mps2 = self.own_accel_mps2
        if own_mps2 is None or dark_s > DARK_AFTER_S:
            eskf.apply(gravity_is_down(eskf, LEVELLING_SIGMA_MPS2**2))
        elif own_mps2 < STEADY_MPS2 and _feels_gravity_alone(eskf):
            variance = STEADY_SIGMA_MPS2**2 + own_mps2**2
            measured = gravity_is_down(eskf, STEADY_LASTS_S * variance)
            eskf.apply(vehicle.softened(eskf, measured))


def _feels_gravity_alone(eskf: Eskf) -> bool:
    """Whether the force of the last second is as large as gravity: not so in a turn."""
    an, ae, ad = eskf.mean_a_n
    return (
        abs(math.hypot(an, ae, ad - eskf.gravity_mps2) - eskf.gravity_mps2)
        < STEADY_MPS2
    )


def gravity_is_down(eskf: Eskf, variance: float) -> Measurement:
    """Of a body of which nothing is known, the mean force is gravity.

    Notes
    -----
    0 = a_n, level axes: z = -f_n, H = [f_n x] theta's level part - C_nb db_a.
    """
    an, ae, ad = eskf.mean_a_n
    fn, fe, fd = an, ae, ad - eskf.gravity_mps2
    H = np.zeros((2, N_ERRORS))
    H[0, 7], H[1, 6] = fd, -fd
    H[:, ACCEL_BIAS] = -matrix(eskf.nominal.q_nb)[:2]
    return Measurement(np.array([-fn, -fe]), H, np.eye(2) * variance)
