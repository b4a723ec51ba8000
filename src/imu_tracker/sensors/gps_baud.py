"""Finding the speed of a receiver by listening: sentences with a good checksum.

What a newcomer gets wrong: at the wrong speed bytes come all the same, only others.
Silence says nothing about the speed, so it changes nothing.
"""

from typing import Final

from imu_tracker.sensors.clock import MILLISECOND_NS, SECOND_NS

BAUDS: Final = (9600, 38400, 115200, 4800, 57600, 19200, 230400)  # by how common

DWELL_NS: Final = 2200 * MILLISECOND_NS  # two bursts of a receiver at 1 Hz
ENOUGH_SENTENCES: Final = 2  # one in 256 is right by chance
GARBAGE_NS: Final = 5 * SECOND_NS  # a receiver that lost power fell back to its default
SILENCE_NS: Final = 3 * SECOND_NS  # who speaks after it has begun anew


class BaudSearch:
    """Which speed to listen at.

    Parameters
    ----------
    baud : int
        The first to try.
    is_fixed : bool
        Stay with it, whatever comes.

    Attributes
    ----------
    baud : int
        The speed to listen at now.
    is_found : bool
        Whether sentences came at this speed, or it is fixed.
    """

    def __init__(self, baud: int, now_ns: int, *, is_fixed: bool = False) -> None:
        self.baud, self.is_found, self._is_fixed = baud, is_fixed, is_fixed
        self._sentences = 0
        self._since_ns = now_ns  # how long there has been nothing but garbage
        self._last_byte_ns = now_ns

    def hear(self, now_ns: int, sentences: int) -> bool:
        """Note that bytes came and completed so many sentences with a good checksum.

        Returns
        -------
        bool
            Whether to listen at another speed from now on.
        """
        if self._is_fixed:
            return False
        if now_ns - self._last_byte_ns > SILENCE_NS:
            self._since_ns = now_ns
        self._last_byte_ns = now_ns
        self._sentences += sentences
        if self._sentences >= ENOUGH_SENTENCES:
            self.is_found = True
        if self.is_found and sentences:
            self._since_ns = now_ns
        if now_ns - self._since_ns < (GARBAGE_NS if self.is_found else DWELL_NS):
            return False
        self.baud = _after(self.baud)
        self.is_found, self._sentences, self._since_ns = False, 0, now_ns
        return True


def _after(baud: int) -> int:
    index = BAUDS.index(baud) + 1 if baud in BAUDS else 0
    return BAUDS[index % len(BAUDS)]
