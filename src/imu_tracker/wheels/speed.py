"""By how much a filter's speed is wrong, from the vibration of the wheels.

While GPS is there the circumference and the strength of the lines are learnt; then, and
without it, the lines say which speed fits. Windows of some seconds are weighed
together: a line that passes by is outvoted.
"""

from collections import deque
from typing import Final

import numpy as np

from imu_tracker.samples import ImuSample
from imu_tracker.wheels.orders import KeptWheels, OrderLearner, Wheels, loaded
from imu_tracker.wheels.posterior import (
    SpeedError,
    Turning,
    Weighed,
    posterior,
    weighed,
)
from imu_tracker.wheels.windows import WINDOW_S, Samples, Spectrum, spectrum

EVERY_S: Final = 2.0
"""Half a window: closer ones hold the same samples, and cost as much each."""

LEAST_TOGETHER: Final = 3
MOST_TOGETHER: Final = 9
"""Windows that make one measurement: as few as are clear, none beyond 18 s."""

BROKEN_NS: Final = 5_000_000_000
"""After so long without a window, in a bend or below `LEAST_SPEED_MPS`, the ones before
are of another time: with them any later error would be explained by a drift."""

CLEAR_SHARE: Final = 0.1
"""A measurement is made as soon as it leaves no more of the variance than this."""

LEAST_SPEED_MPS: Final = 6.0
"""Below, the first order drowns in what the body does when it starts and stops."""

KNOWN_SIGMA_MPS: Final = 0.5
"""A speed known worse than this teaches nothing of the circumference."""

HALF_TRACK_M: Final = 0.75
SPREAD_SHARE: Final = 0.01
"""In a bend the wheels outside turn faster than those inside: no window where they
differ by more than this, below a radius of 75 m."""

JUMP_MPS: Final = 2.0
"""A filter whose speed changes by more between two calls was corrected: its profile
before does not belong to the one after."""


class WheelSpeed:
    """Learns the wheels with GPS, and measures the speed by them.

    Attributes
    ----------
    asked_windows, heard_windows : int
        Windows on the way, and those that became part of an answer.
    """

    def __init__(self) -> None:
        self._samples = Samples()
        self._learner = OrderLearner()
        self._motion: deque[tuple[int, float, float]] = deque()
        self._due_ns = 0
        self._together: list[Weighed] = []
        self.heard_windows = self.asked_windows = 0

    @property
    def wheels(self) -> Wheels | None:
        """What was learnt; None: no lines."""
        return self._learner.wheels

    def add_sample(self, sample: ImuSample) -> None:
        """Take a calibrated sample, at the IMU's own rate."""
        self._samples.add(sample)

    def add_motion(self, t_ns: int, speed_mps: float, turn_radps: float) -> bool:
        """Take a filter's motion at its own instant, a few times a second.

        Returns
        -------
        bool
            Whether a window is due that ends there.
        """
        motion = self._motion
        if motion:
            last_ns, last_mps, _ = motion[-1]
            if t_ns <= last_ns or abs(speed_mps - last_mps) > JUMP_MPS:
                motion.clear()
                self.reset_evidence()
        motion.append((t_ns, speed_mps, turn_radps))
        while motion[0][0] < t_ns - int((WINDOW_S + 0.5) * 1e9):
            motion.popleft()
        period_ns = int(EVERY_S * 1e9)
        if t_ns < self._due_ns <= t_ns + period_ns:
            return False
        self._due_ns = t_ns + period_ns
        slowest_mps = min(v for _, v, _ in motion)
        turn_radps = sum(abs(w) for _, _, w in motion) / len(motion)
        return (
            slowest_mps >= LEAST_SPEED_MPS
            and HALF_TRACK_M * turn_radps <= SPREAD_SHARE * slowest_mps
        )

    def learn(self, found: Spectrum) -> None:
        """Take a window at whose end the speed is known."""
        self._learner.learn(found, self._motion[-1][1], EVERY_S)

    def weigh(
        self, found: Spectrum, circumference_m: float, sigma_mps: float
    ) -> SpeedError | None:
        """Weigh a window, and return an answer when there is one.

        Parameters
        ----------
        found : Spectrum
        circumference_m : float
            By the filter whose motion was told.
        sigma_mps : float
            Of its speed against that of its wheels.
        """
        wheels = self._learner.wheels
        if wheels is None:
            return None
        t_ns, speed_mps, _ = self._motion[-1]
        if self._together and t_ns - self._together[-1].t_ns > BROKEN_NS:
            self.reset_evidence()
        turning = Turning(t_ns, speed_mps, circumference_m)
        self._together.append(weighed(found, wheels.strength, turning, sigma_mps))
        self.asked_windows += 1
        n = len(self._together)
        if n < LEAST_TOGETHER:
            return None
        answer, left = posterior(self._together, speed_mps)
        if left > CLEAR_SHARE and n < MOST_TOGETHER:
            return None
        if answer is not None:
            self.heard_windows += n
        self.reset_evidence()
        return answer

    def is_clearer_than(self, circumference_m: float, factor: float) -> bool:
        """Whether the learnt circumference stands out so much more than another."""
        best, other = self._learner.best, self._learner.at(circumference_m)
        return best is not None and best.clarity > factor * other.clarity

    def shift(self, by_mps: float) -> None:
        """Take along the motion before an answer: its shape is the same."""
        self._motion = deque((t, v + by_mps, w) for t, v, w in self._motion)

    def reset_evidence(self) -> None:
        """Drop the windows that are not a measurement yet."""
        self._together.clear()

    def load(self, kept: KeptWheels) -> None:
        """Begin with the wheels of an earlier run."""
        self._learner.prior = loaded(kept)

    def spectrum(self) -> Spectrum | None:
        """Spectrum of the window that ends with the last motion."""
        t_ns = self._motion[-1][0]
        window = self._samples.until(t_ns)
        if window is None:
            return None
        t_s, values, rate_hz = window
        known_s = (np.array([t for t, _, _ in self._motion]) - t_ns) * 1e-9
        if known_s[0] > t_s[0] + 0.3:
            return None  # the filter began within the window
        speed = np.interp(t_s, known_s, np.array([v for _, v, _ in self._motion]))
        over = speed - self._motion[-1][1]
        steps = 0.5 * (over[1:] + over[:-1]) * np.diff(t_s)
        extra_m = np.concatenate([[0.0], np.cumsum(steps)])
        return spectrum(t_s, values, rate_hz, extra_m - extra_m[-1])
