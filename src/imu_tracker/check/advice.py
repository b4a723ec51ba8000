"""What to do about a receiver that is of no use: the same words for all who say it."""

from collections.abc import Mapping
from typing import Final

from imu_tracker.sensors.gnss.reader import GpsState

USELESS: Final[Mapping[GpsState, str]] = {
    GpsState.SILENT: (
        "not a byte: is the receiver powered, its TX on our RX, and the serial port on "
        "(sudo raspi-config nonint do_serial_hw 0)?"
    ),
    GpsState.SEARCHING: (
        "bytes, but no sentence at any speed: not NMEA, or a bad connection"
    ),
    GpsState.GARBAGE: (
        "bytes, but no sentence: not NMEA, a wrong gps.baud, or a bad connection"
    ),
}
NO_POSITION: Final = "no sentence has a position: it must send RMC or GGA"
NO_DATE: Final = (
    "a fix without a date, and so no log: make it send RMC, or set gps.date"
)
NO_FIX: Final = "no fix yet: the antenna wants to see the sky"

_PLACES: Final = frozenset({"RMC", "GGA", "GNS", "GLL"})


def has_places(kinds: set[str]) -> bool:
    """Tell whether one of these kinds of sentence has a position."""
    return bool(kinds & _PLACES)
