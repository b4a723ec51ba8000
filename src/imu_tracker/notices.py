"""What repeats is told less often: a journal that floods is not read.

Pure: time comes with the calls. What a newcomer gets wrong: states that flap are told
in pairs, so both must be held off, and the last one told must be the one that holds.
"""

import re
from collections import deque
from typing import Final

BURST: Final = 3
QUIET_NS: Final = 60_000_000_000
"""The same is told so often within a minute, and then once a minute with a count."""

_NUMBER = re.compile(r"[-+]?\d+(\.\d+)?")


class HoldOff:
    """Passes notices on until they repeat; numbers in them make no difference."""

    def __init__(self) -> None:
        self._told_ns: dict[str, deque[int]] = {}
        self._held: dict[str, tuple[str, int]] = {}  # text and count, the newest last

    def pass_on(self, t_ns: int, notices: list[str]) -> list[str]:
        """Take what is new at `t_ns`; return what is to be told now."""
        told = []
        for text in notices:
            key = _NUMBER.sub("#", text)
            times_ns = self._told_ns.setdefault(key, deque(maxlen=BURST))
            is_calm = len(times_ns) < BURST or t_ns - times_ns[0] >= QUIET_NS
            if is_calm and key not in self._held:
                times_ns.append(t_ns)
                told.append(text)
            else:
                _, count = self._held.pop(key, ("", 0))
                self._held[key] = text, count + 1
        for key, (text, count) in list(self._held.items()):
            times_ns = self._told_ns[key]
            if t_ns - times_ns[-1] < QUIET_NS:
                continue
            del self._held[key]
            if count:  # else it was calm for a minute
                self._held[key] = text, 0
                times_ns.append(t_ns)
                told.append(_counted(text, count))
        return told

    def take_held(self) -> list[str]:
        """Return what is still held off: nothing comes after it."""
        told = [_counted(text, count) for text, count in self._held.values() if count]
        self._held.clear()
        return told


def _counted(text: str, count: int) -> str:
    times = "once more" if count == 1 else f"{count} times"
    return f"{text} ({times} in the last minute)"


class Flapping:
    """Whether something that comes and goes counts as there.

    After the third loss within a minute it does so only once it has stayed.
    """

    STAYED_NS: Final = 5_000_000_000

    def __init__(self) -> None:
        self._lost_ns: deque[int] = deque(maxlen=BURST)
        self._is_there = True
        self._is_doubted = False
        self._back_ns = 0  # it was not there until then

    def counts(self, t_ns: int, is_there: bool) -> bool:
        """Take whether it is there at `t_ns`; return whether it counts as there."""
        if not is_there:
            if self._is_there:
                self._lost_ns.append(t_ns)
                is_full = len(self._lost_ns) == BURST
                self._is_doubted = is_full and t_ns - self._lost_ns[0] < QUIET_NS
            self._back_ns = t_ns
        self._is_there = is_there
        if self._is_doubted and is_there:
            self._is_doubted = t_ns - self._back_ns < self.STAYED_NS
        return is_there and not self._is_doubted
