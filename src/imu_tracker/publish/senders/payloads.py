"""What is written on the wire for a row: the formats, version 1 of ours.

No clock: all times are those of the rows. What a newcomer gets wrong: `r95_m` holds the
position with 95 %, and those formats that know an accuracy mean about the same, or
nothing in particular.

Sources: OwnTracks booklet, tech/json and tech/http; Traccar, OsmAndProtocolDecoder;
InfluxDB line protocol.
"""

import json
import math
from typing import Any, Final
from urllib.parse import urlencode

from imu_tracker.storage.latlong import LogRow, format_utc

VERSION: Final = 1

_HEALTH: Final = (
    *("state", "mode", "r95_m", "fix_age_s", "imu_rate_hz", "disk_free_mb"),
    *("uptime_s", "faults"),
)
_KNOTS_PER_MPS: Final = 3600.0 / 1852.0
_KMPH_PER_MPS: Final = 3.6


def json_row(device: str, row: LogRow) -> bytes:
    """Return a row as our JSON; what the log leaves empty is left out."""
    return _compact({"v": VERSION, "id": device, **columns(row)})


def columns(row: LogRow) -> dict[str, Any]:
    """Return a row by the columns of the log, without what is empty there."""
    named = row._asdict()
    named.pop("utc_s")
    named = {key: value for key, value in named.items() if value == value}
    return {"time_utc": format_utc(row.utc_s), **named}


def json_health(device: str, status: dict[str, Any] | None) -> bytes:
    """Return how the tracker is as our JSON: no position, no path."""
    found: dict[str, Any] = {"v": VERSION, "id": device, "state": "not running"}
    for key in _HEALTH if status is not None else ():
        if (value := (status or {}).get(key)) is not None:
            found[key] = value
    return _compact(found)


def owntracks_row(tracker_id: str, row: LogRow) -> bytes:
    """Return a row as a location of OwnTracks.

    Notes
    -----
    Whole numbers, as the Recorder and Traccar read them: rounded up where it is a
    promise. `acc` is never left out: without it some drop the message in silence.
    """
    found: dict[str, Any] = {
        "_type": "location",
        "lat": row.lat_deg,
        "lon": row.lon_deg,
        "tst": owntracks_second(row),
        "acc": max(1, math.ceil(row.r95_m)),
        "tid": tracker_id,
        "r95": row.r95_m,
        "mode": row.mode,
    }
    if not math.isnan(row.alt_m):
        found["alt"] = round(row.alt_m)
    if vel := round(row.speed_mps * _KMPH_PER_MPS):
        found["vel"] = vel
    if not math.isnan(row.course_deg):
        found["cog"] = round(row.course_deg) % 360
    return _compact(found)


def owntracks_will(row: LogRow | None) -> bytes:
    """Return what the broker says for us when we are gone."""
    tst = owntracks_second(row) if row is not None else 0
    return _compact({"_type": "lwt", "tst": tst})


def owntracks_second(row: LogRow) -> int:
    """Return the time of a row as OwnTracks knows it: a whole second."""
    return math.floor(row.utc_s + 5e-4)


def traccar_row(device: str, row: LogRow) -> bytes:
    """Return a row as a form of the OsmAnd protocol: knots, and ours as attributes."""
    found: dict[str, Any] = {
        "id": device,
        "timestamp": round(row.utc_s * 1000.0),
        "lat": f"{row.lat_deg:.8f}",
        "lon": f"{row.lon_deg:.8f}",
        "speed": f"{row.speed_mps * _KNOTS_PER_MPS:.3f}",
        "accuracy": f"{row.r95_m:.2f}",
        "r95_m": f"{row.r95_m:.2f}",
        "mode": row.mode,
    }
    if not math.isnan(row.course_deg):
        found["bearing"] = f"{row.course_deg:.1f}"
    if not math.isnan(row.alt_m):
        found["altitude"] = f"{row.alt_m:.1f}"
    return urlencode(found).encode("ascii")


def influx_row(device: str, row: LogRow) -> bytes:
    """Return a row as a line, its time in milliseconds; numbers are always floats."""
    fields = [
        f"{key}={value!r}"
        for key, value in zip(row._fields[1:7], row[1:7], strict=True)
        if value == value
    ]
    milliseconds = round(row.utc_s * 1000.0)
    return (
        f'position,id={device} {",".join(fields)},mode="{row.mode}" {milliseconds}\n'
    ).encode("ascii")


def _compact(found: dict[str, Any]) -> bytes:
    return json.dumps(found, separators=(",", ":"), allow_nan=False).encode("ascii")
