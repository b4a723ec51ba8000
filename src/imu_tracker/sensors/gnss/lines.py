"""Bytes of a receiver to lines, and lines to checked text.

Works on bytes until the checksum has been seen to be right: at a wrong baud rate,
between binary messages or on a long wire anything can come. What a newcomer gets
wrong: a torn sentence is glued to the next one without a line end, so it is the
last ``$`` of a line that begins the sentence.
"""

from collections import Counter
from functools import reduce
from operator import xor
from typing import Final, NamedTuple

from imu_tracker.errors import NmeaError

MAX_LINE: Final = 255
"""Bytes of a sentence. The standard says 82; real receivers send up to 93."""


class Line(NamedTuple):
    """A sentence as it came, without its line end, and where in the stream it began."""

    offset: int
    data: bytes


class LineSplitter:
    """Cut a stream of bytes into sentences, whatever the size of its chunks.

    A line begins at the last ``$`` before a CR or LF. What lies between sentences
    (binary messages, other protocols, torn heads) is dropped.

    Attributes
    ----------
    counters : Counter[str]
        `bytes`; `lines`; `overlong_lines`, which began with ``$`` and did not end
        within 255 bytes; `other_lines`, without any ``$``.
    """

    def __init__(self) -> None:
        self.counters: Counter[str] = Counter()
        self._tail = b""  # since the last line end, at most MAX_LINE bytes of it
        self._is_cut = False  # a `$` was lost from the front of the tail

    def feed(self, chunk: bytes) -> list[bytes]:
        """Return the lines that `chunk` completes."""
        return [line.data for line in self.split(chunk)]

    def split(self, chunk: bytes) -> list[Line]:
        """Return the lines that `chunk` completes, with the offsets of their ``$``."""
        at = self.counters["bytes"]  # of the next piece's end
        self.counters["bytes"] += len(chunk)
        *ended, rest = chunk.replace(b"\r", b"\n").split(b"\n")
        lines = []
        for piece in ended:
            at += len(piece)
            self._extend(piece)
            if (start := self._tail.rfind(b"$")) >= 0:
                lines.append(Line(at - len(self._tail) + start, self._tail[start:]))
            elif self._is_cut:
                self.counters["overlong_lines"] += 1
            elif self._tail:
                self.counters["other_lines"] += 1
            self._tail, self._is_cut = b"", False
            at += 1
        self._extend(rest)
        self.counters["lines"] += len(lines)
        return lines

    def _extend(self, piece: bytes) -> None:
        whole = self._tail + piece
        self._tail = whole[-MAX_LINE:]
        self._is_cut = self._is_cut or b"$" in whole[:-MAX_LINE]


def checked_text(line: bytes) -> str:
    """Return what stands between ``$`` and ``*`` of a sentence that is intact.

    Raises
    ------
    NmeaError
        No checksum, a wrong one, too long, or not ASCII.
    """
    start = line.rfind(b"$") + 1
    body, star, digits = line[start:].rstrip().partition(b"*")
    if not start or not star:
        raise NmeaError("missing_checksums", line)
    if len(line) - start >= MAX_LINE:
        raise NmeaError("overlong_lines", line)
    expected = reduce(xor, body, 0)
    # Some relays drop the leading zero of a sum below 16 (gpsdRelay, request 13).
    if digits.upper() not in (b"%02X" % expected, b"%X" % expected):
        raise NmeaError("bad_checksums", line)
    if not body.isascii():
        raise NmeaError("unparsable_lines", line)
    return body.decode("ascii")
