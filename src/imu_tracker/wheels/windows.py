"""Windows of samples, and their spectra with the change of speed taken out.

A wheel that turns `u` times a second makes lines at `k u`, `k` the order. Speed changes
within a window and smears them; each order is demodulated by the way that the speed
profile differs from its end, which leaves a sharp line at `k v / C`.
"""

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from imu_tracker.samples import ImuSample

Array = NDArray[np.float64]

CHANNELS: Final = 6
ORDERS: Final = (1, 2, 3)
"""Imbalance, out-of-round tyre, and the next; higher ones need more than 100 Hz."""

WINDOW_S: Final = 4.0
"""0.25 Hz of resolution: 0.5 m/s for the first order, less for the others."""

KEPT_S: Final = 8.0
"""The filter runs up to 2.5 s behind the newest sample."""

TYPICAL_CIRCUMFERENCE_M: Final = 1.95
"""For the demodulation alone: 15 % off smears by 15 % of what was smeared before."""

FLOOR_HZ: Final = 1.5
"""Half the width over which power is averaged to find what is there without a line."""


_MOST_WAITING: Final = 1024  # samples, while nobody asks for a window


class Spectrum(NamedTuple):
    """Power over its neighbourhood, by order, bin and channel: 1 without a line."""

    ratio: Array  # shape (orders, bins, channels)
    bin_hz: float

    def at(self, turns_hz: Array) -> Array:
        """Read the ratio at each order's multiple of some turns per second.

        Parameters
        ----------
        turns_hz : ndarray, shape (n,)

        Returns
        -------
        ndarray, shape (n, orders, channels)
            1 beyond the spectrum's end: nothing is known there.
        """
        n_bins = self.ratio.shape[1]
        found = np.ones((len(turns_hz), len(ORDERS), CHANNELS))
        for i, order in enumerate(ORDERS):
            bins = np.rint(order * turns_hz / self.bin_hz).astype(np.intp)
            inside = (bins > 0) & (bins < n_bins)
            found[inside, i] = self.ratio[i, bins[inside]]
        return found


class Samples:
    """The last seconds of samples, in rings of fixed length."""

    def __init__(self) -> None:
        self._t_ns = np.zeros(0, dtype=np.int64)
        self._values = np.zeros((0, CHANNELS))
        self._waiting: list[tuple[int, float, float, float, float, float, float]] = []

    def add(self, sample: ImuSample) -> None:
        """Take a sample."""
        t_ns, (ax, ay, az), (gx, gy, gz) = sample[:3]
        self._waiting.append((t_ns, ax, ay, az, gx, gy, gz))
        if len(self._waiting) >= _MOST_WAITING:
            self._gather()

    def _gather(self) -> None:
        if not self._waiting:
            return
        t_ns = np.array([each[0] for each in self._waiting], dtype=np.int64)
        values = np.array([each[1:] for each in self._waiting])
        self._waiting.clear()
        self._t_ns = np.concatenate([self._t_ns, t_ns])
        self._values = np.concatenate([self._values, values])
        keep = self._t_ns > self._t_ns[-1] - int(KEPT_S * 1e9)
        self._t_ns, self._values = self._t_ns[keep], self._values[keep]

    def until(self, end_ns: int) -> tuple[Array, Array, float] | None:
        """Return the window that ends at an instant.

        Returns
        -------
        t_s : ndarray, shape (n,)
            Relative to the end, 0 or less.
        values : ndarray, shape (n, channels)
        rate_hz : float
            None is returned where samples are missing.
        """
        self._gather()
        low, high = np.searchsorted(self._t_ns, [end_ns - int(WINDOW_S * 1e9), end_ns])
        if high - low < 16:
            return None
        t_s: Array = (self._t_ns[low:high] - end_ns).astype(np.float64) * 1e-9
        gaps_s = np.diff(t_s)
        period_s = float(gaps_s.mean())
        if t_s[-1] - t_s[0] < 0.95 * WINDOW_S or gaps_s.max() > 5.0 * period_s:
            return None
        return t_s, self._values[low:high], 1.0 / period_s


def spectrum(t_s: Array, values: Array, rate_hz: float, extra_m: Array) -> Spectrum:
    """Spectrum of a window, each order demodulated.

    Parameters
    ----------
    t_s : ndarray, shape (n,)
        Relative to the end of the window.
    values : ndarray, shape (n, channels)
    rate_hz : float
    extra_m : ndarray, shape (n,)
        Way relative to the end, less the way at the speed of the end: 0 at a steady
        speed.

    Notes
    -----
    y_k = x hann exp(-2 pi i k extra / C); ratio = |Y_k|^2 / mean of |Y_k|^2 within
    1.5 Hz on both sides.
    """
    n = len(t_s)
    size = 1 << (2 * n - 1).bit_length()
    shaped = (values - values.mean(axis=0)) * np.hanning(n)[:, None]
    phase = -2j * np.pi * extra_m / TYPICAL_CIRCUMFERENCE_M
    turned = np.stack([shaped * np.exp(k * phase)[:, None] for k in ORDERS])
    power = np.abs(np.fft.fft(turned, size, axis=1)[:, : size // 2]) ** 2
    half = max(round(FLOOR_HZ * size / rate_hz), 1)
    total = np.cumsum(np.pad(power, ((0, 0), (1, 0), (0, 0))), axis=1)
    bins = np.arange(power.shape[1])
    low, high = np.maximum(bins - half, 0), np.minimum(bins + half + 1, len(bins))
    mean = (total[:, high] - total[:, low]) / (high - low)[None, :, None]
    return Spectrum(power / np.maximum(mean, 1e-30), rate_hz / size)
