"""What was counted, by kind of fault: how a person or a monitor asks what is wrong.

Weather is no fault: an epoch without a fix, a row that was not due. A count is of
events since the start, most of them survived unnoticed; one that grows is news.
"""

from collections.abc import Mapping
from typing import Final

KINDS: Final[Mapping[str, tuple[str, ...]]] = {
    "imu_bus": ("imu_bus_errors", "imu_missed_ticks"),
    "imu_chip": (
        "imu_fifo_overflows",
        "imu_fifo_restarts",
        "imu_reinitialisations",
        "imu_frozen_frames",
    ),
    "imu_samples": (
        "imu_gaps",
        "saturated_samples",
        "clipped_samples",
        "repeated_samples",
        "frozen_samples",
        "stuck_samples",
        "invalid_samples",
    ),
    "gps_line": (
        "gps_reopens",
        "bad_checksums",
        "missing_checksums",
        "overlong_lines",
        "unparsable_lines",
    ),
    "gps_epochs": (
        "bad_positions",
        "contradictory_epochs",
        "repeated_epochs",
        "sentences_without_time",
        "fixes_without_date",
    ),
    "gps_fixes": (
        "fixes_outlier",
        "fixes_frozen",
        "fixes_too_late",
        "fixes_undated",
        "suspect_fixes",
    ),
    "disk": (
        "write_failures",
        "lost_rows",
        "recording_write_failures",
        "recording_lost_records",
        "state_failures",
    ),
    "log_times": ("skipped_rows",),
    "load": ("refused_frames", "late_rows"),
}
"""Each kind, and the counters that it sums."""


def faults_of(counters: Mapping[str, int]) -> dict[str, int]:
    """Return how many faults of each kind were counted."""
    return {
        kind: sum(counters.get(name, 0) for name in names)
        for kind, names in KINDS.items()
    }
