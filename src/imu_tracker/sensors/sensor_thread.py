"""A thread that reads one sensor until it is told to stop, and tells how it goes."""

from abc import ABC, abstractmethod
from collections.abc import Callable
from threading import Event, Thread

from imu_tracker.samples import Frame, Source
from imu_tracker.sensors.clock import Clock


class SensorThread(ABC):
    """What the readers of both sensors share.

    Parameters
    ----------
    name : str
        Of the sensor; first part of its events.
    put : callable
        Takes each frame, in the thread of the reader; must not block.
    clock : Clock

    Attributes
    ----------
    error : BaseException or None
        The bug that ended the thread; for the loop to raise. The last event,
        `<name>_failed`, says so too.
    turned_ns : int
        When the thread last began something; it does so every few seconds even
        when the sensor does not answer.
    """

    def __init__(self, name: str, put: Callable[[Frame], None], clock: Clock) -> None:
        self._name, self._put, self._clock = name, put, clock
        self._stop = Event()
        self._thread = Thread(
            target=self._run_and_capture_error, name=name, daemon=True
        )
        self.error: BaseException | None = None
        self.turned_ns = clock.now_ns()

    def start(self) -> None:
        """Begin to read in a thread."""
        self._thread.start()

    def stop(self) -> None:
        """Ask the thread to end; returns at once."""
        self._stop.set()

    def join(self, timeout_s: float | None = None) -> None:
        """Wait until the thread has ended."""
        self._thread.join(timeout_s)

    def is_alive(self) -> bool:
        """Tell whether the thread runs."""
        return self._thread.is_alive()

    @abstractmethod
    def run(self) -> None:
        """Read until stopped; what the thread does, and a test may do without one."""

    def _run_and_capture_error(self) -> None:
        try:
            self.run()
        except BaseException as error:  # noqa: BLE001 - handed to the loop
            self.error = error
            self._tell("failed", repr(error))

    def _tell(self, what: str, text: str) -> None:
        """Put an event into the stream."""
        words = [f"{self._name}_{what}", *text.split()]
        data = " ".join(words).encode("ascii", "replace")
        self._put(Frame(self._clock.now_ns(), Source.EVENT, data))
