"""How many rows `imu-tracker publish` sends, and how far their line is from the log.

    python -m benchmarks.thinned

On the drive of the other benchmarks, and on a simulated day: an hour of driving twice,
and rest between them.
"""

import math
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

import numpy as np
from numpy.typing import NDArray

from benchmarks.drives import find_drive, write_drive
from imu_tracker.config import load_config
from imu_tracker.publish.senders.payloads import json_row
from imu_tracker.publish.thinning import LINE_M, Placed, Rules, Thinner
from imu_tracker.recording.files import read_recording
from imu_tracker.recording.replay import Replay
from imu_tracker.samples import Mode
from imu_tracker.storage.latlong import LogRow, format_row, parse_row
from imu_tracker.storage.log_tail import TailPosition

HOUR_S: Final = 3600
RATE_HZ: Final = 4
RULES: Final = (Rules(0, 0), Rules(1), Rules(5), Rules(), Rules(30, 600))


def rows_of(recording: Path) -> list[LogRow]:
    """Return the log of a replay."""
    states = Replay(load_config()).rows(read_recording(recording))
    return [parse_row(format_row(state).encode()) for state in states]


def day(hour: list[LogRow]) -> Iterator[LogRow]:
    """Yield a day: the hour, eight at rest, the hour again, and the night."""
    at_s = hour[0].utc_s
    for rest_h in (8, 14):
        begin_s = hour[0].utc_s
        for each in hour:
            yield each._replace(utc_s=at_s + each.utc_s - begin_s)
        at_s += hour[-1].utc_s - begin_s
        end = hour[-1]._replace(speed_mps=0.0, course_deg=math.nan, mode=Mode.STILL)
        for _ in range(rest_h * HOUR_S * RATE_HZ):
            at_s += 1 / RATE_HZ
            yield end._replace(utc_s=at_s)
        at_s += 1 / RATE_HZ


def apart_m(rows: list[LogRow], sent: list[LogRow]) -> tuple[float, float, float]:
    """Return how far rows lie from the line: 95 %, worst, and over the limit."""
    scale = 111_195.0 * math.cos(math.radians(rows[0].lat_deg))

    def places(of: list[LogRow]) -> NDArray[np.float64]:
        lon_deg = np.array([each.lon_deg for each in of]) - rows[0].lon_deg
        lat_deg = np.array([each.lat_deg for each in of]) - rows[0].lat_deg
        return np.column_stack([lon_deg * scale, lat_deg * 111_195.0])

    times = np.array([each.utc_s for each in sent])
    all_of_them, line = places(rows), places(sent)
    after = np.searchsorted(times, [each.utc_s for each in rows]).clip(1, len(sent) - 1)
    begin, along = line[after - 1], line[after] - line[after - 1]
    length = np.maximum((along**2).sum(1), 1e-9)
    share = (((all_of_them - begin) * along).sum(1) / length).clip(0.0, 1.0)
    found = np.linalg.norm(all_of_them - begin - share[:, None] * along, axis=1)
    inside = [each.utc_s <= sent[-1].utc_s for each in rows]
    allowed = np.array([max(each.r95_m, LINE_M) for each in rows])
    found, allowed = found[inside], allowed[inside]
    return (
        float(np.quantile(found, 0.95)),
        float(found.max()),
        float((found - allowed).max()),
    )


def table(name: str, rows: list[LogRow]) -> None:
    """Print a line for each setting."""
    hours = (rows[-1].utc_s - rows[0].utc_s) / HOUR_S
    print(f"\n{name}: {len(rows)} rows, {hours:.2f} h")
    print("| moving_s | still_s | rows sent | of the log | JSON | p95 | worst |")
    print("| --- | --- | --- | --- | --- | --- | --- |")
    for rules in RULES:
        thinner = Thinner(rules)
        placed = (Placed(each, TailPosition()) for each in rows)
        sent = [due.row for each in placed for due in thinner.feed(each)]
        size = sum(len(json_row("car", each)) for each in sent)
        p95_m, worst_m, beyond_m = apart_m(rows, sent)
        over = f" over by {beyond_m:.2f} m" if beyond_m > 0.01 else ""
        print(
            f"| {rules.moving_s:g} | {rules.still_s:g} | {len(sent)} | "
            f"{len(sent) / len(rows):.1%} | {size / 1000:.0f} kB | {p95_m:.1f} m | "
            f"{worst_m:.1f} m |{over}"
        )


def main() -> None:
    """Print the tables."""
    with TemporaryDirectory() as folder:
        drive = find_drive(Path(folder))
        table(drive.name, rows_of(drive.path))
        hour = rows_of(write_drive(Path(folder) / "hour.rec.gz", float(HOUR_S)))
        table("a simulated day", list(day(hour)))


if __name__ == "__main__":
    main()
