import gzip
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
from hypothesis import given
from hypothesis import strategies as st

from imu_tracker.errors import RecordingError
from imu_tracker.recording.files import (
    LONGEST_SILENCE_NS,
    RecordingWriter,
    read_recording,
)
from imu_tracker.recording.format import MAGIC, MAX_TEXT_BYTES
from imu_tracker.samples import Frame, SessionHeader, Source
from support.recorded import tee

times = st.integers(0, LONGEST_SILENCE_NS)
bursts = st.builds(
    Frame, times, st.just(Source.IMU), st.binary(min_size=14, max_size=14)
)
texts = st.builds(
    Frame,
    times,
    st.sampled_from([Source.GPS, Source.EVENT]),
    st.binary(max_size=200) | st.just(b"\xff" * MAX_TEXT_BYTES),
)
headers = st.builds(
    SessionHeader,
    accel_range_g=st.sampled_from([2, 4, 8, 16]),
    gyro_range_dps=st.sampled_from([250, 500, 1000, 2000]),
    imu_rate_hz=st.floats(0.1, 1000),
    mount=st.sampled_from([None, ("+x", "-y", "-z"), ("+y", "+x", "-z")]),
    profile=st.sampled_from([None, "free", "vehicle", "walker"]),
    start_utc_s=st.none() | st.integers(315_964_800, 2**31).map(float),
    chip=st.text(max_size=20),
    name=st.text(max_size=20),
)


def since(zero_ns: int, item: SessionHeader | Frame) -> SessionHeader | Frame:
    if isinstance(item, SessionHeader):
        return item
    return item._replace(t_ns=zero_ns + item.t_ns)


streams = st.builds(
    lambda header, rest, zero_ns: [header, *(since(zero_ns, item) for item in rest)],
    headers,
    st.lists(bursts | texts | headers, max_size=20),
    st.integers(0, 2**63 - 1 - LONGEST_SILENCE_NS),
)


def recording(items: list[SessionHeader | Frame], name: str = "raw.rec") -> bytes:
    with TemporaryDirectory() as folder:
        path = Path(folder) / name
        with RecordingWriter(path) as writer:
            list(tee(items, writer))
        return path.read_bytes()


def read(data: bytes) -> list[SessionHeader | Frame]:
    with TemporaryDirectory() as folder:
        path = Path(folder) / "raw.rec"
        path.write_bytes(data)
        return list(read_recording(path))


def read_or_refuse(data: bytes) -> tuple[list[SessionHeader | Frame], str]:
    try:
        return read(data), ""
    except RecordingError as error:
        return [], str(error)


@given(streams, st.sampled_from(["raw.rec", "raw.rec.gz"]))
def test_every_byte_comes_back(items: list[SessionHeader | Frame], name: str) -> None:
    assert read(recording(items, name)) == items


@given(streams, st.data())
def test_cut_anywhere_it_is_a_prefix(
    items: list[SessionHeader | Frame], data: st.DataObject
) -> None:
    whole = recording(items)
    cut = data.draw(st.integers(whole.index(b"}\n") + 2, len(whole)))
    found = read(whole[:cut])

    assert found == items[: len(found)]
    # Each line is an item, but for the magic above a header.
    assert len(found) == whole[:cut].count(b"\n") - whole[:cut].count(MAGIC + b"\n")


@given(streams, st.data())
def test_a_gzip_file_cut_anywhere_is_a_prefix(
    items: list[SessionHeader | Frame], data: st.DataObject
) -> None:
    packed = gzip.compress(recording(items))
    cut = data.draw(st.integers(1, len(packed)))
    found, refusal = read_or_refuse(packed[:cut])

    assert found == items[: len(found)]
    assert found or "the file ends before its header" in refusal


@given(streams, st.data())
def test_damage_is_read_or_refused_but_never_a_crash(
    items: list[SessionHeader | Frame], data: st.DataObject
) -> None:
    damaged = bytearray(recording(items, data.draw(st.sampled_from(["a", "a.gz"]))))
    for _ in range(data.draw(st.integers(1, 5))):
        damaged[data.draw(st.integers(0, len(damaged) - 1))] = data.draw(
            st.integers(0, 255)
        )
    found, refusal = read_or_refuse(bytes(damaged))

    assert all(isinstance(item, SessionHeader | Frame) for item in found)
    assert found or "raw.rec:" in refusal


@given(st.binary(max_size=2000))
def test_garbage_is_refused(data: bytes) -> None:
    with pytest.raises(RecordingError, match=r"raw\.rec:1: "):
        read(data)
