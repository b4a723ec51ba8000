"""The track of the last hours, thinned to what a page can draw."""

from typing import Any, Final

from imu_tracker.exports.merging import Point
from imu_tracker.exports.page import map_data
from imu_tracker.exports.thinning import Thinner
from imu_tracker.storage.latlong import MAX_GAP_S, LogRow

MAX_POINTS: Final = 5000
"""150 kB for the page, 3 MB here; shape, modes and r95 stay."""


class History:
    """Takes every row; keeps those that matter.

    Parameters
    ----------
    hours : float
        What is older goes.
    """

    def __init__(self, hours: float) -> None:
        self._seconds = 3600.0 * hours
        self._thinner = Thinner(MAX_POINTS)
        self._segment = 0
        self._last: LogRow | None = None

    def add(self, row: LogRow) -> None:
        """Take a row."""
        last = self._last
        if last is not None and (
            not 0.0 < row.utc_s - last.utc_s <= MAX_GAP_S
            or abs(row.lon_deg - last.lon_deg) > 180.0
        ):
            self._segment += 1
        self._last = row
        self._thinner.drop_before(row.utc_s - self._seconds)
        self._thinner.add(Point("", self._segment, row))

    def data(self) -> dict[str, Any]:
        """Return it as the page wants it."""
        return map_data(self._thinner.with_end(), self._thinner)
