import gzip
import io
import json
from collections.abc import Iterator
from pathlib import Path
from typing import TypeAlias

import pytest

from imu_tracker.errors import InputMissingError, OutputError, RecordingError
from imu_tracker.recording.files import (
    LiveRecordingWriter,
    RecordingWriter,
    read_recording,
)
from imu_tracker.recording.layout import layout_of
from imu_tracker.samples import Frame, SessionHeader, Source
from imu_tracker.storage.append_file import Limits
from support.nmea_text import sentence
from support.recorded import tee
from support.small_disk import SmallDisk

SECOND_NS = 1_000_000_000

Item: TypeAlias = SessionHeader | Frame

HEADER = SessionHeader(4, 500, 100.0)
FULL_HEADER = SessionHeader(
    accel_range_g=4,
    gyro_range_dps=500,
    imu_rate_hz=104.2,
    mount=("+y", "+x", "-z"),
    profile="vehicle",
    start_utc_s=1_795_348_800.0,
    chip="MPU-6500",
    name="Zürich",
)
BURST = Frame(10**9, Source.IMU, bytes.fromhex("fff40012200001c40003fffe0001"))
RMC = b"$GNRMC,120001.00,A,5159.4000000,N,00422.2000000,E,0.012,,221126,,,A*61"
GPS_LINE = Frame(1_180_000_000, Source.GPS, RMC)
EVENT = Frame(1_190_000_000, Source.EVENT, b"bus-error read failed at 0x68")

MANUAL = """\
# imu-tracker recording 1
# {"chip": "MPU-6050", "accel_range_g": 4, "gyro_range_dps": 500, \
"imu_rate_hz": 100, "mount": ["+x", "-y", "-z"], "profile": "vehicle", \
"start_utc": "2026-11-22T12:00:00Z"}
I 1000000000 fff40012200001c40003fffe0001
G 1180000000 $GNRMC,120001.00,A,5159.4000000,N,00422.2000000,E,0.012,,221126,,,A*61
E 1190000000 bus-error read failed at 0x68
"""
MINIMAL = '{"accel_range_g": 4, "gyro_range_dps": 500, "imu_rate_hz": 100}'
START = f"# imu-tracker recording 1\n# {MINIMAL}\n"


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "raw.rec"


def dated(day: str) -> bytes:
    return sentence(f"GNRMC,120001.00,A,5159.4,N,00422.2,E,0.0,,{day},,,A")


def read(path: Path, content: str | bytes) -> list[Item]:
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return list(read_recording(path))


def written(path: Path, *items: Item) -> Path:
    with RecordingWriter(path) as writer:
        list(tee(items, writer))
    return path


def burst(number: int) -> Frame:
    return BURST._replace(t_ns=number * SECOND_NS // 100)


# -- reading


def test_the_recording_of_the_manual_is_read(path: Path) -> None:
    header = SessionHeader(
        4, 500, 100.0, ("+x", "-y", "-z"), "vehicle", 1_795_348_800.0
    )

    assert read(path, MANUAL) == [header, BURST, GPS_LINE, EVENT]


def test_only_ranges_and_rate_are_required(path: Path) -> None:
    assert read(path, START) == [HEADER]


def test_keys_and_events_that_are_not_known_are_no_error(path: Path) -> None:
    header = f'# imu-tracker recording 1\n# {{"colour": [1], {MINIMAL[1:]}\n'

    assert read(path, header + "E 5 solar-flare X9\n") == [
        HEADER,
        Frame(5, Source.EVENT, b"solar-flare X9"),
    ]


def test_a_header_further_down_starts_a_session(path: Path) -> None:
    second = START.replace("500", "250")

    assert read(path, START + "I 9 " + "00" * 14 + "\n" + second + "G 1 $\n") == [
        HEADER,
        Frame(9, Source.IMU, bytes(14)),
        HEADER._replace(gyro_range_dps=250),
        Frame(1, Source.GPS, b"$"),
    ]


def test_a_start_without_a_zone_is_utc_and_other_zones_are_converted(
    path: Path,
) -> None:
    for text in ("2026-11-22T12:00:00", "2026-11-22T14:00:00+02:00"):
        header = f'# imu-tracker recording 1\n# {{"start_utc": "{text}", {MINIMAL[1:]}'
        [item] = read(path, header + "\n")
        assert isinstance(item, SessionHeader)
        assert item.start_utc_s == 1_795_348_800.0


def test_the_content_decides_whether_it_is_compressed(path: Path) -> None:
    parts = MANUAL.encode()[:200], MANUAL.encode()[200:]
    packed = b"".join(gzip.compress(part) for part in parts)

    assert read(path, packed) == read(path, MANUAL)
    assert read(path, packed + b"\0" * 512) == read(path, MANUAL)


def test_a_backslash_may_stand_for_itself(path: Path) -> None:
    items = read(path, START + r"G 1 a\b\x5cc\xff\x0g" + "\n")

    assert items[1].data == b"a\\b\\c\xff\\x0g"  # type: ignore[union-attr]


@pytest.mark.parametrize(
    "torn", ["I 1000000001 fff4", "G", "I 5 " + "00" * 14, "\0" * 100_000]
)
def test_a_torn_tail_is_left_out_with_one_warning(
    path: Path, torn: str, caplog: pytest.LogCaptureFixture
) -> None:
    whole = read(path, MANUAL)

    assert read(path, MANUAL + torn) == whole
    assert [record.levelname for record in caplog.records] == ["WARNING"]
    assert "raw.rec: the end is cut" in caplog.text


def test_a_session_whose_header_is_cut_is_left_out_with_a_warning(
    path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    assert read(path, START + "# imu-tracker recording 1\n") == [HEADER]
    assert "the last session has lost its header" in caplog.text


@pytest.mark.parametrize(
    "line",
    [
        "",
        "I",
        "I 5",
        "I 5 ",
        "I  5 " + "00" * 14,
        "I 5 " + "00" * 13,
        "I 5 " + "00" * 15,
        "I 5 " + "0g" * 14,
        "I 5 " + "00" * 13 + " 0",
        "I 5 " + "00" * 14 + " ",
        "I -5 " + "00" * 14,
        "I +5 " + "00" * 14,
        "I 5_0 " + "00" * 14,
        "I ٣ " + "00" * 14,
        "I 1e9 " + "00" * 14,
        f"I {2**63} " + "00" * 14,
        f"I {'9' * 5000} " + "00" * 14,
        "G 5",
        "G -5 $GPGGA",
        f"G {2**63} $GPGGA",
        "G 5 caf\xe9",
        "G 5 tab\there",
        "G 5 nul\0",
        "G 5 " + "x" * 20_000,
        "X 5 what",
        "i 5 " + "00" * 14,
        "# a remark",
        f"# {MINIMAL}",
        "# imu-tracker recording 2",
        "\0\0\0\0",
    ],
)
def test_any_other_malformed_line_is_an_error_that_says_where(
    path: Path, line: str
) -> None:
    valid = "I 4 " + "00" * 14 + "\n"

    with pytest.raises(
        RecordingError, match=r"raw\.rec:4: expected `I <t_ns>.*, not b'"
    ) as error:
        read(path, f"{START}{valid}{line}\n{valid}")

    assert error.value.exit_code == 65


@pytest.mark.parametrize(
    "content",
    [
        b"time,lat,lon\n1,2,3\n",
        b"\n",
        b"\x89PNG\r\n\x1a\n\0\0",
        b"I 5 " + b"00" * 14 + b"\n",
        b"# imu-tracker recording 2\n{}\n",
    ],
)
def test_a_file_that_does_not_begin_with_the_magic_is_no_recording(
    path: Path, content: bytes
) -> None:
    with pytest.raises(
        RecordingError, match=r"raw\.rec:1: expected '# imu-tracker recording 1'"
    ):
        read(path, content)


def test_a_recording_that_windows_saved_is_read(path: Path) -> None:
    lines = START + "G 5 $GPGGA,x*00\n"
    saved = "\ufeff" + lines.replace("\n", "\r\n")
    assert read(path, saved.encode()) == read(path, lines)


@pytest.mark.parametrize("kept", [0, 1, 25, 26, 40, len(START) - 1])
def test_a_file_that_ends_within_its_header_is_no_recording(
    path: Path, kept: int
) -> None:
    with pytest.raises(
        RecordingError, match=r"raw\.rec:[12]: the file ends before its header"
    ):
        read(path, START[:kept])


@pytest.mark.parametrize(
    ("header", "complaint"),
    [
        ("[]", "one JSON object"),
        ("{", "one JSON object"),
        ('{"a":' * 9000, "one JSON object"),
        ("{}", "another accel_range_g than None: must be 2, 4, 8 or 16"),
        ({"accel_range_g": 3}, "another accel_range_g than 3: must be 2, 4, 8 or 16"),
        ({"accel_range_g": "4"}, "another accel_range_g than '4'"),
        ({"accel_range_g": [4]}, "another accel_range_g"),
        ({"gyro_range_dps": 501}, "another gyro_range_dps than 501: must be 250"),
        ({"imu_rate_hz": 0}, "another imu_rate_hz than 0: must be a number, 0 < rate"),
        ({"imu_rate_hz": True}, "another imu_rate_hz than True"),
        ({"imu_rate_hz": float("nan")}, "NaN is not a number of JSON"),
        ({"imu_rate_hz": float("inf")}, "Infinity is not a number of JSON"),
        (MINIMAL.replace("100", "1e999"), "another imu_rate_hz than inf"),
        (MINIMAL.replace("100", "9" * 5000), "one JSON object"),
        (f'{{"imu_rate_hz": 5, {MINIMAL[1:]}', "a key comes twice"),
        (f"{MINIMAL} {{}}", "one JSON object"),
        ({"mount": "+x-y-z"}, "another mount than"),
        ({"mount": ["+x", "-y", 3]}, "another mount than"),
        ({"mount": ["+x", "-y"]}, "must name each chip axis once"),
        ({"mount": ["+x", "-x", "+z"]}, "must name each chip axis once"),
        ({"mount": ["x", "y", "z"]}, "must be one of"),
        ({"mount": ["+x", "+y", "-z"]}, "is a mirror image"),
        ({"profile": "boat"}, "another profile than 'boat': must be free, vehicle"),
        ({"profile": []}, "another profile than"),
        ({"start_utc": "yesterday"}, "start_utc as ISO 8601 from 1980 on, such as"),
        ({"start_utc": 5}, "start_utc as ISO 8601"),
        ({"chip": 6050}, "another chip than 6050: must be text"),
        ({"name": None}, "another name than None: must be text"),
    ],
)
def test_a_bad_header_is_an_error_that_says_what_is_allowed(
    path: Path, header: str | dict[str, object], complaint: str
) -> None:
    if isinstance(header, dict):
        header = json.dumps(json.loads(MINIMAL) | header)

    with pytest.raises(RecordingError, match=r"raw\.rec:2: ") as error:
        read(path, f"# imu-tracker recording 1\n# {header}\n")

    assert complaint in str(error.value)


def test_a_header_in_another_encoding_is_an_error(path: Path) -> None:
    with pytest.raises(RecordingError, match=r"raw\.rec:2: expected # and one JSON"):
        read(path, START.replace("}", ', "name": "Z\xfcrich"}').encode("latin-1"))


@pytest.mark.parametrize("letter", ["I", "G"])
def test_time_that_leaps_by_years_is_an_error_and_not_years_of_rows(
    path: Path, letter: str
) -> None:
    burst = "fff40012200001c40003fffe0001"
    leap = f"{letter} {10**18} {burst}\n"
    with pytest.raises(RecordingError, match=r"raw\.rec:4: time goes on by more than"):
        read(path, f"{START}I 1000000000 {burst}\n{leap}")


def test_a_clock_may_begin_anywhere_and_anew_with_a_session(path: Path) -> None:
    burst = "fff40012200001c40003fffe0001"
    sessions = f"{START}I 1000000000 {burst}\n{START}I {10**18} {burst}\n"
    assert len(read(path, sessions)) == 4


def test_a_file_without_newlines_is_given_up_early(path: Path) -> None:
    for content in (b"x" * 10**6, gzip.compress(b"x" * 10**8)):
        with pytest.raises(RecordingError, match=r":1: longer than 16384 bytes"):
            read(path, content)


def test_damage_within_a_gzip_file_is_an_error(path: Path) -> None:
    packed = bytearray(gzip.compress(MANUAL.encode()))
    packed[len(packed) // 2] ^= 0xFF

    with pytest.raises(RecordingError, match="the gzip data are damaged here"):
        read(path, bytes(packed))
    with pytest.raises(RecordingError, match="the gzip data are damaged here"):
        read(path, gzip.compress(MANUAL.encode()) + b"and more")


def test_a_recording_that_cannot_be_read_is_named(
    path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(InputMissingError, match=r"raw\.rec: No such file") as error:
        list(read_recording(path))
    assert error.value.exit_code == 66
    with pytest.raises(RecordingError, match="cannot be read: Is a directory"):
        list(read_recording(path.parent))

    def refuse(*_: object) -> None:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(Path, "open", refuse)  # tests may run as root
    with pytest.raises(InputMissingError, match=r"raw\.rec: Permission denied"):
        list(read_recording(path))


# -- writing


@pytest.mark.parametrize("name", ["raw.rec", "raw.rec.gz"])
def test_what_is_written_is_read_again(tmp_path: Path, name: str) -> None:
    items: list[Item] = [FULL_HEADER, BURST, GPS_LINE, EVENT, HEADER, BURST]
    path = written(tmp_path / name, *items)

    assert list(read_recording(path)) == items
    assert path.read_bytes().startswith(b"\x1f\x8b") == name.endswith(".gz")


def test_the_file_is_written_as_in_the_manual(path: Path) -> None:
    header = SessionHeader(4, 500, 100, ("+x", "-y", "-z"), "vehicle", 1_795_348_800.0)

    assert written(path, header, BURST, GPS_LINE, EVENT).read_text() == MANUAL


def test_bytes_outside_ascii_are_escaped(path: Path) -> None:
    line = Frame(7, Source.GPS, b"caf\xe9 \\ \x00\n")

    text = written(path, HEADER, line).read_text()

    assert text.splitlines()[-1] == r"G 7 caf\xe9 \x5c \x00\x0a"


def test_the_same_frames_give_the_same_bytes(tmp_path: Path) -> None:
    one, other = tmp_path / "one.rec.gz", tmp_path / "other.rec.gz"

    assert written(one, HEADER, BURST).read_bytes() == (
        written(other, HEADER, BURST).read_bytes()
    )


def test_a_frame_that_cannot_be_read_again_is_a_bug_of_the_caller(path: Path) -> None:
    bad = [
        BURST._replace(data=bytes(13)),
        BURST._replace(t_ns=-1),
        BURST._replace(t_ns=2**63),
        GPS_LINE._replace(data=b"x" * 5000),
    ]
    with RecordingWriter(path) as writer:
        for frame in bad:
            with pytest.raises(ValueError, match="must be"):
                writer.write(frame)


def test_a_recording_that_cannot_be_written_is_named(path: Path) -> None:
    with pytest.raises(OutputError, match=r"cannot be written: No such file") as error:
        RecordingWriter(path.parent / "missing" / "raw.rec")
    assert error.value.exit_code == 73

    writer = RecordingWriter(Path("/dev/full"))
    writer.write_header(HEADER)
    with pytest.raises(OutputError, match=r"/dev/full: cannot be written: No space"):
        writer.close()


# -- writing live


@pytest.fixture(params=["raw.rec", "raw.rec.gz"])
def live_path(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    return tmp_path / str(request.param)


def live(path: Path, *items: Item, mb: float = 16) -> Iterator[None]:
    """Write items live, a sync every 100 frames; end, or be killed, when told."""
    writer = LiveRecordingWriter(path, Limits(sync_s=1.0, max_mb=mb, min_free_mb=0))
    for number, _ in enumerate(tee(items, writer)):
        writer.tick(number * SECOND_NS // 100)
    yield
    writer.close()


def recorded(path: Path, *items: Item, mb: float = 16) -> None:
    for _ in live(path, *items, mb=mb):
        pass


def test_a_restart_begins_a_session_in_the_same_file(live_path: Path) -> None:
    recorded(live_path, HEADER, burst(1), GPS_LINE)
    recorded(live_path, FULL_HEADER, burst(2))

    assert list(read_recording(live_path)) == [
        HEADER,
        burst(1),
        GPS_LINE,
        FULL_HEADER,
        burst(2),
    ]


def test_frames_are_on_the_disk_after_a_sync(live_path: Path) -> None:
    items: list[Item] = [HEADER, *map(burst, range(250))]
    for _ in live(live_path, *items):
        assert list(read_recording(live_path)) == items[:201]


@pytest.mark.parametrize("lost", [1, 20, 200])
def test_a_torn_tail_is_cut_off_before_the_next_session(
    live_path: Path, lost: int, caplog: pytest.LogCaptureFixture
) -> None:
    items: list[Item] = [HEADER, *map(burst, range(250))]
    recorded(live_path, *items)
    live_path.write_bytes(live_path.read_bytes()[:-lost])

    recorded(live_path, FULL_HEADER, burst(1))

    caplog.clear()
    found = list(read_recording(live_path))
    first = found[: found.index(FULL_HEADER)]
    assert len(first) > 100
    assert first == items[: len(first)]
    assert found[len(first) :] == [FULL_HEADER, burst(1)]
    assert caplog.text == ""


@pytest.mark.parametrize("kept", [1, 25, 26, 30])
def test_a_header_that_was_torn_is_cut_off_too(path: Path, kept: int) -> None:
    path.write_text(START + START[:kept])

    recorded(path, FULL_HEADER, burst(1))

    assert list(read_recording(path)) == [HEADER, FULL_HEADER, burst(1)]


def test_a_file_that_is_no_recording_is_refused_and_left_alone(
    live_path: Path,
) -> None:
    live_path.write_text("my shopping list")

    with pytest.raises(OutputError, match="did not write this file; move it away"):
        recorded(live_path, HEADER, burst(1))

    assert live_path.read_text() == "my shopping list"


def test_a_recording_of_another_version_is_moved_away(live_path: Path) -> None:
    later = START.encode().replace(b"recording 1", b"recording 2")
    is_packed = live_path.suffix == ".gz"
    live_path.write_bytes(gzip.compress(later) if is_packed else later)

    recorded(live_path, HEADER, burst(1))

    (moved,) = live_path.parent.glob("raw-*")
    assert moved.name.startswith("raw-undated")
    assert list(read_recording(live_path)) == [HEADER, burst(1)]


@pytest.mark.parametrize("zeros", [0, 300])
def test_whatever_a_power_cut_leaves_of_the_first_bytes_is_no_strangers_file(
    zeros: int, live_path: Path
) -> None:
    recorded(live_path, HEADER)
    whole, layout = live_path.read_bytes(), layout_of(live_path)
    for kept in range(len(whole)):
        file = io.BytesIO(whole[:kept] + b"\0" * zeros)
        assert layout.whole_size(file) is not None or layout.is_our_format(file)


def test_a_long_member_that_is_torn_is_moved_away_not_cut(tmp_path: Path) -> None:
    path = tmp_path / "raw.rec.gz"
    torn = gzip.compress(MANUAL.encode())[:-20]
    path.write_bytes(torn)

    recorded(path, HEADER)

    assert (tmp_path / "raw-20261122T120000Z.rec.gz").read_bytes() == torn


def test_a_recording_rotates_like_the_log_and_each_part_has_a_header(
    live_path: Path,
) -> None:
    frames = [GPS_LINE._replace(data=dated("221226")), *map(burst, range(250))]
    recorded(live_path, HEADER, *frames, mb=1e-4)
    recorded(live_path, HEADER, *map(burst, range(50)))  # time to compress the rest

    parts = list(live_path.parent.glob("raw-*"))
    assert "raw-20261222T120001Z.rec.gz" in {part.name for part in parts}
    assert {part.suffix for part in parts} == {".gz"}
    found = [list(read_recording(part)) for part in parts]
    assert all(items[0] == HEADER for items in found)
    assert sorted(f for items in found for f in items if isinstance(f, Frame)) == (
        sorted(frames)
    )


def test_after_a_week_rollover_a_rotated_file_does_not_become_the_oldest(
    live_path: Path,
) -> None:
    # It was named by the date as sent, 1024 weeks back, and the oldest goes first.
    recorded(live_path, HEADER, GPS_LINE._replace(data=dated("080507")), mb=1e-6)
    names = {path.name.partition(".")[0] for path in live_path.parent.glob("raw-*")}
    assert "raw-20261222T120001Z" in names


def test_a_date_that_no_clock_shows_leaves_a_rotated_file_undated(
    live_path: Path,
) -> None:
    # Its UTC would lie in the year 0, which ended the daemon.
    early = MINIMAL.replace("}", ', "start_utc": "0001-01-01T00:00:00+14:00"}')
    text = f"# imu-tracker recording 1\n# {early}\n".encode()
    is_gzip = live_path.suffix == ".gz"
    live_path.write_bytes(gzip.compress(text) if is_gzip else text)
    recorded(live_path, HEADER, *map(burst, range(9)), mb=1e-6)
    assert any("undated" in path.name for path in live_path.parent.iterdir())


def test_a_recording_without_a_date_is_rotated_too(tmp_path: Path) -> None:
    path = tmp_path / "raw.rec.gz"
    recorded(path, HEADER, burst(1), mb=0)
    recorded(path, HEADER, burst(2), mb=0)

    assert {part.name for part in tmp_path.glob("raw-*")} >= {
        "raw-undated.rec.gz",
        "raw-undated-2.rec.gz",
    }


def test_the_start_of_the_header_names_the_file(tmp_path: Path) -> None:
    path = tmp_path / "raw.rec.gz"
    recorded(path, FULL_HEADER, burst(1), mb=0)

    assert (tmp_path / "raw-20261122T120000Z.rec.gz").exists()


def test_a_full_disk_does_not_end_a_recording(
    live_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
) -> None:
    disk = SmallDisk(monkeypatch)
    writer = LiveRecordingWriter(live_path, Limits(sync_s=1.0, min_free_mb=0))
    writer.write_header(HEADER)
    for number in range(1000):
        disk.free_bytes = 10**6 if not 200 < number < 700 else 50
        writer.write(burst(number))
        writer.tick(number * SECOND_NS // 100)
        assert writer.is_failing == (200 < number < 700 and number >= 300)
    writer.close()

    assert list(read_recording(live_path)) == [HEADER, *map(burst, range(1000))]
    assert writer.counters["records"] == 1000
    assert caplog.text.count("cannot be written") == 1


def test_sighup_begins_a_moved_recording_anew_with_its_header(live_path: Path) -> None:
    writer = LiveRecordingWriter(live_path, Limits(min_free_mb=0))
    writer.write_header(HEADER)
    writer.write(burst(1))
    moved = live_path.with_name("moved.rec")
    live_path.rename(moved)
    writer.reopen()
    writer.write(burst(2))
    writer.close()

    assert list(read_recording(moved)) == [HEADER, burst(1)]
    assert list(read_recording(live_path)) == [HEADER, burst(2)]
