"""The error-state filter: learns its tilt, its biases, its heading, its mounting.

The filter itself stays some tenths of a second behind, at the instants that fixes
describe (`_horizon`), so that nothing has to be repeated when one arrives; rows are
predicted from there through the steps since, which wait in a queue.
"""

import math
from collections import deque
from collections.abc import Mapping
from typing import Any, Final

import numpy as np

from imu_tracker.estimation import vehicle
from imu_tracker.estimation.error_model import (
    ATTITUDE,
    DELAY,
    GYRO_BIAS,
    MOUNT_PITCH,
    MOUNT_YAW,
    N_ERRORS,
    RECEIVER,
    VELOCITY,
    VELOCITY_DELAY,
    Array,
)
from imu_tracker.estimation.eskf import Eskf, Measurement, Nominal
from imu_tracker.estimation.estimator import R95_PER_SIGMA, Estimate, r95_of
from imu_tracker.estimation.gate import FixOutcome, Gate
from imu_tracker.estimation.geodesy import FRAME_RADIUS_M, LocalFrame, gravity_mps2
from imu_tracker.estimation.noise_bank import START_LEVEL, NoiseBank
from imu_tracker.estimation.preintegration import ImuStep
from imu_tracker.estimation.profile import ProfileJudge
from imu_tracker.estimation.receiver import (
    ReceiverModel,
    geometry_of,
    log_likelihood,
    soft,
)
from imu_tracker.estimation.rotation import (
    conjugate,
    from_euler,
    level_from_gravity,
    multiply,
    rotate,
    to_euler,
    turn_about_down,
    wrap_pi,
)
from imu_tracker.estimation.standstill import Rest
from imu_tracker.estimation.yaw_bank import CONVERGED_SIGMA_RAD, YawBank
from imu_tracker.samples import GpsFix, Quat, Vec3

STRETCH_S: Final = 0.1
"""Errors grow, and constraints are applied, in stretches of three steps: in 0.12 s a
car turns by 5 deg at most."""

LEAST_LAG_NS: Final = 1_000_000_000
MAX_LAG_NS: Final = 2_500_000_000
LAG_MARGIN_NS: Final = 80_000_000
"""How far the filter stays behind: as long as fixes take to come, learnt, and long
enough to see in hindsight whether a rest was one."""

PULLING_OFF_MPS: Final = 0.1
"""A body that rests gains no speed: what a rocking car shows within a second."""

FOLD_S: Final = 0.02
"""A delay beyond this moves the instants of the fixes, half a step of 40 ms; the state
begins again at zero, where v times delay is exact."""

UNKNOWN_ACCEL_PSD: Final = {"vehicle": 1.5**2, "walker": 0.5**2, "free": 1.5**2}
"""While the yaw or the IMU is unknown: a body's own acceleration for a second, as
(m/s^2)^2/Hz."""

COURSE_SPEED_MPS: Final = 2.0
COURSE_SIGMA_RAD: Final = math.radians(5.0)
"""Between course and direction of travel of a vehicle."""

BANK_PERIOD_S: Final = 0.5
BANK_VELOCITY_VAR: Final = 0.3**2
"""A moving box swings against the antenna."""

CONTRADICTED_RAD: Final = math.radians(35.0)
CONTRADICTED_FIXES: Final = 5
"""How far, and how often, the bank must differ before it is believed: delay and tilt
make it err by 10 degrees."""

MOUNTING_SPEED_MPS: Final = 3.0
"""From here on the course is known to some degrees."""

GUESS_SIGMA_RAD: Final = math.radians(30.0)
"""A bank less sure than this says nothing."""

REVERSE_RAD: Final = math.radians(150.0)
REVERSE_MPS: Final = 5.0
"""Nobody reverses faster."""

BELIEVED_SIGMAS: Final = 2.5
DOUBT_S: Final = 5.0
"""A lasting error of the receiver beyond this is the filter's own."""

LONGER_SHARE: Final = 0.35
"""Part of a receiver's error lasts longer than the minute of its state, and the filter
takes it for a place: of the variance of that state, added to the radius."""

DARK_AFTER_S: Final = 2.0
WEAK_PERIOD_S: Final = 1.0
LEVELLING_SIGMA_MPS2: Final = 3.0
"""Own acceleration of a body of which nothing is known, mean of a second."""

ODD_MOUNTING_RAD: Final = math.radians(20.0)
"""No road and no hand's error tips a box so far."""

LOST_YAW_SIGMA_RAD: Final = 0.6
LOST_TURN_RADPS: Final = 0.1
_LARGEST_RADIUS_M: Final = 2e7


class ErrorState:
    """Strapdown navigation with all its errors estimated.

    Parameters
    ----------
    profile : {"auto", "free", "vehicle", "walker"}
    lever_arm_m : Vec3, body axes
        From the chip to the antenna.
    prior : mapping, optional
        What an earlier run learnt.
    """

    in_hindsight = True

    def __init__(
        self,
        profile: str,
        lever_arm_m: Vec3 = (0.0, 0.0, 0.0),
        prior: Mapping[str, Any] | None = None,
    ) -> None:
        self._judge_profile = ProfileJudge() if profile == "auto" else None
        profile = "free" if profile == "auto" else profile
        self._profile = profile
        self._is_vehicle = profile == "vehicle"
        self._unknown_psd = UNKNOWN_ACCEL_PSD[profile]
        self._level_q: Quat | None = None
        self._fix_yaw_rad = 0.0
        self._lever_arm_m = lever_arm_m
        level = START_LEVEL if prior is None else int(prior["noise_level"])
        self._bank = NoiseBank(level, is_vehicle=self._is_vehicle)
        self._receiver = ReceiverModel()
        self._yaw_bank = YawBank()
        self._agnostic: Eskf | None = None
        self._n_contradicted = 0
        self._bank_due_s = 0.0
        self._gate = Gate(profile)
        self._frame = LocalFrame.at(0.0, 0.0)
        self._alt_origin_m: float | None = None
        self._pending: deque[tuple[ImuStep, Rest | None]] = deque()
        self._rest: Rest | None = None
        self._now_ns = 0
        self._lag_ns = LEAST_LAG_NS
        self._shift_ns = 0  # fixes describe so much later than the tracker says
        self._is_started = self._is_aligned = self._is_level = False
        self._stretch_s = self._weak_s = self._dark_s = 0.0
        self._level_s, self._level_dv = 0.0, (0.0, 0.0, 0.0)
        self._sigma_h_m = 0.0
        self._doubt_m = 0.0
        self._nis_sum, self._n_nis, self._log_likelihood = 0.0, 0, 0.0
        self._notices: list[str] = []
        if prior is not None:
            self._begin_with(prior)

    @property
    def _filters(self) -> tuple[Eskf, ...]:
        return self._bank.filters

    @property
    def _eskf(self) -> Eskf:
        return self._bank.main

    # -------------------------------------------------------------------- start

    def start(self, lat_rad: float, lon_rad: float, sigma_m: float) -> None:
        """Begin at a place known to `sigma_m` per axis, at any speed."""
        self._frame = LocalFrame.at(lat_rad, lon_rad)
        self._alt_origin_m = None
        self._sigma_h_m = sigma_m
        for eskf in self._filters:
            eskf.gravity_mps2 = gravity_mps2(lat_rad)
            eskf.predict(use_force=False)
            t_ns, _, _, q_nb = eskf.nominal
            eskf.nominal = Nominal(t_ns, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), q_nb)
            _set_block(eskf, slice(0, 3), [sigma_m**2, sigma_m**2, 1e4])
            _set_block(eskf, VELOCITY, [400.0, 400.0, 1.0])
            eskf.receiver_ne_m = (0.0, 0.0)
            _set_block(eskf, slice(17, 19), [eskf.receiver_var] * 2)
        self._dark_s = 0.0
        self._yaw_bank.forget()
        self._agnostic = None
        self._is_started = True

    # --------------------------------------------------------------------- steps

    def step(self, step: ImuStep, rest: Rest | None) -> None:
        """Queue a step; the filter follows behind."""
        self._pending.append((step, rest))
        self._now_ns = step.t_ns
        while self._pending and (self._pending[0][0].t_ns <= step.t_ns - self._lag_ns):
            self._advance_one()

    def _advance_to(self, t_ns: int) -> None:
        """Bring the filter to the step that ends nearest to an instant."""
        pending = self._pending
        while (
            pending and 2 * pending[0][0].t_ns - _length_ns(pending[0][0]) <= 2 * t_ns
        ):
            self._advance_one()

    def _advance_one(self) -> None:
        """Take the oldest step of the queue into the filters."""
        step, rest = self._pending.popleft()
        self._rest = rest if rest is None or self._stays(step) else None
        if not self._is_level:
            self._level(step)
        use_force = self._use_force
        for eskf in self._filters:
            eskf.propagate(step, use_force=use_force)
        if self._agnostic is not None:
            self._agnostic.propagate(step, use_force=self._rest is not None)
        self._stretch_s += step.dt_s
        if step.is_gap:
            self._lose(step.dt_s)
        if self._stretch_s >= STRETCH_S:
            self._predict()
            self._constrain(self._stretch_s)
            self._stretch_s = 0.0

    def _stays(self, step: ImuStep) -> bool:
        """Whether the steps since, up to now, agree that the body rests."""
        eskf = self._eskf
        if any(rest is None for _, rest in self._pending):
            return False
        dvn, dve, _ = rotate(eskf.nominal.q_nb, _sum_of_dv(step, self._pending))
        time_s = step.dt_s + sum(later.dt_s for later, _ in self._pending)
        bn, be, _ = rotate(eskf.nominal.q_nb, eskf.accel_bias_mps2)
        tilt_var = max(eskf.P[6, 6], eskf.P[7, 7]) * eskf.gravity_mps2**2
        sigma = time_s * math.sqrt(tilt_var + eskf.P[12, 12] + eskf.P[13, 13])
        gained_mps = math.hypot(dvn - bn * time_s, dve - be * time_s)
        return gained_mps < PULLING_OFF_MPS + 3.0 * sigma

    @property
    def _use_force(self) -> bool:
        return self._is_level and (self._is_aligned or self._rest is not None)

    def _predict(self) -> None:
        unknown = 0.0 if self._use_force else self._unknown_psd
        (dvn, dve, _), dt = self._reference.stretch
        self._yaw_bank.add(dt, (dvn, dve))
        for eskf in self._filters:
            eskf.predict(use_force=self._use_force, unknown_accel_psd=unknown)
        if self._agnostic is not None:
            rests = self._rest is not None
            unknown = 0.0 if rests else self._unknown_psd
            self._agnostic.predict(use_force=rests, unknown_accel_psd=unknown)

    def _level(self, step: ImuStep) -> None:
        """Take the mean force of a second for gravity.

        A box that lies far from flat was mounted so: the vehicle is taken for level.
        """
        if step.is_gap:
            self._level_s, self._level_dv = 0.0, (0.0, 0.0, 0.0)
            return
        (x, y, z), (dx, dy, dz) = self._level_dv, step.dv_b_mps
        self._level_dv = (x + dx, y + dy, z + dz)
        self._level_s += step.dt_s
        if self._level_s >= 1.0:
            q_nb = level_from_gravity(self._level_dv)
            roll, pitch, _ = to_euler(q_nb)
            for eskf in self._filters:
                eskf.nominal = eskf.nominal._replace(q_nb=q_nb)
                if max(abs(roll), abs(pitch)) > ODD_MOUNTING_RAD:
                    eskf.q_vb = q_nb
            self._is_level = True
            self._level_q = q_nb

    def _lose(self, dt_s: float) -> None:
        """A gap: nobody knows how the body turned."""
        for eskf in self._filters:
            P = eskf.P.copy()
            for i in range(6, 9):
                P[i, i] += (LOST_TURN_RADPS * dt_s) ** 2
            eskf.P = P
        if self._is_aligned and self._eskf.sigma(8) > LOST_YAW_SIGMA_RAD:
            self._is_aligned = False

    def _constrain(self, period_s: float) -> None:
        """Apply what the body cannot do."""
        self._dark_s += period_s
        self._weak_s += period_s
        is_weak_due = self._weak_s >= WEAK_PERIOD_S
        rest, is_dark = self._rest, self._dark_s > DARK_AFTER_S
        if is_weak_due:
            self._weak_s = 0.0
            if math.hypot(*self._eskf.nominal.p_n[:2]) > FRAME_RADIUS_M:
                self._move_frame()
        if not self._is_level:
            return
        for eskf in self._filters:
            if rest is not None:
                eskf.apply(vehicle.rest(eskf, rest, period_s))
            elif self._is_vehicle and self._is_aligned:
                eskf.apply(vehicle.no_side_slip(eskf, period_s))
                if is_dark and is_weak_due:
                    eskf.apply(vehicle.level_road(eskf, WEAK_PERIOD_S))
                    eskf.apply(vehicle.unhurried(eskf, WEAK_PERIOD_S))
            if is_weak_due and rest is None and not self._is_aligned:
                eskf.apply(_gravity_is_down(eskf))
        if self._agnostic is not None:
            if rest is not None:
                self._agnostic.apply(vehicle.rest(self._agnostic, rest, period_s))
            elif is_weak_due:
                self._agnostic.apply(_gravity_is_down(self._agnostic))

    def _move_frame(self) -> None:
        """Take the origin along when the way from it grows."""
        north, east, _ = self._eskf.nominal.p_n
        lat, lon = self._frame.to_lat_lon(north, east)
        self._frame = LocalFrame.at(lat, lon)
        self._yaw_bank.moved(north, east)
        for eskf in self._filters:
            pn, pe, pd = eskf.nominal.p_n
            eskf.nominal = eskf.nominal._replace(p_n=(pn - north, pe - east, pd))
            eskf.gravity_mps2 = gravity_mps2(lat)
        if self._agnostic is not None:
            pn, pe, pd = self._agnostic.nominal.p_n
            self._agnostic.nominal = self._agnostic.nominal._replace(
                p_n=(pn - north, pe - east, pd)
            )

    # --------------------------------------------------------------------- fixes

    def take(self, fix: GpsFix, instant_ns: int, start_sigma_m: float) -> FixOutcome:
        """Bring the filter to the fix's instant, and correct it."""
        instant_ns += self._shift_ns
        self._learn_lag(instant_ns)
        self._advance_to(instant_ns)
        if self._stretch_s > 0.0:
            self._predict()
        horizon_ns = self._eskf.nominal.t_ns
        ahead_s = (instant_ns - horizon_ns) * 1e-9 if horizon_ns else 0.0
        if start_sigma_m > 0.0:
            self.start(fix.lat_rad, fix.lon_rad, start_sigma_m)
            ahead_s = min(max(ahead_s, -0.1), 0.1)
        elif abs(ahead_s) > 3.0:
            return FixOutcome.TOO_LATE
        outcome = self._update(fix, ahead_s)
        used = outcome in (FixOutcome.ACCEPTED, FixOutcome.REACQUIRED)
        return FixOutcome.INITIALISED if start_sigma_m > 0.0 and used else outcome

    def _learn_lag(self, instant_ns: int) -> None:
        """Stay behind as far as fixes take to come."""
        needed = max(self._now_ns - instant_ns + LAG_MARGIN_NS, LEAST_LAG_NS)
        if needed > self._lag_ns:
            self._lag_ns = min(needed, MAX_LAG_NS)
        else:
            self._lag_ns -= (self._lag_ns - needed) // 50

    def _doubt_itself(self, variance: float) -> None:
        """Open up where the receiver's error would have to be larger than it can be.

        A filter that is wrong and sure of itself explains the difference by the
        receiver. The part beyond `BELIEVED_SIGMAS` becomes its own uncertainty,
        within some seconds.
        """
        for eskf in self._filters:
            error_m = math.hypot(*eskf.receiver_ne_m)
            beyond_m = error_m - BELIEVED_SIGMAS * math.sqrt(variance)
            if beyond_m > 0.0:
                P = eskf.P.copy()
                share = min(self._receiver.period_s / DOUBT_S, 1.0)
                P[0, 0] += share * beyond_m**2
                P[1, 1] += share * beyond_m**2
                P[3, 3] += share * (beyond_m / DOUBT_S) ** 2
                P[4, 4] += share * (beyond_m / DOUBT_S) ** 2
                eskf.P = P

    def _update(self, fix: GpsFix, ahead_s: float) -> FixOutcome:
        speed = math.hypot(*fix.vel_ne_mps) if fix.vel_ne_mps else self.speed()[0]
        if self._gate.is_frozen(fix, speed):
            return FixOutcome.FROZEN
        receiver, eskf = self._receiver, self._eskf
        receiver.observe_period(fix)
        if self._alt_origin_m is None and fix.alt_m is not None:
            self._alt_origin_m = fix.alt_m + eskf.nominal.p_n[2]
        for each in self._filters:
            each.limit_receiver_error(receiver.lasting_var(fix))
        self._doubt_itself(receiver.lasting_var(fix))
        geometry = geometry_of(eskf, self._lever_arm_m, has_yaw=self._is_aligned)
        position = receiver.position(eskf, fix, self._frame, geometry, ahead_s)
        S = eskf.innovation_covariance(position)
        nis = float(position.z @ np.linalg.solve(S, position.z))
        if not self._gate.passes(nis):
            if self._gate.reject(fix):
                self._restart(fix)
                return FixOutcome.REACQUIRED
            if self._gate.n_agreeing > 1:
                self._doubt_m = math.hypot(*position.z) + R95_PER_SIGMA * fix.sigma_h_m
            return FixOutcome.OUTLIER
        self._doubt_m = 0.0
        self._nis_sum, self._n_nis = self._nis_sum + nis, self._n_nis + 1
        self._log_likelihood += log_likelihood(position.z, S)
        if self._dark_s < DARK_AFTER_S and self._is_aligned:
            # The fix as it is, not as it counts: votes would make any receiver shine.
            S_alone = S - position.R * (1.0 - 1.0 / receiver.votes)
            nis_alone = float(position.z @ np.linalg.solve(S_alone, position.z))
            receiver.learn_position(nis_alone)
        self._sigma_h_m = fix.sigma_h_m
        likelihoods = [self._correct(each, fix, ahead_s) for each in self._filters]
        if self._agnostic is not None:
            self._correct(self._agnostic, fix, ahead_s)
        if self._is_aligned:
            self._judge(*likelihoods)
        self._dark_s = 0.0
        self._fold_delay()
        if self._is_level:
            self._learn_profile()
            self._mind_reverse()
            self._ask_yaw_bank(fix)
            if not self._is_aligned:
                self._align(fix)
        return FixOutcome.ACCEPTED

    def _judge(self, main: float, challenger: float) -> None:
        """Let the likelihood of the fix decide between the filters."""
        heading = self._bank.judge(main, challenger, self._receiver.period_s)
        if heading is None:
            return
        if heading:
            self._notices.append("the heading was wrong; learnt anew")
        self._agnostic = None
        self._yaw_bank.forget()

    def _learn_profile(self) -> None:
        """Find out what carries the box, when the configuration leaves it open."""
        judge, eskf = self._judge_profile, self._eskf
        if judge is None or self._level_q is None:
            return
        yaw_rad = _yaw_between(eskf.nominal.q_nb, self._level_q)
        turn_rad = wrap_pi(yaw_rad - self._fix_yaw_rad)
        self._fix_yaw_rad = yaw_rad
        has_changed = judge.observe(
            self._receiver.period_s,
            math.hypot(*eskf.nominal.v_n[:2]),
            turn_rad,
            _tilt_between(eskf.nominal.q_nb, self._level_q),
            eskf.accel_std_mps2,
        )
        if has_changed:
            self._change_profile(judge.profile)

    def _change_profile(self, profile: str) -> None:
        """Constrain the body as its new profile allows."""
        self._profile, self._is_vehicle = profile, profile == "vehicle"
        self._unknown_psd = UNKNOWN_ACCEL_PSD[profile]
        self._gate = Gate(profile)
        for eskf in self._filters:
            eskf.set_vehicle(is_vehicle=self._is_vehicle)
            vn, ve, _ = eskf.nominal.v_n
            if self._is_vehicle and self._is_aligned:
                q_vn = from_euler(0.0, 0.0, -math.atan2(ve, vn))
                eskf.q_vb = multiply(q_vn, eskf.nominal.q_nb)
        self._notices.append(f"profile: {profile}")

    def _mind_reverse(self) -> None:
        """Nobody goes backwards so fast: the box sits turned by half a turn."""
        if not self._is_vehicle or not self._is_aligned:
            return
        ahead_mps = float(self._eskf.C_vn()[0] @ self._eskf.nominal.v_n)
        if ahead_mps < -REVERSE_MPS and self._dark_s < DARK_AFTER_S:
            for eskf in self._filters:
                eskf.turn_mounting_half()
            self._notices.append("the box sits with its x axis backwards")

    def _ask_yaw_bank(self, fix: GpsFix) -> None:
        """Compare the heading with what the accelerations say of it."""
        bank, eskf, levelled = self._yaw_bank, self._eskf, self._reference
        self._bank_due_s -= self._receiver.period_s
        if self._bank_due_s > 0.0:
            return
        self._bank_due_s = BANK_PERIOD_S
        z_v = None if fix.vel_ne_mps is None else np.array(fix.vel_ne_mps)
        bank.update(
            np.array(self._frame.to_ne(fix.lat_rad, fix.lon_rad)),
            max(0.35 * fix.sigma_h_m, 0.3) ** 2,
            z_v,
            self._receiver.velocity_var + BANK_VELOCITY_VAR,
            max(0.1, eskf.sigma(VELOCITY_DELAY)) ** 2,
            max(levelled.P[6, 6], levelled.P[7, 7]),
            max(levelled.P.diagonal()[GYRO_BIAS].tolist()),
        )
        yaw_rad, sigma_rad = bank.answer()
        if not self._is_aligned:
            if sigma_rad < CONVERGED_SIGMA_RAD:
                self._take_yaw(yaw_rad, sigma_rad)
            return
        turned_rad = _yaw_between(eskf.nominal.q_nb, levelled.nominal.q_nb)
        wrong_rad = wrap_pi(yaw_rad - turned_rad)
        if self._bank.is_heading_trial:
            return
        if _contradicts(wrong_rad, sigma_rad):
            self._n_contradicted += 1
        else:
            self._n_contradicted = 0
            if sigma_rad < CONVERGED_SIGMA_RAD and self._agnostic is not None:
                self._agnostic = None
                bank.forget()
        if self._n_contradicted >= CONTRADICTED_FIXES:
            self._n_contradicted = 0
            candidate = eskf.clone(eskf.noise)
            candidate.take_over(levelled)
            self._place(candidate, yaw_rad, sigma_rad)
            self._bank.challenge_heading(candidate)

    def _take_yaw(self, yaw_rad: float, sigma_rad: float) -> None:
        """Align by the bank's word."""
        for eskf in self._filters:
            self._place(eskf, yaw_rad, sigma_rad)
        self._yaw_bank.turned(yaw_rad)
        self._is_aligned = True

    @property
    def _reference(self) -> Eskf:
        """Whose attitude the bank's accelerations are levelled by.

        Until the bank has spoken once, a filter that never took the course for the
        heading: a wrong heading spoils the tilt, and with it the evidence.
        """
        return self._eskf if self._agnostic is None else self._agnostic

    def _place(self, eskf: Eskf, yaw_rad: float, sigma_rad: float) -> None:
        """Turn to the heading that the bank has found; see how the box sits.

        A vehicle goes where its course goes: if that is not ahead, it is the box that
        sits turned. But a half turn at low speed is a vehicle that goes backwards.
        """
        _turn(eskf, yaw_rad)
        eskf.forget_orientation(sigma_rad, is_vehicle=self._is_vehicle)
        vn, ve, _ = eskf.nominal.v_n
        speed_mps = math.hypot(vn, ve)
        if not self._is_vehicle or speed_mps < MOUNTING_SPEED_MPS:
            return
        course_rad = math.atan2(ve, vn)
        ahead_n = eskf.C_vn()[0]
        off_rad = wrap_pi(course_rad - math.atan2(ahead_n[1], ahead_n[0]))
        is_reversing = abs(off_rad) > REVERSE_RAD and speed_mps < REVERSE_MPS
        if abs(off_rad) > CONTRADICTED_RAD and not is_reversing:
            q_vn = from_euler(0.0, 0.0, -course_rad)
            eskf.q_vb = multiply(q_vn, eskf.nominal.q_nb)

    def _fold_delay(self) -> None:
        """Move the instants of the fixes by the delay that was found."""
        delay_s = self._eskf.delay_s
        if abs(delay_s) < FOLD_S or not self._is_aligned:
            return
        self._shift_ns += round(delay_s * 1e9)
        for each in self._filters:
            each.delay_s -= delay_s
            each.velocity_delay_s -= delay_s

    def _correct(self, eskf: Eskf, fix: GpsFix, ahead_s: float) -> float:
        """Fold position, height and velocity into one filter; return how likely."""
        receiver = self._receiver
        geometry = geometry_of(eskf, self._lever_arm_m, has_yaw=self._is_aligned)
        position = receiver.position(eskf, fix, self._frame, geometry, ahead_s)
        if not self._is_aligned or eskf is self._agnostic:
            position.H[:, DELAY] = 0.0  # velocity itself comes from the fixes
        likelihood = log_likelihood(position.z, eskf.innovation_covariance(position))
        eskf.apply(position)
        eskf.apply(receiver.altitude(eskf, fix, self._alt_origin_m))
        velocity = receiver.velocity(eskf, fix, geometry, ahead_s)
        if velocity is not None and self._rest is None:
            S = eskf.innovation_covariance(velocity)
            if eskf is self._eskf and self._is_aligned and self._dark_s < DARK_AFTER_S:
                receiver.learn_velocity(velocity.z, S - velocity.R)
            likelihood += log_likelihood(velocity.z, S)
            eskf.apply(soft(velocity, S))
        return likelihood

    def _align(self, fix: GpsFix) -> None:
        """Take the course for the heading of a vehicle."""
        if fix.vel_ne_mps is None or not self._is_vehicle or not self._is_level:
            return
        vn, ve = fix.vel_ne_mps
        speed = math.hypot(vn, ve)
        if speed < COURSE_SPEED_MPS or abs(self._eskf.rate_n[2]) > 0.3:
            return
        ahead_n = self._eskf.C_vn()[0]
        off_rad = wrap_pi(math.atan2(ve, vn) - math.atan2(ahead_n[1], ahead_n[0]))
        yaw_rad, sigma_rad = self._yaw_bank.answer()
        if _contradicts(wrap_pi(off_rad - yaw_rad), sigma_rad):
            self._take_yaw(yaw_rad, sigma_rad)
            return
        sigma = math.hypot(COURSE_SIGMA_RAD, 0.2 / speed)
        self._agnostic = self._eskf.clone(self._eskf.noise)
        for eskf in self._filters:
            forward_n = eskf.C_vn()[0]
            heading = math.atan2(forward_n[1], forward_n[0])
            _turn(eskf, wrap_pi(math.atan2(ve, vn) - heading))
            _set_yaw_covariance(eskf, sigma)
        self._is_aligned = True

    def _restart(self, fix: GpsFix) -> None:
        """Begin anew from the receiver; the attitude stays if nothing is against it.

        A filter that lost its way before its heading was confirmed had a wrong one.
        """
        alt_origin_m, down = self._alt_origin_m, self._eskf.nominal.p_n[2]
        levelled = self._agnostic
        self.start(fix.lat_rad, fix.lon_rad, fix.sigma_h_m)
        self._doubt_m = 0.0
        self._alt_origin_m = alt_origin_m
        vn, ve = fix.vel_ne_mps or (0.0, 0.0)
        for eskf in self._filters:
            if levelled is not None:
                eskf.take_over(levelled)
                eskf.forget_orientation(math.pi, is_vehicle=self._is_vehicle)
            eskf.nominal = eskf.nominal._replace(
                p_n=(0.0, 0.0, down), v_n=(vn, ve, 0.0)
            )
            _set_block(eskf, slice(0, 3), [fix.sigma_h_m**2] * 2 + [1e4])
            _set_block(eskf, RECEIVER, [eskf.receiver_var] * 2)
            _set_block(eskf, VELOCITY, [1.0 if fix.vel_ne_mps else 400.0] * 2 + [1.0])
        if levelled is not None:
            self._is_aligned = False

    # ------------------------------------------------------------------ estimates

    def estimate_after(self, dt_s: float) -> Estimate:
        """Predict from the filter's instant to one after the last step."""
        eskf = self._eskf
        t_ns = self._now_ns + round(dt_s * 1e9) + self._shift_ns
        nominal = eskf.nominal
        for step, rest in self._pending:
            if step.t_ns - _length_ns(step) // 2 > t_ns:
                break
            use_force = self._is_level and (self._is_aligned or rest is not None)
            nominal = eskf.advanced(nominal, step, use_force=use_force)
        left_s = (t_ns - nominal.t_ns) * 1e-9 if nominal.t_ns else dt_s
        left_s += eskf.delay_s
        (north, east, down), (vn, ve, vd) = nominal.p_n, nominal.v_n
        north, east, down = north + vn * left_s, east + ve * left_s, down + vd * left_s
        if self._is_aligned and any(self._lever_arm_m):
            ln, le, ld = rotate(nominal.q_nb, self._lever_arm_m)
            north, east, down = north + ln, east + le, down + ld
        lat, lon = self._frame.to_lat_lon(north, east)
        alt = None if self._alt_origin_m is None else self._alt_origin_m - down
        total_s = (t_ns - eskf.nominal.t_ns) * 1e-9 + eskf.delay_s
        r95 = max(r95_of(self._position_cov_m2(vn, ve, total_s)), self._doubt_m)
        return Estimate(
            lat, lon, alt, (vn, ve, vd), nominal.q_nb, min(r95, _LARGEST_RADIUS_M)
        )

    def _position_cov_m2(self, vn: float, ve: float, after_s: float) -> Array:
        """Covariance of p + v delay, carried over the time since the horizon."""
        P = self._eskf.P
        H = np.zeros((2, N_ERRORS))
        H[0, 0] = H[1, 1] = 1.0
        H[0, 3] = H[1, 4] = after_s
        if self._is_aligned:  # before, velocity itself follows the fixes
            H[0, DELAY], H[1, DELAY] = vn, ve
        cov: Array = H @ P @ H.T + LONGER_SHARE * P[RECEIVER, RECEIVER]
        return cov

    def speed(self) -> tuple[float, float]:
        """Horizontal speed in m/s and its standard deviation."""
        vn, ve, _ = self._eskf.nominal.v_n
        return math.hypot(vn, ve), max(self._eskf.sigma(3), self._eskf.sigma(4))

    def gyro_bias(self) -> tuple[Vec3, float]:
        """Gyro bias in rad/s, body axes, and its standard deviation per axis."""
        P = self._eskf.P
        worst = max(P.diagonal()[GYRO_BIAS].tolist())
        return self._eskf.gyro_bias_radps, math.sqrt(max(worst, 0.0))

    # ------------------------------------------------------------------- for people

    def take_notices(self) -> list[str]:
        """Transitions since the last call, for the log."""
        notices, self._notices = self._notices, []
        return notices

    def learnt(self) -> dict[str, object]:
        """What a next start can begin with."""
        return {
            **self._eskf.learnt(),
            "noise_level": self._bank.level,
            "profile": self._profile,
            "shift_s": self._shift_ns * 1e-9,
        }

    def _begin_with(self, prior: Mapping[str, Any]) -> None:
        """Take what an earlier run learnt, with doubts that grew meanwhile."""
        if self._judge_profile is not None and prior.get("profile") == "vehicle":
            self._judge_profile.profile = "vehicle"
            self._change_profile("vehicle")
        self._shift_ns = round(float(prior.get("shift_s", 0.0)) * 1e9)
        for eskf in self._filters:
            eskf.begin_with(prior)

    def report(self) -> dict[str, object]:
        """What was learnt, for people."""
        eskf, receiver = self._eskf, self._receiver
        roll, pitch, yaw = to_euler(eskf.q_vb)
        bias, sigma = self.gyro_bias()
        n = max(self._n_nis, 1)
        return {
            "estimator": "error-state",
            "profile": self._profile,
            "mounting_deg": [math.degrees(a) for a in (roll, pitch, yaw)],
            "mounting_sigma_deg": [
                math.degrees(eskf.sigma(i)) for i in (MOUNT_PITCH, MOUNT_YAW)
            ],
            "gyro_bias_dps": [math.degrees(b) for b in bias],
            "gyro_bias_sigma_dps": math.degrees(sigma),
            "accel_bias_mps2": list(eskf.accel_bias_mps2),
            "accel_bias_sigma_mps2": [eskf.sigma(i) for i in range(12, 15)],
            "yaw_sigma_deg": math.degrees(eskf.sigma(8)),
            "yaw_scale": eskf.yaw_scale,
            "axle_m": eskf.axle_m,
            "delay_s": eskf.delay_s + self._shift_ns * 1e-9,
            "delay_sigma_s": eskf.sigma(DELAY),
            "velocity_delay_s": eskf.velocity_delay_s + self._shift_ns * 1e-9,
            "velocity_sigma_mps": math.sqrt(receiver.velocity_var),
            "fix_noise_level": receiver.nis_level,
            "fix_period_s": receiver.period_s,
            "lag_s": self._lag_ns * 1e-9,
            "nis_mean": self._nis_sum / n,
            "fix_log_likelihood": self._log_likelihood / n,
            "noise_level": self._bank.level,
        }


def _contradicts(wrong_rad: float, sigma_rad: float) -> bool:
    """Whether a heading differs from the bank's beyond its doubts and its errors."""
    return (
        sigma_rad < GUESS_SIGMA_RAD
        and abs(wrong_rad) > CONTRADICTED_RAD + 2.0 * sigma_rad
    )


def _yaw_between(q_nb: Quat, other_q_nb: Quat) -> float:
    """Angle about down from the other attitude to this one."""
    return to_euler(multiply(q_nb, conjugate(other_q_nb)))[2]


def _tilt_between(q_nb: Quat, other_q_nb: Quat) -> float:
    """Angle between two attitudes' down axes."""
    roll, pitch, _ = to_euler(multiply(q_nb, conjugate(other_q_nb)))
    return math.acos(min(1.0, math.cos(roll) * math.cos(pitch)))


def _sum_of_dv(step: ImuStep, later: deque[tuple[ImuStep, Rest | None]]) -> Vec3:
    x, y, z = step.dv_b_mps
    for each, _ in later:
        dx, dy, dz = each.dv_b_mps
        x, y, z = x + dx, y + dy, z + dz
    return (x, y, z)


def _length_ns(step: ImuStep) -> int:
    return round(step.dt_s * 1e9)


def _set_block(eskf: Eskf, where: slice, variances: list[float]) -> None:
    """Make some errors known so well, and independent of all others."""
    P = eskf.P.copy()
    P[where, :] = P[:, where] = 0.0
    P[where, where] = np.diag(variances)
    eskf.P = P


def _turn(eskf: Eskf, yaw_rad: float) -> None:
    """Turn the attitude about down, and its covariance with it."""
    nominal = eskf.nominal
    eskf.nominal = nominal._replace(q_nb=turn_about_down(nominal.q_nb, yaw_rad))
    sine, cosine = math.sin(yaw_rad), math.cos(yaw_rad)
    T = np.eye(N_ERRORS)
    T[6:8, 6:8] = [[cosine, -sine], [sine, cosine]]
    eskf.P = T @ eskf.P @ T.T


def _set_yaw_covariance(eskf: Eskf, sigma_rad: float) -> None:
    """A heading of the vehicle was taken: the box's yaw is that less the mounting.

    Notes
    -----
    theta_d = course - mu_yaw: var = sigma^2 + var(mu), cov(theta_d, mu) = -var(mu).
    """
    P = eskf.P.copy()
    P[8, :] = P[:, 8] = 0.0
    row = -P[MOUNT_YAW, :].copy()
    P[8, :] = P[:, 8] = row
    P[8, 8] = sigma_rad**2 + P[MOUNT_YAW, MOUNT_YAW]
    eskf.P = P


def _gravity_is_down(eskf: Eskf) -> Measurement:
    """Of a body of which nothing is known, the mean force is gravity.

    Notes
    -----
    0 = a_n, level axes: z = -f_n, H = [f_n x] theta's level part.
    """
    fn, fe, fd = (eskf.a_n[0], eskf.a_n[1], eskf.a_n[2] - eskf.gravity_mps2)
    H = np.zeros((2, N_ERRORS))
    H[0, 7], H[1, 6] = fd, -fd
    return Measurement(
        np.array([-fn, -fe]), H[:, :], np.eye(2) * LEVELLING_SIGMA_MPS2**2
    )


_ = ATTITUDE
