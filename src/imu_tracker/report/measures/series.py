"""A value over time in so many bins and no more: a drive of an hour, or of a month."""

from typing import Final, NamedTuple

BINS: Final = 600
"""Two pixels each on a wide screen."""


class Bin(NamedTuple):
    """What came in one stretch of time."""

    t_s: float  # its middle
    least: float
    mean: float
    greatest: float


class Series:
    """Takes a value at growing times; the bins widen as time goes on.

    Parameters
    ----------
    limit : int
        Bins at most.
    """

    def __init__(self, limit: int = BINS) -> None:
        self._limit, self._width_s = limit, 1.0
        self._bins: dict[int, tuple[int, float, float, float]] = {}

    def add(self, t_s: float, value: float) -> None:
        """Take a value; `t_s` counts from the beginning, in seconds."""
        while t_s >= self._limit * self._width_s:
            self._widen()
        self._put(int(t_s / self._width_s), (1, value, value, value))

    def bins(self) -> list[Bin]:
        """Return the bins that hold something, in order."""
        return [
            Bin((number + 0.5) * self._width_s, least, total / n, greatest)
            for number, (n, total, least, greatest) in sorted(self._bins.items())
        ]

    @property
    def width_s(self) -> float:
        """How long a bin is."""
        return self._width_s

    def _put(self, number: int, new: tuple[int, float, float, float]) -> None:
        old = self._bins.get(number)
        if old is not None:
            new = (
                old[0] + new[0],
                old[1] + new[1],
                min(old[2], new[2]),
                max(old[3], new[3]),
            )
        self._bins[number] = new

    def _widen(self) -> None:
        bins, self._bins = self._bins, {}
        self._width_s *= 2.0
        for number, values in bins.items():
            self._put(number // 2, values)
