"""How noisy the IMU is in its place, found by the likelihood of the fixes.

The noise of a chip that is glued to a car and of a phone in its holder differ by ten,
and nothing but the receiver tells which it is. The filter that is listened to runs at
one level; a challenger runs beside it, at the next lower or higher one, from a copy of
its state. Whoever foretold the fixes better goes on.
"""

from typing import Final

from imu_tracker.estimation.error_state.filter import Eskf
from imu_tracker.estimation.error_state.states import NoiseLevel

NOISE_LEVELS: Final = (
    NoiseLevel(gyro_share=0.13, accel_share=0.1),
    NoiseLevel(gyro_share=0.4, accel_share=0.2),
    NoiseLevel(gyro_share=1.2, accel_share=0.4),
    NoiseLevel(gyro_share=3.6, accel_share=0.8),
)
"""Glued to the vehicle, held well, held badly, loose. Steps of three: a filter whose
noise is off by less than two loses nothing that can be measured."""

START_LEVEL: Final = 1

TRIAL_S: Final = 60.0
"""Of fixes: some turns and some stops, where levels differ."""

WIN_NATS: Final = 1.5
WIN_SURELY_NATS: Final = 3.0
"""A radius that is too small is worse than one that is too large, and what leads has
led so far: less noise, or another heading, must be proved better."""

EARLY_WIN_NATS: Final = 6.0
"""Likelier by so much at the end of a trial, or at any time within it: odds of 4, of
20 and of 400 to 1."""

MOST_NATS: Final = 1.0
"""No single fix decides: not a wild one, not the first after a tunnel."""


def known_level(level: int) -> int:
    """Return a level that exists, for one that another version may have stored."""
    return min(max(level, 0), len(NOISE_LEVELS) - 1)


class NoiseBank:
    """The filter that is listened to, and its challenger.

    Attributes
    ----------
    main, challenger : Eskf
    is_heading_trial : bool
        Whether the challenger differs by its heading, not by its noise.
    """

    def __init__(self, level: int, *, is_vehicle: bool) -> None:
        self._level = level
        self._direction = -1
        self._trial_s = self._lead = 0.0
        self.main = Eskf(NOISE_LEVELS[level], is_vehicle=is_vehicle)
        self.challenger = self.main
        self.is_heading_trial = False
        self.challenge_noise()

    @property
    def filters(self) -> tuple[Eskf, ...]:
        """Both of them: all that happens, happens to each."""
        return (self.main, self.challenger)

    @property
    def level(self) -> int:
        """Index of the level that is listened to."""
        return self._level

    def challenge_heading(self, candidate: Eskf) -> None:
        """Try a filter with another heading, at the same noise level."""
        self.challenger = candidate
        self.is_heading_trial = True
        self._trial_s = self._lead = 0.0

    def add_log_likelihoods(
        self, main: float, challenger: float, period_s: float
    ) -> bool | None:
        """Take the log-likelihoods of one fix under both.

        Returns
        -------
        bool or None
            Whether another heading has won or lost its trial; None: neither.
        """
        self._trial_s += period_s
        self._lead += min(max(challenger - main, -MOST_NATS), MOST_NATS)
        is_over = self._trial_s >= TRIAL_S
        is_upward = self._direction > 0 and not self.is_heading_trial
        needed = WIN_NATS if is_upward else WIN_SURELY_NATS
        if self._lead > EARLY_WIN_NATS or (is_over and self._lead > needed):
            return self._end_trial(is_won=True)
        if is_over or self._lead < -EARLY_WIN_NATS:
            return self._end_trial(is_won=False)
        return None

    def adopt_heading(self) -> bool:
        """Take the other heading at once if it leads; return whether it did."""
        if not self.is_heading_trial or self._lead <= 0.0:
            return False
        self._end_trial(is_won=True)
        return True

    def _end_trial(self, *, is_won: bool) -> bool | None:
        verdict = is_won if self.is_heading_trial else None
        if is_won:
            self.main = self.challenger
        if self.is_heading_trial:
            self.is_heading_trial = False
        elif is_won:
            self._level += self._direction  # and on in the same direction
        else:
            self._direction = -self._direction
        self.challenge_noise()
        return verdict

    def challenge_noise(self) -> None:
        """Begin a trial of a neighbouring level."""
        if not 0 <= self._level + self._direction < len(NOISE_LEVELS):
            self._direction = -self._direction
        self.challenger = self.main.clone(NOISE_LEVELS[self._level + self._direction])
        self.is_heading_trial = False
        self._trial_s = self._lead = 0.0
