"""Owns time: the order of events, the history for late ones, the grid of rows.

Events come in the order of arrival; estimates are made in the order of the instants
that the events describe. A fix that arrives describes an instant in the past; what that
means is the estimator's affair: error-state runs behind by as much (`fixed_lag`),
six-state returns to a snapshot of that instant and repeats the steps since (`rewind`).
Rows lie on the grid of UTC and never use what arrived after them.
"""

import math
from collections import Counter
from collections.abc import Iterable
from typing import Final, NamedTuple

from imu_tracker.estimation.error_state.estimator import ErrorState
from imu_tracker.estimation.error_state.warm_start import Learnt, Since
from imu_tracker.estimation.estimate import R95_PER_SIGMA
from imu_tracker.estimation.prediction import Prediction, Turning, predict
from imu_tracker.estimation.receiver.gate import FixOutcome
from imu_tracker.estimation.receiver.utc import UtcClock
from imu_tracker.estimation.rewind import (
    COAST_NS,
    USED_OUTCOMES,
    Navigator,
    Rewinding,
)
from imu_tracker.motion.preintegration import ImuStep, Preintegrator
from imu_tracker.motion.standstill import Rest, StandstillDetector
from imu_tracker.notices import Flapping
from imu_tracker.samples import GpsFix, ImuSample, Mode, Mount, NavState, UtcTime, Vec3

COAST_AFTER_NS: Final = 400_000_000
"""A step through silence is made so long after its beginning: until then rows wait for
the IMU, and no row may come half a second late."""

GPS_MODE_NS: Final = 2_000_000_000
GPS_MODE_PERIODS: Final = 1.5
"""A row is `gps` when a fix was used within the longer of these."""

REST_VETO_NS: Final = 10_000_000_000
REST_VETO_FIXES: Final = 5
"""Fixes that agree on another place speak against rest for the longer of these: until
the filter has learnt the speed from them, when the receiver does not tell it."""

TYPICAL_LATENCY_S: Final = 0.2
"""From the instant that an epoch describes to its first byte, for most receivers."""

START_FACTOR: Final = 10.0
"""At its start the filter knows its place ten times worse than the first fix says:
that fix is then taken like any other."""

UNHEARD_OUTCOMES: Final = (
    FixOutcome.TOO_LATE,
    FixOutcome.UNDATED,
    FixOutcome.FROZEN,
)
"""Of these not even the speed is believed."""

_NO_ROWS: Final[list[NavState]] = []

_SAID_OF_SENSORS: Final = {
    (True, True): "GPS in use",
    (True, False): "{no_gps}: dead reckoning",
    (False, True): "IMU unavailable: GPS alone",
    (False, False): "IMU unavailable, {no_gps}",
}
"""Whether there is an IMU, whether there is a receiver: changes are told."""


class TrackerSettings(NamedTuple):
    """What the configuration says to the estimation."""

    estimator: str = "error-state"
    profile: str = "auto"
    latency_s: float | None = None  # None: measured, by an estimator that can
    lever_arm_m: Vec3 = (0.0, 0.0, 0.0)
    rate_hz: int = 4
    mount: Mount | None = None  # None: the header's
    gps_date: str = ""
    start: tuple[float, float] | None = None  # latitude, longitude in radians
    start_radius_m: float = 50.0
    prior: Learnt | None = None  # what an earlier run learnt
    hears_wheels: bool = True


def navigator_of(settings: TrackerSettings, latency_s: float) -> Navigator:
    """Make the estimator that the configuration chooses."""
    if settings.estimator == "error-state":
        prior = settings.prior
        if prior is not None:
            prior = _later(prior, -latency_s)
        return ErrorState(
            *(settings.profile, settings.lever_arm_m, prior),
            hears_wheels=settings.hears_wheels,
        )
    # Imported here: filterpy brings scipy and matplotlib, 1.3 s and 70 MB.
    from imu_tracker.estimation.six_state.estimator import SixState

    profile = "free" if settings.profile == "auto" else settings.profile
    return Rewinding(SixState(profile, settings.lever_arm_m), profile)


def _later(learnt: Learnt, by_s: float) -> Learnt:
    """Count the latencies from another instant."""
    return learnt._replace(
        latency_s=learnt.latency_s + by_s,
        velocity_latency_s=learnt.velocity_latency_s + by_s,
    )


class Tracker:
    """Turns events into rows.

    Parameters
    ----------
    settings : TrackerSettings
    """

    def __init__(self, settings: TrackerSettings) -> None:
        self._settings = settings
        self._fixes: Counter[str] = Counter()
        self._preintegrator = Preintegrator()
        self._turning = Turning()
        latency_s = settings.latency_s
        if latency_s is None:
            latency_s = TYPICAL_LATENCY_S
        self._navigator = navigator_of(settings, latency_s)
        self._standstill = StandstillDetector(in_hindsight=self._navigator.in_hindsight)
        if settings.prior is not None:
            self._standstill.vibration.recall(settings.prior.still_levels)
        self._latency_ns = round(latency_s * 1e9)
        self._utc = UtcClock(self._latency_ns)
        self._period_ns = 1_000_000_000 // settings.rate_hz
        self._last_step: ImuStep | None = None
        self._last_rest: Rest | None = None
        self._now_ns = 0
        self._step_ns: int | None = None  # end of the last step
        self._is_started = self._is_guess = False
        self._begin_ns = 0  # rows begin no earlier
        self._row_utc_ns: int | None = None  # of the next row
        self._fix_ns: int | None = None
        self._fix_periods_ns = (1_000_000_000, 1_000_000_000)  # the last two
        self._n_outliers = 0  # in a row
        self._used_ns: int | None = None
        self._imu_flapping = Flapping()
        self._said_sensors = ""
        self._notices: list[str] = []

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
        step = self._preintegrator.add(sample)
        return rows if step is None else rows + self._on_step(step)

    def advance(self, t_ns: int) -> list[NavState]:
        """Let stream time pass; return the rows that became due.

        Called before what arrived at `t_ns` is told, and at any time when nothing
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
        self._hear_time(time.t_ns, time.utc_s)
        if self._settings.start is not None and not self._is_started:
            self._recall(time.utc_s, None)
            lat_rad, lon_rad = self._settings.start
            self._navigator.start(
                lat_rad, lon_rad, self._settings.start_radius_m / R95_PER_SIGMA
            )
            self._begin(time.t_ns)
            self._is_guess = True
            self._notices.append("started at the configured place, without a fix")

    def on_fix(self, fix: GpsFix) -> FixOutcome:
        """Take a fix at the instant that it describes."""
        self._learn_period(fix)
        instant_ns = fix.t_ns - self._latency_ns
        if fix.utc_s is not None:
            if not self._is_started:
                # A receiver without a fix may have told its own birthday until now.
                self._utc = UtcClock(self._latency_ns)
            self._hear_time(fix.t_ns, fix.utc_s)
            told_ns = self._utc.instant_ns(fix.utc_s)
            instant_ns = instant_ns if told_ns is None else min(told_ns, fix.t_ns)
        outcome = self._take(fix, instant_ns)
        self._fixes[outcome] += 1
        self._n_outliers = self._n_outliers + 1 if outcome is FixOutcome.OUTLIER else 0
        is_lone = self._n_outliers == 1  # a wild fix changes nothing
        if (
            fix.vel_ne_mps is not None
            and outcome not in UNHEARD_OUTCOMES
            and not is_lone
        ):
            self._standstill.observe_speed(fix.t_ns, math.hypot(*fix.vel_ne_mps))
        if self._n_outliers > 1 or outcome is FixOutcome.REACQUIRED:
            veto_ns = max(REST_VETO_NS, REST_VETO_FIXES * min(self._fix_periods_ns))
            self._standstill.veto(self._now_ns + veto_ns)
        if outcome in USED_OUTCOMES:
            self._used_ns = self._now_ns
        if outcome is FixOutcome.REACQUIRED:
            self._notices.append("position lost; started again from the receiver")
        return outcome

    def _hear_time(self, arrival_ns: int, utc_s: float) -> None:
        jump_s = self._utc.observe(arrival_ns, utc_s)
        if jump_s:
            follows = self._utc.follows(jump_s)
            self._notices.append(
                f"the receiver's time jumped by {jump_s:+.1f} s; {follows}"
            )

    def _take(self, fix: GpsFix, instant_ns: int) -> FixOutcome:
        """Give the fix to the navigator; the first one starts it."""
        # A receiver's buffer may be full of old fixes: until the first row is out,
        # each begins anew.
        is_first = self._row_utc_ns is None or self._is_guess
        if self._utc.is_in_doubt and not is_first:
            return FixOutcome.UNDATED
        if is_first:
            if not self._is_started:
                self._recall(fix.utc_s, fix)
            self._begin(instant_ns)
        start_sigma_m = START_FACTOR * fix.sigma_h_m if is_first else 0.0
        return self._navigator.take(fix, instant_ns, start_sigma_m)

    def _recall(self, utc_s: float | None, fix: GpsFix | None) -> None:
        """Begin with what an earlier run learnt, now that the time is known."""
        prior = self._settings.prior
        if prior is not None:
            elapsed_s = None
            if utc_s is not None and prior.utc_s is not None:
                elapsed_s = utc_s - prior.utc_s
            self._navigator.recall(Since(elapsed_s, warmer_k=None), fix)

    def _begin(self, t_ns: int) -> None:
        """Rows can be made from now on, with an IMU or without."""
        if not self._is_started:
            self._notices.append("tracking begins")
            self._begin_ns = self._now_ns
        self._is_started, self._is_guess = True, False
        if self._step_ns is None:
            self._step_ns = t_ns

    def _learn_period(self, fix: GpsFix) -> None:
        if self._fix_ns is not None and fix.t_ns > self._fix_ns:
            self._fix_periods_ns = (self._fix_periods_ns[1], fix.t_ns - self._fix_ns)
        self._fix_ns = fix.t_ns

    # ------------------------------------------------------------- steps and rows

    def _on_step(self, step: ImuStep) -> list[NavState]:
        navigator = self._navigator
        bias, bias_sigma = navigator.gyro_bias()
        rest = self._standstill.add(step, bias, bias_sigma, *navigator.speed())
        navigator.step(step, rest)
        self._preintegrator.gyro_bias_radps = bias
        self._turning.add(step, bias)
        self._step_ns = step.t_ns
        self._last_step, self._last_rest = step, rest
        return self._due_rows()

    def _due_rows(self) -> list[NavState]:
        utc = self._utc
        if not self._is_started or self._step_ns is None:
            return _NO_ROWS
        if self._row_utc_ns is None:
            settled_ns = utc.settled_ns
            if settled_ns is None or self._now_ns < settled_ns:
                return _NO_ROWS
            utc.show()
            begin_utc_ns = utc.row_utc_ns(max(self._begin_ns, settled_ns))
            self._row_utc_ns = -(-begin_utc_ns // self._period_ns) * self._period_ns
        rows: list[NavState] = []
        while (row_ns := utc.row_instant_ns(self._row_utc_ns)) <= self._step_ns:
            rows.append(self._row(row_ns, self._row_utc_ns))
            self._row_utc_ns += self._period_ns
            if hole_ns := utc.slew(self._period_ns):
                self._row_utc_ns += -(-hole_ns // self._period_ns) * self._period_ns
                way = "forward" if hole_ns > 0 else "back"
                self._notices.append(
                    f"the rows' times go {way} by {abs(hole_ns) * 1e-9:.1f} s at once"
                )
        return rows

    def _row(self, row_ns: int, row_utc_ns: int) -> NavState:
        """State at an instant near the end of the last step."""
        assert self._step_ns is not None
        believed = self._navigator.estimate_after((row_ns - self._step_ns) * 1e-9)
        mode = self._mode_at(row_ns)
        # A row that is dated wrong tells where it was then, not at its date.
        misdated_s = self._utc.behind_ns(self._period_ns) * 1e-9
        way_m = misdated_s * math.hypot(*believed.v_n_mps[:2])
        return NavState(
            row_ns,
            row_utc_ns * 1e-9,
            believed.lat_rad,
            believed.lon_rad,
            believed.alt_m,
            believed.v_n_mps,
            believed.q_nb,
            believed.r95_m + way_m,
            mode,
            self._utc.is_sure,
        )

    def _mode_at(self, row_ns: int) -> Mode:
        # Of two intervals the shorter one: an outage is none.
        window_ns = max(GPS_MODE_NS, int(GPS_MODE_PERIODS * min(self._fix_periods_ns)))
        has_gps = self._used_ns is not None and row_ns - self._used_ns <= window_ns
        is_fed = self._last_step is not None and not self._last_step.is_gap
        has_imu = self._imu_flapping.counts(row_ns, is_fed)
        no_gps = "no GPS yet" if self._used_ns is None else "GPS lost"
        if self._fix_ns is not None and row_ns - self._fix_ns <= window_ns:
            no_gps = "fixes do not fit"
        said = _SAID_OF_SENSORS[has_imu, has_gps].format(no_gps=no_gps)
        if said != self._said_sensors:
            self._said_sensors = said
            self._notices.append(said)
        if not has_imu or self._navigator.contradicts_receiver:
            return Mode.GPSONLY
        if self._last_rest is not None:
            return Mode.STILL
        return Mode.GPS if has_gps else Mode.DR

    def predict(self, after_s: Iterable[float]) -> list[Prediction]:
        """Say where it will be, counted from the newest sample; [] before the start."""
        if not self._is_started or self._step_ns is None:
            return []
        navigator = self._navigator
        believed = navigator.estimate_after((self._now_ns - self._step_ns) * 1e-9)
        turn_radps = 0.0
        if self._last_rest is None:
            turn_radps = self._turning.about_down_radps(believed)
        return predict(
            believed,
            navigator.speed()[1],
            turn_radps,
            navigator.profile,
            after_s,
        )

    # ------------------------------------------------------------------- for people

    @property
    def counters(self) -> Counter[str]:
        """Fixes by what became of them, samples by what was wrong with them."""
        fixes = Counter({f"fixes_{k}": n for k, n in self._fixes.items()})
        return fixes + self._preintegrator.counters

    def take_notices(self) -> list[str]:
        """Transitions since the last call, for the log."""
        notices, self._notices = self._notices, []
        return notices + self._navigator.take_notices()

    def learnt(self) -> Learnt | None:
        """What a next start can begin with; None: nothing, or not yet."""
        learnt = self._navigator.learnt()
        if learnt is None or not self._is_started:
            return None
        return _later(learnt, self._latency_ns * 1e-9)._replace(
            utc_s=None if self._row_utc_ns is None else self._row_utc_ns * 1e-9,
            still_levels=self._standstill.vibration.levels,
        )

    def report(self) -> dict[str, object]:
        """What was learnt."""
        vibration = self._standstill.vibration
        return {
            **self._navigator.report(),
            "still_gyro_threshold_dps": math.degrees(vibration.gyro_threshold_radps),
            "still_accel_threshold_mps2": vibration.accel_threshold_mps2,
            "utc_jumps": self._utc.jumps,
            "utc_holes": self._utc.holes,
        }
