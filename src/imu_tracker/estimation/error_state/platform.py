"""The platform: its profile, given or found from how it moves."""

import math
from typing import Final

from imu_tracker.estimation.error_state.filter import Eskf
from imu_tracker.estimation.error_state.hypotheses.reorient import lean_right
from imu_tracker.estimation.tuning import UNKNOWN_ACCEL_PSD
from imu_tracker.motion.profile import ProfileClassifier
from imu_tracker.motion.step_detector import StepDetector
from imu_tracker.samples import Quat

LONGEST_S: Final = 2.0
"""Into a turn and out of it takes longer."""

MOST_DRIFT_MPS2: Final = 0.3
"""Lateral acceleration by the uncertainty of the gyro bias alone."""


class Platform:
    """A profile that is configured, or found from how the body moves.

    Parameters
    ----------
    profile : {"auto", "free", "vehicle", "walker"}
        With "auto" it is free until the evidence is in.

    Attributes
    ----------
    profile : {"free", "vehicle", "walker"}
    step_detector : StepDetector
        Takes every step of the filters.
    turned_rad : float
        To the right since the start, by the gyro alone: a heading that is found is no
        turn.
    """

    def __init__(self, profile: str) -> None:
        self._classifier = ProfileClassifier() if profile == "auto" else None
        self.profile = "free" if profile == "auto" else profile
        self.turned_rad = 0.0
        self._seen_ns, self._seen_rad = 0, 0.0
        self.step_detector = StepDetector()

    @property
    def is_vehicle(self) -> bool:
        """Whether it rolls on wheels, ahead."""
        return self.profile == "vehicle"

    @property
    def is_walker(self) -> bool:
        """Whether it is somebody on foot."""
        return self.profile == "walker"

    @property
    def unknown_accel_psd(self) -> float:
        """Its own acceleration, (m/s^2)^2/Hz, while nothing measures it."""
        return UNKNOWN_ACCEL_PSD[self.profile]

    def load_prior(self, profile: object) -> bool:
        """Take a vehicle that an earlier run found; return whether that is news."""
        if self._classifier is None or profile != "vehicle":
            return False
        self._classifier.profile = self.profile = "vehicle"
        return True

    def add_motion(self, eskf: Eskf, level_q: Quat, *, is_aligned: bool) -> None:
        """See how it moved since the last call, a second ago.

        Ignored after a longer time (an outage, a rest): the lean of an instant does not
        belong to a turn that is over. Ignored before heading and gyro bias are known.

        Parameters
        ----------
        eskf : Eskf
        level_q : Quat
            Attitude of the box when it was levelled.
        is_aligned : bool
            Whether the heading is known.
        """
        if self._classifier is None:
            return
        t_ns, speed_mps = eskf.nominal.t_ns, math.hypot(*eskf.nominal.v_n[:2])
        period_s = (t_ns - self._seen_ns) * 1e-9
        turn_rad = self.turned_rad - self._seen_rad
        self._seen_ns, self._seen_rad = t_ns, self.turned_rad
        if not 0.0 < period_s < LONGEST_S:
            return
        drift_mps2 = speed_mps * math.sqrt(eskf.down_bias[1])
        knows_turns = is_aligned and drift_mps2 < MOST_DRIFT_MPS2
        self._classifier.add_motion(
            period_s,
            speed_mps,
            turn_rad,
            lean_right(eskf, level_q) if knows_turns else None,
            is_stepping=self.step_detector.is_stepping,
        )

    def adopt_found_profile(self) -> bool:
        """Let what was found by now hold; return whether it is news."""
        before = self.profile
        if self._classifier is not None:
            self.profile = self._classifier.profile
        return self.profile != before
