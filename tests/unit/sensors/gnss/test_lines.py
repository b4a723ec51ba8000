"""Bytes to lines, and lines to text that may be believed."""

import pytest

from imu_tracker.errors import NmeaError
from imu_tracker.sensors.gnss.lines import MAX_LINE, LineSplitter, checked_text
from support.nmea_text import sentence

ONE, TWO = sentence("GPRMC,1"), sentence("GPGGA,22")


def test_lines_end_with_cr_or_lf_or_both() -> None:
    assert LineSplitter().feed(ONE + b"\r\n" + TWO + b"\n" + ONE + b"\r") == [
        ONE,
        TWO,
        ONE,
    ]


def test_a_line_without_its_end_waits_for_it() -> None:
    splitter = LineSplitter()
    assert splitter.feed(ONE[:4]) == []
    assert splitter.feed(ONE[4:]) == []
    assert splitter.feed(b"\n") == [ONE]


def test_a_torn_sentence_gives_way_to_the_one_that_it_runs_into() -> None:
    assert LineSplitter().feed(ONE[:-4] + TWO + b"\r\n") == [TWO]


def test_binary_before_a_sentence_is_dropped_even_with_a_dollar_in_it() -> None:
    binary = b"\xb5b\x01\x07$\x00" + bytes(range(128, 256)) * 3
    assert LineSplitter().feed(binary + TWO + b"\r\n") == [TWO]


def test_a_line_of_the_longest_length_passes_and_one_byte_more_is_counted() -> None:
    splitter = LineSplitter()
    longest = b"$" + b"x" * (MAX_LINE - 1)
    assert splitter.feed(longest + b"\n" + longest + b"x\n" + ONE + b"\n") == [
        longest,
        ONE,
    ]
    assert splitter.counters["overlong_lines"] == 1


def test_other_lines_are_counted_and_empty_ones_are_not() -> None:
    splitter = LineSplitter()
    assert splitter.feed(b"\r\n\r\n!AIVDM,1*00\r\n# comment\r\n") == []
    assert splitter.counters == {"bytes": 28, "other_lines": 2, "lines": 0}


def test_offsets_point_at_the_dollar_however_the_stream_is_cut() -> None:
    stream = b"junk" + ONE + b"\r\n\x00" + ONE[:3] + TWO + b"\n"
    splitter = LineSplitter()
    lines = [
        line for i in range(len(stream)) for line in splitter.split(stream[i : i + 1])
    ]
    assert lines == LineSplitter().split(stream)
    assert [stream[at : at + len(data)] for at, data in lines] == [ONE, TWO]


def test_a_sum_below_16_may_come_without_its_zero() -> None:
    assert checked_text(b"$GPGGA,u*F") == checked_text(b"$GPGGA,u*0F")


def test_checked_text_is_what_the_checksum_covers() -> None:
    assert checked_text(TWO) == "GPGGA,22"


@pytest.mark.parametrize(
    "line",
    [TWO[:-2] + TWO[-2:].lower(), b"\xff$GPR" + TWO, TWO + b" \r\n"],
    ids=["small digits", "torn head", "line end"],
)
def test_an_intact_sentence_is_found_in_its_line(line: bytes) -> None:
    assert checked_text(line) == "GPGGA,22"


@pytest.mark.parametrize(
    ("line", "trouble"),
    [
        (b"", "missing_checksums"),
        (b"GPGGA,22*4F", "missing_checksums"),
        (b"$GPGGA,22", "missing_checksums"),
        (TWO[:-1], "bad_checksums"),
        (TWO + b"0", "bad_checksums"),
        (TWO[:-2] + b"+3", "bad_checksums"),
        (TWO.replace(b"22", b"23"), "bad_checksums"),
        (sentence("GPTXT,\xe9"), "unparsable_lines"),
        (sentence("GPTXT," + "x" * MAX_LINE), "overlong_lines"),
    ],
)
def test_a_damaged_line_is_refused_by_kind(line: bytes, trouble: str) -> None:
    with pytest.raises(NmeaError) as caught:
        checked_text(line)
    assert caught.value.trouble == trouble
