"""What the lines of some windows say of a filter's speed: likelihood and posterior.

Lines may be absent, an engine may be louder, and the error of the speed grows from
window to window. What is left must be one clear top; else there is no answer.
"""

import math
from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np

from imu_tracker.wheels.windows import Array, Spectrum

WORTH_SHARE: Final = 0.8
"""An answer that leaves more of the variance than this says nothing."""

ALIKE: Final = 2.0
"""Windows share half of their samples, and six channels of one box shake alike: so many
votes are one."""

MOST_POWER: Final = 3.0
"""In units of a line's mean: what is stronger is something else, and counts no more."""

ORDER_NATS: Final = 4.0
ORDER_TIMES: Final = 1.5
"""No order says more in one window than this, or than so many times what it says on
average where its lines are. An engine in gear makes a line that follows the speed and
is stronger than a wheel's: a wheel's weak order must not speak for it."""

ABSENT: Final = 0.1
GONE: Final = 0.8
"""Probability that the lines are missing in one window (a bump), and in all windows of
a measurement (another surface): the highest peak of noise is no speed. So one answer in
a hundred is beyond three sigma."""

TOP_MPS: Final = 0.75
TOP_SHARE: Final = 0.9
"""An answer with less of its probability so near to its mean has two tops, or none."""

SMEAR_MPS: Final = 0.12
"""The error of a filter's speed does not quite keep to a straight line in time."""

REACH_SIGMAS: Final = 3.5
LEAST_REACH_MPS: Final = 0.5
MOST_REACH_MPS: Final = 8.0
STEP_MPS: Final = 0.05
ERRORS_MPS: Final = np.arange(-MOST_REACH_MPS, MOST_REACH_MPS, STEP_MPS)
"""Of a filter's speed: the grid of all that follows."""

FLOOR_MPS: Final = 0.12
FLOOR_SHARE: Final = 0.002
"""No answer counts as better: the window's resolution, and wheels that slip."""


class SpeedError(NamedTuple):
    """A filter's speed at an instant is too low by `error_mps`."""

    error_mps: float
    var: float  # (m/s)^2


class Turning(NamedTuple):
    """How a filter takes its wheels to turn."""

    t_ns: int
    speed_mps: float
    circumference_m: float


class Weighed(NamedTuple):
    """A window whose likelihood is known."""

    t_ns: int
    sigma_mps: float  # of the filter's speed, against that of its wheels
    log_l: Array  # shape (n,), at `ERRORS_MPS`


def weighed(
    found: Spectrum, strength: Array, turning: Turning, sigma_mps: float
) -> Weighed:
    """Weigh a window; `sigma_mps` is that of the speed against that of its wheels."""
    t_ns, speed_mps, circumference_m = turning
    turns_hz = np.maximum(speed_mps + ERRORS_MPS, 0.0) / circumference_m
    log_l = blurred(log_likelihood(found, strength, turns_hz)) / ALIKE
    return Weighed(t_ns, sigma_mps, log_l)


def log_likelihood(found: Spectrum, strength: Array, turns_hz: Array) -> Array:
    """Log-likelihood of turns per second, shape (n,).

    Notes
    -----
    Under a line the power is exponential with the mean 1 + rho, elsewhere with the
    mean 1: log L = sum of -log(1 + rho) + r rho / (1 + rho) over orders and channels,
    no r above `MOST_POWER` (1 + rho), no order above `ORDER_NATS` and `ORDER_TIMES` its
    mean under lines, the sum of rho - log(1 + rho); or else, with the probability
    `ABSENT`, the window says nothing.
    """
    rho = strength
    power = np.minimum(found.at(turns_hz) / (1.0 + rho), MOST_POWER)
    terms = power * rho - np.log1p(rho)
    mean = (rho - np.log1p(rho)).sum(axis=1)
    most = np.maximum(ORDER_TIMES * mean, ORDER_NATS)
    total = np.minimum(terms.sum(axis=2), most).sum(axis=1)
    log_l: Array = np.logaddexp(total + math.log(1.0 - ABSENT), math.log(ABSENT))
    return log_l


def blurred(log_l: Array) -> Array:
    """Widen a likelihood by `SMEAR_MPS`."""
    most = float(log_l.max())
    likelihood = np.pad(np.exp(log_l - most), len(_SMEAR) // 2, mode="edge")
    smeared: Array = np.convolve(likelihood, _SMEAR, "valid")
    return np.log(np.maximum(smeared, 1e-300)) + most


def _gaussian(x: Array) -> Array:
    weights = np.exp(-0.5 * x**2)
    normalised: Array = weights / weights.sum()
    return normalised


_SMEAR: Final = _gaussian(np.arange(-8.0, 9.0) * STEP_MPS / SMEAR_MPS)
_NODES: Final = np.linspace(-2.0, 2.0, 9)  # of a normal distribution
_LOG_NODES: Final = np.log(_gaussian(_NODES))


def joint(together: Sequence[Weighed]) -> tuple[Array, Array]:
    """Prior of the newest error, and prior times likelihood of all windows, as logs.

    Notes
    -----
    What is wrong with the tilt is so for the whole time: the error was e_1 at the first
    window, N(0, s_1^2), and grew evenly, by N(0, s_n^2 - s_1^2), s the filter's own
    sigma. So a window i is read at e_n less what came after it.
    """
    first, last = together[0], together[-1]
    grown_mps = math.sqrt(max(last.sigma_mps**2 - first.sigma_mps**2, 0.0))
    drifts_mps = _NODES * grown_mps
    start_mps = ERRORS_MPS - drifts_mps[:, None]
    log_prior = _LOG_NODES[:, None] - 0.5 * (start_mps / first.sigma_mps) ** 2
    reach_mps = max(REACH_SIGMAS * last.sigma_mps, LEAST_REACH_MPS)
    log_prior = np.where(np.abs(ERRORS_MPS) <= reach_mps, log_prior, -math.inf)
    span_ns = max(last.t_ns - first.t_ns, 1)
    n = len(ERRORS_MPS)
    log_l = np.zeros_like(log_prior)
    for window in together:
        since = (last.t_ns - window.t_ns) / span_ns
        back = np.rint(drifts_mps * since / STEP_MPS).astype(np.intp)
        log_l += window.log_l[np.clip(np.arange(n) - back[:, None], 0, n - 1)]
    return (
        np.logaddexp.reduce(log_prior, axis=0),
        np.logaddexp.reduce(log_prior + log_l, axis=0),
    )


def posterior(
    together: Sequence[Weighed], speed_mps: float
) -> tuple[SpeedError | None, float]:
    """Weigh the filter's speed with the wheels', and take the filter out again.

    Parameters
    ----------
    together : sequence of Weighed
        Windows; the last one is the instant that the answer is of.
    speed_mps : float
        Of the filter.

    Returns
    -------
    SpeedError or None
        None: too little is known more.
    float
        Share of the variance that is left.

    Notes
    -----
    Mean m and variance s of prior times likelihood on a grid; two tops make s wide. The
    measurement that does the same to a Kalman filter has the variance
    R = s P / (P - s) and the value m P / (P - s). P is the prior's variance on that
    grid: where the grid cuts a wide prior off, the cut is no evidence. With the
    probability `GONE` there are no lines, L = 1, and the prior remains.
    """
    log_prior, log_lines = joint(together)
    _, prior_var = _moments(log_prior)
    log_p = np.logaddexp(log_lines + math.log(1.0 - GONE), log_prior + math.log(GONE))
    mean, var = _moments(log_p)
    p = np.exp(log_p - log_p.max())
    top = float(p[np.abs(ERRORS_MPS - mean) < TOP_MPS].sum() / p.sum())
    if var > WORTH_SHARE * prior_var or top < TOP_SHARE:
        return None, 1.0
    gain = prior_var / (prior_var - var)
    floor = math.hypot(FLOOR_MPS, FLOOR_SHARE * speed_mps)
    return SpeedError(mean * gain, var * gain + floor**2), var / prior_var


def _moments(log_p: Array) -> tuple[float, float]:
    """Mean and variance of the error under unnormalised log-probabilities."""
    p = np.exp(log_p - log_p.max())
    p /= p.sum()
    mean = float(p @ ERRORS_MPS)
    return mean, float(p @ (ERRORS_MPS - mean) ** 2)
