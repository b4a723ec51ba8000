"""Text files of lines, plain or gzip, that may have lost their tail.

A power cut takes the end of a file: half a line, half a gzip member, or a run of
zero bytes where the file system had promised space. Readers drop that tail and say
so; writers cut it off before they append. What is damaged anywhere else is an error.
"""

import codecs
import contextlib
import io
import logging
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import BinaryIO

from imu_tracker.errors import InputMissingError, TrackerError

MAX_LINE_BYTES = 16_384
"""Nothing that we write comes near it; a file without newlines goes no further."""

MAX_ZERO_BYTES = 64_000_000
"""A file system promises less than that ahead of what it has written."""

GZIP_MAGIC = b"\x1f\x8b"

_BLOCK_BYTES = 1 << 18
_TAIL_BYTES = 4 * MAX_LINE_BYTES
_GZIP_ONLY = 16 + zlib.MAX_WBITS  # wbits: expect a gzip header and trailer

log = logging.getLogger(__name__)


def read_lines(path: Path, fault: type[TrackerError]) -> Iterator[list[bytes]]:
    """Read the whole lines of a file in batches, without their newlines.

    A byte order mark and CRs before newlines, from editors of Windows, are left out.

    Parameters
    ----------
    path : Path
        Plain text or gzip, of any number of members; the content decides.
    fault : type of TrackerError
        What to raise, with `path:line`, when the file cannot be what it should be.

    Raises
    ------
    InputMissingError
        When there is no such file, or it may not be read.

    Notes
    -----
    Memory is bounded whatever the file holds. A tail that was cut is logged, once.
    """
    try:
        with path.open("rb") as file:
            yield from _batches(path, file, fault)
    except (FileNotFoundError, PermissionError) as error:
        raise InputMissingError(f"{path}: {error.strerror}") from error
    except OSError as error:
        raise fault(f"{path}: cannot be read: {error.strerror}") from error


def _batches(
    path: Path, file: io.BufferedReader, fault: type[TrackerError]
) -> Iterator[list[bytes]]:
    is_gzip = file.peek(len(GZIP_MAGIC)).startswith(GZIP_MAGIC)
    number, zeros, rest, is_torn = 0, 0, b"", False
    try:
        for block in _unpacked(file) if is_gzip else _blocks(file):
            text = rest + block
            lines = text.split(b"\n")
            rest = lines.pop()
            if lines and not number:
                lines[0] = lines[0].removeprefix(codecs.BOM_UTF8)
            if b"\r" in text:
                lines = [line.removesuffix(b"\r") for line in lines]
            number += len(lines)
            if len(rest) > MAX_LINE_BYTES:
                whole = len(rest)
                rest = rest.rstrip(b"\0") + b"\0"  # zeros to the end are a lost tail
                zeros += whole - len(rest)
            if zeros > MAX_ZERO_BYTES:
                raise fault(
                    f"{path}:{number + 1}: nothing but zeros from here on: expected a "
                    "text file of lines"
                )
            if len(rest) > MAX_LINE_BYTES:
                raise fault(
                    f"{path}:{number + 1}: longer than {MAX_LINE_BYTES} bytes: "
                    "expected a text file of lines"
                )
            if lines:
                yield lines
    except EOFError:
        is_torn = True
    except zlib.error as error:
        where = f"{path}:{number + 1}"
        raise fault(f"{where}: the gzip data are damaged here ({error})") from error
    if rest or is_torn:
        log.warning("%s: the end is cut (power loss?); left out what is torn", path)


def _blocks(file: BinaryIO) -> Iterator[bytes]:
    return iter(lambda: file.read(_BLOCK_BYTES), b"")


def _unpacked(file: BinaryIO) -> Iterator[bytes]:
    """Decompress member after member; EOFError, after all data, when one is cut.

    The gzip module would do, but for a member of which a single byte is left.
    """
    member = zlib.decompressobj(_GZIP_ONLY)
    for packed in _blocks(file):
        while packed:
            if member.eof:
                packed = packed.lstrip(b"\0")  # padding, as gzip(1) takes it
                if not packed:
                    break
                member = zlib.decompressobj(_GZIP_ONLY)
            while block := member.decompress(packed, _BLOCK_BYTES):
                yield block
                packed = member.unconsumed_tail
            packed = member.unused_data
    if not member.eof:
        raise EOFError


def end_of_lines(
    file: BinaryIO, first_line: bytes, is_whole: Callable[[bytes], bool]
) -> int | None:
    """Find where the last whole line ends.

    Parameters
    ----------
    file : BinaryIO
        Seekable.
    first_line : bytes
        What the file must begin with, without newline.
    is_whole : Callable[[bytes], bool]
        Whether a line, without newline, is one that the writer completed.

    Returns
    -------
    int or None
        Size to cut the file to; None when it is not ours to cut: it begins with
        another line, or with a tail of 64 kB that holds no whole line.
    """
    start = file.read(len(first_line) + 1)
    begin = max(0, file.seek(0, io.SEEK_END) - _TAIL_BYTES)
    file.seek(begin)
    tail = file.read()
    if begin == 0 and first_line.startswith(tail.rstrip(b"\0")):
        return 0
    if start != first_line + b"\n":
        return None
    end = tail.rfind(b"\n") + 1
    while end:
        previous = tail.rfind(b"\n", 0, end - 1) + 1
        if is_whole(tail[previous : end - 1]):
            return begin + end
        end = previous
    return None if begin else 0


def end_of_members(file: BinaryIO, first_line: bytes) -> int | None:
    """Find where the last whole gzip member ends; see `end_of_lines`.

    None also when no member is whole: it may be a long one of somebody else.
    """
    end = position = 0
    start = b""
    member = zlib.decompressobj(_GZIP_ONLY)
    try:
        for packed in _blocks(file):
            while packed:
                block = member.decompress(packed)
                start += block[: max(0, len(first_line) + 1 - len(start))]
                position += len(packed) - len(member.unused_data)
                packed = member.unused_data
                if member.eof:
                    end, member = position, zlib.decompressobj(_GZIP_ONLY)
    except zlib.error:
        pass  # what follows the last whole member is no member
    is_empty = file.seek(0, io.SEEK_END) == 0
    is_ours = end > 0 and start == first_line + b"\n"
    return end if is_ours or is_empty else None


def is_our_format(
    file: BinaryIO, first_words: bytes, is_whole: Callable[[bytes], bool]
) -> bool:
    """Tell whether a file is of the same kind, of whatever version.

    Parameters
    ----------
    file : BinaryIO
        Seekable, plain or gzip.
    first_words : bytes
        What the first line of every version begins with.
    is_whole : Callable[[bytes], bool]
        Tells a line of the kind; one is enough where a power cut took the first.
    """
    file.seek(0)
    head = file.read(_TAIL_BYTES).removeprefix(codecs.BOM_UTF8).replace(b"\r", b"")
    if head[:1] == GZIP_MAGIC[:1]:
        head = _unpacked_start(head)
    if first_words.startswith(head.rstrip(b"\0")):  # cut before it could tell
        return True
    return head.startswith(first_words) or any(map(is_whole, head.split(b"\n")))


def _unpacked_start(packed: bytes) -> bytes:
    """Decompress as far as the data are sound; zeros at the end are a lost tail."""
    packed = packed.rstrip(b"\0")
    member = zlib.decompressobj(_GZIP_ONLY)
    start = b""
    with contextlib.suppress(zlib.error):
        for begin in range(0, len(packed), 64):
            start += member.decompress(packed[begin : begin + 64])
    return start
