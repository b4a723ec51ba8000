"""Sentences of our own making."""

from functools import reduce
from operator import xor


def sentence(body: str) -> bytes:
    """Frame a body: `GPGGA,...` becomes `$GPGGA,...*hh`."""
    data = body.encode("latin-1")
    return b"$%s*%02X" % (data, reduce(xor, data, 0))


def rmc(tod: str = "120000.00", day: str = "231126", **changes: str) -> bytes:
    """A good RMC at 51 deg 59.4' N, 4 deg 22.2' E, 10 knots to the east."""
    fields = {
        "status": "A",
        "place": "5159.4000,N,00422.2000,E",
        "speed": "10.0",
        "course": "90.0",
        "mode": "A",
    } | changes
    motion = f"{fields['speed']},{fields['course']}"
    return sentence(
        f"GNRMC,{tod},{fields['status']},{fields['place']},{motion},{day},,,"
        f"{fields['mode']}"
    )


def gga(tod: str = "120000.00", **changes: str) -> bytes:
    """A good GGA at the same place, 12.5 m above the sea, HDOP 1.2."""
    fields = {
        "talker": "GN",
        "place": "5159.4000,N,00422.2000,E",
        "quality": "1",
        "satellites": "08",
        "hdop": "1.2",
        "altitude": "12.5",
    } | changes
    return sentence(
        f"{fields['talker']}GGA,{tod},{fields['place']},{fields['quality']},"
        f"{fields['satellites']},{fields['hdop']},{fields['altitude']},M,47.0,M,,"
    )


def gll(tod: str = "120000.00", status: str = "A", mode: str = "A") -> bytes:
    """A good GLL at the same place."""
    return sentence(f"GNGLL,5159.4000,N,00422.2000,E,{tod},{status},{mode}")
