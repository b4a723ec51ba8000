"""Laws of the NMEA reader, whatever comes over the wire."""

from itertools import pairwise

from hypothesis import example, given
from hypothesis import strategies as st

from imu_tracker.samples import GpsFix
from imu_tracker.sensors.gnss.epoch_reader import EpochReader, LineSplitter, Positions
from imu_tracker.sensors.gnss.lines import MAX_LINE
from support.nmea_text import gga, gll, rmc, sentence

BYTE_NS = 87_000  # 115200 baud
MESSAGES = [
    rmc(),
    gga(),
    gll(),
    rmc("120001.00"),
    gga("120001.00", quality="0"),
    sentence("GPZDA,120002.00,23,11,2026,00,00"),
    sentence("GPVTG,90.0,T,,M,10.0,N,,K,A"),
    sentence("GPGST,120001.00,,,,,1.0,1.0,1.0"),
]
pieces = st.one_of(
    st.binary(max_size=300),
    st.sampled_from([b"$", b"*", b"\r\n", b"\n", b",", b"$GPGGA,", b"$" * 300]),
    st.sampled_from(MESSAGES),
    st.sampled_from(MESSAGES).map(lambda line: line + b"\r\n"),
)
streams = st.lists(pieces, max_size=20).map(b"".join)
field = st.one_of(
    st.text(st.characters(max_codepoint=127, exclude_characters="*$\r\n"), max_size=12),
    st.sampled_from(["120000.00", "5159.4000", "N", "E", "A", "1", "nan", "-0", ""]),
)


def positions_of(stream: bytes, cuts: list[int]) -> Positions:
    splitter, reader = LineSplitter(), EpochReader()
    edges = sorted({0, len(stream), *(cut % (len(stream) + 1) for cut in cuts)})
    return [
        position
        for start, end in pairwise(edges)
        for line in splitter.split(stream[start:end])
        for position in reader.feed(line.offset * BYTE_NS, line.data)
    ]


@given(streams, st.lists(st.integers(0, 5000), max_size=30))
def test_the_size_of_the_chunks_does_not_matter(stream: bytes, cuts: list[int]) -> None:
    assert positions_of(stream, cuts) == positions_of(stream, [])


@given(streams)
def test_a_stream_in_single_bytes_gives_the_same_lines_and_counts(
    stream: bytes,
) -> None:
    whole, single = LineSplitter(), LineSplitter()
    lines = whole.split(stream)
    assert [line for byte in stream for line in single.split(bytes([byte]))] == lines
    assert +single.counters == +whole.counters
    assert all(stream[at : at + len(data)] == data for at, data in lines)


@given(st.lists(st.binary(max_size=2000), max_size=10))
def test_no_line_is_long_and_no_memory_grows(chunks: list[bytes]) -> None:
    splitter = LineSplitter()
    for chunk in chunks:
        for line in splitter.feed(chunk):
            assert line.startswith(b"$")
            assert len(line) <= MAX_LINE
        assert len(splitter._tail) <= MAX_LINE


@given(
    st.lists(st.tuples(st.integers(0, 10**12), st.binary(max_size=300)), max_size=20)
)
def test_no_line_at_any_time_raises(lines: list[tuple[int, bytes]]) -> None:
    reader = EpochReader()
    for t_ns, line in lines:
        reader.feed(t_ns, line)
        reader.advance(t_ns + 1)


@given(
    st.sampled_from(["RMC", "GGA", "GLL", "GNS", "VTG", "GST", "ZDA"]),
    st.lists(field, max_size=20),
)
@example("GGA", ["120000.00", "5159.4000", "N", "00422.2000", "E", "1" * 200])
@example("ZDA", ["120000.00", "31", "2", "2026"])
@example("ZDA", ["120000.00", "1", "1", "9" * 30])
def test_no_field_raises_and_what_comes_out_is_on_earth(
    kind: str, fields: list[str]
) -> None:
    reader = EpochReader()
    reader.feed(0, sentence(",".join([f"GP{kind}", *fields])))
    for position in reader.advance(10**9):
        if type(position) is GpsFix:
            assert abs(position.lat_rad) <= 1.5708
            assert abs(position.lon_rad) <= 3.1416
            assert (position.lat_rad, position.lon_rad) != (0, 0)
            assert position.sigma_h_m > 0


@given(st.sampled_from([rmc(), gga(), gll()]), st.data())
def test_a_flipped_bit_never_yields_a_fix(line: bytes, data: st.DataObject) -> None:
    at = data.draw(st.integers(0, len(line) - 1))
    bit = data.draw(st.integers(0, 7))
    flipped = bytearray(line)
    flipped[at] ^= 1 << bit
    if flipped.upper() == line:  # the case of a hexadecimal digit
        return
    reader = EpochReader()
    reader.feed(0, bytes(flipped))
    assert reader.advance(10**9) == []


@given(st.sampled_from([rmc(), gga(), gll()]), st.integers(1, 30))
def test_a_sentence_that_is_cut_never_yields_a_fix(line: bytes, lost: int) -> None:
    reader = EpochReader()
    reader.feed(0, line[:-lost])
    assert reader.advance(10**9) == []
