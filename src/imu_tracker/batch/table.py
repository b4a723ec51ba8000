"""One table of a batch: CSV always, Parquet where pyarrow is installed."""

import csv
import io
from collections.abc import Iterable
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Final

from imu_tracker.batch.jobs import Line

COLUMNS: Final = (
    *("recording", "failed", "begin_utc", "length_s", "rows", "km", "dr_share"),
    *("still_share", "outages", "longest_outage_s", "reacquisitions", "miss_rms_m"),
    *("miss_median_m", "miss_max_m", "miss_inside", "fixes", "fix_inside"),
    *("fix_miss_rms_m", "nis", "r95_mean_m", "imu_rate_hz", "imu_missing_share"),
    *("profile", "faults"),
)
TEXTS: Final = frozenset({"recording", "failed", "begin_utc", "profile", "faults"})
WHOLES: Final = frozenset({"rows", "outages", "reacquisitions", "fixes"})


def csv_of(lines: Iterable[Line]) -> str:
    """Return the table as text; a cell that was not measured is empty."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(COLUMNS)
    for line in lines:
        writer.writerow([_cell(line.get(name)) for name in COLUMNS])
    return text.getvalue()


def _cell(value: Any) -> str:
    match value:
        case None:
            return ""
        case float():
            return f"{value:.6g}"
        case _:
            return str(value)


def has_parquet() -> bool:
    """Tell whether pyarrow is there."""
    return find_spec("pyarrow") is not None


def write_parquet(lines: Iterable[Line], path: Path) -> None:
    """Write the same columns with their types."""
    import pyarrow as pa
    from pyarrow import parquet

    kinds = {
        name: pa.string()
        if name in TEXTS
        else pa.int64()
        if name in WHOLES
        else pa.float64()
        for name in COLUMNS
    }
    rows = [{name: line.get(name) for name in COLUMNS} for line in lines]
    parquet.write_table(pa.Table.from_pylist(rows, pa.schema(kinds)), path)
