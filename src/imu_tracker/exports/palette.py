"""The colours of pictures and maps, told apart also by those who see no red or green.

Source: Okabe and Ito, Color Universal Design, 2008.
"""

from collections.abc import Mapping
from typing import Final

from imu_tracker.samples import Mode

BLACK: Final = "#1A1A1A"
ORANGE: Final = "#E69F00"
SKY: Final = "#56B4E9"
GREEN: Final = "#009E73"
BLUE: Final = "#0072B2"
VERMILION: Final = "#D55E00"
PURPLE: Final = "#CC79A7"

MODES: Final[Mapping[Mode, tuple[str, str]]] = {
    Mode.GPS: (BLUE, "with GPS"),
    Mode.DR: (VERMILION, "dead reckoning"),
    Mode.STILL: (GREEN, "standing still"),
    Mode.GPSONLY: (PURPLE, "GPS alone"),
}
"""Colour and name."""
