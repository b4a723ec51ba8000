"""Any number of logs as one stream of points that know where they belong.

Logs that follow one another, as rotated ones do, are one track; a log that goes back
in time is a track of its own. A track is cut into segments where the tracker was off
and where it crosses the 180th meridian: a line must not be drawn across either.
"""

import itertools
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Final, NamedTuple

from imu_tracker.samples import Mode
from imu_tracker.storage.latlong import MAX_GAP_S, LogRow, read_rows

MAX_RUN: Final = 10_000
"""Rows of a run at most: what the formats that want columns hold in memory."""


class Point(NamedTuple):
    """A row of a log; `track` names its track alone, `segment` counts through all."""

    track: str
    segment: int
    row: LogRow


class Run(NamedTuple):
    """Rows of one mode that follow one another, at least one.

    `before` is the row before them in the same segment, where a line begins.
    """

    track: str
    mode: Mode
    before: LogRow | None
    rows: list[LogRow]


def merged(paths: Sequence[Path]) -> Iterator[Point]:
    """Read logs in the order of their first rows; logs without rows are left out.

    Raises
    ------
    LogError
        When a row is malformed.
    InputMissingError
        When there is no such file.
    """
    first_rows = [(_first_utc_s(path), path) for path in paths]
    ordered = sorted((utc_s, path) for utc_s, path in first_rows if utc_s is not None)
    track, segment = "", -1
    used: Counter[str] = Counter()
    last: LogRow | None = None
    for _, path in ordered:
        for row in read_rows(path):
            if last is None or row.utc_s <= last.utc_s:
                track, segment = _unused(_name(path), used), segment + 1
            elif (
                row.utc_s - last.utc_s > MAX_GAP_S
                or abs(row.lon_deg - last.lon_deg) > 180.0
            ):
                segment += 1
            last = row
            yield Point(track, segment, row)


def _first_utc_s(path: Path) -> float | None:
    return next((row.utc_s for row in read_rows(path)), None)


def _unused(name: str, used: Counter[str]) -> str:
    """Number the tracks of files that have the same name in several directories."""
    used[name] += 1
    return name if used[name] == 1 else f"{name} ({used[name]})"


def _name(path: Path) -> str:
    """Return a file's name as text that XML can carry, whatever its bytes."""
    text = path.name.encode("utf-8", "surrogateescape").decode("utf-8", "replace")
    return "".join(
        letter if letter.isprintable() else "\N{REPLACEMENT CHARACTER}"
        for letter in text
    )


def spaced(points: Iterable[Point], every_s: float) -> Iterator[Point]:
    """Leave out what comes sooner than `every_s` after the last, in the same mode."""
    last: Point | None = None
    for point in points:
        if (
            last is None
            or point.segment != last.segment
            or point.row.mode != last.row.mode
            or point.row.utc_s - last.row.utc_s >= every_s - 1e-3
        ):
            last = point
            yield point


def runs(points: Iterable[Point]) -> Iterator[Run]:
    """Cut segments where the mode changes, and where they become long."""
    for _, segment in itertools.groupby(points, lambda point: point.segment):
        before: LogRow | None = None
        for mode, alike in itertools.groupby(segment, lambda point: point.row.mode):
            while part := list(itertools.islice(alike, MAX_RUN)):
                rows = [point.row for point in part]
                yield Run(part[0].track, Mode(mode), before, rows)
                before = rows[-1]
