"""Trial of what an earlier run learnt, against a filter without it.

In another car, or turned anew, the box must not be led by remembered values. So as soon
as the vehicle goes, two filters run, and the fixes decide between them.
"""

from typing import Final

from imu_tracker.estimation.error_state.filter import Eskf
from imu_tracker.estimation.error_state.hypotheses.noise_bank import NoiseBank
from imu_tracker.estimation.error_state.hypotheses.reorient import (
    RESTED_SIGMA_RADPS,
    REVERSE_RAD,
    inflate_unrested_gyro_bias,
    is_odd_mounting,
    off_course,
    set_course_heading,
)
from imu_tracker.estimation.error_state.hypotheses.yaw_bank import CONTRADICTED_RAD
from imu_tracker.estimation.error_state.platform import Platform
from imu_tracker.estimation.error_state.states import GYRO_BIAS, YAW
from imu_tracker.geometry.rotation import IDENTITY
from imu_tracker.samples import Quat

HOLDS: Final = "what the last run learnt holds"
DOES_NOT_FIT: Final = "what the last run learnt does not fit; learnt anew"


class PriorTrial:
    """Whether what an earlier run learnt is in the filters, and on trial.

    Parameters
    ----------
    bank : NoiseBank
    platform : Platform

    Attributes
    ----------
    is_unproved : bool
        Whether it is in the filters, and no trial has ended yet.
    is_running : bool
        Whether the trial in the bank is this one.
    """

    def __init__(self, bank: NoiseBank, platform: Platform) -> None:
        self._bank, self._platform = bank, platform
        self.is_unproved = self.is_running = self._is_fresh = False
        self._with_prior: Eskf | None = None

    def note(self, *, is_fresh: bool) -> None:
        """Note that the filters began with it.

        `is_fresh` says that there was no time to take the box elsewhere.
        """
        self.is_unproved, self._is_fresh = True, is_fresh

    def drop(self) -> None:
        """Use it no more, and end its trial."""
        self.is_unproved = self.is_running = False

    def begin(self, course_rad: float, sigma_rad: float, level_q: Quat | None) -> None:
        """Let a filter without it compete, on a vehicle's course.

        Parked, nothing tells the two apart. If the box is in another car, the filter
        without soon predicts the fixes better. The one with it leads meanwhile. But if
        the box never rested and may be another one, it follows: the gyro bias of
        another chip would lead it astray within seconds.

        Parameters
        ----------
        course_rad, sigma_rad : float
            As `reorient.course_heading` returns them.
        level_q : Quat or None
            Attitude of the box as it was levelled.
        """
        main = self._bank.main
        without = main.clone(main.noise)
        self.forget(without, level_q)
        if self._platform.is_vehicle:
            off_rad = abs(off_course(main, course_rad))
            if CONTRADICTED_RAD < off_rad < REVERSE_RAD:
                # Neither ahead nor in reverse: it was not left with this heading.
                for eskf in self._bank.filters:
                    set_course_heading(eskf, course_rad, sigma_rad)
            set_course_heading(without, course_rad, sigma_rad)
        self.is_running, self._with_prior = True, main
        if self._is_fresh or main.sigma(GYRO_BIAS.start) < RESTED_SIGMA_RADPS:
            self._bank.challenge_heading(without)
        else:
            self._bank.main = without
            self._bank.challenge_heading(main)

    def conclude(self) -> str:
        """End the trial; return the verdict in words."""
        verdict = HOLDS if self._bank.main is self._with_prior else DOES_NOT_FIT
        self._with_prior = None
        self.drop()
        return verdict

    def forget(self, eskf: Eskf, level_q: Quat | None) -> None:
        """Doubt orientation, biases and mounting of a filter as a first start does."""
        is_vehicle = self._platform.is_vehicle
        eskf.inflate_orientation(eskf.sigma(YAW.start), is_vehicle=is_vehicle)
        inflate_unrested_gyro_bias(eskf)
        if is_vehicle and level_q is not None:
            eskf.q_vb = level_q if is_odd_mounting(level_q) else IDENTITY
