"""What `publish` tells of itself: to `imu-tracker status` and to Prometheus.

Version 1 of the object::

    version, pid     1; the process
    t_ns             CLOCK_MONOTONIC at writing: older than 5 s means that it hangs
    uptime_s         since its start
    destinations     by name:
      kind, to       of the configuration: no password is in it
      state          "sending", "failing" (nothing was taken since the last error),
                     "ended" (of --once)
      unsent_rows    rows of the log that are not read yet, and rows that are due and
                     not acknowledged
      oldest_unsent  the time of the oldest that is due; null when none waits
      last_row       the time of the newest row that the other side has; null before
      success_age_s  since it took a row; null before
      last_error     what went wrong last; "" when nothing did
      error_age_s    since then; null before
      sent_rows, refused_rows, old_rows, deleted_rows, errors
                     counted since the start: taken by the other side, never taken by
                     it, left out for max_age_h, deleted unsent for want of space

No position is in it.
"""

import os
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Final

from imu_tracker.config.publishing import PublishConfig
from imu_tracker.publish.waiting import Waiting
from imu_tracker.publish.worker import Worker
from imu_tracker.storage.latlong import format_utc
from imu_tracker.storage.status_file import metric

VERSION: Final = 1

_COUNTED: Final = (
    ("sent_rows", "Rows that the destination has taken."),
    ("refused_rows", "Rows that it will never take."),
    ("old_rows", "Rows that were left out for their age."),
    ("deleted_rows", "Rows that were deleted unsent, for want of space."),
    ("errors", "Connections that failed."),
)
_GAUGES: Final = (
    ("unsent_rows", "unsent_rows", "Rows of the log that it has not got."),
    ("success_age_seconds", "success_age_s", "Since it took a row."),
    ("oldest_unsent_age_seconds", "oldest_unsent_age_s", "Behind the newest row."),
)


def describe(
    configs: Sequence[PublishConfig],
    workers: Sequence[Worker],
    waiting: Waiting,
    begun_ns: int,
    now_ns: int,
) -> dict[str, Any]:
    """Return the object."""
    return {
        "version": VERSION,
        "pid": os.getpid(),
        "t_ns": now_ns,
        "uptime_s": (now_ns - begun_ns) // 1_000_000_000,
        "destinations": {
            config.name: _destination(config, worker, waiting, number, now_ns)
            for number, (config, worker) in enumerate(
                zip(configs, workers, strict=True)
            )
        },
    }


def _destination(
    config: PublishConfig, worker: Worker, waiting: Waiting, number: int, now_ns: int
) -> dict[str, Any]:
    placed, oldest_s = worker.cursor.placed, worker.oldest_utc_s
    state = "failing" if worker.is_failing else "sending"
    return {
        "kind": config.kind if config.kind != "mqtt" else f"mqtt {config.format}",
        "to": str(config.endpoint),
        "state": "ended" if worker.is_done and not worker.is_failing else state,
        "unsent_rows": waiting.unsent_rows(number),
        "oldest_unsent": None if oldest_s is None else format_utc(oldest_s),
        "oldest_unsent_age_s": (
            None if oldest_s is None else waiting.behind_newest_s(oldest_s)
        ),
        "last_row": None if placed is None else format_utc(placed.row.utc_s),
        "success_age_s": _age_s(worker.success_ns, now_ns),
        "last_error": worker.last_error,
        "error_age_s": _age_s(worker.error_ns, now_ns),
        "sent_rows": worker.sent_rows,
        "refused_rows": worker.refused_rows,
        "old_rows": worker.outbox.old_rows,
        "deleted_rows": waiting.deleted_rows[number],
        "errors": worker.errors,
    }


def _age_s(then_ns: int | None, now_ns: int) -> int | None:
    return None if then_ns is None else max(0, now_ns - then_ns) // 1_000_000_000


def exposition(status: Mapping[str, Any]) -> str:
    """Return the object as metrics; what is not known is left out."""
    return "".join(f"{line}\n" for line in _lines(status["destinations"]))


def _lines(destinations: Mapping[str, Mapping[str, Any]]) -> Iterator[str]:
    for name, key, text in _GAUGES:
        samples: list[tuple[dict[str, str], float]] = [
            ({"destination": destination}, found[key])
            for destination, found in destinations.items()
            if found[key] is not None
        ]
        yield from metric(f"publish_{name}", "gauge", text, samples)
    yield from metric(
        "publish_failing",
        "gauge",
        "1 while nothing was taken since the last error.",
        [
            ({"destination": destination}, int(found["state"] == "failing"))
            for destination, found in destinations.items()
        ],
    )
    for name, text in _COUNTED:
        yield from metric(
            f"publish_{name}_total",
            "counter",
            text,
            [({"destination": d}, found[name]) for d, found in destinations.items()],
        )
