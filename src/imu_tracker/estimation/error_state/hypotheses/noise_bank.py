"""The bank of filters that use the IMU: a leader, and rivals that fixes compare to it.

A rival has another noise level, another heading and mounting, or does or does not use
what an earlier run learnt. The noise of a chip that is glued to a car and that of a
phone in its holder differ by a factor of ten, and a box may be mounted in any way; only
fixes show which filter is right. Each fix adds the difference of the log-likelihoods to
the log odds of a rival against the leader.
"""

import math
from dataclasses import dataclass
from enum import Enum
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

HEADING_WIN_NATS: Final = 3.0
HEADING_LOST_NATS: Final = -5.0
"""Odds at which one of several headings takes the lead, and at which it is dropped: its
weight no longer moves the radius."""

MOST_NATS: Final = 1.0
"""No single fix decides: not a wild one, not the first after a tunnel."""


def known_level(level: int) -> int:
    """Return a level that exists, for one that another version may have stored."""
    return min(max(level, 0), len(NOISE_LEVELS) - 1)


class Kind(Enum):
    """What a rival differs by."""

    NOISE = "noise"
    TRIAL = "trial"
    HEADING = "heading"


@dataclass(slots=True)
class Rival:
    """A filter that competes with the leader.

    Attributes
    ----------
    eskf : Eskf
    kind : Kind
    name : str
    nats : float
        Log odds against the leader.
    trial_s : float
        Fixes that were compared, in seconds.
    """

    eskf: Eskf
    kind: Kind
    name: str = ""
    nats: float = 0.0
    trial_s: float = 0.0


class NoiseBank:
    """The leading filter and its rivals.

    Attributes
    ----------
    main : Eskf
    main_name : str
        What its heading assumes; empty: that the box points ahead.
    rivals : list of Rival
        One with another noise level, with several headings beside it, or one on trial.
    """

    def __init__(self, level: int, *, is_vehicle: bool) -> None:
        self._level = level
        self._direction = -1
        self.main = Eskf(NOISE_LEVELS[level], is_vehicle=is_vehicle)
        self.main_name = ""
        self.rivals: list[Rival] = []
        self.challenge_noise()

    @property
    def filters(self) -> tuple[Eskf, ...]:
        """All of them: all that happens, happens to each; the leader first."""
        return (self.main, *(rival.eskf for rival in self.rivals))

    @property
    def is_heading_trial(self) -> bool:
        """Whether another heading, or what an earlier run learnt, is on trial."""
        return any(rival.kind is not Kind.NOISE for rival in self.rivals)

    @property
    def has_headings(self) -> bool:
        """Whether several headings are alive."""
        return any(rival.kind is Kind.HEADING for rival in self.rivals)

    @property
    def level(self) -> int:
        """Index of the leader's noise level."""
        return self._level

    @property
    def weights(self) -> list[float]:
        """Probabilities of the filters; another noise level alone has none."""
        nats = [0.0] + [
            -math.inf if rival.kind is Kind.NOISE else rival.nats
            for rival in self.rivals
        ]
        top = max(nats)
        odds = [math.exp(each - top) for each in nats]
        total = sum(odds)
        return [each / total for each in odds]

    def mixed(self, likelihoods: list[float]) -> float:
        """Log-likelihood of a fix under all headings, weighted by their odds."""
        if not self.has_headings:
            return likelihoods[0]
        pairs = zip(self.weights, likelihoods, strict=True)
        shares = [(share, each) for share, each in pairs if share > 0.0]
        top = max(each for _, each in shares)
        return top + math.log(sum(w * math.exp(each - top) for w, each in shares))

    def challenge_heading(self, candidate: Eskf) -> None:
        """Try a filter with another heading, at the same noise level."""
        self.rivals = [Rival(candidate, Kind.TRIAL, "another heading")]

    def begin_headings(self, rivals: list[Rival]) -> None:
        """Let several headings compete; the most probable one leads."""
        best = max(rivals, key=lambda rival: rival.nats)
        self.main, self.main_name = best.eskf, best.name
        self.rivals = [rival for rival in rivals if rival is not best]
        for rival in self.rivals:
            rival.nats -= best.nats
        self.rivals.append(self._noise_rival())

    def add_log_likelihoods(
        self, likelihoods: list[float], period_s: float
    ) -> bool | None:
        """Compare the log-likelihoods of one fix under all filters.

        Returns
        -------
        bool or None
            Whether another heading has won or lost; None: neither.
        """
        main, *others = likelihoods
        for rival, likelihood in zip(self.rivals, others, strict=True):
            rival.trial_s += period_s
            better = min(max(likelihood - main, -MOST_NATS), MOST_NATS)
            if rival.kind is Kind.HEADING:
                better *= min(period_s, 1.0)
            rival.nats += better
        if self.has_headings:
            return self._judge_headings()
        return self._judge_trial(self.rivals[0]) if self.rivals else None

    def _judge_headings(self) -> bool | None:
        headings = [r for r in self.rivals if r.kind is Kind.HEADING]
        noise = next(r for r in self.rivals if r.kind is Kind.NOISE)
        best = max(headings, key=lambda rival: rival.nats)
        if best.nats > HEADING_WIN_NATS:
            self._swap(best)
            noise = self._noise_rival()  # the old one has the heading of the loser
        headings = [r for r in headings if r.nats > HEADING_LOST_NATS]
        self.rivals = [*headings, noise]
        if not headings:
            return self.main_name != ""
        self._judge_trial(noise)
        return None

    def _judge_trial(self, rival: Rival) -> bool | None:
        is_over = rival.trial_s >= TRIAL_S
        is_upward = self._direction > 0 and rival.kind is Kind.NOISE
        needed = WIN_NATS if is_upward else WIN_SURELY_NATS
        if rival.nats > EARLY_WIN_NATS or (is_over and rival.nats > needed):
            return self._end_trial(rival, is_won=True)
        if is_over or rival.nats < -EARLY_WIN_NATS:
            return self._end_trial(rival, is_won=False)
        return None

    def _swap(self, winner: Rival) -> None:
        """Let a rival lead; the leader becomes a rival."""
        nats = winner.nats
        for rival in self.rivals:
            rival.nats -= nats
        old, self.main = self.main, winner.eskf
        name, self.main_name = self.main_name, winner.name
        winner.eskf, winner.name, winner.nats = old, name, -nats

    def adopt_heading(self) -> bool:
        """Take another heading at once if it leads; return whether it did."""
        others = [rival for rival in self.rivals if rival.kind is not Kind.NOISE]
        best = max(others, key=lambda rival: rival.nats, default=None)
        if best is None or best.nats <= 0.0:
            return False
        if best.kind is Kind.HEADING:
            self._swap(best)
        else:
            self._end_trial(best, is_won=True)
        return True

    def _end_trial(self, rival: Rival, *, is_won: bool) -> bool | None:
        verdict = None if rival.kind is Kind.NOISE else is_won
        if is_won:
            self.main = rival.eskf
        if rival.kind is Kind.NOISE:
            if is_won:
                self._level += self._direction  # and on in the same direction
            else:
                self._direction = -self._direction
        headings = [r for r in self.rivals if r.kind is Kind.HEADING]
        for each in headings:
            each.eskf = each.eskf.clone(NOISE_LEVELS[self._level])
        self.rivals = [*headings, self._noise_rival()]
        return verdict

    def challenge_noise(self) -> None:
        """Begin a trial of a neighbouring level, and drop all others."""
        self.rivals = [self._noise_rival()]

    def _noise_rival(self) -> Rival:
        if not 0 <= self._level + self._direction < len(NOISE_LEVELS):
            self._direction = -self._direction
        noise = NOISE_LEVELS[self._level + self._direction]
        return Rival(self.main.clone(noise), Kind.NOISE)
