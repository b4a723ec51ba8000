"""When which constraint is applied.

Those of a vehicle are in `vehicle`, those of a walker in `pedestrian`. A free body has
two: zero velocity at standstill, and gravity as its mean specific force.
"""

import math
from typing import Final

import numpy as np

from imu_tracker.estimation.error_state.constraints import vehicle
from imu_tracker.estimation.error_state.constraints.pedestrian import Gait
from imu_tracker.estimation.error_state.constraints.road_prior import RoadPrior
from imu_tracker.estimation.error_state.filter import Eskf, Measurement
from imu_tracker.estimation.error_state.hypotheses.alignment import Alignment
from imu_tracker.estimation.error_state.hypotheses.noise_bank import NoiseBank
from imu_tracker.estimation.error_state.platform import Platform
from imu_tracker.estimation.error_state.states import (
    ACCEL_BIAS,
    N_ERRORS,
    TILT_E,
    TILT_N,
)
from imu_tracker.estimation.tuning import (
    LEVELLING_SIGMA_MPS2,
    STEADY_CORRELATION_S,
    STEADY_MPS2,
    STEADY_SIGMA_MPS2,
)
from imu_tracker.geometry.rotation import matrix
from imu_tracker.motion.standstill import Rest

OUTAGE_AFTER_S: Final = 2.0
WEAK_PERIOD_S: Final = 1.0
"""What lasts for seconds is applied once a second."""


class MotionConstraints:
    """Applies the constraints of the profile, and learns their parameters from fixes.

    Parameters
    ----------
    bank : NoiseBank
    alignment : Alignment
    platform : Platform

    Attributes
    ----------
    own_accel_mps2 : float or None
        Change of the receiver's velocity at the last fix; None: it sends none.
    """

    def __init__(
        self, bank: NoiseBank, alignment: Alignment, platform: Platform
    ) -> None:
        self._bank, self._alignment, self._platform = bank, alignment, platform
        self._weak_s = 0.0
        self._road_prior, self._gait = RoadPrior(), Gait()
        self.own_accel_mps2: float | None = None

    def reset_gait(self) -> None:
        """Discard the learnt gait, because the box may have been turned."""
        self._gait = Gait()

    def apply(self, rest: Rest | None, period_s: float, outage_s: float) -> None:
        """Let a stretch pass.

        Parameters
        ----------
        rest : Rest or None
            Whether the body stands still at its end.
        period_s : float
        outage_s : float
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
        if alignment.is_aligned and self._platform.is_vehicle:
            for eskf in self._bank.filters:
                eskf.update(vehicle.non_holonomic(eskf, period_s))
        if is_weak_due:
            if not alignment.is_aligned:
                for eskf in self._bank.filters:
                    self._level(eskf, outage_s)
            if outage_s > OUTAGE_AFTER_S:
                self._apply_priors(outage_s)
            else:
                self._learn()

    def _rest(self, rest: Rest, period_s: float) -> None:
        for eskf in self._bank.filters:
            eskf.update(vehicle.zero_velocity(eskf, rest, period_s))

    def _learn(self) -> None:
        """Learn slope, acceleration and gait while the velocity is known from fixes."""
        main, platform, alignment = self._bank.main, self._platform, self._alignment
        if alignment.level_q is not None:
            is_aligned = alignment.is_aligned
            platform.add_motion(main, alignment.level_q, is_aligned=is_aligned)
        if platform.is_vehicle and alignment.is_aligned:
            self._road_prior.learn(main, WEAK_PERIOD_S)
        elif platform.is_walker:
            v_ne, is_stepping = main.nominal.v_n[:2], platform.step_detector.is_stepping
            turned_rad = platform.turned_rad
            self._gait.learn(v_ne, turned_rad, WEAK_PERIOD_S, is_stepping=is_stepping)

    def _apply_priors(self, outage_s: float) -> None:
        """Apply the priors that hold in an outage: the body moves on as before."""
        platform = self._platform
        for eskf in self._bank.filters:
            if platform.is_vehicle and self._alignment.is_aligned:
                slope, haste = (
                    self._road_prior.slope_sigma_rad,
                    self._road_prior.forward_sigma_mps2,
                )
                eskf.update(vehicle.road_slope_prior(eskf, slope, WEAK_PERIOD_S))
                eskf.update(
                    vehicle.longitudinal_accel_prior(eskf, haste, WEAK_PERIOD_S)
                )
            elif platform.is_walker:
                onward = None
                if platform.step_detector.is_stepping:
                    turned_rad = platform.turned_rad
                    onward = self._gait.continued_velocity(
                        eskf, turned_rad, outage_s, WEAK_PERIOD_S
                    )
                eskf.update(onward or self._gait.speed_bound(eskf, WEAK_PERIOD_S))

    def _level(self, eskf: Eskf, outage_s: float) -> None:
        """Correct the tilt by gravity, as far as the body is steady."""
        own_mps2 = self.own_accel_mps2
        if own_mps2 is None or outage_s > OUTAGE_AFTER_S:
            eskf.update(gravity_levelling(eskf, LEVELLING_SIGMA_MPS2**2))
        elif own_mps2 < STEADY_MPS2 and _is_force_gravity(eskf):
            variance = STEADY_SIGMA_MPS2**2 + own_mps2**2
            measured = gravity_levelling(eskf, STEADY_CORRELATION_S * variance)
            eskf.update(vehicle.soft_gated(eskf, measured))


def _is_force_gravity(eskf: Eskf) -> bool:
    """Whether the force of the last second is as large as gravity: not so in a turn."""
    an, ae, ad = eskf.mean_a_n
    return (
        abs(math.hypot(an, ae, ad - eskf.gravity_mps2) - eskf.gravity_mps2)
        < STEADY_MPS2
    )


def gravity_levelling(eskf: Eskf, variance: float) -> Measurement:
    """Pseudo-measurement: the mean specific force is gravity.

    Notes
    -----
    0 = a_n, level axes: z = -f_n, H = [f_n x] theta's level part - C_nb db_a.
    """
    an, ae, ad = eskf.mean_a_n
    fn, fe, fd = an, ae, ad - eskf.gravity_mps2
    H = np.zeros((2, N_ERRORS))
    H[0, TILT_E], H[1, TILT_N] = fd, -fd
    H[:, ACCEL_BIAS] = -matrix(eskf.nominal.q_nb)[:2]
    return Measurement(np.array([-fn, -fe]), H, np.eye(2) * variance)
