"""gpsd's protocol as clients of gpsd want it: requests in, JSON objects out.

Pure: bytes and rows in, bytes out. `eph` is documented as a 95 % guess of the
horizontal error, and so is exactly `r95_m`. What a newcomer gets wrong: a status of 0
or 1 is never sent; dead reckoning is 5, fused with GPS 6.

Source: gpsd_json(5).
"""

import json
import math
import re
from typing import Any, Final

from imu_tracker import __version__
from imu_tracker.exports.nmea import SIGMAS_IN_R95
from imu_tracker.samples import Mode
from imu_tracker.serve.view import Shown
from imu_tracker.storage.latlong import format_utc

DEVICE: Final = "imu-tracker"
RELAY: Final = b'?WATCH={"enable":true,"json":true};'
"""What a gpsd means that relays another one: it says nothing."""

MAX_REQUEST: Final = 4096
"""Bytes of requests without an end; the longest that clients send has 100."""

_FUSED, _DEAD_RECKONING = 6, 5
_AXIS_OF_R95: Final = 1.96 / SIGMAS_IN_R95
"""95 % of one axis of a circular normal error, over 95 % of both."""

_REQUEST: Final = re.compile(r"\?([A-Z]+)\s*(?:=\s*(.*))?", re.DOTALL)


def tpv(shown: Shown) -> dict[str, Any]:
    """Return a time-position-velocity report."""
    row = shown.row
    report: dict[str, Any] = {
        "class": "TPV",
        "device": DEVICE,
        "mode": 2 if math.isnan(row.alt_m) else 3,
        "time": format_utc(row.utc_s),
        "lat": row.lat_deg,
        "lon": row.lon_deg,
        "eph": row.r95_m,
        "epx": round(row.r95_m * _AXIS_OF_R95, 2),
        "epy": round(row.r95_m * _AXIS_OF_R95, 2),
        "speed": row.speed_mps,
    }
    if not shown.has_fix:
        report["status"] = _DEAD_RECKONING
    elif row.mode != Mode.GPSONLY:  # that is a plain fix, which has no number
        report["status"] = _FUSED
    if not math.isnan(row.alt_m):
        report["altMSL"] = report["alt"] = row.alt_m
    if not math.isnan(row.course_deg):
        report["track"] = row.course_deg
    return report


def no_fix() -> dict[str, Any]:
    """Return the report of a receiver that has none: the daemon is away."""
    return {"class": "TPV", "device": DEVICE, "mode": 1}


def line(message: dict[str, Any]) -> bytes:
    """Write an object as gpsd does."""
    return json.dumps(message, separators=(",", ":")).encode() + b"\r\n"


def greeting() -> bytes:
    """Return what a client hears first."""
    return line(
        {
            "class": "VERSION",
            "release": f"imu-tracker {__version__}",
            "rev": __version__,
            "proto_major": 3,
            "proto_minor": 14,
        }
    )


class GpsdSession:
    """One client.

    Attributes
    ----------
    wants_json, wants_nmea : bool
        What it watches.
    """

    def __init__(self) -> None:
        self._policy: dict[str, Any] = {
            "enable": False,
            "json": False,
            "nmea": False,
            "raw": 0,
            "scaled": False,
            "timing": False,
            "split24": False,
            "pps": False,
        }
        self._rest = b""

    @property
    def wants_json(self) -> bool:
        """Whether it watches reports."""
        return bool(self._policy["enable"] and self._policy["json"])

    @property
    def wants_nmea(self) -> bool:
        """Whether it watches sentences."""
        policy = self._policy
        return bool(policy["enable"] and (policy["nmea"] or policy["raw"]))

    def feed(self, data: bytes, last: Shown | None, *, is_on: bool) -> bytes:
        """Take bytes of the client; return the answers.

        Parameters
        ----------
        data : bytes
        last : Shown, optional
            The newest row.
        is_on : bool
            Whether the daemon is there.

        Raises
        ------
        ValueError
            When a request does not end.
        """
        *requests, self._rest = re.split(rb"[;\r\n]", self._rest + data)
        whole = _is_whole(self._rest)
        if whole:  # clients leave the semicolon out
            requests, self._rest = [*requests, self._rest], b""
        if len(self._rest) > MAX_REQUEST:
            raise ValueError("a request without an end")
        answers = bytearray()
        for request in requests:
            text = request.decode("utf-8", "replace").strip()
            if text:
                answers += self._answer(text, last if is_on else None, is_on=is_on)
        return bytes(answers)

    def _answer(self, text: str, last: Shown | None, *, is_on: bool) -> bytes:
        match = _REQUEST.fullmatch(text)
        name = match[1] if match else ""
        match name:
            case "VERSION":
                return greeting()
            case "DEVICES":
                return line(_devices(last, is_on=is_on))
            case "DEVICE":
                return line(_device(last, is_on=is_on))
            case "POLL":
                report = no_fix() if last is None else tpv(last)
                time = {} if last is None else {"time": report["time"]}
                poll = {"class": "POLL", **time, "active": int(is_on)}
                return line({**poll, "tpv": [report], "gst": [], "sky": []})
            case "WATCH":
                return self._watch(match[2] if match else None, last, is_on=is_on)
        said = "".join(c if c.isprintable() else "?" for c in text[:80])
        return line({"class": "ERROR", "message": f"Unrecognized request '{said}'"})

    def _watch(self, text: str | None, last: Shown | None, *, is_on: bool) -> bytes:
        if text:
            try:
                asked = json.loads(text)
            except (ValueError, RecursionError):
                asked = None
            if not isinstance(asked, dict):
                return line({"class": "ERROR", "message": "Invalid WATCH"})
            for key in self._policy.keys() & asked.keys():
                wanted = type(self._policy[key])
                if isinstance(asked[key], bool | int):
                    self._policy[key] = wanted(min(max(int(asked[key]), 0), 2))
            if "enable" not in asked:
                self._policy["enable"] = True
            if self._policy["enable"] and not asked.keys() & {"json", "nmea", "raw"}:
                self._policy["json"] = True
        watch = {"class": "WATCH", **self._policy}
        answer = line(_devices(last, is_on=is_on)) + line(watch)
        if self.wants_json and last is not None:
            answer += line(tpv(last))
        return answer


def _is_whole(request: bytes) -> bool:
    """Tell whether a request without its semicolon is one: clients leave it out."""
    if request.startswith(b"?WATCH={") and request.rstrip().endswith(b"}"):
        return True
    return request in (b"?POLL", b"?DEVICES", b"?VERSION")


def _device(last: Shown | None, *, is_on: bool) -> dict[str, Any]:
    device: dict[str, Any] = {"class": "DEVICE", "path": DEVICE}
    if is_on and last is not None:
        device |= {
            "driver": "imu-tracker",
            "activated": format_utc(last.row.utc_s),
            "flags": 1,
            "cycle": 0.25,
        }
    return device


def _devices(last: Shown | None, *, is_on: bool) -> dict[str, Any]:
    return {"class": "DEVICES", "devices": [_device(last, is_on=is_on)]}
