"""Allan deviation: which noise a sensor has, told by how averaging helps.

Averaged over `tau` seconds, white noise falls with 1/sqrt(tau), a wandering bias
stays, and a random walk grows. A fit of these three to the overlapping Allan variance
gives the coefficients of IEEE Std 952. What a newcomer gets wrong: the points of the
curve are not independent, and the last ones hardly mean anything. The fit weighs them
by their covariance, which follows from the spectrum of the noise itself.
"""

import math
from collections.abc import Sequence
from itertools import combinations
from typing import Final, NamedTuple

import numpy as np

from imu_tracker.calibration.readings import Array

FLICKER: Final = 2.0 * math.log(2.0) / math.pi
"""Allan variance of flicker noise with a bias instability of 1 (IEEE Std 952)."""

SHORTEST_FIT_S: Final = 0.1
"""Below, the chip's low-pass filter joins neighbouring samples."""

MOST_OF_IT: Final = 8
"""The longest average is an eighth of the longest stretch: fewer say nothing."""

LEAST_LONGEST_S: Final = 2.0
"""A curve that ends before cannot tell noise from vibration."""

_SIGMAS_95: Final = 1.96
_MODEL_ERROR: Final = 0.01
"""Of each variance: no sensor is quite what three kinds of noise can say."""

_FREQUENCIES: Final = 4_000


class Curve(NamedTuple):
    """Overlapping Allan deviation of one axis, shape (k,)."""

    tau_s: Array
    deviation: Array
    length_s: float  # of all stretches together
    rate_hz: float


class Coefficient(NamedTuple):
    """A value, and the interval that holds it with 95 % probability."""

    value: float
    low: float
    high: float


class Noise(NamedTuple):
    """What the curve of one axis says; `x` is the unit of the axis.

    Attributes
    ----------
    random_walk : Coefficient, x sqrt(s)
        White noise, as angle or velocity random walk.
    bias_instability : Coefficient, x
        Flicker noise: 0.664 of it is how flat the curve becomes.
    rate_random_walk : Coefficient, x / sqrt(s)
        How the bias walks away.
    lowest, lowest_tau_s : float
        The lowest point of the curve.
    misfit : float
        Chi-square per degree of freedom; the intervals have grown by its root.
    """

    random_walk: Coefficient
    bias_instability: Coefficient
    rate_random_walk: Coefficient
    lowest: float
    lowest_tau_s: float
    misfit: float

    def variance(self, tau_s: Array) -> Array:
        """Return the Allan variance that was fitted."""
        squares = np.square(
            [
                self.random_walk.value,
                self.bias_instability.value,
                self.rate_random_walk.value,
            ]
        )
        fitted: Array = _shapes(tau_s) @ squares
        return fitted


def allan_curve(stretches: Sequence[Array], rate_hz: float) -> Curve:
    """Compute the overlapping Allan deviation of one axis over all stretches.

    Parameters
    ----------
    stretches : sequence of ndarray, shape (n,)
        Evenly spaced values of the rate or of the specific force.
    rate_hz : float
        Their rate.

    Notes
    -----
    avar(m) = mean((x[k+2m] - 2 x[k+m] + x[k])^2) / (2 tau^2), with x the sum of the
    values and tau = m / rate. Source: IEEE Std 952-1997, annex C; NIST SP 1065,
    equation 10.
    """
    longest = max(map(len, stretches), default=0)
    octaves = range(2 * max(0, int(math.log2(max(1, longest // MOST_OF_IT)))) + 1)
    factors = np.unique(np.rint(2.0 ** (np.array(octaves) / 2)).astype(int))
    phases = [
        np.concatenate([[0.0], np.cumsum(values - values.mean())]) / rate_hz
        for values in stretches
        if len(values)
    ]
    variances = []
    for m in factors:
        tau_s = m / rate_hz
        total = count = 0.0
        for phase in phases:
            if len(phase) > 2 * m:
                bends = phase[2 * m :] - 2.0 * phase[m:-m] + phase[: -2 * m]
                total += float(bends @ bends)
                count += len(bends)
        variances.append(total / (2.0 * tau_s**2 * max(count, 1.0)))
    return Curve(
        factors / rate_hz,
        np.sqrt(variances),
        sum(map(len, stretches)) / rate_hz,
        rate_hz,
    )


def fit_noise(curve: Curve) -> Noise | None:
    """Read the noise off a curve; None when it is too short, or of a dead axis.

    Notes
    -----
    avar(tau) = N^2 / tau + B^2 (2 ln 2 / pi) + K^2 tau / 3, by generalised least
    squares, none of the three below zero.
    """
    is_fit = curve.tau_s >= SHORTEST_FIT_S
    tau_s, observed = curve.tau_s[is_fit], np.square(curve.deviation[is_fit])
    if not len(tau_s) or tau_s[-1] < LEAST_LONGEST_S or not observed.all():
        return None
    shapes = _shapes(tau_s)
    squares = np.array([float(np.median(observed[:3] * tau_s[:3])), 0.0, 0.0])
    f_hz, through = _seen_through(tau_s, curve.rate_hz)
    for _ in range(3):
        covariance = _covariance(squares, f_hz, through, curve.length_s)
        covariance += np.diag(np.square(_MODEL_ERROR * (shapes @ squares)))
        try:
            weights: Array = np.asarray(np.linalg.inv(covariance), float)
        except np.linalg.LinAlgError:  # a signal, no noise: the fit has nothing to say
            return None
        squares, misfit = _least_squares(shapes, observed, weights)
    freedom = len(tau_s) - int(np.count_nonzero(squares))
    misfit /= max(freedom, 1)
    spread = np.linalg.inv(shapes.T @ weights @ shapes) * max(1.0, misfit)
    sigmas = np.sqrt(np.diag(spread))
    lowest = int(np.argmin(observed))
    return Noise(
        _coefficient(squares[0], sigmas[0]),
        _coefficient(squares[1], sigmas[1]),
        _coefficient(squares[2], sigmas[2]),
        float(math.sqrt(observed[lowest])),
        float(tau_s[lowest]),
        float(misfit),
    )


def _shapes(tau_s: Array) -> Array:
    """Allan variance of unit random walk, bias instability and rate random walk."""
    return np.column_stack([1.0 / tau_s, np.full_like(tau_s, FLICKER), tau_s / 3.0])


def _seen_through(tau_s: Array, rate_hz: float) -> tuple[Array, Array]:
    """Return frequencies, and how much of each the points of a curve see, (k, f).

    Notes
    -----
    The Allan variance is the spectrum S seen through H(f) = 2 sin^4(pi f tau) /
    (m sin(pi f / rate))^2; returned is H sqrt(df).
    """
    f_hz = np.geomspace(0.02 / tau_s[-1], 0.5 * rate_hz, _FREQUENCIES)
    down = np.outer(1.0 / (tau_s * rate_hz), 1.0 / np.sin(np.pi * f_hz / rate_hz))
    through: Array = 2.0 * np.sin(np.pi * np.outer(tau_s, f_hz)) ** 4 * down**2
    return f_hz, through * np.sqrt(np.gradient(f_hz))


def _covariance(squares: Array, f_hz: Array, through: Array, length_s: float) -> Array:
    """Covariance of the points of a curve, for the noise that is in it.

    Notes
    -----
    Frequencies of a record of length T, 1 / T apart, are independent and exponential,
    so cov = 1/T integral of S^2 H_i H_j df.
    """
    white, flicker, walk = squares
    spectrum = 2.0 * white + flicker / (np.pi * f_hz)
    spectrum += walk / (2.0 * np.pi**2 * np.square(f_hz))
    seen = through * spectrum
    covariance: Array = seen @ seen.T / length_s
    return covariance


def _least_squares(
    shapes: Array, observed: Array, weights: Array
) -> tuple[Array, float]:
    """Best squares of the coefficients, none negative, white noise always there."""
    best, least = np.zeros(3), math.inf
    for others in (pair for n in (2, 1, 0) for pair in combinations((1, 2), n)):
        chosen = [0, *others]
        part = shapes[:, chosen]
        solved = np.linalg.solve(part.T @ weights @ part, part.T @ weights @ observed)
        if solved.min() < 0:
            continue
        left = observed - part @ solved
        chi_square = float(left @ weights @ left)
        if chi_square < least:
            least, best = chi_square, np.zeros(3)
            best[chosen] = solved
    return best, least


def _coefficient(square: float, sigma: float) -> Coefficient:
    # Variances of few averages are skew, the more the less is known: to second order.
    skew = min(1.0, sigma / square) if square else 1.0
    low, high = square - _SIGMAS_95 * sigma, square + _SIGMAS_95 * sigma * (1.0 + skew)
    return Coefficient(*(math.sqrt(max(0.0, x)) for x in (square, low, high)))
