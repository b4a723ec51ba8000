"""The program: a thread for each destination, and a loop that counts and reports."""

import logging
import signal
import time
from collections.abc import Sequence
from contextlib import ExitStack
from threading import Event
from typing import Any, Final

from imu_tracker.config import Config
from imu_tracker.config.publishing import PublishConfig
from imu_tracker.errors import ConfigError, NotRunningError
from imu_tracker.publish.cursor import Cursor
from imu_tracker.publish.outbox import Outbox, Selection
from imu_tracker.publish.report import describe, exposition
from imu_tracker.publish.senders.factory import sender_of
from imu_tracker.publish.thinning import Rules
from imu_tracker.publish.waiting import Waiting
from imu_tracker.publish.worker import Worker
from imu_tracker.storage.status_file import StatusFile, read_status

TURN_S: Final = 1.0
END_S: Final = 5.0
"""So long the threads have to end; one that hangs in a name look-up is left behind."""

FAILED: Final = 69

_SIGNALS: Final = (signal.SIGTERM, signal.SIGINT)

log = logging.getLogger(__name__)


def run(config: Config, *, is_once: bool = False) -> int:
    """Publish until SIGTERM or SIGINT; return the exit code.

    Parameters
    ----------
    config : Config
    is_once : bool
        Send what waits and end: 0 when all of it was taken, 69 when not.

    Raises
    ------
    ConfigError
        When there is no destination, or a package is missing.
    OutputError
        When a cursor cannot be kept, or another process has it.
    """
    if not config.publish:
        raise ConfigError(
            "[[publish]]: there is none: write one for each destination; see "
            "docs/publish.md"
        )
    # Blocked in every thread and waited for in this one: no handler, so no instant at
    # which a signal could come amiss.
    before = signal.pthread_sigmask(signal.SIG_BLOCK, _SIGNALS)
    try:
        with ExitStack() as opened:
            stop = Event()
            workers = [
                worker_of(config, table, stop, opened, is_once=is_once)
                for table in config.publish
            ]
            opened.pop_all()  # from here on each closes what it has
            return _Loop(config, workers, stop).run()
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def worker_of(
    config: Config,
    table: PublishConfig,
    stop: Event,
    opened: ExitStack,
    *,
    is_once: bool = False,
) -> Worker:
    """Return what brings rows to one destination; it is not started."""
    cursor = Cursor(table.cursor_dir, table.name)
    opened.enter_context(cursor)
    last = cursor.placed
    is_newest_only = table.format == "home-assistant" or not table.backlog
    selection = Selection(
        Rules(table.moving_s, table.still_s, table.turn_deg),
        is_newest_only,
        table.max_age_h * 3600.0,
    )
    outbox = Outbox(config.log.path, selection, last)

    def status() -> dict[str, Any] | None:
        try:
            return read_status(config.status.path)[1]
        except (NotRunningError, OSError):
            return None

    sender = sender_of(table, status, last.row if last is not None else None)
    return Worker(
        table.name,
        outbox,
        cursor,
        sender,
        stop,
        is_once=is_once,
        is_newest_only=is_newest_only,
    )


class _Loop:
    """What happens each second beside the sending."""

    def __init__(self, config: Config, workers: Sequence[Worker], stop: Event) -> None:
        self._config, self._workers, self._stop = config, workers, stop
        self._waiting = Waiting(config.log.path, workers)
        self._files = [StatusFile(config.status.publish)]
        if (path := config.status.publish_prometheus) is not None:
            self._files.append(StatusFile(path, exposition))
        self._begun_ns = time.monotonic_ns()

    def run(self) -> int:
        for table in self._config.publish:
            log.info("%s: to %s", table.name, table.endpoint)
            if table.credentials_file is not None and not table.endpoint.is_tls:
                log.warning(
                    "%s: its password goes unencrypted over the network", table.name
                )
        for worker in self._workers:
            worker.start()
        try:
            while not all(worker.is_done for worker in self._workers):
                self._turn()
                if signal.sigtimedwait(_SIGNALS, TURN_S) is not None:
                    break
        finally:
            self._end()
        self._raise_bugs()
        is_failed = any(worker.is_failing for worker in self._workers)
        is_by_signal = not all(worker.is_once for worker in self._workers)
        return FAILED if is_failed and not is_by_signal else 0

    def _turn(self) -> None:
        self._waiting.count()
        status = describe(
            self._config.publish,
            self._workers,
            self._waiting,
            self._begun_ns,
            time.monotonic_ns(),
        )
        for file in self._files:
            file.write(status)
        self._raise_bugs()

    def _raise_bugs(self) -> None:
        for worker in self._workers:
            if worker.error is not None:
                raise worker.error

    def _end(self) -> None:
        self._stop.set()
        until_s = time.monotonic() + END_S
        for worker in self._workers:
            if not worker.join(max(0.0, until_s - time.monotonic())):
                log.warning("%s: does not end, left behind", worker.name)
        self._waiting.close()
        for file in self._files:
            file.remove()
        sent = ", ".join(f"{w.name} {w.sent_rows}" for w in self._workers)
        log.info("ended; rows sent: %s", sent)
