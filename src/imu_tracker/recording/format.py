r"""The lines of a recording, version 1: text to headers and frames, and back.

A byte of the receiver that is not printable ASCII stands as `\xNN`, and so does the
backslash: whatever the wire brought comes back byte for byte. All complaints are plain
ValueErrors that begin with what was expected; `recording` knows the place.
"""

import json
import re
import reprlib
from binascii import unhexlify
from datetime import UTC, datetime, timedelta
from typing import Any, Final

from imu_tracker.calibration.counts import COUNTS_PER_DPS, COUNTS_PER_G, parse_mount
from imu_tracker.samples import (
    FIRST_YEAR,
    LAST_YEAR,
    Frame,
    SessionHeader,
    Source,
)
from imu_tracker.storage.torn_lines import MAX_LINE_BYTES

MAGIC: Final = b"# imu-tracker recording 1"

MAX_T_NS: Final = 2**63 - 1

BURST_BYTES: Final = 14

MAX_TEXT_BYTES: Final = (MAX_LINE_BYTES - 32) // 4
"""Of one line of the receiver: in the file each byte may need four."""

_MAX_RATE_HZ = 8000.0  # of the chip's gyro; its accelerometer ends at 1000
_PROFILES = ("free", "vehicle", "walker")
_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)

EXPECTED: Final = (
    r"expected `I <t_ns> <28 hex digits>`, or `G` or `E <t_ns> <text>` with bytes "
    r"outside printable ASCII as \xNN"
)

_BURST = re.compile(rb"(I) (\d{1,19}) ([0-9a-fA-F]{28})")
_TEXT = re.compile(rb"([GE]) (\d{1,19}) ([ -~]*)")
_ESCAPE = re.compile(rb"\\x([0-9a-fA-F]{2})")
_UNPRINTABLE = re.compile(rb"[^ -\[\]-~]")


def format_frame(frame: Frame) -> bytes:
    """Format a frame as one line, with its newline."""
    t_ns, source, data = frame
    if not 0 <= t_ns <= MAX_T_NS:
        raise ValueError(f"t_ns = {t_ns}: must be from 0 to 2^63 - 1")
    if source is Source.IMU:
        if len(data) != BURST_BYTES:
            raise ValueError(f"a burst of {len(data)} bytes: must be {BURST_BYTES}")
        return f"I {t_ns} {data.hex()}\n".encode("ascii")
    if len(data) > MAX_TEXT_BYTES:
        raise ValueError(f"{len(data)} bytes: must be at most {MAX_TEXT_BYTES}")
    text = _UNPRINTABLE.sub(lambda byte: b"\\x%02x" % byte[0][0], data)
    return b"%s %d %s\n" % (source.encode("ascii"), t_ns, text)


def parse_frame(line: bytes) -> Frame:
    """Parse the line of a frame, without newline."""
    match = _BURST.fullmatch(line) or _TEXT.fullmatch(line)
    if match is None or len(line) > MAX_LINE_BYTES or int(match[2]) > MAX_T_NS:
        raise ValueError(EXPECTED)
    kind, time, data = match.groups()
    if kind == b"I":
        data = unhexlify(data)
    elif b"\\" in data:
        data = _ESCAPE.sub(lambda digits: unhexlify(digits[1]), data)
    return Frame(int(time), Source(kind.decode()), data)


def format_header(header: SessionHeader) -> bytes:
    """Format the two lines that start a session."""
    fields: dict[str, object] = {
        "chip": header.chip,
        "accel_range_g": header.accel_range_g,
        "gyro_range_dps": header.gyro_range_dps,
        "imu_rate_hz": header.imu_rate_hz,
        "mount": header.mount,
        "profile": header.profile,
        "name": header.name or None,
        "start_utc": None,
    }
    if header.start_utc_s is not None:
        start = _EPOCH + timedelta(seconds=header.start_utc_s)
        fields["start_utc"] = start.isoformat().replace("+00:00", "Z")
    known = {key: value for key, value in fields.items() if value is not None}
    return b"%s\n# %s\n" % (MAGIC, json.dumps(known).encode("ascii"))


def parse_header(line: bytes) -> SessionHeader:
    """Parse the second line of a header; keys that it does not know are ignored."""
    fields = _parse_json(line)
    accel: Any = fields.get("accel_range_g")
    gyro: Any = fields.get("gyro_range_dps")
    _require(accel in list(COUNTS_PER_G), "accel_range_g", accel, "2, 4, 8 or 16")
    allowed = "250, 500, 1000 or 2000"
    _require(gyro in list(COUNTS_PER_DPS), "gyro_range_dps", gyro, allowed)
    rate: Any = fields.get("imu_rate_hz")
    is_number = isinstance(rate, int | float) and not isinstance(rate, bool)
    allowed = f"a number, 0 < rate <= {_MAX_RATE_HZ:.0f}"
    _require(is_number and 0 < rate <= _MAX_RATE_HZ, "imu_rate_hz", rate, allowed)
    mount = fields.get("mount")
    if mount is not None:
        is_texts = isinstance(mount, list) and all(isinstance(a, str) for a in mount)
        _require(is_texts, "mount", mount, "three signed axes of the chip")
        mount = tuple(mount)
        parse_mount(mount)
    profile = fields.get("profile")
    _require(profile in (None, *_PROFILES), "profile", profile, "free, vehicle, walker")
    chip, name = fields.get("chip", "MPU-6050"), fields.get("name", "")
    _require(isinstance(chip, str), "chip", chip, "text")
    _require(isinstance(name, str), "name", name, "text")
    start_utc_s = _parse_utc(fields.get("start_utc"))
    return SessionHeader(
        int(accel), int(gyro), float(rate), mount, profile, start_utc_s, chip, name
    )


def _require(is_allowed: bool, key: str, value: object, allowed: str) -> None:
    if not is_allowed:
        raise ValueError(
            f"expected another {key} than {reprlib.repr(value)}: must be {allowed}"
        )


def _parse_json(line: bytes) -> dict[str, Any]:
    if not line.startswith(b"# {"):
        raise ValueError("expected # and one JSON object")
    try:
        fields: dict[str, Any] = json.loads(
            line[2:], object_pairs_hook=_unique, parse_constant=_refuse
        )
    except (ValueError, RecursionError) as error:
        raise ValueError(f"expected # and one JSON object ({error})") from error
    return fields


def _unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    fields = dict(pairs)
    if len(fields) < len(pairs):
        raise ValueError("a key comes twice")
    return fields


def _refuse(constant: str) -> None:
    raise ValueError(f"{constant} is not a number of JSON")


def _parse_utc(text: object) -> float | None:
    if text is None:
        return None
    try:
        start = datetime.fromisoformat(str(text))
        if not FIRST_YEAR <= start.year <= LAST_YEAR:
            raise ValueError
    except ValueError as error:
        example = "ISO 8601 from 1980 on, such as 2026-11-22T12:00:00Z"
        raise ValueError(
            f"expected start_utc as {example}, not {reprlib.repr(text)}"
        ) from error
    return start.replace(tzinfo=start.tzinfo or UTC).timestamp()
