"""Update the filters by a fix: use it, de-weight it, reject it, or restart from it."""

import math
from collections.abc import Callable
from typing import Final

import numpy as np

from imu_tracker.estimation.error_state.constraints.schedule import OUTAGE_AFTER_S
from imu_tracker.estimation.error_state.filter import Eskf, Measurement
from imu_tracker.estimation.error_state.hypotheses.alignment import Alignment
from imu_tracker.estimation.error_state.hypotheses.comparison import (
    Comparison,
    log_likelihood_of,
)
from imu_tracker.estimation.error_state.hypotheses.mixture import Verdict
from imu_tracker.estimation.error_state.hypotheses.noise_bank import NoiseBank
from imu_tracker.estimation.error_state.hypotheses.receiver_alone import FixNoise
from imu_tracker.estimation.error_state.hypotheses.reorient import (
    inflate_gyro_bias,
    inflate_unexplained,
    separate_delays,
    set_delay_covariance,
)
from imu_tracker.estimation.error_state.platform import Platform
from imu_tracker.estimation.error_state.propagation import Propagation
from imu_tracker.estimation.error_state.receiver_model import (
    HELD_PLACE_VAR,
    HELD_SPEED_VAR,
    FixGeometry,
    ReceiverModel,
    geometry_of,
    log_likelihood,
    soft_gated,
)
from imu_tracker.estimation.error_state.states import (
    DELAY,
    DELAYS,
    VELOCITY,
    VELOCITY_DELAY,
    start_covariance,
)
from imu_tracker.estimation.estimate import R95_PER_SIGMA
from imu_tracker.estimation.receiver.fix_period import FixPeriod
from imu_tracker.estimation.receiver.gate import FixOutcome, Gate
from imu_tracker.samples import GpsFix, Vec3

AGAIN_NS: Final = 60_000_000_000
"""A restart soon after another one means that the attitude was wrong, too."""


class FixUpdate:
    """Corrects all filters by fixes, and learns their noise.

    Parameters
    ----------
    lever_arm_m : Vec3, body axes
        From the chip to the antenna.
    bank, alignment, platform, propagation
    notify : callable
        Takes messages for the log.
    fix_period : FixPeriod

    Attributes
    ----------
    receiver : ReceiverModel
    comparison : Comparison
        Of the filters with the receiver alone.
    alt_origin_m : float or None
        Height of the origin of positions, from the first fix with one.
    ambiguity_m : float
        Radius that reaches to where refused fixes agree on; 0: none do.
    """

    def __init__(
        self,
        lever_arm_m: Vec3,
        bank: NoiseBank,
        alignment: Alignment,
        platform: Platform,
        propagation: Propagation,
        notify: Callable[[str], None],
        fix_period: FixPeriod,
    ) -> None:
        self._notify, self._lever_arm_m = notify, lever_arm_m
        self._bank, self._alignment, self._platform = bank, alignment, platform
        self._propagation = propagation
        self._gate = Gate(platform.profile)
        self.receiver = ReceiverModel(fix_period)
        self.alt_origin_m: float | None = None
        self.ambiguity_m = 0.0
        self._nis_sum = self._log_likelihood_sum = 0.0
        self._n_used = 0
        self.comparison = Comparison(platform)
        self._restarted_ns: int | None = None

    @property
    def nis_mean(self) -> float:
        """Mean normalised innovation squared; 2 for a consistent filter."""
        return self._nis_sum / max(self._n_used, 1)

    @property
    def log_likelihood_mean(self) -> float:
        """Mean log-likelihood of the positions that were used."""
        return self._log_likelihood_sum / max(self._n_used, 1)

    def change_profile(self) -> None:
        """Gate by what the platform may do now."""
        self._gate = Gate(self._platform.profile)
        self.comparison.change_profile()

    def update(self, fix: GpsFix, ahead_s: float) -> FixOutcome:
        """Correct by a fix that describes the instant `ahead_s` after the filters'."""
        receiver, eskf = self.receiver, self._bank.main
        speed_n = fix.vel_ne_mps or eskf.nominal.v_n[:2]
        if self._gate.is_frozen(fix, math.hypot(*speed_n)):
            # It moves by its own velocity, or by the filter's, which may be wrong.
            if fix.vel_ne_mps is None and self._gate.reject(fix):
                self._restart(fix)
                return FixOutcome.REACQUIRED
            return FixOutcome.FROZEN
        receiver.add_fix(fix)
        self._propagation.constraints.own_accel_mps2 = receiver.accel_mps2
        receiver.is_resting = self._propagation.rest is not None
        if self.alt_origin_m is None and fix.alt_m is not None:
            self.alt_origin_m = fix.alt_m + eskf.nominal.p_n[2]
        for each in self._bank.filters:
            each.set_receiver_var(receiver.lasting_var(fix))
            inflate_unexplained(each, receiver.lasting_var(fix), receiver.period_s)
        is_aligned = self._alignment.is_aligned
        geometry = geometry_of(eskf, self._lever_arm_m, has_yaw=is_aligned)
        position = self._position(eskf, fix, geometry, ahead_s)
        S = eskf.innovation_covariance(position)
        nis = float(position.z @ np.linalg.solve(S, position.z))
        has_say = is_aligned and not receiver.is_catching_up
        has_say = has_say and not self._propagation.is_imu_silent
        noise = receiver.noise(fix, position)
        likelihoods = self._log_likelihoods(fix, ahead_s, noise) if has_say else []
        imu = self._bank.mixed(likelihoods) if has_say else None
        instant_ns = eskf.nominal.t_ns + round((ahead_s + eskf.delay_s) * 1e9)
        verdict = self.comparison.weigh(fix, instant_ns, noise, imu, receiver.period_s)
        if verdict is Verdict.IMU_LOST:
            if not self._recover_heading(fix):
                self._restart_imu(fix)
            return FixOutcome.ACCEPTED
        if verdict is Verdict.IMU_BACK:
            self._notify("the IMU agrees with the receiver again")
        if not self._gate.passes(nis):
            odds = self.comparison.odds
            if self._gate.reject(fix):
                self._restart(fix)
                # While the IMU is out the rows were the receiver's already.
                return FixOutcome.ACCEPTED if odds.is_imu_out else FixOutcome.REACQUIRED
            if not odds.has_imu_lead:
                return FixOutcome.ACCEPTED  # by the receiver alone
            if self._gate.n_agreeing > 1:
                # Two say the same: the truth may be there as well as here.
                reach_m = R95_PER_SIGMA * fix.sigma_h_m
                self.ambiguity_m = math.hypot(*position.z) + reach_m
            return FixOutcome.OUTLIER
        self.ambiguity_m = 0.0
        self._nis_sum, self._n_used = self._nis_sum + nis, self._n_used + 1
        self._log_likelihood_sum += log_likelihood(position.z, S)
        is_tracking = is_aligned and self._propagation.outage_s < OUTAGE_AFTER_S
        is_tracking = is_tracking and not receiver.is_catching_up
        if is_tracking and self.comparison.odds.has_imu_lead:
            # Use the single-fix R: the correlation-inflated R
            # would make every receiver look consistent.
            S_alone = S - position.R * (1.0 - 1.0 / receiver.correlation_factor)
            nis_alone = float(position.z @ np.linalg.solve(S_alone, position.z))
            receiver.learn_position_noise(nis_alone)
        corrected = [self._correct(x, fix, ahead_s) for x in self._bank.filters]
        if has_say:
            likelihoods = likelihoods if self._bank.has_headings else corrected
            self._alignment.add_log_likelihoods(likelihoods, receiver.period_s)
        self._propagation.outage_s = 0.0
        return FixOutcome.ACCEPTED

    def _recover_heading(self, fix: GpsFix) -> bool:
        """Whether it was only a heading that was wrong."""
        if not self._alignment.adopt_other_heading():
            return False
        self._begin_at(fix)
        self.comparison.odds.undo_loss()
        return True

    def _restart_imu(self, fix: GpsFix) -> None:
        """Relearn the IMU from the start; rows follow the receiver meanwhile."""
        self._alignment.reset_orientation(
            "the IMU contradicts the receiver: GPS alone until it agrees; if that is "
            "told again and again: is the box fixed? run imu-tracker selftest; is the "
            "antenna more than 3 m from it? set gps.lever_arm_m"
        )
        self._restarted_ns = None
        fresh = start_covariance(is_vehicle=False)
        for eskf in self._bank.filters:
            inflate_gyro_bias(eskf)
            set_delay_covariance(eskf, fresh[DELAYS, DELAYS])
        self.receiver.reset_noise()
        self._begin_at(fix)

    def _log_likelihoods(
        self, fix: GpsFix, ahead_s: float, noise: FixNoise
    ) -> list[float]:
        """How well each heading predicted a fix, of a receiver that may be late."""
        found, bank = [], self._bank
        for eskf in bank.filters if bank.has_headings else (bank.main,):
            geometry = geometry_of(eskf, self._lever_arm_m, has_yaw=True)
            position = self._position(eskf, fix, geometry, ahead_s)
            velocity = self.receiver.velocity(eskf, fix, geometry, ahead_s)
            found.append(log_likelihood_of(eskf, position, velocity, noise.late_var))
        return found

    @property
    def _held(self) -> int:  # none while the heading is undecided
        return int(not self._bank.has_headings)

    def _position(
        self, eskf: Eskf, fix: GpsFix, geometry: FixGeometry, ahead_s: float
    ) -> Measurement:
        """Measurement of the position: the same for gate, comparison and update."""
        frame = self._propagation.frame
        position = self.receiver.position(eskf, fix, frame, geometry, ahead_s)
        if not self._alignment.is_aligned:
            position.H[:, DELAY] = 0.0  # the place itself is the receiver's
        elif self.receiver.is_catching_up:
            position.H[:, DELAY] = 0.0
            position = position._replace(R=position.R + self._held * HELD_PLACE_VAR)
        return position

    def _velocity(
        self, eskf: Eskf, fix: GpsFix, geometry: FixGeometry, ahead_s: float
    ) -> Measurement | None:
        """Measurement of the velocity, as far as the receiver follows the body."""
        velocity = self.receiver.velocity(eskf, fix, geometry, ahead_s)
        if velocity is None or self._propagation.rest is not None:
            return None
        if not self._alignment.is_aligned:
            velocity.H[:, VELOCITY_DELAY] = 0.0  # the velocity is the receiver's
        elif self.receiver.is_catching_up:
            velocity.H[:, VELOCITY_DELAY] = 0.0
            velocity = velocity._replace(R=velocity.R + self._held * HELD_SPEED_VAR)
        return velocity

    def _correct(self, eskf: Eskf, fix: GpsFix, ahead_s: float) -> float:
        """Fold position, height and velocity into one filter; return how likely."""
        receiver, propagation = self.receiver, self._propagation
        is_aligned = self._alignment.is_aligned
        geometry = geometry_of(eskf, self._lever_arm_m, has_yaw=is_aligned)
        position = self._position(eskf, fix, geometry, ahead_s)
        likelihood = log_likelihood(position.z, eskf.innovation_covariance(position))
        eskf.update(position)
        eskf.update(receiver.altitude(eskf, fix, self.alt_origin_m))
        velocity = self._velocity(eskf, fix, geometry, ahead_s)
        if velocity is not None:
            S = eskf.innovation_covariance(velocity)
            is_tracking = is_aligned and propagation.outage_s < OUTAGE_AFTER_S
            is_tracking = is_tracking and self.comparison.odds.has_imu_lead
            is_tracking = is_tracking and not receiver.is_catching_up
            if eskf is self._bank.main and is_tracking:
                receiver.learn_velocity_noise(velocity.z, S - velocity.R)
            likelihood += log_likelihood(velocity.z, S)
            eskf.update(soft_gated(velocity, S))
        return likelihood

    def _restart(self, fix: GpsFix) -> None:
        """Start again at the receiver's position; keep the attitude if it may be right.

        The heading was wrong if it was not confirmed yet, or if this is the second
        restart within a minute and no velocity supports it.
        """
        last_ns, self._restarted_ns = self._restarted_ns, fix.t_ns
        is_again = last_ns is not None and fix.t_ns - last_ns < AGAIN_NS
        is_doubtful = fix.vel_ne_mps is None or self.comparison.odds.nats < 0.0
        if is_again and is_doubtful:
            self._alignment.reset_orientation()
            self._restarted_ns = None
        self.comparison.odds.restart_trial()
        self._begin_at(fix)

    def _begin_at(self, fix: GpsFix) -> None:
        """Put all filters where the receiver is."""
        down = self._bank.main.nominal.p_n[2]
        self._propagation.start(fix.lat_rad, fix.lon_rad, fix.sigma_h_m)
        self.ambiguity_m = 0.0
        vn, ve = fix.vel_ne_mps or (0.0, 0.0)
        for eskf in self._bank.filters:
            eskf.nominal = eskf.nominal._replace(
                p_n=(0.0, 0.0, down), v_n=(vn, ve, 0.0)
            )
            if fix.vel_ne_mps is not None:
                eskf.set_variances(VELOCITY, [1.0] * 3)
            if self._alignment.is_aligned:
                separate_delays(eskf)
