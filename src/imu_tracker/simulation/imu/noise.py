"""Random processes that go on for ever in constant memory."""

import math

import numpy as np
from numpy.typing import ArrayLike

from imu_tracker.simulation.motion.paths import FloatArray


class GaussMarkov:
    """Independent first-order Gauss-Markov processes, stationary from the start.

    Parameters
    ----------
    rng : Generator
        Its own: nobody else may draw from it.
    sigma : array_like, shape (k,)
        Standard deviation of each process.
    tau_s : array_like
        Time after which the correlation has fallen to 1/e, of each or of all.
    knot_s : float
        Drawn exactly at multiples of this, straight lines between.
    """

    def __init__(
        self,
        rng: np.random.Generator,
        sigma: ArrayLike,
        tau_s: ArrayLike,
        knot_s: float = 1.0,
    ) -> None:
        self._rng = rng
        self._sigma = np.asarray(sigma, dtype=float)
        self._knot_s = knot_s
        taus_s = np.broadcast_to(np.asarray(tau_s, dtype=float), self._sigma.shape)
        self._keep = np.array([math.exp(-knot_s / tau) for tau in taus_s.tolist()])
        self._first = 0  # number of the first knot remembered
        self._knots = [self._sigma * rng.standard_normal(len(self._sigma))]

    def at(self, t_s: FloatArray) -> FloatArray:
        """Values at growing instants from 0 on, shape (n, k)."""
        place = t_s / self._knot_s
        last = int(place[-1]) + 1
        fresh = self._sigma * np.sqrt(1.0 - self._keep**2)
        while self._first + len(self._knots) <= last:
            step = fresh * self._rng.standard_normal(len(fresh))
            self._knots.append(self._keep * self._knots[-1] + step)
        passed = max(0, int(place[0]) - self._first)
        del self._knots[:passed]
        self._first += passed

        knots = np.array(self._knots)
        left = place.astype(int) - self._first
        share = (place - place.astype(int))[:, None]
        values: FloatArray = (1.0 - share) * knots[left] + share * knots[left + 1]
        return values


class Flicker:
    """Independent noises with a spectrum of 1/f: what "bias instability" is.

    Parameters
    ----------
    rng : Generator
        Its own: nobody else may draw from it.
    instability : array_like, shape (k,)
        Bias instability of each, as IEEE Std 952 defines it: the Allan deviation is
        flat at 0.664 of it, here from 1 s to 1000 s.

    Notes
    -----
    Gauss-Markov processes whose correlation times grow by a factor r, each of variance
    B^2 ln(r) / pi, add up to the one-sided spectrum B^2 / (pi f).
    Source: Keshner 1982, "1/f noise", Proc. IEEE 70(3), section IV.
    """

    _FACTOR = 3.0
    _SHORTEST_S = 0.1
    _N = 11  # up to 5900 s
    _KNOT_S = 0.05

    def __init__(self, rng: np.random.Generator, instability: ArrayLike) -> None:
        each = np.asarray(instability, dtype=float)
        taus_s = self._SHORTEST_S * self._FACTOR ** np.arange(self._N)
        sigma = each * math.sqrt(math.log(self._FACTOR) / math.pi)
        self._n_axes = len(each)
        self._parts = GaussMarkov(
            rng, np.tile(sigma, self._N), np.repeat(taus_s, len(each)), self._KNOT_S
        )

    def at(self, t_s: FloatArray) -> FloatArray:
        """Values at growing instants from 0 on, shape (n, k)."""
        parts = self._parts.at(t_s).reshape(len(t_s), self._N, self._n_axes)
        total: FloatArray = parts.sum(axis=1)
        return total


class Rumble:
    """Band-limited noise of unit variance, as an engine or a road makes it.

    It has no part at zero frequency: what vibrates does not travel.

    Parameters
    ----------
    rng : Generator
        Its own: nobody else may draw from it.
    n_axes : int
        How many independent processes.
    rate_hz : float
        Sample rate.
    centre_hz, width_hz : float
        Middle and half width of the band.
    """

    def __init__(
        self,
        rng: np.random.Generator,
        n_axes: int,
        rate_hz: float,
        centre_hz: float = 12.0,
        width_hz: float = 4.0,
    ) -> None:
        self._rng = rng
        half = math.ceil(0.5 * rate_hz / width_hz)
        t_s = np.arange(-half, half + 1) / rate_hz
        window = np.hanning(len(t_s) + 2)[1:-1]
        kernel = window * np.cos(2.0 * np.pi * centre_hz * t_s)
        kernel -= window * (kernel.sum() / window.sum())
        self._kernel = kernel / np.sqrt(np.sum(kernel**2))
        self._tail = rng.standard_normal((len(kernel) - 1, n_axes))

    def draw(self, n: int) -> FloatArray:
        """Return the next samples, shape (n, n_axes)."""
        fresh = self._rng.standard_normal((n, self._tail.shape[1]))
        noise = np.vstack([self._tail, fresh])
        self._tail = noise[n:]
        columns = [np.convolve(axis, self._kernel, "valid") for axis in noise.T]
        return np.column_stack(columns)
