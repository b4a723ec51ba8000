"""The error-state filter: learns its tilt, its biases, its heading, its mounting.

Here its parts are put together and driven through time. The filters stay some tenths
of a second behind (`fixed_lag`), move on by steps (`propagation`), are corrected by
fixes (`fix_update`) and turned the right way round (`hypotheses/alignment`); rows are
predicted from their instant through the steps that wait.
"""

import math
from typing import Final

import numpy as np

from imu_tracker.estimation.error_state.filter import Eskf
from imu_tracker.estimation.error_state.fix_update import FixUpdate
from imu_tracker.estimation.error_state.fixed_lag import Trail
from imu_tracker.estimation.error_state.hearing import Hearing
from imu_tracker.estimation.error_state.hypotheses.alignment import Alignment
from imu_tracker.estimation.error_state.hypotheses.mixture import radius_m
from imu_tracker.estimation.error_state.hypotheses.noise_bank import (
    START_LEVEL,
    NoiseBank,
    known_level,
)
from imu_tracker.estimation.error_state.hypotheses.receiver_alone import (
    AloneEstimate,
)
from imu_tracker.estimation.error_state.hypotheses.reorient import mount_along_course
from imu_tracker.estimation.error_state.platform import Carrier
from imu_tracker.estimation.error_state.propagation import Propagation
from imu_tracker.estimation.error_state.states import (
    DELAY,
    GYRO_BIAS,
    MOUNT_PITCH,
    MOUNT_YAW,
    N_ERRORS,
    RECEIVER,
    Array,
)
from imu_tracker.estimation.error_state.warm_start import (
    FRESH_S,
    PARKED_YAW_SIGMA_RAD,
    Learnt,
    Place,
    Since,
    begin_with,
    begin_with_latency,
    grown,
    is_parked,
    is_remounted,
    learnt_of,
)
from imu_tracker.estimation.estimate import R95_PER_SIGMA, Estimate, r95_of
from imu_tracker.estimation.receiver.gate import FixOutcome
from imu_tracker.geometry.geodesy import LocalFrame
from imu_tracker.geometry.rotation import rotate, to_euler
from imu_tracker.motion.preintegration import ImuStep
from imu_tracker.motion.standstill import Rest
from imu_tracker.samples import GpsFix, ImuSample, Vec3

FOLD_S: Final = 0.02
"""A delay beyond this moves the instants of the fixes, half a step of 40 ms; the state
begins again at zero, where v times delay is exact."""

LATEST_S: Final = 3.0
"""A fix that lies further from the filter's instant is of no use."""

LONGER_SHARE: Final = 0.2
"""Orbits and air are wrong for hours, not for the minute of the state for a receiver's
error, and the filter takes that part for a place: a fifth of that state's variance."""

_LARGEST_RADIUS_M: Final = 2e7  # half way round the Earth


class ErrorState:
    """Strapdown navigation with all its errors estimated.

    Parameters
    ----------
    profile : {"auto", "free", "vehicle", "walker"}
    lever_arm_m : Vec3, body axes
        From the chip to the antenna.
    prior : Learnt, optional
        What an earlier run learnt; its latency counts from what the tracker assumes.
    hears_wheels : bool
        Whether an outage's speed is taken from the vibration of the wheels.
    """

    in_hindsight = True

    def __init__(
        self,
        profile: str,
        lever_arm_m: Vec3 = (0.0, 0.0, 0.0),
        prior: Learnt | None = None,
        *,
        hears_wheels: bool = True,
    ) -> None:
        self._hearing = Hearing(self._notify) if hears_wheels else None
        self._lever_arm_m = lever_arm_m
        self._notices: list[str] = []
        self._temp_degc: float | None = None
        self._shift_ns = 0  # fixes describe so much later than the tracker says
        self._prior = prior
        self._since: tuple[Since, GpsFix | None] | None = None  # to be recalled
        level = START_LEVEL if prior is None else known_level(prior.noise_level)
        self._carrier = Carrier(profile)
        self._bank = NoiseBank(level, is_vehicle=self._carrier.is_vehicle)
        self._alignment = Alignment(self._bank, self._carrier, self._notify)
        self._propagation = Propagation(self._bank, self._alignment, self._carrier)
        self._fixes = FixUpdate(
            *(lever_arm_m, self._bank, self._alignment, self._carrier),
            *(self._propagation, self._notify),
        )
        self._trail = Trail()
        if prior is not None:
            if self._carrier.recall(prior.profile):
                self._change_profile()
            self._shift_ns = round(prior.latency_s * 1e9)

    @property
    def _eskf(self) -> Eskf:
        return self._bank.main

    def start(self, lat_rad: float, lon_rad: float, sigma_m: float) -> None:
        """Begin at a place known to `sigma_m` per axis, at any speed."""
        self._propagation.start(lat_rad, lon_rad, sigma_m)
        self._fixes.alt_origin_m = None

    # -------------------------------------------------------------- steps and fixes

    def add_sample(self, sample: ImuSample) -> None:
        """Take a sample at the IMU's own rate: its vibration, not its motion."""
        if self._hearing is not None and self._carrier.is_vehicle:
            self._hearing.add_sample(sample)

    def step(self, step: ImuStep, rest: Rest | None) -> None:
        """Queue a step; the filters follow behind."""
        self._trail.add(step, rest)
        for each in self._trail.due():
            self._advance(*each)

    def _advance(self, step: ImuStep, rest: Rest | None) -> None:
        """Take the oldest step into the filters; rest is believed in hindsight."""
        rests = rest is not None and self._trail.confirms_rest(self._eskf, step)
        self._propagation.take(step, rest if rests else None)
        self._temp_degc = step.temp_degc
        if self._hearing is not None and self._hears:
            self._hearing.update(self._bank.filters, self._propagation)
        if self._since is not None:
            self._recall()

    @property
    def _hears(self) -> bool:
        return self._carrier.is_vehicle and self._alignment.is_aligned

    def take(self, fix: GpsFix, instant_ns: int, start_sigma_m: float) -> FixOutcome:
        """Bring the filters to the fix's instant, and correct them."""
        instant_ns += self._shift_ns
        self._trail.learn_lag(instant_ns)
        for each in self._trail.until(instant_ns):
            self._advance(*each)
        self._propagation.predict()
        filter_ns = self._eskf.nominal.t_ns
        ahead_s = (instant_ns - filter_ns) * 1e-9 if filter_ns else 0.0
        if start_sigma_m > 0.0:
            self.start(fix.lat_rad, fix.lon_rad, start_sigma_m)
            ahead_s = min(max(ahead_s, -0.1), 0.1)
        elif abs(ahead_s) > LATEST_S:
            return FixOutcome.TOO_LATE
        outcome = self._fixes.update(fix, ahead_s)
        if outcome is FixOutcome.REACQUIRED:
            self._alignment.give_up_memory()
        if outcome is FixOutcome.ACCEPTED:
            self._learn(fix)
        used = outcome in (FixOutcome.ACCEPTED, FixOutcome.REACQUIRED)
        return FixOutcome.INITIALISED if start_sigma_m > 0.0 and used else outcome

    def _learn(self, fix: GpsFix) -> None:
        """Draw conclusions from a fix beyond those of the filters."""
        self._fold_delay()
        if not self._alignment.is_level:
            return
        if self._carrier.take_change():
            self._change_profile()
        position_ne = np.array(self._propagation.frame.to_ne(fix.lat_rad, fix.lon_rad))
        self._alignment.observe(fix, position_ne, self._fixes.receiver)

    def _fold_delay(self) -> None:
        """Move the instants of the fixes by the delay that was found."""
        delay_s = self._eskf.delay_s
        if abs(delay_s) < FOLD_S or not self._alignment.is_aligned:
            return
        self._shift_ns += round(delay_s * 1e9)
        for each in self._bank.filters:
            each.delay_s -= delay_s
            each.velocity_delay_s -= delay_s

    def _change_profile(self) -> None:
        """Constrain the body as its new profile allows."""
        is_vehicle = self._carrier.is_vehicle
        self._fixes.change_profile()
        self._propagation.behaviour.forget_gait()
        for eskf in self._bank.filters:
            eskf.set_vehicle(is_vehicle=is_vehicle)
            if is_vehicle and self._alignment.is_aligned:
                mount_along_course(eskf)
        self._notify(f"profile: {self._carrier.profile}")

    # -------------------------------------------------------------------- estimates

    @property
    def contradicts_receiver(self) -> bool:
        """Whether the IMU is being relearnt, and the receiver is followed alone."""
        return self._fixes.comparison.odds.is_imu_out

    @property
    def _has_imu_lead(self) -> bool:
        fixes = self._fixes
        is_silent = self._propagation.is_imu_silent
        return not fixes.comparison.alone.is_running or (
            fixes.comparison.odds.has_imu_lead and not is_silent
        )

    def estimate_after(self, dt_s: float) -> Estimate:
        """Place of the leading hypothesis, and the radius that holds both."""
        imu, alone = self._by_imu(dt_s), self._by_receiver(dt_s)
        if alone is None:
            return imu
        here = LocalFrame.at(imu.lat_rad, imu.lon_rad)
        apart_m = math.hypot(*here.to_ne(alone.lat_rad, alone.lon_rad))
        is_silent = self._propagation.is_imu_silent
        weight = 0.0 if is_silent else self._fixes.comparison.odds.imu_weight
        leader, other, share = imu, alone, weight
        if not self._has_imu_lead:
            leader, other, share = alone, imu, 1.0 - weight
        r95 = radius_m(
            [(share, 0.0, leader.r95_m), (1.0 - share, apart_m, other.r95_m)]
        )
        return leader._replace(r95_m=min(r95, _LARGEST_RADIUS_M))

    def _by_receiver(self, dt_s: float) -> Estimate | None:
        """Estimate without an IMU; height and attitude are the filter's."""
        if not self._fixes.comparison.alone.is_running:
            return None
        eskf, at = self._eskf, self._alone_at(dt_s)
        alt_origin_m = self._fixes.alt_origin_m
        alt_m = None if alt_origin_m is None else alt_origin_m - eskf.nominal.p_n[2]
        r95 = R95_PER_SIGMA * math.sqrt(at.position_var_m2)
        v_n = (*at.v_ne_mps, eskf.nominal.v_n[2])
        return Estimate(at.lat_rad, at.lon_rad, alt_m, v_n, eskf.nominal.q_nb, r95)

    def _alone_at(self, dt_s: float) -> AloneEstimate:
        """State of the receiver's hypothesis `dt_s` after the last step."""
        after_s = dt_s + self._eskf.delay_s
        t_ns = self._trail.now_ns + round(after_s * 1e9) + self._shift_ns
        return self._fixes.comparison.alone.estimate_at(
            t_ns, self._carrier.unknown_accel_psd
        )

    def _by_imu(self, dt_s: float) -> Estimate:
        """Predict from the filter's instant to one after the last step."""
        eskf, alignment, fixes = self._eskf, self._alignment, self._fixes
        t_ns = self._trail.now_ns + round(dt_s * 1e9) + self._shift_ns
        nominal = self._trail.predict(eskf, t_ns, alignment.can_use_force)
        left_s = (t_ns - nominal.t_ns) * 1e-9 if nominal.t_ns else dt_s
        left_s += eskf.delay_s
        (north, east, down), (vn, ve, vd) = nominal.p_n, nominal.v_n
        north, east, down = north + vn * left_s, east + ve * left_s, down + vd * left_s
        if alignment.is_aligned and any(self._lever_arm_m):
            ln, le, ld = rotate(nominal.q_nb, self._lever_arm_m)
            north, east, down = north + ln, east + le, down + ld
        lat, lon = self._propagation.frame.to_lat_lon(north, east)
        alt = None if fixes.alt_origin_m is None else fixes.alt_origin_m - down
        total_s = (t_ns - eskf.nominal.t_ns) * 1e-9 + eskf.delay_s
        r95 = max(r95_of(self._position_cov_m2(vn, ve, total_s)), fixes.doubt_m)
        return Estimate(
            lat, lon, alt, (vn, ve, vd), nominal.q_nb, min(r95, _LARGEST_RADIUS_M)
        )

    def _position_cov_m2(self, vn: float, ve: float, after_s: float) -> Array:
        """Covariance of p + v delay, carried over the time since the filter's."""
        P = self._eskf.P
        H = np.zeros((2, N_ERRORS))
        H[0, 0] = H[1, 1] = 1.0
        H[0, 3] = H[1, 4] = after_s
        if self._alignment.is_aligned:  # before, velocity itself follows the fixes
            H[0, DELAY], H[1, DELAY] = vn, ve
        cov: Array = H @ P @ H.T + LONGER_SHARE * P[RECEIVER, RECEIVER]
        return cov

    @property
    def profile(self) -> str:
        """The configured profile, or the one that was found."""
        return self._carrier.profile

    def speed(self) -> tuple[float, float]:
        """Horizontal speed in m/s and its standard deviation."""
        if not self._has_imu_lead:
            alone = self._alone_at(0.0)
            return math.hypot(*alone.v_ne_mps), math.sqrt(alone.velocity_var)
        vn, ve, _ = self._eskf.nominal.v_n
        return math.hypot(vn, ve), max(self._eskf.sigma(3), self._eskf.sigma(4))

    def gyro_bias(self) -> tuple[Vec3, float]:
        """Gyro bias in rad/s, body axes, and its standard deviation per axis."""
        P = self._eskf.P
        worst = max(P.diagonal()[GYRO_BIAS].tolist())
        return self._eskf.gyro_bias_radps, math.sqrt(max(worst, 0.0))

    # ------------------------------------------------------------------- for people

    def _notify(self, notice: str) -> None:
        self._notices.append(notice)

    def take_notices(self) -> list[str]:
        """Transitions since the last call, for the log."""
        notices, self._notices = self._notices, []
        return notices

    def learnt(self) -> Learnt | None:
        """What a next start can begin with; None: nothing, or not yet."""
        if not self._alignment.is_level or self._since is not None:
            return None
        eskf = self._eskf
        learnt = learnt_of(
            eskf,
            profile=self._carrier.profile,
            noise_level=self._bank.level,
            shift_s=self._shift_ns * 1e-9,
        )
        place = None
        if self._alignment.is_aligned:
            lat, lon = self._propagation.frame.to_lat_lon(*eskf.nominal.p_n[:2])
            place = Place(
                *(lat, lon, math.hypot(eskf.sigma(0), eskf.sigma(RECEIVER.start))),
                *(eskf.nominal.q_nb, eskf.sigma(8)),
                is_at_rest=self._propagation.rest is not None,
            )
        return learnt._replace(temp_degc=self._temp_degc, place=place)

    def recall(self, since: Since, fix: GpsFix | None) -> None:
        """Begin with what an earlier run learnt, as soon as down is known."""
        if self._prior is not None:
            self._since = since, fix
            self._recall()

    def _recall(self) -> None:
        level_q = self._alignment.level_q
        if self._prior is None or self._since is None or level_q is None:
            return
        (since, fix), self._since = self._since, None
        temps = self._prior.temp_degc, self._temp_degc
        if temps[0] is not None and temps[1] is not None:
            since = since._replace(warmer_k=temps[1] - temps[0])
        prior = grown(self._prior, since)
        if self._carrier.is_vehicle and is_remounted(prior, level_q):
            # Perhaps another box altogether: its biases cannot be told from the tilt.
            self._notify("the box was turned since the last run; learnt anew")
            return
        for eskf in self._bank.filters:
            begin_with(eskf, prior, takes_mounting=self._carrier.is_vehicle)
            begin_with_latency(eskf, prior)
        if prior.place is not None and is_parked(prior, since, level_q, fix):
            yaw_rad = to_euler(prior.place.q_nb)[2]
            sigma_rad = math.hypot(prior.place.yaw_sigma_rad, PARKED_YAW_SIGMA_RAD)
            self._alignment.recall_yaw(yaw_rad, sigma_rad)
        is_fresh = since.elapsed_s is not None and abs(since.elapsed_s) < FRESH_S
        self._alignment.remember(is_fresh=is_fresh)
        self._notify("began with what the last run learnt")

    def report(self) -> dict[str, object]:
        """What was learnt, for people."""
        eskf, fixes = self._eskf, self._fixes
        receiver = fixes.receiver
        roll, pitch, yaw = to_euler(eskf.q_vb)
        bias, sigma = self.gyro_bias()
        return {
            "estimator": "error-state",
            "profile": self._carrier.profile,
            "mounting_deg": [math.degrees(a) for a in (roll, pitch, yaw)],
            "mounting_sigma_deg": [
                math.degrees(eskf.sigma(i)) for i in (MOUNT_PITCH, MOUNT_YAW)
            ],
            "gyro_bias_dps": [math.degrees(b) for b in bias],
            "gyro_bias_sigma_dps": math.degrees(sigma),
            "accel_bias_mps2": list(eskf.accel_bias_mps2),
            "accel_bias_sigma_mps2": [eskf.sigma(i) for i in range(12, 15)],
            "yaw_sigma_deg": math.degrees(eskf.sigma(8)),
            "gyro_gain": list(eskf.gyro_gain),
            "axle_m": eskf.axle_m,
            "delay_s": eskf.delay_s + self._shift_ns * 1e-9,
            "delay_sigma_s": eskf.sigma(DELAY),
            "velocity_delay_s": eskf.velocity_delay_s + self._shift_ns * 1e-9,
            "velocity_sigma_mps": math.sqrt(receiver.velocity_var),
            "fix_noise_level": receiver.nis_level,
            "fix_period_s": receiver.period_s,
            "lag_s": self._trail.lag_ns * 1e-9,
            "nis_mean": fixes.nis_mean,
            "fix_log_likelihood": fixes.log_likelihood_mean,
            "noise_level": self._bank.level,
            "wheels": None if self._hearing is None else self._hearing.report(),
            "hypotheses": {
                "imu": fixes.comparison.odds.imu_weight,
                "receiver_alone": 1.0 - fixes.comparison.odds.imu_weight,
            },
        }
