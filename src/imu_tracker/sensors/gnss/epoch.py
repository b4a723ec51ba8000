"""Sentences that describe one instant, and the fix that they make together.

What a newcomer gets wrong: HDOP is not metres. It says how the geometry of the
satellites enlarges range errors, whose size the kind of the solution decides.
"""

from typing import Any, Final, NamedTuple

from imu_tracker.samples import GpsFix
from imu_tracker.sensors.gnss.sentences import Report
from imu_tracker.sensors.gnss.verdicts import weigh

EPOCH_NS: Final = 300_000_000
"""An epoch that nothing else closes is open for so long after its first sentence."""


class Accuracy(NamedTuple):
    """One standard deviation per horizontal axis."""

    per_hdop_m: float
    floor_m: float


ACCURACY_OF_QUALITY: Final = {
    # Ranges are good to about 2.8 m (orbits, air, reflections at the curb), and HDOP
    # is for both axes together: 2.8 m / sqrt 2. The floor is the best geometry's.
    1: Accuracy(per_hdop_m=2.0, floor_m=1.0),
    # Corrections take away orbits and most of the air, not the reflections.
    2: Accuracy(per_hdop_m=1.4, floor_m=0.7),
    3: Accuracy(per_hdop_m=1.4, floor_m=0.7),
    # Platform phase: centimetres with whole wavelengths, decimetres without.
    4: Accuracy(per_hdop_m=0.02, floor_m=0.02),
    5: Accuracy(per_hdop_m=0.3, floor_m=0.3),
}
UNKNOWN_HDOP: Final = 2.5  # poor, so that a silent receiver is not believed too much

# Receivers repeat one place in all kinds of sentence. Gateways that mix sources do
# not, and GLL is then nearest to its time. Only GGA tells the kinds of RTK apart.
_PLACE_FROM: Final = ("GLL", "GGA", "RMC", "GNS", "VTG", "GST", "GBS", "GSA")
_REST_FROM: Final = ("GGA", "GNS", "RMC", "GLL", "VTG", "GST", "GBS", "GSA")


class Epoch:
    """Sentences of one instant, in the order of their arrival."""

    def __init__(self, t_ns: int, tod_s: float) -> None:
        self.t_ns, self.tod_s, self.is_open = t_ns, tod_s, True
        self.reports: list[Report] = []

    @property
    def has_velocity(self) -> bool:
        """Whether one of them told the velocity."""
        return any(report.vel_ne_mps is not None for report in self.reports)

    def is_young(self, t_ns: int) -> bool:
        """Tell whether a sentence that comes now can still be of use."""
        return t_ns - self.t_ns < EPOCH_NS

    def owns(self, t_ns: int, report: Report) -> bool:
        """Tell whether a sentence describes this instant.

        VTG has no time of day: it is the epoch's that just came and has none yet.
        """
        if report.tod_s is not None:
            return report.tod_s == self.tod_s
        return self.is_young(t_ns) and report.kind not in (r.kind for r in self.reports)

    def verdicts(self) -> set[bool]:
        """Return what the sentences say about having a fix; two if they differ.

        Kinds vote, not sentences: a receiver with a talker for each constellation
        may well have a fix by one of them alone.
        """
        kinds: dict[str, bool] = {}
        for report in self.reports:
            if report.has_fix is not None:
                kinds[report.kind] = kinds.get(report.kind, False) or report.has_fix
        return weigh(kinds)

    def fix(self) -> GpsFix | None:
        """Join what the sentences say, but the date; None without a position."""
        reports = [report for report in self.reports if report.has_fix is not False]
        place = _first(_in_order(_PLACE_FROM, reports), "lat_lon_rad")
        if place is None:
            return None
        reports = _in_order(_REST_FROM, reports)
        quality = _first(reports, "quality") or 1
        return GpsFix(
            t_ns=self.t_ns,
            utc_s=None,
            lat_rad=place[0],
            lon_rad=place[1],
            alt_m=_first(reports, "alt_m"),
            vel_ne_mps=_first(reports, "vel_ne_mps"),
            sigma_h_m=_first(reports, "sigma_m")
            or _sigma_m(quality, _first(reports, "hdop") or UNKNOWN_HDOP),
            quality=quality,
        )


def _in_order(kinds: tuple[str, ...], reports: list[Report]) -> list[Report]:
    return sorted(reports, key=lambda report: kinds.index(report.kind))


def _first(reports: list[Report], field: str) -> Any:
    """Return the first report's value of a field that is not blank."""
    values = (getattr(report, field) for report in reports)
    return next((value for value in values if value is not None), None)


def _sigma_m(quality: int, hdop: float) -> float:
    accuracy = ACCURACY_OF_QUALITY.get(quality, ACCURACY_OF_QUALITY[1])
    return max(accuracy.per_hdop_m * hdop, accuracy.floor_m)
