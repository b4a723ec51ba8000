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

import numpy as np

from imu_tracker.estimation.error_state.filter import Eskf
from imu_tracker.estimation.error_state.hypotheses.noise_bank import (
    Kind,
    NoiseBank,
    Rival,
)
from imu_tracker.estimation.error_state.hypotheses.reorient import (
    COURSE_SPEED_MPS,
    REVERSE_RAD,
    course_sigma_rad,
    inflate_gyro_bias,
    mount,
    off_course,
    rotate_yaw,
    separate_delays,
    set_bank_heading,
    set_course_heading,
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
from imu_tracker.estimation.tuning import (
    LEVELLING_S,
    ODD_MOUNTING_RAD,
    REVERSE_MPS,
    USABLE_YAW_SIGMA_RAD,
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

COURSE_TURN_RADPS: Final = 0.3
"""A vehicle that turns more tightly does not head along its course."""

BANK_PERIOD_S: Final = 0.5
BANK_VELOCITY_VAR: Final = 0.3**2
"""A moving box swings against the antenna."""

CONTRADICTED_RAD: Final = math.radians(35.0)
CONTRADICTED_FIXES: Final = 5
"""How far, and how often, the bank must differ before it is used: delay and tilt
make it err by 10 degrees."""

GUESS_SIGMA_RAD: Final = math.radians(30.0)
"""A bank less sure than this says nothing."""

TURNED_BY_RAD: Final = math.pi / 4.0
TURNED_SIGMA_RAD: Final = math.radians(15.0)
TURNED_NATS: Final = -2.0
"""Steps in which a box may lie turned in its vehicle, how far it is off those, and the
log odds of each against one that points ahead."""

LOST_TILT_SIGMA_RAD: Final = 1.0
"""A tilt known worse than this is levelled again: the filter is linear about it. So is
a yaw beyond `USABLE_YAW_SIGMA_RAD`."""

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
        self._level_s, self._level_dv = 0.0, (0.0, 0.0, 0.0)
        self.level_q: Quat | None = None
        self.is_aligned = False
        self.is_prior_unproved = self._is_prior_tried = False
        self._is_prior_fresh = self._is_half_turn_tried = False
        self._with_prior: Eskf | None = None

    @property
    def is_level(self) -> bool:
        """Whether down is known."""
        return self.level_q is not None

    def can_use_force(self, rest: Rest | None) -> bool:
        """Whether forces can be rotated; at rest any yaw will do."""
        return self.is_level and (self.is_aligned or rest is not None)

    def start(self) -> None:
        """Gather the evidence anew; the attitude stays."""
        self._yaw_bank.reset()
        self._n_contradicted = 0

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
        (dvn, dve, _), dt = self._bank.main.stretch
        self._yaw_bank.add_stretch(dt, (dvn, dve))

    def shift_origin(self, north_m: float, east_m: float) -> None:
        """Hear that the origin of positions went so far."""
        self._yaw_bank.shift_origin(north_m, east_m)

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
        if not _contradicts(yaw_rad, sigma_rad):
            return False
        self._bank.challenge_noise()
        self._is_prior_tried = self._is_half_turn_tried = False
        self._set_bank_yaw(yaw_rad, GUESS_SIGMA_RAD)
        self._yaw_bank.reset()
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
        self._yaw_bank.reset()

    def update(self, fix: GpsFix, position_ne: Array, receiver: ReceiverModel) -> None:
        """Find the heading, or doubt it, by a fix that was accepted."""
        self._check_reverse()
        self._update_yaw_bank(fix, position_ne, receiver)
        if not self.is_aligned:
            if not receiver.is_catching_up:
                self._align(fix)
        elif self.is_prior_unproved and not self._bank.is_heading_trial:
            self._try_prior(fix)

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
            self._is_prior_tried, self._is_half_turn_tried = False, True
            self._bank.challenge_heading(candidate)

    def _update_yaw_bank(
        self, fix: GpsFix, position_ne: Array, receiver: ReceiverModel
    ) -> None:
        """Compare the heading with what the accelerations say of it."""
        yaw_bank, eskf = self._yaw_bank, self._bank.main
        self._yaw_bank_due_s -= receiver.period_s
        if self._yaw_bank_due_s > 0.0:
            return
        self._yaw_bank_due_s = BANK_PERIOD_S
        if receiver.is_catching_up:
            yaw_bank.reset()
            return
        yaw_bank.update(
            position_ne,
            max(0.35 * fix.sigma_h_m, 0.3) ** 2,
            None if fix.vel_ne_mps is None else np.array(fix.vel_ne_mps),
            receiver.velocity_var + BANK_VELOCITY_VAR,
            max(0.1, eskf.sigma(VELOCITY_DELAY)) ** 2,
            eskf.level_accel_var,
            eskf.down_bias,
        )
        if self.is_aligned and (
            self._is_prior_tried or not self._bank.is_heading_trial
        ):
            self._compare_heading(*yaw_bank.yaw())

    def _compare_heading(self, yaw_rad: float, sigma_rad: float) -> None:
        """Try the bank's heading, once it has contradicted for long enough."""
        eskf = self._bank.main
        if not _contradicts(yaw_rad, sigma_rad):
            self._n_contradicted = 0
            return
        self._n_contradicted += 1
        if self._n_contradicted >= CONTRADICTED_FIXES:
            self._n_contradicted = 0
            candidate = eskf.clone(eskf.noise)
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
            if not self.is_aligned:
                separate_delays(eskf)
        self._yaw_bank.rotate_yaw(yaw_rad)
        self.is_aligned = True

    def _align(self, fix: GpsFix) -> None:
        """Begin with a heading: along a vehicle's course, or by the yaw bank."""
        if not self._platform.is_vehicle or fix.vel_ne_mps is None:
            yaw_rad, sigma_rad = self._yaw_bank.yaw()
            if sigma_rad < CONVERGED_SIGMA_RAD:
                self._set_bank_yaw(yaw_rad, sigma_rad)
            return
        course = self._course(fix)
        if course is None:
            return
        if self.is_prior_unproved:
            for eskf in self._bank.filters:
                set_course_heading(eskf, *course)
                separate_delays(eskf)
        else:
            self._begin_headings(*course)
        self.is_aligned = True

    def _begin_headings(self, course_rad: float, sigma_rad: float) -> None:
        """Let filters compete that differ by how the box is turned in the vehicle."""
        main, rivals = self._bank.main, []
        for i in range(round(2.0 * math.pi / TURNED_BY_RAD)):
            turned_rad = wrap_pi(i * TURNED_BY_RAD)
            eskf, nats = main.clone(main.noise), 0.0
            if i:
                nats = TURNED_NATS
                mount(eskf, turned_rad, TURNED_SIGMA_RAD)
            nats += self._yaw_bank.log_density(off_course(eskf, course_rad))
            set_course_heading(eskf, course_rad, sigma_rad)
            separate_delays(eskf)
            degrees = math.degrees(turned_rad)
            name = f"box sits turned by {degrees:.0f} deg" if i else ""
            rivals.append(Rival(eskf, Kind.HEADING, name, nats))
        self._bank.begin_headings(rivals)
        self._yaw_bank.reset()

    def _course(self, fix: GpsFix) -> tuple[float, float] | None:
        """Course as far as it tells the heading of a vehicle, with its sigma."""
        if fix.vel_ne_mps is None:
            return None
        vn, ve = fix.vel_ne_mps
        speed_mps = math.hypot(vn, ve)
        turn_radps = abs(self._bank.main.rate_n[2])
        if speed_mps < COURSE_SPEED_MPS or turn_radps > COURSE_TURN_RADPS:
            return None
        return math.atan2(ve, vn), course_sigma_rad(speed_mps)

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
