"""Between the daemon and who runs it: signals in, notifications to systemd out.

What a newcomer gets wrong: a signal handler runs between any two bytecodes of the main
thread, perhaps inside a lock. So it takes a note and nothing else; the loop reads the
notes 50 times a second.
"""

import os
import signal
from collections.abc import Callable
from types import FrameType
from typing import Self, TypeAlias

Notify: TypeAlias = Callable[[str], None]


class Signals:
    """SIGTERM and SIGINT ask for the end, SIGHUP for a log that is opened anew.

    A context manager: the handlers of before come back. Until `defer` is called there
    is nothing to be flushed, and the end comes at once.

    Attributes
    ----------
    is_stop : bool
        Whether the daemon shall end.
    """

    def __init__(self) -> None:
        self.is_stop = self._is_reopen = self._is_deferred = False

    def defer(self) -> None:
        """Leave the end to whoever reads `is_stop` from now on."""
        self._is_deferred = True

    def stop(self) -> None:
        """Ask for the end."""
        self.is_stop = True
        if not self._is_deferred:
            raise SystemExit(0)

    def reopen(self) -> None:
        """Ask for a log that is opened anew."""
        self._is_reopen = True

    def take_reopen(self) -> bool:
        """Return whether that was asked for since the last call."""
        is_reopen, self._is_reopen = self._is_reopen, False
        return is_reopen

    def __enter__(self) -> Self:
        def on_stop(_number: int, _frame: FrameType | None) -> None:
            self.stop()

        def on_reopen(_number: int, _frame: FrameType | None) -> None:
            self.reopen()

        self._before = [
            (number, signal.signal(number, handler))
            for number, handler in (
                (signal.SIGTERM, on_stop),
                (signal.SIGINT, on_stop),
                (signal.SIGHUP, on_reopen),
            )
        ]
        return self

    def __exit__(self, *_: object) -> None:
        for number, handler in self._before:
            signal.signal(number, handler)


def systemd_notify() -> Notify:
    """Return how to tell systemd: its socket, or nobody when it did not start us."""
    if not os.environ.get("NOTIFY_SOCKET"):
        return lambda _: None
    from sdnotify import SystemdNotifier

    notify: Notify = SystemdNotifier().notify
    return notify
