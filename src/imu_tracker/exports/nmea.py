"""NMEA 0183: what a receiver on the tracker's track would have sent.

RMC, GGA and GST for each row, written and summed by pynmea2. Dead reckoning and the
standing still that the IMU tells are marked as receivers with inertial sensors mark
theirs: quality 6 and mode E, estimated. GST carries r95 as the standard deviation
of each axis. HDOP, which the log does not know, is empty. So should the number of
satellites be, but gpsd takes a GGA without one for no fix: it is a filler.

Source: NMEA 0183 4.10; u-blox M8 receiver description, section 31.1.5 (fix flags).
"""

import math
from collections.abc import Iterable, Iterator
from typing import Final, NamedTuple

import pynmea2

from imu_tracker.errors import UsageError
from imu_tracker.exports.merging import Point
from imu_tracker.samples import Mode
from imu_tracker.storage.latlong import LogRow, format_utc

SIGMAS_IN_R95: Final = math.sqrt(-2.0 * math.log(0.05))
"""Of a circular normal error: 95 % lie within 2.45 standard deviations of an axis."""

SATELLITES: Final = "04"
"""As many as a fix with height takes; the log does not know how many there were."""

MPS_PER_KNOT: Final = 1852 / 3600
_ESTIMATED_MODES: Final = (Mode.DR, Mode.STILL)


class Validity(NamedTuple):
    """How sentences mark a position: RMC's status, FAA mode, GGA's quality."""

    status: str
    mode: str
    quality: str


MEASURED: Final = Validity("A", "A", "1")
ESTIMATED: Final = Validity("A", "E", "6")
INVALID: Final = Validity("V", "N", "0")


def nmea(points: Iterable[Point]) -> Iterator[str]:
    """Yield three sentences a row.

    Raises
    ------
    UsageError
        When logs of the same time are to be mixed: sentences have no track.
    """
    track: str | None = None
    for point in points:
        if point.track != track and track is not None:
            raise UsageError(
                f"{point.track} goes back in time: NMEA has no tracks; export these "
                "logs one by one"
            )
        track = point.track
        is_estimated = point.row.mode in _ESTIMATED_MODES
        yield from sentences_of(point.row, ESTIMATED if is_estimated else MEASURED)


def sentences_of(row: LogRow, validity: Validity) -> Iterator[str]:
    """Yield RMC, GGA and GST of a row, each with its CR LF."""
    utc = format_utc(row.utc_s)
    time = f"{utc[11:13]}{utc[14:16]}{utc[17:23]}"
    date = f"{utc[8:10]}{utc[5:7]}{utc[2:4]}"
    position = (*angle(row.lat_deg, "NS", 2), *angle(row.lon_deg, "EW", 3))
    speed = f"{row.speed_mps / MPS_PER_KNOT:.3f}"
    course = "" if math.isnan(row.course_deg) else f"{row.course_deg:.1f}"
    height = "" if math.isnan(row.alt_m) else f"{row.alt_m:.1f}"
    sigma = f"{row.r95_m / SIGMAS_IN_R95:.3f}"
    status, mode, quality = validity
    yield sentence("RMC", time, status, *position, speed, course, date, "", "", mode)
    yield sentence(
        "GGA", time, *position, quality, SATELLITES, "", height, "M", "", "M", "", ""
    )
    yield sentence("GST", time, "", sigma, sigma, "", sigma, sigma, "")


def sentence(kind: str, *fields: str) -> str:
    """Write a sentence with its checksum and CR LF."""
    return f"{pynmea2.TalkerSentence('GP', kind, fields)}\r\n"


def angle(angle_deg: float, letters: str, width: int) -> tuple[str, str]:
    """Return degrees and minutes in one number, and the hemisphere."""
    degrees, units = divmod(round(abs(angle_deg) * 60e6), 60_000_000)
    minutes, millionths = divmod(units, 1_000_000)
    text = f"{degrees:0{width}d}{minutes:02d}.{millionths:06d}"
    return text, letters[angle_deg < 0]
