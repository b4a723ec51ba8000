"""NMEA 0183 of a row, live: position, its error, and the way along the route.

GSA carries r95 to programs that know no other field for it: gpsd takes HDOP times 19 m
for the 95 % error, so that HDOP is r95 / 19 here and no geometry of satellites.

Source: NMEA 0183 4.10; gpsd's driver_nmea0183.c and libgpsd_core.c (P_UERE_NO_DGPS).
"""

import math
from typing import Final

from imu_tracker.exports.nmea import (
    ESTIMATED,
    INVALID,
    MEASURED,
    MPS_PER_KNOT,
    Validity,
    angle,
    sentence,
    sentences_of,
)
from imu_tracker.guidance.guide import Guidance, GuideState
from imu_tracker.serve.view import Shown
from imu_tracker.storage.latlong import LogRow, format_utc

UERE_M: Final = 19.0
_METRES_PER_MILE: Final = 1852.0
_MAX_XTE_MILES: Final = 9.99


def sentences(shown: Shown, limit_m: float) -> bytes:
    """Return all sentences of a row.

    Parameters
    ----------
    shown : Shown
    limit_m : float
        Beyond this r95 the position is not valid.
    """
    row = shown.row
    validity = MEASURED if shown.has_fix else ESTIMATED
    if row.r95_m > limit_m:
        validity = INVALID
    lines = [*sentences_of(row, validity), _vtg(row, validity), _gsa(row, validity)]
    if shown.guidance is not None:
        lines += _guidance(row, shown.guidance, validity)
    return "".join(lines).encode("ascii", "replace")


def _vtg(row: LogRow, validity: Validity) -> str:
    course = "" if math.isnan(row.course_deg) else f"{row.course_deg:.1f}"
    knots = f"{row.speed_mps / MPS_PER_KNOT:.3f}"
    kmh = f"{row.speed_mps * 3.6:.3f}"
    return sentence("VTG", course, "T", "", "M", knots, "N", kmh, "K", validity.mode)


def _gsa(row: LogRow, validity: Validity) -> str:
    fix = "1" if validity is INVALID else "2" if math.isnan(row.alt_m) else "3"
    hdop = f"{row.r95_m / UERE_M:.3f}"
    return sentence("GSA", "A", fix, *[""] * 12, "", hdop, "")


def _guidance(row: LogRow, guidance: Guidance, validity: Validity) -> list[str]:
    """Return APB, RMB, XTE and BWC; marked as not valid where it cannot tell."""
    can_tell = validity is not INVALID and guidance.state is not GuideState.UNSURE
    status, mode = ("A", validity.mode) if can_tell else ("V", INVALID.mode)
    arrived = "A" if guidance.state is GuideState.ARRIVED else "V"
    steer = "L" if guidance.cross_track_m > 0.0 else "R"  # back to the line
    miles = abs(guidance.cross_track_m) / _METRES_PER_MILE
    xte = f"{min(miles, _MAX_XTE_MILES):.3f}"
    origin, name = (_identifier(w.name) for w in (guidance.origin, guidance.waypoint))
    leg = f"{guidance.leg_bearing_deg:.1f}"
    bearing = f"{guidance.bearing_deg:.1f}"
    range_miles = f"{min(guidance.distance_m / _METRES_PER_MILE, 999.9):.3f}"
    waypoint = guidance.waypoint
    place = (*angle(waypoint.lat_deg, "NS", 2), *angle(waypoint.lon_deg, "EW", 3))
    closing = _closing_knots(guidance)
    utc = format_utc(row.utc_s)
    time = f"{utc[11:13]}{utc[14:16]}{utc[17:23]}"
    passed = ("A" if arrived == "A" else "V",) * 2
    way = (leg, "T", name, bearing, "T", bearing, "T")
    return [
        sentence("APB", status, status, xte, steer, "N", *passed, *way, mode),
        sentence(
            "RMB",
            *(status, xte, steer, origin, name, *place),
            *(range_miles, bearing, closing, arrived, mode),
        ),
        sentence("XTE", status, status, xte, steer, "N", mode),
        sentence(
            "BWC",
            *(time, *place, bearing, "T", "", "M", range_miles, "N", name, mode),
        ),
    ]


def _closing_knots(guidance: Guidance) -> str:
    if not guidance.time_to_go_s:
        return ""
    return f"{guidance.distance_m / guidance.time_to_go_s / MPS_PER_KNOT:.1f}"


def _identifier(name: str) -> str:
    """Return a name without what separates fields."""
    kept = "".join(c for c in name if c.isascii() and (c.isalnum() or c in " _-"))
    return kept.strip()[:20] or "WPT"
