"""By how much a filter's speed is wrong, from what the wheels sound like.

While GPS is there the circumference and the strength of the lines are learnt; without
it the lines say which speed fits. The error of a filter's speed changes little within
some seconds, so their windows are weighed together: a line that passes by is outvoted.
Where nothing is heard nothing is said.
"""

import math
from collections import deque
from typing import Final, NamedTuple

import numpy as np

from imu_tracker.samples import ImuSample
from imu_tracker.wheels.orders import OrderLearner, Wheels
from imu_tracker.wheels.windows import (
    WINDOW_S,
    Array,
    Samples,
    Spectrum,
    spectrum,
)

LEARN_EVERY_S: Final = 2.0
EVERY_S: Final = 1.0
OVERLAP: Final = WINDOW_S / EVERY_S
"""Windows share samples: so many of them are one piece of evidence."""

TOGETHER: Final = 6
"""Windows that make one measurement; then the evidence begins again."""

ALIKE_CHANNELS: Final = 2.0
"""Six channels of one box feel the same shaking: so many of them are one."""

LASTING: Final = 3.0
"""A line that is taken for another one is so again six seconds later: measurements of
an outage share their errors, and count as a third."""

LEAST_SPEED_MPS: Final = 6.0
"""Below, the first order drowns in what the body does when it starts and stops."""

KNOWN_SIGMA_MPS: Final = 0.5
"""A speed known worse than this teaches nothing of the circumference."""

REACH_SIGMAS: Final = 3.5
LEAST_REACH_MPS: Final = 0.5
MOST_REACH_MPS: Final = 8.0
STEP_MPS: Final = 0.05

FLOOR_MPS: Final = 0.15
FLOOR_SHARE: Final = 0.006
"""No heard speed counts as better: the window's resolution, and a circumference that
changes by 0.5 % with temperature and load, the same way for a whole outage."""

WORTH_SHARE: Final = 0.8
"""An answer that leaves more of the variance than this says nothing."""


class SpeedError(NamedTuple):
    """A filter's speed at an instant is too low by `error_mps`."""

    error_mps: float
    var: float  # (m/s)^2


class WheelSpeed:
    """Learns the wheels with GPS, and tells the speed without it.

    Attributes
    ----------
    asked_windows, heard_windows : int
        Measurements that were due without GPS, and those that said something.
    """

    def __init__(self) -> None:
        self._samples = Samples()
        self._learner = OrderLearner()
        self._speeds: deque[tuple[int, float]] = deque()
        self._due_ns = 0
        self._errors = np.arange(-MOST_REACH_MPS, MOST_REACH_MPS, STEP_MPS)
        self._log_l = np.zeros(len(self._errors))
        self._n_together = 0
        self.heard_windows = self.asked_windows = 0

    @property
    def wheels(self) -> Wheels | None:
        """What was learnt; None: nothing is heard."""
        return self._learner.wheels

    def add_sample(self, sample: ImuSample) -> None:
        """Take a calibrated sample, at the IMU's own rate."""
        self._samples.add(sample)

    def add_speed(
        self, t_ns: int, speed_mps: float, sigma_mps: float, *, has_gps: bool
    ) -> SpeedError | None:
        """Take the speed of a filter at its own instant, a few times a second.

        `reset_evidence` goes before when it is another filter's speed.

        Returns
        -------
        SpeedError or None
            None: not due, nothing heard, or GPS says it better.
        """
        speeds = self._speeds
        if speeds and t_ns <= speeds[-1][0]:
            speeds.clear()
        speeds.append((t_ns, speed_mps))
        while speeds[0][0] < t_ns - int((WINDOW_S + 0.5) * 1e9):
            speeds.popleft()
        if has_gps:
            self.reset_evidence()
        every_s = LEARN_EVERY_S if has_gps else EVERY_S
        if t_ns < self._due_ns <= t_ns + int(every_s * 1e9):
            return None
        self._due_ns = t_ns + int(every_s * 1e9)
        if min(v for _, v in speeds) < LEAST_SPEED_MPS:
            return None
        wheels = self._learner.wheels
        is_asked = not has_gps and wheels is not None
        if not is_asked and (not has_gps or sigma_mps > KNOWN_SIGMA_MPS):
            return None
        found = self._spectrum_at(t_ns)
        if found is None:
            return None
        if wheels is None or has_gps:
            self._learner.learn(found, speed_mps, LEARN_EVERY_S)
            return None
        speeds_mps = np.maximum(speed_mps + self._errors, 0.0)
        self._log_l += log_likelihood(found, wheels, speeds_mps)
        self._n_together += 1
        if self._n_together < TOGETHER:
            return None
        answer = posterior(self._errors, self._log_l, speed_mps, sigma_mps)
        self.reset_evidence()
        self.asked_windows += 1
        self.heard_windows += answer is not None
        return answer

    def reset_evidence(self) -> None:
        """Drop the windows that are not a measurement yet."""
        if self._n_together:
            self._log_l = np.zeros(len(self._errors))
            self._n_together = 0

    def _spectrum_at(self, t_ns: int) -> Spectrum | None:
        window = self._samples.until(t_ns)
        if window is None:
            return None
        t_s, values, rate_hz = window
        known_s = (np.array([t for t, _ in self._speeds]) - t_ns) * 1e-9
        if known_s[0] > t_s[0] + 0.3:
            return None  # the filter began within the window
        speed = np.interp(t_s, known_s, np.array([v for _, v in self._speeds]))
        over = speed - self._speeds[-1][1]
        steps = 0.5 * (over[1:] + over[:-1]) * np.diff(t_s)
        extra_m = np.concatenate([[0.0], np.cumsum(steps)])
        return spectrum(t_s, values, rate_hz, extra_m - extra_m[-1])


def log_likelihood(heard: Spectrum, wheels: Wheels, speeds_mps: Array) -> Array:
    """Log-likelihood of speeds, shape (n,).

    Notes
    -----
    Under a line the power is exponential with the mean 1 + rho, elsewhere with the
    mean 1: log L = sum of -log(1 + rho) + r rho / (1 + rho) over orders and channels.
    """
    rho = wheels.strength
    ratio = heard.at(speeds_mps / wheels.circumference_m)
    terms = ratio * (rho / (1.0 + rho)) - np.log1p(rho)
    total: Array = terms.sum(axis=(1, 2))
    return total


def posterior(
    errors_mps: Array, log_l: Array, speed_mps: float, sigma_mps: float
) -> SpeedError | None:
    """Weigh the filter's speed with what is heard, and take the filter out again.

    Parameters
    ----------
    errors_mps, log_l : ndarray, shape (n,)
        Errors of the filter's speed, and their log-likelihood.
    speed_mps, sigma_mps : float
        Of the filter.

    Notes
    -----
    Mean m and variance s of prior times likelihood on a grid; two tops make s wide. The
    measurement that does the same to a Kalman filter has the variance
    R = s P / (P - s) and the value m P / (P - s). P is the prior's variance on that
    grid: where the grid cuts a wide prior off, the cut is no evidence.
    """
    reach = max(REACH_SIGMAS * sigma_mps, LEAST_REACH_MPS)
    log_prior = -0.5 * (errors_mps / sigma_mps) ** 2
    log_prior = np.where(np.abs(errors_mps) <= reach, log_prior, -math.inf)
    _, prior_var = _moments(errors_mps, log_prior)
    log_p = log_prior + log_l / (OVERLAP * ALIKE_CHANNELS)
    mean, var = _moments(errors_mps, log_p)
    if var > WORTH_SHARE * prior_var:
        return None
    gain = prior_var / (prior_var - var)
    floor = math.hypot(FLOOR_MPS, FLOOR_SHARE * speed_mps)
    return SpeedError(mean * gain, LASTING * var * gain + floor**2)


def _moments(x: Array, log_p: Array) -> tuple[float, float]:
    """Mean and variance of x under unnormalised log-probabilities."""
    p = np.exp(log_p - log_p.max())
    p /= p.sum()
    mean = float(p @ x)
    return mean, float(p @ (x - mean) ** 2)
