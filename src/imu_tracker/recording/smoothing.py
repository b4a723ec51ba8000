"""A recording tracked forward, and smoothed backward: the best track afterwards."""

from imu_tracker.calibration.corrected import Corrections
from imu_tracker.config import Config
from imu_tracker.errors import ConfigError
from imu_tracker.estimation.error_state.smoothing.history import History
from imu_tracker.estimation.error_state.smoothing.smoother import Smoother
from imu_tracker.estimation.settings import TrackerSettings
from imu_tracker.pipeline import Pipeline
from imu_tracker.recording.replay import Replay
from imu_tracker.samples import NavState, SessionHeader


class Smoothing(Replay):
    """A replay whose rows use the whole recording; they come some minutes later.

    Parameters
    ----------
    config : Config
        What is written in it overrules the headers.
    corrections : Corrections, optional
        Of the chip that was recorded.

    Raises
    ------
    ConfigError
        When the configuration chooses an estimator that cannot be smoothed.
    """

    def __init__(self, config: Config, corrections: Corrections | None = None) -> None:
        if config.filter.estimator != "error-state":
            raise ConfigError(
                f"filter.estimator = {config.filter.estimator}: only error-state can "
                "be smoothed"
            )
        super().__init__(config, corrections)
        self._smoother: Smoother | None = None

    def pipeline(self, header: SessionHeader, settings: TrackerSettings) -> Pipeline:
        """Make the pipeline of a session, and a smoother for its rows."""
        history = History()
        self._smoother = Smoother(history, settings.lever_arm_m)
        return super().pipeline(header, settings._replace(history=history))

    def finished(self, due: list[NavState]) -> list[NavState]:
        """Return the rows that are smoothed by now."""
        return [] if self._smoother is None else self._smoother.add(due)

    def remaining(self) -> list[NavState]:
        """Return the rest of a session's rows, smoothed."""
        return [] if self._smoother is None else self._smoother.finish()
