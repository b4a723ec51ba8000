"""Coarse alignment: find down, north, and the mounting of the box.

Course is not heading. A vehicle moves along its course, but its box may be mounted
turned, or the vehicle may reverse. So when the course is first known, eight filters
start, one for each 45 degrees of mounting yaw, weighted by the yaw bank, which compares
earlier accelerations with the receiver. Fixes then decide between them. Without wheels,
only the yaw bank gives a heading.
"""

import math
from collections.abc import Callable
from typing import Final

from imu_tracker.estimation.error_state.hypotheses.heading_evidence import (
    HeadingEvidence,
    turned_rivals,
)
from imu_tracker.estimation.error_state.hypotheses.noise_bank import NoiseBank
from imu_tracker.estimation.error_state.hypotheses.prior_trial import (
    DOES_NOT_FIT,
    PriorTrial,
)
from imu_tracker.estimation.error_state.hypotheses.reorient import (
    RELEVELLED_SIGMA_RAD,
    course_heading,
    inflate_unrested_gyro_bias,
    rotate_yaw,
    separate_delays,
    set_bank_heading,
    set_course_heading,
    set_level,
)
from imu_tracker.estimation.error_state.hypotheses.yaw_bank import (
    CONVERGED_SIGMA_RAD,
    GUESS_SIGMA_RAD,
)
from imu_tracker.estimation.error_state.platform import Platform
from imu_tracker.estimation.error_state.receiver_model import ReceiverModel
from imu_tracker.estimation.error_state.states import TILT, YAW, Array
from imu_tracker.estimation.tuning import LEVELLING_S, REVERSE_MPS, USABLE_YAW_SIGMA_RAD
from imu_tracker.geometry.rotation import (
    IDENTITY,
    level_from_gravity,
    to_euler,
    wrap_pi,
)
from imu_tracker.motion.preintegration import ImuStep
from imu_tracker.motion.standstill import Rest
from imu_tracker.samples import GpsFix, Quat

LOST_TILT_SIGMA_RAD: Final = 1.0
"""A tilt known worse than this is levelled again: the filter is linear about it. So is
a yaw beyond `USABLE_YAW_SIGMA_RAD`."""


class Alignment:
    """Levels the filters, gives them a heading, and doubts it.

    Parameters
    ----------
    bank : NoiseBank
        The filters.
    platform : Platform
    notify : callable
        Called with a sentence for the user.

    Attributes
    ----------
    is_level, is_aligned : bool
        Whether down is known, and north.
    level_q : Quat or None
        Attitude of the box as it was levelled.
    prior : PriorTrial
        Trial of what an earlier run learnt.
    """

    def __init__(
        self, bank: NoiseBank, platform: Platform, notify: Callable[[str], None]
    ) -> None:
        self._bank, self._platform, self._notify = bank, platform, notify
        self._evidence = HeadingEvidence()
        self._level_s, self._level_dv = 0.0, (0.0, 0.0, 0.0)
        self.level_q: Quat | None = None
        self.is_aligned = self._is_half_turn_tried = False
        self.prior = PriorTrial(bank, platform)

    @property
    def is_level(self) -> bool:
        """Whether down is known."""
        return self.level_q is not None

    def can_use_force(self, rest: Rest | None) -> bool:
        """Whether forces can be rotated; at rest any yaw will do."""
        return self.is_level and (self.is_aligned or rest is not None)

    def start(self) -> None:
        """Gather the evidence anew; the attitude stays."""
        self._evidence.restart()

    # --------------------------------------------------------------- with each step

    def add_levelling_step(self, step: ImuStep) -> None:
        """Take the mean force of a second for gravity."""
        if step.is_gap:
            self._level_s, self._level_dv = 0.0, (0.0, 0.0, 0.0)
            return
        (x, y, z), (dx, dy, dz) = self._level_dv, step.dv_b_mps
        self._level_dv = (x + dx, y + dy, z + dz)
        self._level_s += step.dt_s
        if self._level_s >= LEVELLING_S:
            q_nb = level_from_gravity(self._level_dv)
            for eskf in self._bank.filters:
                set_level(eskf, q_nb)
            self.level_q = q_nb

    def add_stretch(self) -> None:
        """Give the yaw bank the level acceleration since the last prediction."""
        (dvn, dve, _), dt = self._bank.main.stretch
        self._evidence.add_stretch(dt, (dvn, dve))

    def shift_origin(self, north_m: float, east_m: float) -> None:
        """Follow a move of the origin of positions."""
        self._evidence.shift_origin(north_m, east_m)

    def check_orientation(self) -> None:
        """Give up a heading, or a level, that is hardly known any more."""
        main = self._bank.main
        if self.is_level and max(main.P.diagonal()[TILT]) > LOST_TILT_SIGMA_RAD**2:
            self.reset_orientation()
        elif self.is_aligned and main.sigma(YAW.start) > USABLE_YAW_SIGMA_RAD:
            self.is_aligned = False
            self._bank.challenge_noise()
            self.start()  # the bank, too, turned with this attitude

    def reset_orientation(
        self, notice: str = "the orientation was lost; learnt anew"
    ) -> None:
        """Level anew and find north anew: the attitude, or the mounting, is wrong."""
        is_vehicle = self._platform.is_vehicle
        for eskf in self._bank.filters:
            eskf.inflate_orientation(math.pi, is_vehicle=is_vehicle)
            eskf.set_variances(TILT, [RELEVELLED_SIGMA_RAD**2] * 2)
            inflate_unrested_gyro_bias(eskf)
            eskf.q_vb = IDENTITY
        self._bank.challenge_noise()
        self.level_q, self._level_s, self._level_dv = None, 0.0, (0.0, 0.0, 0.0)
        self.is_aligned = False
        self.prior.drop()
        self.start()
        self._notify(notice)

    # ---------------------------------------------------------------- with each fix

    def adopt_other_heading(self) -> bool:
        """Save the IMU by another heading: one on trial that leads, or the yaw bank's.

        Returns
        -------
        bool
            Whether there was one.
        """
        if self._bank.adopt_heading():
            self._settle(is_other=True)
            return True
        heading = self._evidence.contradiction()
        if heading is None:
            return False
        self._bank.challenge_noise()
        self.prior.is_running = self._is_half_turn_tried = False
        self._set_bank_yaw(heading[0], GUESS_SIGMA_RAD)
        self._evidence.reset()
        self._notify("the heading was wrong; learnt anew")
        return True

    def add_log_likelihoods(self, likelihoods: list[float], period_s: float) -> None:
        """Let the likelihood of the fix decide between the filters."""
        has_headings = self._bank.has_headings
        heading = self._bank.add_log_likelihoods(likelihoods, period_s)
        if heading is None:
            return
        if not has_headings:
            self._settle(is_other=heading)
        elif heading:
            self._notify(f"the {self._bank.main_name}")

    def _settle(self, *, is_other: bool) -> None:
        """Draw the conclusions of a trial of headings."""
        if self.prior.is_running:
            verdict = self.prior.conclude()
            if is_other:
                self._notify(verdict)
        elif is_other:
            self._notify("the heading was wrong; learnt anew")
        elif self._is_half_turn_tried:
            self._notify("the box sits with its x axis backwards")
        self._is_half_turn_tried = False
        self._evidence.reset()

    def update(self, fix: GpsFix, position_ne: Array, receiver: ReceiverModel) -> None:
        """Find the heading, or doubt it, by a fix that was accepted."""
        self._check_reverse()
        self._check_heading(fix, position_ne, receiver)
        if not self.is_aligned:
            if not receiver.is_catching_up:
                self._align(fix)
        elif self.prior.is_unproved and not self._bank.is_heading_trial:
            course = course_heading(self._bank.main, fix)
            if course is not None:
                self.prior.begin(*course, self.level_q)

    def _check_reverse(self) -> None:
        """So fast backwards: the box, or the heading, is half a turn off."""
        if not self._platform.is_vehicle or not self.is_aligned:
            return
        main = self._bank.main
        if float(main.C_vn()[0] @ main.nominal.v_n) < -REVERSE_MPS:
            if self._bank.has_headings:
                main.turn_mounting_half()  # the other heading is alive already
                return
            candidate = main.clone(main.noise)
            rotate_yaw(candidate, math.pi)
            candidate.inflate_orientation(GUESS_SIGMA_RAD, is_vehicle=True)
            for eskf in self._bank.filters:
                eskf.turn_mounting_half()
            self.prior.is_running, self._is_half_turn_tried = False, True
            self._bank.challenge_heading(candidate)

    def _check_heading(
        self, fix: GpsFix, position_ne: Array, receiver: ReceiverModel
    ) -> None:
        """Try the yaw bank's heading once it has contradicted often enough."""
        evidence, eskf = self._evidence, self._bank.main
        if not evidence.add_fix(fix, position_ne, receiver, eskf):
            return
        if not self.is_aligned or (
            self._bank.is_heading_trial and not self.prior.is_running
        ):
            return
        heading = evidence.lasting_contradiction()
        if heading is not None:
            candidate = eskf.clone(eskf.noise)
            set_bank_heading(candidate, *heading, is_vehicle=self._platform.is_vehicle)
            self.prior.is_running = False
            self._bank.challenge_heading(candidate)

    def _set_bank_yaw(self, yaw_rad: float, sigma_rad: float) -> None:
        """Turn all filters to the heading that the yaw bank found."""
        for eskf in self._bank.filters:
            set_bank_heading(
                eskf, yaw_rad, sigma_rad, is_vehicle=self._platform.is_vehicle
            )
            if not self.is_aligned:
                separate_delays(eskf)
        self._evidence.rotate_yaw(yaw_rad)
        self.is_aligned = True

    def _align(self, fix: GpsFix) -> None:
        """Begin with a heading: along a vehicle's course, or by the yaw bank."""
        if not self._platform.is_vehicle or fix.vel_ne_mps is None:
            yaw_rad, sigma_rad = self._evidence.yaw()
            if sigma_rad < CONVERGED_SIGMA_RAD:
                self._set_bank_yaw(yaw_rad, sigma_rad)
            return
        course = course_heading(self._bank.main, fix)
        if course is None:
            return
        if self.prior.is_unproved:
            for eskf in self._bank.filters:
                set_course_heading(eskf, *course)
                separate_delays(eskf)
        else:
            main, log_density = self._bank.main, self._evidence.log_density
            self._bank.begin_headings(turned_rivals(main, *course, log_density))
            self._evidence.reset()
        self.is_aligned = True

    # ------------------------------------------------------- what an earlier run knew

    def set_parked_yaw(self, yaw_rad: float, sigma_rad: float) -> None:
        """Take the heading in which the vehicle was left."""
        for eskf in self._bank.filters:
            rotate_yaw(eskf, wrap_pi(yaw_rad - to_euler(eskf.nominal.q_nb)[2]))
            eskf.set_variances(YAW, [sigma_rad**2])
        self._evidence.rotate_yaw(yaw_rad)
        self.is_aligned = True

    def discard_prior(self) -> None:
        """Learn anew, after what was remembered has led astray."""
        if not self.prior.is_unproved:
            return
        self.prior.drop()
        self.prior.forget(self._bank.main, self.level_q)
        self._bank.challenge_noise()
        self.is_aligned = False
        self.start()
        self._notify(DOES_NOT_FIT)
