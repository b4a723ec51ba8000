"""Which way is down, which way is north, and how the box sits: the coarse stage.

Course is not heading. The course is taken for the heading of a vehicle once there
is one, and checked against the accelerations: beside the filters runs one that never
used the course (`course_free`); its attitude levels the accelerations for the yaw bank.
Where the bank contradicts the heading, a filter with the bank's is tried by likelihood.
"""

import math
from collections.abc import Callable
from typing import Final

import numpy as np

from imu_tracker.estimation.error_state.filter import Eskf
from imu_tracker.estimation.error_state.hypotheses.noise_bank import NoiseBank
from imu_tracker.estimation.error_state.hypotheses.reorient import (
    REVERSE_MPS,
    REVERSE_RAD,
    inflate_gyro_bias,
    off_course,
    rotate_yaw,
    set_bank_heading,
    set_course_heading,
    yaw_between,
)
from imu_tracker.estimation.error_state.hypotheses.yaw_bank import (
    CONVERGED_SIGMA_RAD,
    YawBank,
)
from imu_tracker.estimation.error_state.platform import Platform
from imu_tracker.estimation.error_state.receiver_model import ReceiverModel
from imu_tracker.estimation.error_state.states import (
    GYRO_BIAS,
    TILT,
    VELOCITY_DELAY,
    YAW,
    Array,
)
from imu_tracker.geometry.rotation import (
    IDENTITY,
    level_from_gravity,
    to_euler,
    wrap_pi,
)
from imu_tracker.motion.preintegration import ImuStep
from imu_tracker.motion.standstill import Rest
from imu_tracker.samples import GpsFix, Quat

LEVELLING_S: Final = 1.0
ODD_MOUNTING_RAD: Final = math.radians(20.0)
"""No road and no hand's error tips a box so far."""

COURSE_SPEED_MPS: Final = 2.0
COURSE_TURN_RADPS: Final = 0.3
COURSE_SIGMA_RAD: Final = math.radians(5.0)
COURSE_SIGMA_MPS: Final = 0.2
"""Between course and direction of travel of a vehicle that does not turn tightly; and
across it, at low speed."""

BANK_PERIOD_S: Final = 0.5
BANK_VELOCITY_VAR: Final = 0.3**2
"""A moving box swings against the antenna."""

CONTRADICTED_RAD: Final = math.radians(35.0)
CONTRADICTED_FIXES: Final = 5
"""How far, and how often, the bank must differ before it is used: delay and tilt
make it err by 10 degrees."""

GUESS_SIGMA_RAD: Final = math.radians(30.0)
"""A bank less sure than this says nothing."""

PATIENCE_S: Final = 5.0
"""For so long of a usable course the bank is heard first: pulling off shows it in some
seconds whether the box sits turned; on a steady road it never can."""

DOUBTED_PATIENCE_S: Final = 60.0
"""And for so long once a course has proved to be no heading."""

LOST_YAW_SIGMA_RAD: Final = 0.6
LOST_TILT_SIGMA_RAD: Final = 1.0
"""Known worse than this, an angle is sooner found anew than mended: a filter that is
linear about it goes the wrong way."""

RELEVELLED_SIGMA_RAD: Final = 0.5
"""What a level may be wrong by that was found amid a turn: an aeroplane banks so."""

_VERDICTS: Final = {
    True: "what the last run learnt holds",
    False: "what the last run learnt does not fit; learnt anew",
}

RESTED_SIGMA_RADPS: Final = math.radians(0.05)
"""Better known than this is a gyro's bias only after a rest (`vehicle.rest`)."""


class Alignment:
    """Levels the filters, gives them a heading, and doubts it.

    Parameters
    ----------
    bank : NoiseBank
        The filters.
    platform : Platform
    notify : callable
        Told in words what people want to read of.

    Attributes
    ----------
    is_level, is_aligned : bool
        Whether down is known, and north.
    level_q : Quat or None
        Attitude of the box as it was levelled.
    course_free : Eskf or None
        The filter that never took the course for the heading, until the yaw bank has
        confirmed the others.
    is_prior_unproved : bool
        Whether what an earlier run learnt is in the filters, and was not yet held
        against a filter without it.
    """

    def __init__(
        self, bank: NoiseBank, platform: Platform, notify: Callable[[str], None]
    ) -> None:
        self._bank, self._platform, self._notify = bank, platform, notify
        self._yaw_bank = YawBank()
        self._yaw_bank_due_s = 0.0
        self._n_contradicted = 0
        self._waited_s, self._patience_s = 0.0, PATIENCE_S
        self._level_s, self._level_dv = 0.0, (0.0, 0.0, 0.0)
        self.level_q: Quat | None = None
        self.is_aligned = False
        self.course_free: Eskf | None = None
        self.is_prior_unproved = self._is_prior_tried = False
        self._is_prior_fresh = self._is_half_turn_tried = False
        self._with_prior: Eskf | None = None

    @property
    def is_level(self) -> bool:
        """Whether down is known."""
        return self.level_q is not None

    @property
    def filters(self) -> tuple[Eskf, ...]:
        """All there are: what happens to the body, happens to each."""
        course_free = self.course_free
        return self._bank.filters + (() if course_free is None else (course_free,))

    @property
    def _reference(self) -> Eskf:
        """Whose attitude the bank's accelerations are levelled by.

        Until the bank has spoken once, a filter that never took the course for the
        heading: a wrong heading spoils the tilt, and with it the evidence.
        """
        return self._bank.main if self.course_free is None else self.course_free

    def can_use_force(self, rest: Rest | None) -> bool:
        """Whether forces can be rotated; at rest any yaw will do."""
        return self.is_level and (self.is_aligned or rest is not None)

    def start(self) -> None:
        """Gather the evidence anew; the attitude stays."""
        self._yaw_bank.reset()
        self.course_free = None
        self._waited_s, self._n_contradicted = 0.0, 0

    def distrust_course(self) -> None:
        """Wait for accelerations to show the heading: the course was none."""
        self._patience_s = DOUBTED_PATIENCE_S

    # --------------------------------------------------------------- with each step

    def add_levelling_step(self, step: ImuStep) -> None:
        """Take the mean force of a second for gravity.

        A box that lies far from flat was mounted so: the vehicle is taken for level.
        """
        if step.is_gap:
            self._level_s, self._level_dv = 0.0, (0.0, 0.0, 0.0)
            return
        (x, y, z), (dx, dy, dz) = self._level_dv, step.dv_b_mps
        self._level_dv = (x + dx, y + dy, z + dz)
        self._level_s += step.dt_s
        if self._level_s >= LEVELLING_S:
            q_nb = level_from_gravity(self._level_dv)
            roll, pitch, _ = to_euler(q_nb)
            for eskf in self._bank.filters:
                eskf.nominal = eskf.nominal._replace(q_nb=q_nb)
                if max(eskf.P.diagonal()[TILT]) > RELEVELLED_SIGMA_RAD**2:
                    eskf.set_variances(TILT, [RELEVELLED_SIGMA_RAD**2] * 2)
                if max(abs(roll), abs(pitch)) > ODD_MOUNTING_RAD:
                    eskf.q_vb = q_nb
            self.level_q = q_nb

    def add_stretch(self) -> None:
        """Give the yaw bank the level acceleration since the last prediction."""
        (dvn, dve, _), dt = self._reference.stretch
        self._yaw_bank.add_stretch(dt, (dvn, dve))

    def shift_origin(self, north_m: float, east_m: float) -> None:
        """Hear that the origin of positions went so far."""
        self._yaw_bank.shift_origin(north_m, east_m)

    def check_orientation(self) -> None:
        """Give up a heading, or a level, that is hardly known any more."""
        main = self._bank.main
        if self.is_level and max(main.P.diagonal()[TILT]) > LOST_TILT_SIGMA_RAD**2:
            self.reset_orientation()
        elif self.is_aligned and main.sigma(YAW.start) > LOST_YAW_SIGMA_RAD:
            self.is_aligned = False
            self.start()  # the bank, too, turned with this attitude

    def reset_orientation(
        self, notice: str = "the orientation was lost; learnt anew"
    ) -> None:
        """Level anew and find north anew: the attitude, or the mounting, is wrong."""
        is_vehicle = self._platform.is_vehicle
        for eskf in self._bank.filters:
            eskf.inflate_orientation(math.pi, is_vehicle=is_vehicle)
            eskf.set_variances(TILT, [RELEVELLED_SIGMA_RAD**2] * 2)
            if eskf.sigma(GYRO_BIAS.start) > RESTED_SIGMA_RADPS:
                inflate_gyro_bias(eskf)
            eskf.q_vb = IDENTITY
        self._bank.challenge_noise()
        self.level_q, self._level_s, self._level_dv = None, 0.0, (0.0, 0.0, 0.0)
        self.is_aligned = self.is_prior_unproved = self._is_prior_tried = False
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
        yaw_rad, sigma_rad = self._yaw_bank.yaw()
        if self.course_free is not None or not _contradicts(yaw_rad, sigma_rad):
            return False
        self._bank.challenge_noise()
        self._is_prior_tried = self._is_half_turn_tried = False
        self._set_bank_yaw(yaw_rad, GUESS_SIGMA_RAD)
        self._yaw_bank.reset()
        self._notify("the heading was wrong; learnt anew")
        return True

    def add_log_likelihoods(
        self, main: float, challenger: float, period_s: float
    ) -> None:
        """Let the likelihood of the fix decide between the filters."""
        heading = self._bank.add_log_likelihoods(main, challenger, period_s)
        if heading is not None:
            self._settle(is_other=heading)

    def _settle(self, *, is_other: bool) -> None:
        """Draw the conclusions of a trial of headings."""
        if self._is_prior_tried:
            self._is_prior_tried = self.is_prior_unproved = False
            if is_other:
                self._notify(_VERDICTS[self._bank.main is self._with_prior])
            self._with_prior = None
        elif is_other:
            self._notify("the heading was wrong; learnt anew")
        elif self._is_half_turn_tried:
            self._notify("the box sits with its x axis backwards")
        self._is_half_turn_tried = False
        self.course_free = None
        self._yaw_bank.reset()

    def update(self, fix: GpsFix, position_ne: Array, receiver: ReceiverModel) -> None:
        """Find the heading, or doubt it, by a fix that was accepted."""
        self._check_reverse()
        self._update_yaw_bank(fix, position_ne, receiver)
        if not self.is_aligned:
            self._align(fix, receiver.period_s)
        elif self.is_prior_unproved and not self._bank.is_heading_trial:
            self._try_prior(fix)

    def _check_reverse(self) -> None:
        """So fast backwards: the box, or the heading, is half a turn off."""
        if not self._platform.is_vehicle or not self.is_aligned:
            return
        main = self._bank.main
        if float(main.C_vn()[0] @ main.nominal.v_n) < -REVERSE_MPS:
            candidate = main.clone(main.noise)
            rotate_yaw(candidate, math.pi)
            candidate.inflate_orientation(GUESS_SIGMA_RAD, is_vehicle=True)
            for eskf in self._bank.filters:
                eskf.turn_mounting_half()
            self._is_prior_tried, self._is_half_turn_tried = False, True
            self._bank.challenge_heading(candidate)

    def _update_yaw_bank(
        self, fix: GpsFix, position_ne: Array, receiver: ReceiverModel
    ) -> None:
        """Compare the heading with what the accelerations say of it."""
        yaw_bank, eskf, levelled = self._yaw_bank, self._bank.main, self._reference
        self._yaw_bank_due_s -= receiver.period_s
        if self._yaw_bank_due_s > 0.0:
            return
        self._yaw_bank_due_s = BANK_PERIOD_S
        yaw_bank.update(
            position_ne,
            max(0.35 * fix.sigma_h_m, 0.3) ** 2,
            None if fix.vel_ne_mps is None else np.array(fix.vel_ne_mps),
            receiver.velocity_var + BANK_VELOCITY_VAR,
            max(0.1, eskf.sigma(VELOCITY_DELAY)) ** 2,
            levelled.level_accel_var,
            levelled.down_bias,
        )
        if self.is_aligned and (
            self._is_prior_tried or not self._bank.is_heading_trial
        ):
            self._compare_heading(*yaw_bank.yaw())

    def _compare_heading(self, yaw_rad: float, sigma_rad: float) -> None:
        """Try the bank's heading, once it has contradicted for long enough."""
        eskf, levelled = self._bank.main, self._reference
        turned_rad = yaw_between(eskf.nominal.q_nb, levelled.nominal.q_nb)
        if not _contradicts(wrap_pi(yaw_rad - turned_rad), sigma_rad):
            self._n_contradicted = 0
            if sigma_rad < CONVERGED_SIGMA_RAD and self.course_free is not None:
                self.course_free = None
                self._yaw_bank.reset()
            return
        self._n_contradicted += 1
        if self._n_contradicted >= CONTRADICTED_FIXES:
            self._n_contradicted = 0
            candidate = eskf.clone(eskf.noise)
            candidate.copy_state_from(levelled)
            set_bank_heading(
                candidate, yaw_rad, sigma_rad, is_vehicle=self._platform.is_vehicle
            )
            self._is_prior_tried = False
            self._bank.challenge_heading(candidate)

    def _set_bank_yaw(self, yaw_rad: float, sigma_rad: float) -> None:
        """Align by the bank's word."""
        for eskf in self._bank.filters:
            set_bank_heading(
                eskf, yaw_rad, sigma_rad, is_vehicle=self._platform.is_vehicle
            )
        self._yaw_bank.rotate_yaw(yaw_rad)
        self.is_aligned = True

    def _align(self, fix: GpsFix, period_s: float) -> None:
        """Take the course of a vehicle for its heading, or else the bank's word."""
        yaw_rad, sigma_rad = self._yaw_bank.yaw()
        course = self._course(fix) if self._platform.is_vehicle else None
        if course is None:
            if sigma_rad < CONVERGED_SIGMA_RAD:
                self._set_bank_yaw(yaw_rad, sigma_rad)
            return
        course_rad, course_sigma_rad = course
        main = self._bank.main
        if sigma_rad > GUESS_SIGMA_RAD and self._waited_s < self._patience_s:
            self._waited_s += period_s
            return
        wrong_rad = wrap_pi(off_course(main, course_rad) - yaw_rad)
        if _contradicts(wrong_rad, sigma_rad):
            self._set_bank_yaw(yaw_rad, sigma_rad)
            return
        self.course_free = main.clone(main.noise)
        for eskf in self._bank.filters:
            set_course_heading(eskf, course_rad, course_sigma_rad)
        self.is_aligned = True

    def _course(self, fix: GpsFix) -> tuple[float, float] | None:
        """Course as far as it tells the heading of a vehicle, with its sigma."""
        if fix.vel_ne_mps is None:
            return None
        vn, ve = fix.vel_ne_mps
        speed_mps = math.hypot(vn, ve)
        turn_radps = abs(self._bank.main.rate_n[2])
        if speed_mps < COURSE_SPEED_MPS or turn_radps > COURSE_TURN_RADPS:
            return None
        sigma_rad = math.hypot(COURSE_SIGMA_RAD, COURSE_SIGMA_MPS / speed_mps)
        return math.atan2(ve, vn), sigma_rad

    # ------------------------------------------------------- what an earlier run knew

    def set_parked_yaw(self, yaw_rad: float, sigma_rad: float) -> None:
        """Take the heading in which the vehicle was left."""
        for eskf in self._bank.filters:
            rotate_yaw(eskf, wrap_pi(yaw_rad - to_euler(eskf.nominal.q_nb)[2]))
            eskf.set_variances(YAW, [sigma_rad**2])
        self._yaw_bank.rotate_yaw(yaw_rad)
        self.is_aligned = True

    def note_prior(self, *, is_fresh: bool) -> None:
        """Hear that the filters began with what an earlier run learnt.

        `is_fresh` says that there was no time to take the box elsewhere.
        """
        self.is_prior_unproved, self._is_prior_fresh = True, is_fresh

    def _try_prior(self, fix: GpsFix) -> None:
        """Try a filter with what an earlier run learnt against one without it.

        As soon as the vehicle goes: parked, nothing tells the two apart. If the box is
        in another car, the one without will soon foretell the fixes better. The other
        one leads meanwhile; but if it never rested and may be anybody's, it follows:
        the rate of another chip would lead it astray within seconds.
        """
        course = self._course(fix)
        if course is None:
            return
        main = self._bank.main
        without = main.clone(main.noise)
        self._forget_prior(without)
        if self._platform.is_vehicle:
            off_rad = abs(off_course(main, course[0]))
            if CONTRADICTED_RAD < off_rad < REVERSE_RAD:
                # Neither ahead nor in reverse: it was not left with this heading.
                for eskf in self._bank.filters:
                    set_course_heading(eskf, *course)
            set_course_heading(without, *course)
        self._is_prior_tried, self._with_prior = True, main
        if self._is_prior_fresh or main.sigma(GYRO_BIAS.start) < RESTED_SIGMA_RADPS:
            self._bank.challenge_heading(without)
        else:
            self._bank.main = without
            self._bank.challenge_heading(main)

    def discard_prior(self) -> None:
        """Learn anew, after what was remembered has led astray."""
        if not self.is_prior_unproved:
            return
        self.is_prior_unproved = self._is_prior_tried = False
        self._forget_prior(self._bank.main)
        self._bank.challenge_noise()
        self.is_aligned = False
        self.start()
        self._notify("what the last run learnt does not fit; learnt anew")

    def _forget_prior(self, eskf: Eskf) -> None:
        """Doubt the orientation, the biases and the mounting as a first start does."""
        eskf.inflate_orientation(
            eskf.sigma(YAW.start), is_vehicle=self._platform.is_vehicle
        )
        if eskf.sigma(GYRO_BIAS.start) > RESTED_SIGMA_RADPS:
            inflate_gyro_bias(eskf)
        if self._platform.is_vehicle and self.level_q is not None:
            roll, pitch, _ = to_euler(self.level_q)
            is_odd = max(abs(roll), abs(pitch)) > ODD_MOUNTING_RAD
            eskf.q_vb = self.level_q if is_odd else IDENTITY


def _contradicts(wrong_rad: float, sigma_rad: float) -> bool:
    """Whether a heading differs from the bank's beyond its doubts and its errors."""
    return (
        sigma_rad < GUESS_SIGMA_RAD
        and abs(wrong_rad) > CONTRADICTED_RAD + 2.0 * sigma_rad
    )
