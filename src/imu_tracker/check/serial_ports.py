"""What may be wrong with a receiver on a serial port."""

import itertools
import os
from pathlib import Path
from typing import Final

from imu_tracker.sensors import pi_advice as mending
from imu_tracker.sensors.gnss.reader import GpsState

WHY_USELESS: Final = {
    GpsState.SILENT: (
        "not a byte: is the receiver powered, its TX on our RX, and the serial port on "
        "(sudo raspi-config nonint do_serial_hw 0)?"
    ),
    GpsState.SEARCHING: (
        "bytes, but no sentence at any speed: a bad connection, or no NMEA: switch the "
        "receiver from its binary mode (UBX, SiRF) to NMEA with its maker's tool"
    ),
    GpsState.GARBAGE: (
        "bytes, but no sentence: a bad connection, a wrong gps.baud (try auto), or a "
        "receiver in its binary mode: switch it to NMEA with its maker's tool"
    ),
}


def why_closed(port: str, detail: str) -> str:
    """Say why a port cannot be opened, and what to do."""
    path = Path(port)
    if not path.exists():
        patterns = ("serial/by-id/*", "ttyACM*", "ttyUSB*", "serial0", "ttyAMA0")
        found = itertools.chain.from_iterable(map(Path("/dev").glob, patterns))
        others = ", ".join(map(str, found)) or "no serial port"
        advice = "set gps.port"
        if path.name in mending.UARTS:
            advice = f"{mending.switch_uart_on()}; or {advice}"
        return f"{port} does not exist (there is {others}): {advice}"
    if not os.access(path, os.R_OK | os.W_OK):
        return f"no permission for {port}: {mending.join_group(path, 'dialout')}"
    return (
        f"{port}: {detail}: another program has it; if that is gpsd, set gps.port = "
        '"gpsd://localhost:2947", or stop it: sudo systemctl disable --now gpsd.socket '
        "gpsd"
    )
