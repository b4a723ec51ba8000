"""Tries what the daemon may do and what it may not, from within its sandbox.

Prints one JSON object: for each attempt "yes", or the name of the error.
"""

import ctypes
import errno
import json
import mmap
import os
import socket
import sys
import time
from collections.abc import Callable
from importlib import import_module
from pathlib import Path

_LIBC = ctypes.CDLL(None, use_errno=True)
_CLONE_NEWUSER = 0x10000000


def attempt(action: Callable[[], object]) -> str:
    try:
        action()
    except OSError as error:
        return errno.errorcode.get(error.errno or 0, str(error))
    return "yes"


def opens(path: str) -> str:
    return attempt(lambda: os.close(os.open(path, os.O_RDWR | os.O_NONBLOCK)))


def writes(directory: str) -> str:
    path = Path(directory) / ".probe"

    def write() -> None:
        path.write_text("")
        path.unlink()

    return attempt(write)


def maps_code() -> str:
    protection = mmap.PROT_READ | mmap.PROT_WRITE | mmap.PROT_EXEC
    return attempt(lambda: mmap.mmap(-1, 4096, prot=protection).close())


def calls(name: str, *arguments: object) -> str:
    """Call a function of the C library that gives 0 when it went well."""
    if getattr(_LIBC, name)(*arguments) == 0:
        return "yes"
    return errno.errorcode[ctypes.get_errno()]


def computes() -> str:
    """Run what the daemon runs of numpy and scipy."""
    import numpy as np
    from filterpy.kalman import KalmanFilter

    matrix = np.eye(6) + 0.1
    kalman = KalmanFilter(6, 3)
    kalman.x = np.zeros(6)
    kalman.H = np.eye(3, 6)
    kalman.predict()
    kalman.update(np.ones(3))
    # What scipy has compiled code for; it comes without types.
    linalg, stats = map(import_module, ("scipy.linalg", "scipy.stats"))
    root = linalg.cholesky(matrix)
    is_right = (
        np.allclose(root.T @ root, matrix)
        and abs(stats.chi2.ppf(0.95, 2) - 5.991) < 1e-3
        and np.isfinite(np.linalg.solve(matrix, kalman.x)).all()
    )
    return "yes" if is_right else "wrong"


def main() -> None:
    found = {f"open {path}": opens(path) for path in sys.argv[1:]}
    for directory in (
        "/var/lib/imu-tracker",
        "/var/log/imu-tracker",
        os.environ["RUNTIME_DIRECTORY"],
        "/tmp",  # its own
        "/etc/imu-tracker",
        "/usr/lib/imu-tracker",
        "/var/log",
        "/var/lib",
        "/usr/local",
    ):
        found[f"write {directory}"] = writes(directory)
    now_s = time.clock_gettime(time.CLOCK_REALTIME)
    found |= {
        "see /home": attempt(lambda: next(Path("/home").iterdir())),
        "see process 1": attempt(lambda: Path("/proc/1").stat()),
        "a network socket": attempt(lambda: socket.socket(socket.AF_INET).close()),
        "a netlink socket": attempt(
            lambda: socket.socket(socket.AF_NETLINK, socket.SOCK_RAW).close()
        ),
        "code in writable memory": maps_code(),
        "mount": calls("mount", b"none", b"/tmp", b"tmpfs", 0, None),
        "a new namespace": calls("unshare", _CLONE_NEWUSER),
        "set the clock": attempt(
            lambda: time.clock_settime(time.CLOCK_REALTIME, now_s)
        ),
        "real-time priority": attempt(
            lambda: os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(1))
        ),
        "become root": attempt(lambda: os.setuid(0)),
        "numpy and scipy": computes(),
    }
    print(json.dumps(found))


if __name__ == "__main__":
    main()
