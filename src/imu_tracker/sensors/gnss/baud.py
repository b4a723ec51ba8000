"""Finding the speed of a receiver by listening: sentences with a good checksum.

What a newcomer gets wrong: at the wrong speed bytes come all the same, only others.
Silence says nothing about the speed. And garbage is more often noise than another
speed: the one that was right gets every other turn, or else a receiver that is
itself again is not heard for a dozen seconds.
"""

from typing import Final

from imu_tracker.sensors.clock import MILLISECOND_NS, SECOND_NS

BAUDS: Final = (9600, 38400, 115200, 4800, 57600, 19200, 230400, 460800, 921600)
"""By how common; the last ones are of receivers for RTK (ArduPilot, request 12670)."""

DWELL_NS: Final = 2200 * MILLISECOND_NS  # two bursts of a receiver at 1 Hz
ENOUGH_SENTENCES: Final = 2  # one in 256 is right by chance
GARBAGE_NS: Final = 5 * SECOND_NS
"""A receiver that lost power fell back to its default. Where bytes come without any
pause, one dwell more."""

SILENCE_NS: Final = 3 * SECOND_NS  # who speaks after it has begun anew


class BaudSearch:
    """Which speed to listen at.

    Parameters
    ----------
    baud : int
        The first to try.
    is_fixed : bool
        Stay with it, whatever comes.
    known : int, optional
        A speed at which sentences came before.

    Attributes
    ----------
    baud : int
        The speed to listen at now.
    is_found : bool
        Whether sentences came at this speed, or it is fixed.
    """

    def __init__(
        self,
        baud: int,
        now_ns: int,
        *,
        is_fixed: bool = False,
        known: int | None = None,
    ) -> None:
        self.baud, self.is_found, self._is_fixed = baud, is_fixed, is_fixed
        self.known, self._candidate = known, baud
        self._sentences = 0  # at this speed
        self._has_heard = False  # since the last pause
        self._since_ns = now_ns  # how long there has been nothing but garbage
        self._last_byte_ns = now_ns

    def add_bytes(self, now_ns: int, sentences: int) -> bool:
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
        self._last_byte_ns, self._has_heard = now_ns, True
        self._sentences += sentences
        if self._sentences >= ENOUGH_SENTENCES:
            self.is_found, self.known = True, self.baud
        if self.is_found and sentences:
            self._since_ns = now_ns
        patience_ns = GARBAGE_NS + DWELL_NS if self.is_found else DWELL_NS
        if now_ns - self._since_ns < patience_ns:
            return False
        self._switch(now_ns)
        return True

    def pause(self, now_ns: int) -> bool:
        """Note that no bytes came for a moment; return whether to change the speed.

        Between two bursts is the time to do it: the next one is then heard as a
        whole. It is all that a speed gets for its turn when another one is known to
        have been right.
        """
        has_heard, self._has_heard = self._has_heard, False
        if self._is_fixed or self.known is None or not has_heard:
            return False
        if self.is_found:
            is_over = now_ns - self._since_ns >= GARBAGE_NS
        else:
            is_over = not self._sentences
        if is_over:
            self._switch(now_ns)
        return is_over

    def _switch(self, now_ns: int) -> None:
        if self.known is not None and self.baud != self.known:
            self.baud = self.known
        else:
            self._candidate = _after(self._candidate)
            if self._candidate == self.known:
                self._candidate = _after(self._candidate)
            self.baud = self._candidate
        self.is_found, self._sentences, self._has_heard = False, 0, False
        self._since_ns = now_ns


def _after(baud: int) -> int:
    index = BAUDS.index(baud) + 1 if baud in BAUDS else 0
    return BAUDS[index % len(BAUDS)]
