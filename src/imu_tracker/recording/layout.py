"""What a live recording must know of its content: where it may be cut, and its date."""

import logging
import re
from datetime import UTC, datetime, timedelta
from functools import partial
from pathlib import Path

from imu_tracker.errors import RecordingError, TrackerError
from imu_tracker.recording.format import MAGIC, parse_frame, parse_header
from imu_tracker.sensors.gnss.calendar import (
    ROLLOVER_WEEKS,
    release_utc_s,
    rollovers_before,
)
from imu_tracker.storage.append_file import Layout
from imu_tracker.storage.torn_lines import (
    end_of_lines,
    end_of_members,
    is_our_format,
    read_lines,
)

_DATED = re.compile(
    rb'^# .*"start_utc": *"(?P<header>[^"]+)"'
    rb"|^G \d+ \$..RMC,(?P<time>\d{6})[^,\n]*,A,(?:[^,\n]*,){6}(?P<date>\d{6}),",
    re.MULTILINE,
)


log = logging.getLogger(__name__)


def _is_whole(line: bytes) -> bool:
    """Whether a line may be the last of a file: the magic may not, without its JSON."""
    try:
        if line.startswith(b"# {"):
            parse_header(line)
        else:
            parse_frame(line)
    except ValueError:
        return False
    return True


def _first_utc(path: Path) -> str | None:
    """Name a file by its first date; one that rolled over would sort as the oldest."""
    try:
        for lines in read_lines(path, RecordingError):
            if match := _DATED.search(b"\n".join(lines)):
                header, time, date = (text and text.decode() for text in match.groups())
                if header:
                    start = datetime.fromisoformat(header).astimezone(UTC)
                else:
                    start = datetime.strptime(f"{date}{time}Z", "%d%m%y%H%M%S%z")
                    lost = rollovers_before(start.timestamp(), release_utc_s())
                    start += timedelta(weeks=ROLLOVER_WEEKS * lost)
                return f"{start:%Y%m%dT%H%M%SZ}"
    except (TrackerError, ValueError, OverflowError) as error:
        log.debug("%s: tells no time: %s", path, error)
    return None


_is_our_format = partial(
    is_our_format, first_words=MAGIC.rstrip(b"1"), is_whole=_is_whole
)
_PLAIN = Layout(
    partial(end_of_lines, first_line=MAGIC, is_whole=_is_whole),
    _is_our_format,
    _first_utc,
)
_PACKED = Layout(partial(end_of_members, first_line=MAGIC), _is_our_format, _first_utc)


def layout_of(path: Path) -> Layout:
    """Return what a live recording under this name must know of its content."""
    return _PACKED if path.name.endswith(".gz") else _PLAIN
