"""The settings of the estimation, and the estimator that they choose."""

from typing import Final, NamedTuple

from imu_tracker.estimation.error_state.estimator import ErrorState
from imu_tracker.estimation.error_state.smoothing.history import History
from imu_tracker.estimation.error_state.warm_start import LearnedParameters
from imu_tracker.estimation.receiver.fix_period import FixPeriod
from imu_tracker.estimation.rewind import Navigator, Rewinding
from imu_tracker.samples import Mount, Vec3

TYPICAL_LATENCY_S: Final = 0.2
"""From the instant that an epoch describes to its first byte, for most receivers."""


class TrackerSettings(NamedTuple):
    """The part of the configuration that the estimation needs."""

    estimator: str = "error-state"
    profile: str = "auto"
    latency_s: float | None = None  # None: measured, by an estimator that can
    lever_arm_m: Vec3 = (0.0, 0.0, 0.0)
    rate_hz: int = 4
    mount: Mount | None = None  # None: the header's
    gps_date: str = ""
    start: tuple[float, float] | None = None  # latitude, longitude in radians
    start_radius_m: float = 50.0
    prior: LearnedParameters | None = None  # what an earlier run learnt
    uses_wheels: bool = True
    history: History | None = None  # keeps what happens, for a smoother

    @property
    def assumed_latency_s(self) -> float:
        """The configured latency, or what is assumed until it is measured."""
        return TYPICAL_LATENCY_S if self.latency_s is None else self.latency_s


def navigator_of(settings: TrackerSettings, fix_period: FixPeriod) -> Navigator:
    """Make the estimator that the configuration chooses."""
    if settings.estimator == "error-state":
        prior = settings.prior
        if prior is not None:
            prior = relative_to(prior, settings.assumed_latency_s)
        return ErrorState(
            *(settings.profile, settings.lever_arm_m, prior),
            uses_wheels=settings.uses_wheels,
            fix_period=fix_period,
            history=settings.history,
        )
    # Imported here: filterpy brings scipy and matplotlib, 1.3 s and 70 MB.
    from imu_tracker.estimation.six_state.estimator import SixState

    profile = "free" if settings.profile == "auto" else settings.profile
    return Rewinding(SixState(profile, settings.lever_arm_m, fix_period), profile)


def relative_to(learnt: LearnedParameters, assumed_s: float) -> LearnedParameters:
    """Turn latencies into the estimator's delays, or its delays into latencies.

    Notes
    -----
    delay = assumed - latency; latency = assumed - delay. A positive delay says that
    fixes describe a later instant than assumed: they are less late.
    """
    return learnt._replace(
        latency_s=assumed_s - learnt.latency_s,
        velocity_latency_s=assumed_s - learnt.velocity_latency_s,
    )
