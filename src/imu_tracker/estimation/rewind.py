"""Late fixes: how the tracker drives an estimator.

A fix describes an instant in the past. There are two ways to live with that: go back
to a snapshot of that instant and repeat the steps since (`Rewinding`, for estimators
that are cheap to repeat), or keep the filter itself at the instant of the last fix and
predict from there (the error-state filter does).
"""

from collections import deque
from typing import Final, NamedTuple, Protocol

from imu_tracker.estimation.error_state.warm_start import Downtime, LearnedParameters
from imu_tracker.estimation.estimate import Estimate, Estimator
from imu_tracker.estimation.receiver.gate import FixOutcome
from imu_tracker.estimation.report import EstimatorReport
from imu_tracker.geometry.geodesy import LocalFrame
from imu_tracker.motion.preintegration import ImuStep
from imu_tracker.motion.standstill import Rest
from imu_tracker.samples import GpsFix, ImuSample, Vec3

HISTORY_NS: Final = 3_000_000_000
"""How late a fix may come: receivers that smooth their course take up to 2 s."""

COAST_NS: Final = 100_000_000
"""Length of a step through an IMU gap."""

USED_OUTCOMES: Final = (
    FixOutcome.INITIALISED,
    FixOutcome.ACCEPTED,
    FixOutcome.REACQUIRED,
)


class Navigator(Protocol):
    """What the tracker asks: steps and fixes in the order of arrival.

    Attributes
    ----------
    in_hindsight : bool
        Whether standstill is used some time after it was detected.
    """

    in_hindsight: bool

    @property
    def profile(self) -> str:
        """The configured profile, or the one that was found."""

    @property
    def contradicts_receiver(self) -> bool:
        """Whether the receiver is followed alone, against the IMU."""

    def start(self, lat_rad: float, lon_rad: float, sigma_m: float) -> None:
        """Begin at a place known to `sigma_m` per axis, at any speed."""

    def add_sample(self, sample: ImuSample) -> None:
        """Take a sample at the IMU's own rate, before the step that it ends in."""

    def add_step(self, step: ImuStep, rest: Rest | None) -> None:
        """Move on by a step; `rest` when the body stands still."""

    def update(self, fix: GpsFix, instant_ns: int, start_sigma_m: float) -> FixOutcome:
        """Take a fix at the instant that it describes.

        With `start_sigma_m` above zero it starts again at this fix, with this sigma.
        """

    def estimate_after(self, dt_s: float) -> Estimate:
        """The estimate of the instant `dt_s` after the end of the last step."""

    def speed(self) -> tuple[float, float]:
        """Horizontal speed in m/s and its standard deviation."""

    def gyro_bias(self) -> tuple[Vec3, float]:
        """Gyro bias in rad/s, body axes, and its standard deviation per axis."""

    def report(self) -> EstimatorReport:
        """What was learnt, for people."""

    def load_prior(self, since: Downtime, fix: GpsFix | None) -> None:
        """Begin with what an earlier run learnt, `since` which that happened.

        The first fix, if there is one, is about to be taken.
        """

    def learned_parameters(self) -> LearnedParameters | None:
        """What a next start can begin with; None: nothing, or not yet."""

    def take_notices(self) -> list[str]:
        """Transitions since the last call, for the log."""


class _Past(NamedTuple):
    """One step of the history, and the estimator after it."""

    t_ns: int
    step: ImuStep
    rest: Rest | None
    saved: object


class Rewinding:
    """Drives an estimator by snapshots of the last seconds.

    Parameters
    ----------
    estimator : Estimator
    profile : {"free", "vehicle", "walker"}
    """

    in_hindsight = False
    contradicts_receiver = False

    def __init__(self, estimator: Estimator, profile: str) -> None:
        self._estimator, self.profile = estimator, profile
        self._past: deque[_Past] = deque()

    def start(self, lat_rad: float, lon_rad: float, sigma_m: float) -> None:
        """Begin at a place known to `sigma_m` per axis, at any speed."""
        self._estimator.start(lat_rad, lon_rad, sigma_m)

    def add_sample(self, sample: ImuSample) -> None:
        """Ignored: six-state has no wheel speed."""

    def add_step(self, step: ImuStep, rest: Rest | None) -> None:
        """Move on by a step, and remember the estimator after it."""
        estimator, past = self._estimator, self._past
        estimator.propagate(step, rest)
        past.append(_Past(step.t_ns, step, rest, estimator.snapshot()))
        while step.t_ns - past[0].t_ns > HISTORY_NS:
            past.popleft()

    def update(self, fix: GpsFix, instant_ns: int, start_sigma_m: float) -> FixOutcome:
        """Go back to the fix's instant, apply it, and repeat the steps since."""
        estimator, past = self._estimator, self._past
        is_first = start_sigma_m > 0.0
        if past and instant_ns < past[0].t_ns - COAST_NS and not is_first:
            return FixOutcome.TOO_LATE
        index = len(past) - 1
        while index > 0 and 2 * instant_ns < past[index].t_ns + past[index - 1].t_ns:
            index -= 1
        ahead_s = 0.0
        if past:
            estimator.restore(past[index].saved)
            ahead_s = (instant_ns - past[index].t_ns) * 1e-9
        if is_first:
            estimator.start(fix.lat_rad, fix.lon_rad, start_sigma_m)
            ahead_s = max(ahead_s, -COAST_NS * 1e-9)
        outcome = estimator.update(fix, ahead_s)
        if outcome not in USED_OUTCOMES:
            if past:
                estimator.restore(past[-1].saved)
            return outcome
        for i in range(max(index, 0), len(past)):
            t_ns, step, rest, _ = past[i]
            if i > index:
                estimator.propagate(step, rest)
            past[i] = _Past(t_ns, step, rest, estimator.snapshot())
        return FixOutcome.INITIALISED if is_first else outcome

    def estimate_after(self, dt_s: float) -> Estimate:
        """Carry the last estimate to an instant, by its velocity."""
        estimate = self._estimator.estimate()
        vn, ve, vd = estimate.v_n_mps
        here = LocalFrame.at(estimate.lat_rad, estimate.lon_rad)
        lat_rad, lon_rad = here.to_lat_lon(vn * dt_s, ve * dt_s)
        alt_m = None if estimate.alt_m is None else estimate.alt_m - vd * dt_s
        return estimate._replace(lat_rad=lat_rad, lon_rad=lon_rad, alt_m=alt_m)

    def speed(self) -> tuple[float, float]:
        """Horizontal speed in m/s and its standard deviation."""
        return self._estimator.speed()

    def gyro_bias(self) -> tuple[Vec3, float]:
        """Gyro bias in rad/s, body axes, and its standard deviation per axis."""
        return self._estimator.gyro_bias()

    def report(self) -> EstimatorReport:
        """What was learnt, for people."""
        return self._estimator.report()

    def load_prior(self, since: Downtime, fix: GpsFix | None) -> None:
        """Nothing was remembered."""

    def learned_parameters(self) -> LearnedParameters | None:
        """Nothing that a next start can begin with."""
        return None

    def take_notices(self) -> list[str]:
        """None: six-state reports no transitions."""
        return []
