"""What to do about a receiver whose sentences are of no use: the words of all."""

from typing import Final

NO_POSITION: Final = "no sentence has a position: it must send RMC or GGA"
NO_DATE: Final = (
    "a fix without a date, and so no log: make it send RMC, or set gps.date"
)
NO_FIX: Final = "no fix yet: the antenna wants to see the sky"
UNUSABLE: Final = "set the receiver, or what relays it, to plain NMEA 0183"

_PLACES: Final = frozenset({"RMC", "GGA", "GNS", "GLL"})


def has_places(kinds: set[str]) -> bool:
    """Tell whether one of these kinds of sentence has a position."""
    return bool(kinds & _PLACES)
