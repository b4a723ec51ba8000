"""What may be wrong with a receiver that is reached by the network."""

from typing import Final

from imu_tracker.sensors.gnss.reader import GpsState

_USELESS: Final = {
    "socket": {
        GpsState.SILENT: (
            "connected, but no sentence: does the other side send NMEA? If it is gpsd, "
            "write gpsd:// for socket://"
        ),
        GpsState.GARBAGE: (
            "bytes, but no sentence: the other side does not send NMEA; if it is gpsd, "
            "write gpsd:// for socket://"
        ),
    },
    "gpsd": {
        GpsState.SILENT: (
            "gpsd answers, but sends no sentence: has it a receiver? See gpspipe -r"
        ),
        GpsState.GARBAGE: "gpsd sends no NMEA of this device: see gpspipe -r",
    },
    "udp": {
        GpsState.SILENT: (
            "no datagram: does the other side send to this computer and this port, and "
            "does a firewall let it in?"
        ),
        GpsState.GARBAGE: "datagrams, but no sentence: the other side sends no NMEA",
    },
}
_CLOSED: Final = {
    "socket": "is the other side there, and listening?",
    "gpsd": "does gpsd run there (systemctl status gpsd.socket)?",
    "udp": "has another program this port?",
}


def why_useless(port: str, state: GpsState) -> str:
    """Say why an open port brings no sentences; "" for a serial port."""
    return _USELESS.get(port.partition("://")[0], {}).get(state, "")


def why_closed(port: str, detail: str) -> str:
    """Say why a port cannot be opened; some faults say themselves what to do."""
    if "imu-tracker" in detail or "gpsd://" in detail:
        return detail
    return f"{detail}: {_CLOSED[port.partition('://')[0]]}"
