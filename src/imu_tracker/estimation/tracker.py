"""Handles time: the order of events, late fixes, and the instants of the rows.

Events come in order of arrival; estimates are made in order of the instants that the
events describe. A fix describes an instant before its arrival, and each estimator
handles that in its own way: error-state lags behind the present by the latency of the
fixes (`fixed_lag`); six-state returns to a snapshot of that instant and repeats the
steps since then (`rewind`). Rows are at multiples of the output interval in UTC and
never use events that arrived after them.
"""

import math
from collections import Counter
from collections.abc import Iterable
from typing import Final

from imu_tracker.estimation.error_state.warm_start import Downtime, LearnedParameters
from imu_tracker.estimation.estimate import R95_PER_SIGMA
from imu_tracker.estimation.life_cycle import Phase
from imu_tracker.estimation.prediction import Prediction, Turning, predict
from imu_tracker.estimation.receiver.fix_period import FixPeriod
from imu_tracker.estimation.receiver.gate import POSITION_RESET, FixOutcome
from imu_tracker.estimation.receiver.utc import UtcClock
from imu_tracker.estimation.report import EstimatorReport
from imu_tracker.estimation.rewind import COAST_NS, USED_OUTCOMES
from imu_tracker.estimation.rows import ModeMonitor, RowGrid
from imu_tracker.estimation.settings import TrackerSettings, navigator_of, relative_to
from imu_tracker.motion.preintegration import ImuStep, Preintegrator
from imu_tracker.motion.standstill import Rest, StandstillDetector
from imu_tracker.samples import GpsFix, ImuSample, NavState, UtcTime

COAST_AFTER_NS: Final = 400_000_000
"""A step through silence is made so long after its beginning: until then rows wait for
the IMU, and no row may come half a second late."""

REST_VETO_NS: Final = 10_000_000_000
REST_VETO_FIXES: Final = 5
"""Rejected fixes that agree veto standstill for the longer of these: until the filter
has learnt the speed from them, when the receiver sends none."""

START_FACTOR: Final = 10.0
"""The filter starts with ten times the sigma of the first fix, which then corrects it
like any other."""

UNUSABLE_OUTCOMES: Final = (
    FixOutcome.TOO_LATE,
    FixOutcome.UNDATED,
    FixOutcome.FROZEN,
)
"""Of these not even the speed is used."""

_NO_ROWS: Final[list[NavState]] = []


class Tracker:
    """Turns events into rows.

    Parameters
    ----------
    settings : TrackerSettings
    """

    def __init__(self, settings: TrackerSettings) -> None:
        self._settings = settings
        self._fixes: Counter[str] = Counter()
        self._notices: list[str] = []
        self._notify = self._notices.append
        self._fix_period = FixPeriod()
        self._preintegrator = Preintegrator()
        self._turning = Turning()
        self._navigator = navigator_of(settings, self._fix_period)
        self._standstill = StandstillDetector(in_hindsight=self._navigator.in_hindsight)
        if settings.prior is not None:
            self._standstill.vibration.load_prior(settings.prior.still_levels)
        self._utc = UtcClock(round(settings.assumed_latency_s * 1e9))
        self._grid = RowGrid(settings.rate_hz, self._notify)
        self._modes = ModeMonitor(self._fix_period, self._notify)
        self._last_step: ImuStep | None = None
        self._last_rest: Rest | None = None
        self._now_ns = 0
        self._step_ns: int | None = None  # end of the last step
        self._phase = Phase.WAITING
        self._begin_ns = 0  # rows begin no earlier
        self._n_outliers = 0  # in a row

    # ---------------------------------------------------------------- the events

    def on_imu(self, sample: ImuSample) -> list[NavState]:
        """Take a sample; return the rows that became due."""
        t_ns = sample[0]
        rows = _NO_ROWS
        if self._step_ns is not None and t_ns >= self._step_ns + COAST_AFTER_NS:
            rows = self.advance(t_ns)
        elif t_ns > self._now_ns:
            self._now_ns = t_ns
        self._navigator.add_sample(sample)
        step = self._preintegrator.add_sample(sample)
        return rows if step is None else rows + self._on_step(step)

    def advance(self, t_ns: int) -> list[NavState]:
        """Let stream time pass; return the rows that became due.

        Called before what arrived at `t_ns` is passed in, and at any time when nothing
        arrives: rows are the same however often it is called.
        """
        rows: list[NavState] = []
        while self._step_ns is not None and t_ns >= self._step_ns + COAST_AFTER_NS:
            self._now_ns = max(self._now_ns, self._step_ns + COAST_AFTER_NS)
            end_ns = self._step_ns + COAST_NS
            rows += self._on_step(self._preintegrator.bridge(end_ns, COAST_NS * 1e-9))
        self._now_ns = max(self._now_ns, t_ns)
        return rows + self._due_rows()

    def on_time(self, time: UtcTime) -> None:
        """Learn UTC from a receiver that does not know the place yet."""
        self._add_epoch(time.t_ns, time.utc_s)
        if self._settings.start is not None and self._phase is Phase.WAITING:
            self._load_prior(time.utc_s, None)
            lat_rad, lon_rad = self._settings.start
            self._navigator.start(
                lat_rad, lon_rad, self._settings.start_radius_m / R95_PER_SIGMA
            )
            self._enter(Phase.GUESS, time.t_ns)
            self._notify("started at the configured place, without a fix")

    def on_fix(self, fix: GpsFix) -> FixOutcome:
        """Take a fix at the instant that it describes."""
        self._fix_period.add_fix(fix)
        self._modes.add_fix(fix)
        if fix.utc_s is not None:
            if self._phase is Phase.WAITING:
                # A receiver without a fix may have sent a wrong date until now.
                self._utc = UtcClock(self._utc.latency_ns)
            self._add_epoch(fix.t_ns, fix.utc_s)
        instant_ns = self._utc.instant_of(fix)
        outcome = self._update(fix, instant_ns)
        self._fixes[outcome] += 1
        self._n_outliers = self._n_outliers + 1 if outcome is FixOutcome.OUTLIER else 0
        is_lone = self._n_outliers == 1  # a wild fix changes nothing
        if (
            fix.vel_ne_mps is not None
            and outcome not in UNUSABLE_OUTCOMES
            and not is_lone
        ):
            self._standstill.add_speed(fix.t_ns, math.hypot(*fix.vel_ne_mps))
        if self._n_outliers > 1 or outcome is FixOutcome.REACQUIRED:
            veto_ns = max(REST_VETO_NS, REST_VETO_FIXES * self._fix_period.shortest_ns)
            self._standstill.veto(self._now_ns + veto_ns)
        if outcome in USED_OUTCOMES:
            self._modes.set_used(self._now_ns)
        if outcome is FixOutcome.REACQUIRED:
            self._notify(POSITION_RESET)
        return outcome

    def _add_epoch(self, arrival_ns: int, utc_s: float) -> None:
        jump_s = self._utc.add_epoch(arrival_ns, utc_s)
        if jump_s:
            follows = self._utc.follows(jump_s)
            self._notify(f"the receiver's time jumped by {jump_s:+.1f} s; {follows}")

    def _update(self, fix: GpsFix, instant_ns: int) -> FixOutcome:
        """Give the fix to the navigator; until the first row, each one starts it.

        A receiver's buffer may be full of old fixes.
        """
        is_first = self._phase is not Phase.RUNNING
        if self._utc.is_uncertain and not is_first:
            return FixOutcome.UNDATED
        start_sigma_m = 0.0
        if is_first:
            if self._phase is Phase.WAITING:
                self._load_prior(fix.utc_s, fix)
            has_rows = self._grid.next_utc_ns is not None
            self._enter(Phase.RUNNING if has_rows else Phase.STARTING, instant_ns)
            start_sigma_m = START_FACTOR * fix.sigma_h_m
        return self._navigator.update(fix, instant_ns, start_sigma_m)

    def _load_prior(self, utc_s: float | None, fix: GpsFix | None) -> None:
        """Begin with what an earlier run learnt, now that the time is known."""
        prior = self._settings.prior
        if prior is not None:
            elapsed_s = None
            if utc_s is not None and prior.utc_s is not None:
                elapsed_s = utc_s - prior.utc_s
            self._navigator.load_prior(Downtime(elapsed_s, warmer_k=None), fix)

    def _enter(self, phase: Phase, t_ns: int) -> None:
        """Go on to another phase; from the first one on rows can be made."""
        if self._phase is Phase.WAITING:
            self._notify("tracking begins")
            self._begin_ns = self._now_ns
        self._phase = phase
        if self._step_ns is None:
            self._step_ns = t_ns

    # ------------------------------------------------------------- steps and rows

    def _on_step(self, step: ImuStep) -> list[NavState]:
        navigator = self._navigator
        bias, bias_sigma = navigator.gyro_bias()
        rest = self._standstill.add_step(step, bias, bias_sigma, *navigator.speed())
        navigator.add_step(step, rest)
        self._preintegrator.gyro_bias_radps = bias
        self._turning.add_step(step, bias)
        self._step_ns = step.t_ns
        self._last_step, self._last_rest = step, rest
        return self._due_rows()

    def _due_rows(self) -> list[NavState]:
        if self._phase is Phase.WAITING or self._step_ns is None:
            return _NO_ROWS
        now_ns, step_ns = self._now_ns, self._step_ns
        due = self._grid.due(self._utc, self._begin_ns, now_ns, step_ns)
        rows = [self._row(*at_ns) for at_ns in due]
        if self._phase is Phase.STARTING and self._grid.next_utc_ns is not None:
            self._enter(Phase.RUNNING, step_ns)
        return rows

    def _row(self, row_ns: int, row_utc_ns: int) -> NavState:
        """State at an instant near the end of the last step."""
        assert self._step_ns is not None
        estimate = self._navigator.estimate_after((row_ns - self._step_ns) * 1e-9)
        step, navigator = self._last_step, self._navigator
        mode = self._modes.mode_at(
            row_ns,
            has_imu=step is not None and not step.is_gap,
            is_resting=self._last_rest is not None,
            is_imu_out=navigator.contradicts_receiver,
        )
        # A row that is dated wrong is right of another instant than its date.
        misdated_s = self._utc.behind_ns(self._grid.period_ns) * 1e-9
        way_m = misdated_s * math.hypot(*estimate.v_n_mps[:2])
        return NavState(
            row_ns,
            row_utc_ns * 1e-9,
            estimate.lat_rad,
            estimate.lon_rad,
            estimate.alt_m,
            estimate.v_n_mps,
            estimate.q_nb,
            estimate.r95_m + way_m,
            mode,
            self._utc.is_sure,
        )

    def predict(self, after_s: Iterable[float]) -> list[Prediction]:
        """Say where it will be, counted from the newest sample; [] before the start."""
        if self._phase is Phase.WAITING or self._step_ns is None:
            return []
        navigator = self._navigator
        estimate = navigator.estimate_after((self._now_ns - self._step_ns) * 1e-9)
        turn_radps = 0.0
        if self._last_rest is None:
            turn_radps = self._turning.about_down_radps(estimate)
        return predict(
            estimate,
            navigator.speed()[1],
            turn_radps,
            navigator.profile,
            after_s,
        )

    # ------------------------------------------------------------------- for people

    @property
    def is_standing(self) -> bool:
        """Whether the IMU shows standstill, whatever the receiver reports."""
        return self._standstill.is_standing

    @property
    def counters(self) -> Counter[str]:
        """Fixes by what became of them, samples by what was wrong with them."""
        fixes = Counter({f"fixes_{k}": n for k, n in self._fixes.items()})
        return fixes + self._preintegrator.counters

    def take_notices(self) -> list[str]:
        """Transitions since the last call, for the log."""
        notices = self._notices.copy()
        self._notices.clear()
        return notices + self._navigator.take_notices()

    def learned_parameters(self) -> LearnedParameters | None:
        """What a next start can begin with; None: nothing, or not yet."""
        learnt = self._navigator.learned_parameters()
        if learnt is None or self._phase is Phase.WAITING:
            return None
        row_utc_ns = self._grid.next_utc_ns
        return relative_to(learnt, self._utc.latency_ns * 1e-9)._replace(
            utc_s=None if row_utc_ns is None else row_utc_ns * 1e-9,
            still_levels=self._standstill.vibration.levels,
        )

    def report(self) -> EstimatorReport:
        """What was learnt."""
        vibration, report = self._standstill.vibration, self._navigator.report()
        gyro_radps = vibration.gyro_threshold_radps
        report["still_gyro_threshold_dps"] = math.degrees(gyro_radps)
        report["still_accel_threshold_mps2"] = vibration.accel_threshold_mps2
        report["utc_jumps"], report["utc_holes"] = self._utc.jumps, self._utc.holes
        return report
