"""The thread that listens to the receiver and turns it into timed lines.

It opens the port, finds the speed, and opens it again when it is gone. What a
newcomer gets wrong: a line is as old as its first byte, not as its last; at 9600
baud that is a tenth of a second, three metres on a motorway.
"""

from collections import Counter
from collections.abc import Callable
from contextlib import closing
from enum import StrEnum
from typing import Final, Literal, NamedTuple, TypeAlias

from imu_tracker.errors import NmeaError
from imu_tracker.samples import Frame
from imu_tracker.sensors.clock import MILLISECOND_NS, SECOND_NS, Backoff, Clock
from imu_tracker.sensors.gnss.baud import BAUDS, BaudSearch
from imu_tracker.sensors.gnss.lines import checked_text
from imu_tracker.sensors.gnss.network_port import open_port as open_any_port
from imu_tracker.sensors.gnss.port import FAULTS, GpsPort, TimedLines
from imu_tracker.sensors.sensor_thread import SensorThread

RETRY_FIRST_NS: Final = 250 * MILLISECOND_NS
RETRY_LAST_NS: Final = SECOND_NS  # so that it is back within 2 s of being plugged in
SETTLE_NS: Final = 100 * MILLISECOND_NS  # a USB receiver hands over old epochs first
QUIET_NS: Final = 3 * SECOND_NS  # without bytes or sentences: the state says so
DEAD_NS: Final = 30 * SECOND_NS  # without bytes: the peer may be gone, so open again

Baud: TypeAlias = int | Literal["auto"]


class GpsState(StrEnum):
    """How the port is."""

    CLOSED = "closed"  # it cannot be opened, or is being opened again
    SEARCHING = "searching"  # bytes, and no sentence at any speed tried so far
    SILENT = "silent"
    GARBAGE = "garbage"  # bytes, and no sentence any more
    OK = "ok"


class GpsHealth(NamedTuple):
    """A snapshot of the reader; `detail` is the last fault of the port."""

    state: GpsState
    detail: str
    baud: int
    bytes: int
    lines: int
    sentences: int
    reopens: int


class GpsReader(SensorThread):
    """Listens to a receiver until it is stopped, whatever the port does meanwhile.

    Parameters
    ----------
    path : str
        A device, or `socket://`, `gpsd://` or `udp://` with host and port.
    baud : int or "auto"
    put : callable
        Takes each frame, in the thread of the reader; must not block. Events say
        `gps_open <port>` when bytes begin to come, `gps_lost <reason>` when they
        end, `gps_baud <speed>` when it was found; and `gps_failed <error>` as the
        last word of a bug, see `error`.
    clock : Clock
    open_port : callable, optional
        Opens a path at a speed; a test gives its own.
    """

    def __init__(
        self,
        path: str,
        baud: Baud,
        put: Callable[[Frame], None],
        clock: Clock,
        *,
        open_port: Callable[[str, int], GpsPort] = open_any_port,
    ) -> None:
        super().__init__("gps", put, clock)
        self._path, self._open_port = path, open_port
        self._is_auto = baud == "auto"
        self._baud = BAUDS[0] if baud == "auto" else baud
        self._search: BaudSearch | None = None  # while the port is open
        self._known_baud: int | None = None  # sentences came at it
        self._backoff = Backoff(RETRY_FIRST_NS, RETRY_LAST_NS)
        self._is_lost: bool | None = None  # as told by the last event
        self._detail = ""
        self._counts: Counter[str] = Counter()
        self._heard_ns = self._understood_ns = self.turned_ns

    def health(self) -> GpsHealth:
        """Tell how it goes."""
        return GpsHealth(
            state=self._state(),
            detail=self._detail,
            baud=self._baud,
            bytes=self._counts["bytes"],
            lines=self._counts["lines"],
            sentences=self._counts["sentences"],
            reopens=max(0, self._counts["opens"] - 1),
        )

    def _state(self) -> GpsState:
        search, now_ns = self._search, self._clock.now_ns()
        if search is None:
            return GpsState.CLOSED
        if now_ns - self._heard_ns > QUIET_NS:
            return GpsState.SILENT
        if not search.is_found:
            return GpsState.SEARCHING
        is_clear = now_ns - self._understood_ns <= QUIET_NS
        return GpsState.OK if is_clear else GpsState.GARBAGE

    def run(self) -> None:
        """Listen until stopped; what the thread does, and a test may do without one."""
        while not self._stop.is_set():
            self._visit()

    def _visit(self) -> None:
        """Open the port and listen until it is gone; then pause."""
        self.turned_ns = self._clock.now_ns()
        try:
            with closing(self._open_port(self._path, self._baud)) as port:
                self._counts["opens"] += 1
                self._listen(port)
        except FAULTS as error:
            self._search = None
            self._detail = " ".join(str(error).split())
            self._tell_lost(is_lost=True, text=self._detail)
            pause_ns = self._backoff.next_ns()
            self._clock.sleep_until_ns(self._clock.now_ns() + pause_ns, self._stop)

    def _listen(self, port: GpsPort) -> None:
        settled_ns = self._clock.now_ns() + SETTLE_NS
        if self._clock.sleep_until_ns(settled_ns, self._stop):
            return
        port.discard()
        self._heard_ns = self._clock.now_ns()
        is_fixed = not (self._is_auto and port.has_speed)
        if self._known_baud is not None:
            self._baud = self._known_baud
            port.set_baud(self._baud)
        self._search = search = BaudSearch(
            *(self._baud, self._heard_ns), is_fixed=is_fixed, known=self._known_baud
        )
        lines = self._begin(port)
        while not self._stop.is_set():
            chunk = port.read()
            self.turned_ns = self._clock.now_ns()
            if chunk:
                sentences = self._deliver(chunk, lines.feed(chunk, self.turned_ns))
                was_found = search.is_found
                if search.add_bytes(self.turned_ns, sentences):
                    lines = self._change_baud(port, search.baud)
                elif search.is_found and not was_found:
                    self._known_baud = search.known
                    self._tell("baud", str(search.baud))
            elif search.pause(self.turned_ns):
                lines = self._change_baud(port, search.baud)
            elif self.turned_ns - self._heard_ns > DEAD_NS:
                raise TimeoutError(f"silent for {DEAD_NS // SECOND_NS} s")

    def _change_baud(self, port: GpsPort, baud: int) -> TimedLines:
        self._baud = baud
        port.set_baud(baud)
        port.discard()
        return self._begin(port)

    def _begin(self, port: GpsPort) -> TimedLines:
        byte_ns = 10 * SECOND_NS // self._baud if port.has_speed else 0
        return TimedLines(byte_ns, self._clock.now_ns())

    def _deliver(self, chunk: bytes, frames: list[Frame]) -> int:
        """Pass lines on and return how many are good sentences."""
        self._heard_ns = self.turned_ns
        self._backoff.reset()
        self._tell_lost(is_lost=False, text=self._path)
        for frame in frames:
            self._put(frame)
        sentences = sum(_is_sentence(frame.data) for frame in frames)
        if sentences:
            self._understood_ns = self.turned_ns
        self._counts.update(bytes=len(chunk), lines=len(frames), sentences=sentences)
        return sentences

    def _tell_lost(self, *, is_lost: bool, text: str) -> None:
        if is_lost is not self._is_lost:
            self._is_lost = is_lost
            self._tell("lost" if is_lost else "open", text)


def _is_sentence(line: bytes) -> bool:
    try:
        checked_text(line)
    except NmeaError:
        return False
    return True
