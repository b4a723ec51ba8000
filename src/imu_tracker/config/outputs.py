"""`[log]`, `[record]`, `[status]`, `[state]`: the files that are written."""

from pathlib import Path
from typing import Annotated, Final, Literal

from pydantic import field_validator

from imu_tracker.config.table import Table, key
from imu_tracker.config.values import Exact, FilePath, OptionalPath

STATE: Final = Path("/var/lib/imu-tracker/state.json")
PUBLISH_STATUS: Final = Path("/run/imu-tracker-publish/status.json")


class LogConfig(Table):
    """`[log]`: the lat/long log, the product of the program."""

    path: FilePath = key(Path("/var/log/imu-tracker/latlong.csv"), "the path of a file")
    rate_hz: Annotated[Literal[1, 2, 4, 5, 8, 10], Exact] = key(
        4, "1, 2, 4, 5, 8 or 10"
    )
    sync_s: float = key(5.0, "from 0 to 3600 s", ge=0, le=3600)
    max_mb: float = key(16.0, "from 0.01 to 4096 MB", ge=0.01, le=4096)
    min_free_mb: float = key(500.0, "from 0 to 1000000 MB", ge=0, le=1e6)


class RecordConfig(Table):
    """`[record]`: raw capture beside the tracking."""

    path: OptionalPath = key(None, 'the path of a recording, or "" for none')


class StatusConfig(Table):
    """`[status]`: the files that `imu-tracker status` and monitors read."""

    path: FilePath = key(Path("/run/imu-tracker/status.json"), "the path of a file")
    prometheus: OptionalPath = key(None, 'a path that ends in .prom, or "" for none')
    publish: FilePath = key(PUBLISH_STATUS, "the path of a file")
    publish_prometheus: OptionalPath = key(
        None, 'a path that ends in .prom, or "" for none'
    )

    @field_validator("prometheus", "publish_prometheus", mode="after")
    @classmethod
    def _the_collector_reads_only_its_own(cls, path: Path | None) -> Path | None:
        if path is not None and path.suffix != ".prom":
            raise ValueError
        return path


class StateConfig(Table):
    """`[state]`: what was learnt, for the next start."""

    path: OptionalPath = key(STATE, 'the path of a file, or "" for none')
