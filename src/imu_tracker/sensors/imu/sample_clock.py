"""When the chip took its samples, told in the host's time.

Pure arithmetic. What a newcomer gets wrong: the chip's clock is 1 or 2 % off, so its
100 Hz are 98 to 102, and the time at which the host reads says little about the time
at which the chip measured. But the number of samples that the FIFO held at a known
instant says both, in the long run, to a fraction of a millisecond.
"""

from typing import Final

PERIOD_SIGMA: Final = 0.01  # PS-MPU-6000A section 6.6: the PLL is within 1 %
PERIOD_WALK: Final = 5e-6  # per square root of a second, while the chip warms up

_PER_NS: Final = 1e-9


class SampleClock:
    """Fit the chip's clock to the host's from the counts of the FIFO.

    Parameters
    ----------
    rate_hz : float
        Sample rate by the chip's own clock.
    delay_ns : int
        Delay of the low-pass filter: a sample describes the instant before it.

    Notes
    -----
    A Kalman filter of two states: the time t at which the newest sample became
    complete, and the period p. A look into the FIFO at the time T means that t lies
    in (T - p, T], evenly: a measurement z = T - p / 2 with variance p^2 / 12. The
    instant of the look itself is known to lie between two readings of the clock,
    which widens the variance when the host was interrupted between them, and the
    interval is a hard bound besides. The errors are independent as long as the looks
    drift through the phase of the chip: see `imu.drain_period_ns`.
    """

    def __init__(self, rate_hz: float, delay_ns: int) -> None:
        self._delay_ns, self._p = delay_ns, 1e9 / rate_hz
        self._t = self._var_t = self._cov = 0.0
        self._var_p = (PERIOD_SIGMA * self._p) ** 2
        self._has_phase, self._stamped_ns = False, 0

    @property
    def rate_hz(self) -> float:
        """The sample rate by the host's clock, as far as it is known."""
        return 1e9 / self._p

    def restart(self) -> None:
        """Forget the phase, samples were lost; the period stays known."""
        self._has_phase = False

    def stamp(self, count: int, before_ns: int, after_ns: int) -> list[int]:
        """Return the instants of the `count` samples of one look into the FIFO.

        Parameters
        ----------
        count : int
            How many samples became complete since the last look.
        before_ns, after_ns : int
            The look was between these.

        Returns
        -------
        list of int, length `count`
            Later than all before, strictly increasing, ns of CLOCK_MONOTONIC, the
            delay of the filter taken off.
        """
        if not (count or self._has_phase):
            return []
        z = (before_ns + after_ns) / 2 - self._p / 2
        var_z = (self._p**2 + (after_ns - before_ns) ** 2) / 12
        if self._has_phase:
            self._predict(count)
            self._update(z, var_z)
            start_ns = self._stamped_ns
        else:
            self._t, self._var_t, self._cov = z, var_z, 0.0
            self._has_phase = True
            start_ns = max(round(self._t - count * self._p), self._stamped_ns)
        self._t = min(max(self._t, before_ns - self._p), after_ns)
        return self._spread(count, start_ns)

    def _predict(self, count: int) -> None:
        elapsed_s = count * self._p * _PER_NS
        self._t += count * self._p
        self._var_t += count * (2 * self._cov + count * self._var_p)
        self._cov += count * self._var_p
        self._var_p += (PERIOD_WALK * self._p) ** 2 * elapsed_s

    def _update(self, z: float, var_z: float) -> None:
        innovation, variance = z - self._t, self._var_t + var_z
        gain_t, gain_p = self._var_t / variance, self._cov / variance
        self._t += gain_t * innovation
        self._p += gain_p * innovation
        self._var_p -= gain_p * self._cov
        self._cov *= 1 - gain_t
        self._var_t *= 1 - gain_t

    def _spread(self, count: int, start_ns: int) -> list[int]:
        """Lay the samples evenly behind the last one of the block before."""
        if not count:
            return []
        length_ns = max(round(self._t) - start_ns, count)  # time never stands still
        self._stamped_ns = start_ns + length_ns
        return [
            start_ns + length_ns * number // count - self._delay_ns
            for number in range(1, count + 1)
        ]
