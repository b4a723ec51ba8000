"""Compare a track with the truth: how far off, and was the promise kept.

Works on whole tracks as arrays. What a newcomer gets wrong: the truth asks, the track
answers. Every truth point is a question; it counts where the track has a row on
either side at most two seconds apart, and the share that has is part of the score.
"""

import csv
import gzip
import math
import zlib
from collections.abc import Iterable, Iterator, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Final, NamedTuple, TextIO

import numpy as np
from numpy.typing import NDArray

from imu_tracker.errors import InputMissingError, RecordingError
from imu_tracker.geometry.geodesy import radii_m
from imu_tracker.recording.edit import Outage
from imu_tracker.storage.torn_lines import MAX_LINE_BYTES

Array = NDArray[np.float64]

MAX_GAP_S: Final = 2.0
"""Rows further apart than this do not answer for what lies between them."""

WARM_UP_S: Final = 30.0
"""The first seconds of the truth do not count."""

_COLUMNS: Final = ("time_utc", "lat_deg", "lon_deg")

_radii_m = np.vectorize(radii_m, otypes=[float, float])


class Track(NamedTuple):
    """Positions over time; arrays of shape (n,), times strictly growing."""

    utc_s: Array
    lat_deg: Array
    lon_deg: Array


class Answers(NamedTuple):
    """What a track says at the instants of the truth; arrays of shape (n,)."""

    is_answered: NDArray[np.bool_]
    error_m: Array  # horizontal
    r95_m: Array


def read_truth(path: Path) -> Track:
    """Read the columns `time_utc,lat_deg,lon_deg` of a CSV file, plain or gzip.

    Raises
    ------
    InputMissingError, RecordingError
        When the file is not there, or a line of it is not a row.
    """
    rows: list[tuple[float, float, float]] = []
    line = 1
    try:
        with path.open("rb") as file:
            is_gzip = file.read(2) == b"\x1f\x8b"
        opener = gzip.open if is_gzip else open
        with opener(path, "rt", encoding="utf-8-sig", newline="") as text:
            reader = csv.DictReader(_bounded(text))
            for row in reader:
                line = reader.line_num
                rows.append(_truth_row(row))
                if len(rows) > 1 and rows[-1][0] <= rows[-2][0]:
                    raise ValueError("time must grow")
    except (FileNotFoundError, PermissionError) as error:
        raise InputMissingError(f"{path}: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise RecordingError(f"{path}: not UTF-8 text") from error
    except (OSError, EOFError, zlib.error, csv.Error, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise RecordingError(f"{path}:{line}: {reason}") from error
    if not rows:
        raise RecordingError(f"{path}: no rows: expected {','.join(_COLUMNS)}")
    return Track(*np.array(rows).T)


def _bounded(text: TextIO) -> Iterator[str]:
    """Yield the lines of a file that may not have any."""
    while line := text.readline(MAX_LINE_BYTES):
        if len(line) == MAX_LINE_BYTES:
            raise ValueError(f"longer than {MAX_LINE_BYTES} bytes")
        yield line


def _truth_row(row: dict[str, str]) -> tuple[float, float, float]:
    missing = [name for name in _COLUMNS if name not in row]
    if missing:
        raise ValueError(f"no column {missing[0]}: expected {','.join(_COLUMNS)}")
    try:
        time = datetime.fromisoformat(row["time_utc"])
        lat_deg, lon_deg = float(row["lat_deg"]), float(row["lon_deg"])
        if not (abs(lat_deg) <= 90 and abs(lon_deg) <= 180):
            raise ValueError
    except (TypeError, ValueError) as error:  # a short row holds None
        raise ValueError(f"not a row of {','.join(_COLUMNS)}") from error
    return time.replace(tzinfo=time.tzinfo or UTC).timestamp(), lat_deg, lon_deg


def answer(track: Track, r95_m: Array, truth: Track) -> Answers:
    """Ask the track, and its promise, at the instants of the truth.

    Linear between rows. Metres come from the radii of curvature of WGS-84 at the
    truth; longitudes may cross the date line.
    """
    n = len(truth.utc_s)
    if len(track.utc_s) < 2:
        return Answers(np.zeros(n, bool), np.full(n, np.inf), np.zeros(n))
    after = np.clip(np.searchsorted(track.utc_s, truth.utc_s), 1, len(track.utc_s) - 1)
    before = after - 1
    gap_s = track.utc_s[after] - track.utc_s[before]
    is_answered = (
        (truth.utc_s >= track.utc_s[0])
        & (truth.utc_s <= track.utc_s[-1])
        & (gap_s <= MAX_GAP_S)
    )
    share = (truth.utc_s - track.utc_s[before]) / gap_s

    def between(values: Array) -> Array:
        return values[before] + share * (values[after] - values[before])

    north_m, east_m = metres_per_degree(truth.lat_deg)
    lon_step = _turn(track.lon_deg[after] - track.lon_deg[before])
    lon_deg = track.lon_deg[before] + share * lon_step
    error_m = np.hypot(
        (between(track.lat_deg) - truth.lat_deg) * north_m,
        _turn(lon_deg - truth.lon_deg) * east_m,
    )
    return Answers(is_answered, error_m, between(r95_m))


def score(
    track: Track,
    r95_m: Array,
    truth: Track,
    outages: Sequence[Outage] = (),
    zero_utc_s: float | None = None,
) -> dict[str, Any]:
    """Compute the figures of a track against the truth.

    Parameters
    ----------
    track, r95_m : Track and array, shape (n,)
        The log.
    truth : Track
    outages : sequence of Outage
        In seconds from `zero_utc_s`, which is the first truth point when None.

    Returns
    -------
    dict
        `answered`: share of the truth after the warm-up that the log answers;
        `with_gps` and `outage`: count, rms, p50, p95 and max of the horizontal error
        in metres, the share inside r95 and the median of r95; `outage_end_error` and
        `outage_end_r95`, one for each outage, infinite where the log does not answer.
    """
    answers = answer(track, r95_m, truth)
    zero_s = truth.utc_s[0] if zero_utc_s is None else zero_utc_s
    is_due = truth.utc_s >= truth.utc_s[0] + WARM_UP_S
    is_answered = answers.is_answered & is_due
    is_dark = np.zeros(len(truth.utc_s), bool)
    ends: list[tuple[float, float]] = []
    for outage in outages:
        # Closed at both ends: the last question is how far off it is when GPS returns.
        since_s = truth.utc_s - zero_s - outage.start_s
        is_in = (since_s >= 0) & (since_s <= outage.length_s)
        is_dark |= is_in
        if not is_in.any():
            continue
        last = int(np.flatnonzero(is_in)[-1])
        ends.append(
            (float(answers.error_m[last]), float(answers.r95_m[last]))
            if is_answered[last]
            else (math.inf, math.inf)
        )
    figures: dict[str, Any] = {
        "answered": float(is_answered.sum() / max(1, is_due.sum())),
        "with_gps": _figures(answers, is_answered & ~is_dark),
        "outage": _figures(answers, is_answered & is_dark),
        "outage_end_error": [error for error, _ in ends],
        "outage_end_r95": [r95 for _, r95 in ends],
    }
    if ends:
        errors, promises = np.array(ends).T
        figures["outage_end_rms"] = float(np.sqrt(np.mean(errors**2)))
        figures["outage_end_r95_median"] = float(np.median(promises))
    return figures


def describe(figures: dict[str, Any]) -> Iterable[str]:
    """Yield the score as lines of a table for people."""
    columns = "".join(f"{name:>12}" for name in ("rms", "p50", "p95", "max"))
    yield f"{'':12}{'n':>7}{columns}   inside r95  r95"
    for name, title in (("with_gps", "with GPS"), ("outage", "in outages")):
        if part := figures[name]:
            yield (
                f"{title:12} {part['n']:6d}"
                + "".join(
                    f" {part[key]:9.2f} m" for key in ("rms", "p50", "p95", "max")
                )
                + f"   {part['inside_r95']:9.1%}  {part['r95_median']:.2f} m"
            )
    for number, (error_m, r95_m) in enumerate(
        zip(figures["outage_end_error"], figures["outage_end_r95"], strict=True), 1
    ):
        end = f"{error_m:.2f} m off, r95 {r95_m:.2f} m"
        yield f"end of outage {number}: {end if error_m < math.inf else 'no answer'}"
    yield f"answered: {figures['answered']:.1%} of the truth after {WARM_UP_S:g} s"


def metres_per_degree(lat_deg: Array) -> tuple[Array, Array]:
    """Return metres per degree of latitude and of longitude on the WGS-84 ellipsoid."""
    lat_rad = np.radians(lat_deg)
    meridian_m, prime_vertical_m = _radii_m(lat_rad)
    return np.radians(meridian_m), np.radians(prime_vertical_m * np.cos(lat_rad))


def _turn(angle_deg: Array) -> Array:
    """Bring differences of longitude into [-180, 180)."""
    return (angle_deg + 180.0) % 360.0 - 180.0


def _figures(answers: Answers, chosen: NDArray[np.bool_]) -> dict[str, Any]:
    error_m, r95_m = answers.error_m[chosen], answers.r95_m[chosen]
    if not len(error_m):
        return {}
    return {
        "n": len(error_m),
        "rms": float(np.sqrt(np.mean(error_m**2))),
        "p50": float(np.median(error_m)),
        "p95": float(np.percentile(error_m, 95)),
        "max": float(error_m.max()),
        "inside_r95": float(np.mean(error_m <= r95_m)),
        "r95_median": float(np.median(r95_m)),
    }
