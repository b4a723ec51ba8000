"""A receiver on a pseudo-terminal: to pyserial a real serial device, in real time."""

import os
import pty
import threading
import tty
from datetime import UTC, datetime, timedelta
from functools import reduce
from operator import xor
from pathlib import Path
from typing import Self

START_UTC = datetime(2027, 3, 1, 12, 0, 0, tzinfo=UTC)
PERIOD_S = 0.2


def sentence(body: str) -> bytes:
    checksum = reduce(xor, body.encode("ascii"))
    return f"${body}*{checksum:02X}\r\n".encode("ascii")


class PtyReceiver:
    """Reports a standing position five times a second, and can be pulled out.

    Parameters
    ----------
    path : Path
        Where the device is, as long as it is plugged in.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._begun_ns = 0
        self._epochs = 0
        self._controller: int | None = None
        self._lock = threading.Lock()
        self._end = threading.Event()
        self._thread = threading.Thread(target=self._report, name="pty receiver")

    def plug(self) -> None:
        controller, device = pty.openpty()
        tty.setraw(device)
        self._path.symlink_to(os.ttyname(device))
        os.close(device)
        os.set_blocking(controller, False)
        with self._lock:
            self._controller = controller

    def unplug(self) -> None:
        with self._lock:
            if self._controller is not None:
                os.close(self._controller)
                self._path.unlink()
            self._controller = None

    def __enter__(self) -> Self:
        self.plug()
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._end.set()
        self._thread.join()
        self.unplug()

    def _report(self) -> None:
        while not self._end.wait(PERIOD_S):
            self._epochs += 1
            utc = START_UTC + timedelta(seconds=self._epochs * PERIOD_S)
            time, date = f"{utc:%H%M%S}.{utc:%f}"[:9], f"{utc:%d%m%y}"
            place = "5159.4000,N,00422.2000,E"
            epoch = sentence(f"GNRMC,{time},A,{place},0.01,,{date},,,A") + sentence(
                f"GNGGA,{time},{place},1,10,0.9,5.0,M,45.0,M,,"
            )
            with self._lock:
                if self._controller is not None:
                    try:
                        os.write(self._controller, epoch)
                    except OSError:  # nobody listens: the buffer is full
                        continue
