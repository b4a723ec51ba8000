"""The status as metrics, for the textfile collector of the node exporter.

No library: the format is a line a sample. Positions are left out: a monitor need not
know where somebody is.

Source: Prometheus' text exposition format, version 0.0.4; its names and base units.
"""

from collections.abc import Iterator, Mapping
from typing import Any, Final

from imu_tracker import __version__
from imu_tracker.samples import Mode
from imu_tracker.storage.status_file import metric

STATES: Final = ("starting", "waiting for the first fix", "tracking", "not logging")

_GAUGES: Final = (
    ("uptime_seconds", "uptime_s", 1, "Since the start of the daemon."),
    ("r95_meters", "r95_m", 1, "Radius that holds the position with 95 %."),
    ("row_age_seconds", "row_age_s", 1, "Since the instant of the last row."),
    ("fix_age_seconds", "fix_age_s", 1, "Since a fix was used."),
    ("imu_rate_hertz", "imu_rate_hz", 1, "Samples per second; 0 while none come."),
    ("disk_free_bytes", "disk_free_mb", 1_000_000, "Left for the log."),
)


def exposition(status: Mapping[str, Any]) -> str:
    """Return the metrics of a status; what is not known is left out."""
    return "".join(f"{line}\n" for line in _lines(status))


def _lines(status: Mapping[str, Any]) -> Iterator[str]:
    info = {"version": __version__, "source": status["source"]}
    yield from metric("info", "gauge", "What runs.", [(info, 1)])
    for name, key, scale, text in _GAUGES:
        if status[key] is not None:
            yield from metric(name, "gauge", text, [({}, status[key] * scale)])
    yield from metric(
        "state",
        "gauge",
        "1 for what the daemon is doing.",
        [({"state": state}, int(status["state"] == state)) for state in STATES],
    )
    yield from metric(
        "mode",
        "gauge",
        "1 for the mode of the last row.",
        [({"mode": mode}, int(status["mode"] == mode)) for mode in Mode],
    )
    failing = int(status["log"]["is_failing"])
    yield from metric(
        "log_failing", "gauge", "1 while rows wait in memory.", [({}, failing)]
    )
    for name, key, label, text in (
        ("faults_total", "faults", "kind", "Faults since the start, by kind."),
        ("counted_total", "counters", "counter", "Everything counted since the start."),
    ):
        samples = [({label: each}, n) for each, n in status[key].items()]
        yield from metric(name, "counter", text, samples)
