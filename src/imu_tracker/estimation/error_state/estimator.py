"""The error-state estimator: also estimates tilt, heading, biases and mounting.

This module combines its parts and advances them in time. The filters lag behind the
present (`fixed_lag`), are propagated by steps (`propagation`), corrected by fixes
(`fix_update`) and aligned (`hypotheses/alignment`). Rows are predicted from the
filters' instant through the buffered steps.
"""

import math

import numpy as np

from imu_tracker.estimation.error_state.constraints.wheel_aiding import WheelAiding
from imu_tracker.estimation.error_state.filter import Eskf
from imu_tracker.estimation.error_state.fix_update import FixUpdate
from imu_tracker.estimation.error_state.fixed_lag import FixedLagBuffer
from imu_tracker.estimation.error_state.hypotheses.alignment import Alignment
from imu_tracker.estimation.error_state.hypotheses.combined import Combined
from imu_tracker.estimation.error_state.hypotheses.noise_bank import (
    START_LEVEL,
    NoiseBank,
    known_level,
)
from imu_tracker.estimation.error_state.hypotheses.reorient import mount_along_course
from imu_tracker.estimation.error_state.platform import Platform
from imu_tracker.estimation.error_state.propagation import Propagation
from imu_tracker.estimation.error_state.smoothing.history import History
from imu_tracker.estimation.error_state.states import GYRO_BIAS
from imu_tracker.estimation.error_state.warm_start import (
    FRESH_S,
    PARKED_YAW_SIGMA_RAD,
    Downtime,
    LearnedParameters,
    begin_with,
    grown,
    is_parked,
    is_remounted,
    learned_from,
    place_of,
)
from imu_tracker.estimation.estimate import Estimate
from imu_tracker.estimation.receiver.fix_period import FixPeriod
from imu_tracker.estimation.receiver.gate import FixOutcome
from imu_tracker.estimation.report import EstimatorReport, figures_of
from imu_tracker.estimation.tuning import LATEST_FIX_S
from imu_tracker.geometry.rotation import to_euler
from imu_tracker.motion.preintegration import ImuStep
from imu_tracker.motion.standstill import Rest
from imu_tracker.samples import GpsFix, ImuSample, Vec3


class ErrorState:
    """Strapdown navigation with all its errors estimated.

    Parameters
    ----------
    profile : {"auto", "free", "vehicle", "walker"}
    lever_arm_m : Vec3, body axes
        From the chip to the antenna.
    prior : LearnedParameters, optional
        What an earlier run learnt; its latencies are delays here, see `warm_start`.
    uses_wheels : bool
        Whether an outage's speed is taken from the vibration of the wheels.
    fix_period : FixPeriod, optional
        The tracker's, which sees every fix.
    history : History, optional
    """

    in_hindsight = True

    def __init__(
        self,
        profile: str,
        lever_arm_m: Vec3 = (0.0, 0.0, 0.0),
        prior: LearnedParameters | None = None,
        *,
        uses_wheels: bool = True,
        fix_period: FixPeriod | None = None,
        history: History | None = None,
    ) -> None:
        self._notices: list[str] = []
        self._notify = self._notices.append
        self._wheel_aiding = WheelAiding(self._notify) if uses_wheels else None
        self._temp_degc: float | None = None
        self._prior, self._history = prior, history
        self._since: tuple[Downtime, GpsFix | None] | None = None  # to be recalled
        level = START_LEVEL if prior is None else known_level(prior.noise_level)
        self._platform = Platform(profile)
        self._bank = NoiseBank(level, is_vehicle=self._platform.is_vehicle)
        self._alignment = Alignment(self._bank, self._platform, self._notify)
        self._propagation = Propagation(self._bank, self._alignment, self._platform)
        self._fixes = FixUpdate(
            *(lever_arm_m, self._bank, self._alignment, self._platform),
            *(self._propagation, self._notify, fix_period or FixPeriod()),
        )
        self._buffer = FixedLagBuffer()
        self._output = Combined(
            *(lever_arm_m, self._bank, self._alignment, self._platform),
            *(self._propagation, self._fixes, self._buffer),
        )
        if history is not None:
            history.begin(self._bank.filters, self._fixes.comparison)
        if prior is not None:
            if self._platform.load_prior(prior.profile):
                self._change_profile()
            self._buffer.shift_ns = round(prior.latency_s * 1e9)

    @property
    def _eskf(self) -> Eskf:
        return self._bank.main

    def start(self, lat_rad: float, lon_rad: float, sigma_m: float) -> None:
        """Begin at a place known to `sigma_m` per axis, at any speed."""
        self._propagation.start(lat_rad, lon_rad, sigma_m)
        self._fixes.alt_origin_m = None

    def add_sample(self, sample: ImuSample) -> None:
        """Take a sample at the IMU's own rate: its vibration, not its motion."""
        if self._wheel_aiding is not None and self._platform.is_vehicle:
            self._wheel_aiding.add_sample(sample)

    def add_step(self, step: ImuStep, rest: Rest | None) -> None:
        """Queue a step; the filters follow behind."""
        self._buffer.add_step(step, rest)
        for each in self._buffer.due():
            self._propagate(*each)

    def _propagate(self, step: ImuStep, rest: Rest | None) -> None:
        """Take the oldest step into the filters; rest is confirmed in hindsight."""
        rests = rest is not None and self._buffer.confirms_rest(self._eskf, step)
        self._propagation.add_step(step, rest if rests else None)
        self._temp_degc = step.temp_degc
        if self._wheel_aiding is not None and self._platform.is_vehicle:
            self._wheel_aiding.update(self._bank.filters, self._propagation)
        self._load_prior()
        if self._history is not None and self._propagation.is_predicted:
            self._history.mark(self._bank.filters, self._output.scene())

    def update(self, fix: GpsFix, instant_ns: int, start_sigma_m: float) -> FixOutcome:
        """Bring the filters to the fix's instant, and correct them."""
        instant_ns += self._buffer.shift_ns
        self._buffer.learn_lag(instant_ns)
        for each in self._buffer.until(instant_ns):
            self._propagate(*each)
        self._propagation.predict()
        filter_ns = self._eskf.nominal.t_ns
        ahead_s = (instant_ns - filter_ns) * 1e-9 if filter_ns else 0.0
        if start_sigma_m > 0.0:
            self.start(fix.lat_rad, fix.lon_rad, start_sigma_m)
            ahead_s = min(max(ahead_s, -0.1), 0.1)
        elif abs(ahead_s) > LATEST_FIX_S:
            return FixOutcome.TOO_LATE
        outcome = self._fixes.update(fix, ahead_s)
        if outcome is FixOutcome.REACQUIRED:
            self._alignment.discard_prior()
        if outcome is FixOutcome.ACCEPTED:
            self._learn(fix)
        used = outcome in (FixOutcome.ACCEPTED, FixOutcome.REACQUIRED)
        return FixOutcome.INITIALISED if start_sigma_m > 0.0 and used else outcome

    def _learn(self, fix: GpsFix) -> None:
        """Draw conclusions from a fix beyond those of the filters."""
        if self._alignment.is_aligned:
            self._buffer.fold_delay(self._bank.filters)
        if not self._alignment.is_level:
            return
        if self._platform.adopt_found_profile():
            self._change_profile()
        position_ne = np.array(self._propagation.frame.to_ne(fix.lat_rad, fix.lon_rad))
        self._alignment.update(fix, position_ne, self._fixes.receiver)

    def _change_profile(self) -> None:
        """Constrain the body as its new profile allows."""
        is_vehicle = self._platform.is_vehicle
        self._fixes.change_profile()
        self._propagation.constraints.reset_gait()
        for eskf in self._bank.filters:
            eskf.set_vehicle(is_vehicle=is_vehicle)
            if is_vehicle and self._alignment.is_aligned:
                mount_along_course(eskf)
        self._notify(f"profile: {self._platform.profile}")

    @property
    def contradicts_receiver(self) -> bool:
        """Whether the IMU is being relearnt, and the receiver is followed alone."""
        return self._fixes.comparison.odds.is_imu_out

    @property
    def profile(self) -> str:
        """The configured profile, or the one that was found."""
        return self._platform.profile

    def estimate_after(self, dt_s: float) -> Estimate:
        """Estimate `dt_s` after the end of the last step."""
        return self._output.estimate_after(dt_s)

    def speed(self) -> tuple[float, float]:
        """Horizontal speed in m/s and its standard deviation."""
        return self._output.speed()

    def gyro_bias(self) -> tuple[Vec3, float]:
        """Gyro bias in rad/s, body axes, and its standard deviation per axis."""
        P = self._eskf.P
        worst = max(P.diagonal()[GYRO_BIAS].tolist())
        return self._eskf.gyro_bias_radps, math.sqrt(max(worst, 0.0))

    # ------------------------------------------------------------------- for people

    def take_notices(self) -> list[str]:
        """Transitions since the last call, for the log."""
        notices = self._notices.copy()
        self._notices.clear()
        return notices

    def learned_parameters(self) -> LearnedParameters | None:
        """What a next start can begin with; None: nothing, or not yet."""
        if not self._alignment.is_level or self._since is not None:
            return None
        eskf = self._eskf
        learnt = learned_from(
            eskf,
            profile=self._platform.profile,
            noise_level=self._bank.level,
            shift_s=self._buffer.shift_ns * 1e-9,
        )
        place = None
        if self._alignment.is_aligned:
            is_at_rest = self._propagation.rest is not None
            place = place_of(eskf, self._propagation.frame, is_at_rest=is_at_rest)
        wheels = self._wheel_aiding and self._wheel_aiding.learnt()
        return learnt._replace(temp_degc=self._temp_degc, place=place, wheels=wheels)

    def load_prior(self, since: Downtime, fix: GpsFix | None) -> None:
        """Begin with what an earlier run learnt, as soon as down is known."""
        if self._prior is not None:
            self._since = since, fix
            self._load_prior()

    def _load_prior(self) -> None:
        level_q = self._alignment.level_q
        if self._prior is None or self._since is None or level_q is None:
            return
        (since, fix), self._since = self._since, None
        temps = self._prior.temp_degc, self._temp_degc
        if temps[0] is not None and temps[1] is not None:
            since = since._replace(warmer_k=temps[1] - temps[0])
        prior = grown(self._prior, since)
        if self._platform.is_vehicle and is_remounted(prior, level_q):
            # Perhaps another box: its biases cannot be separated from the tilt.
            self._notify("the box was turned since the last run; learnt anew")
            return
        for eskf in self._bank.filters:
            begin_with(eskf, prior, takes_mounting=self._platform.is_vehicle)
        if self._wheel_aiding is not None and prior.wheels is not None:
            self._wheel_aiding.load(prior.wheels, self._bank.filters)
        if prior.place is not None and is_parked(prior, since, level_q, fix):
            sigma_rad = math.hypot(prior.place.yaw_sigma_rad, PARKED_YAW_SIGMA_RAD)
            self._alignment.set_parked_yaw(to_euler(prior.place.q_nb)[2], sigma_rad)
        is_fresh = since.elapsed_s is not None and abs(since.elapsed_s) < FRESH_S
        self._alignment.prior.note(is_fresh=is_fresh)
        self._notify("began with what the last run learnt")

    def report(self) -> EstimatorReport:
        """What was learnt, for people."""
        fixes, shift_s = self._fixes, self._buffer.shift_ns * 1e-9
        report: EstimatorReport = {
            "estimator": "error-state",
            "profile": self._platform.profile,
        }
        report.update(figures_of(self._eskf, self.gyro_bias()[1]))
        report["delay_s"] += shift_s
        report["velocity_delay_s"] += shift_s
        report.update(
            {
                "velocity_sigma_mps": math.sqrt(fixes.receiver.velocity_var),
                "fix_noise_level": fixes.receiver.nis_level,
                "fix_period_s": fixes.receiver.period_s,
                "lag_s": self._buffer.lag_ns * 1e-9,
                "nis_mean": fixes.nis_mean,
                "fix_log_likelihood": fixes.log_likelihood_mean,
                "noise_level": self._bank.level,
                "wheels": self._wheel_aiding and self._wheel_aiding.report(),
                "hypotheses": self._output.weights(),
            }
        )
        return report
