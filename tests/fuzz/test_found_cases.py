"""What fuzzing and reading with its eyes found: each was a crash, a hang or a flood."""

import gzip
import json
import time
import tracemalloc
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from fuzz.targets import SEEDS, TARGETS
from imu_tracker.cli import build_parser
from imu_tracker.commands.status import read_status
from imu_tracker.config import Config, load_config
from imu_tracker.errors import (
    ConfigError,
    LogError,
    NotRunningError,
    RecordingError,
)
from imu_tracker.recording.files import read_recording
from imu_tracker.recording.replay import Replay
from imu_tracker.recording.scoring import read_truth
from imu_tracker.samples import Frame, GpsFix, SessionHeader, Source
from imu_tracker.sensors.gnss.epoch_reader import EpochReader
from imu_tracker.storage.latlong import HEADER, read_log
from support.nmea_text import gga, rmc, sentence

MB = 1_000_000
RANGES = '"accel_range_g": 4, "gyro_range_dps": 500, "imu_rate_hz": 100'
START = f"# imu-tracker recording 1\n# {{{RANGES}}}\n".encode()


@contextmanager
def at_most(megabytes: float) -> Iterator[None]:
    """Whatever is in the file, so much memory must do."""
    tracemalloc.start()
    try:
        yield
        assert tracemalloc.get_traced_memory()[1] < megabytes * MB
    finally:
        tracemalloc.stop()


def bomb(path: Path, block: bytes, megabytes: int, head: bytes = b"") -> Path:
    """Write so many MB, packed to a thousandth."""
    with gzip.open(path, "wb", compresslevel=1) as file:
        file.write(head)
        for _ in range(megabytes * MB // len(block)):
            file.write(block)
    return path


# ------------------------------------------------------------------------ configuration


def refused(path: Path, data: bytes) -> list[str]:
    path.write_bytes(data)
    with pytest.raises(ConfigError) as caught:
        load_config(path)
    return str(caught.value).split("\n")


def test_a_whole_number_that_python_will_not_print_is_refused() -> None:
    # str() of more than 4300 digits is a ValueError; TOML has hexadecimal ones.
    for override in (f"imu.bus=0x{'f' * 5000}", f"imu.read=[0x{'f' * 5000}]"):
        with pytest.raises(
            ConfigError, match=r"^imu\.\w+ = \[?0xF+\.\.\.: must"
        ) as caught:
            load_config(None, [override])
        assert len(str(caught.value)) < 200


def test_a_key_with_a_line_end_makes_one_line(tmp_path: Path) -> None:
    for data in (b'"a\\nb" = 1', b'["a\\u001b[2J"]\nb = 1', b'[imu]\n"a\\nb" = 1'):
        (line,) = refused(tmp_path / "c.toml", data)
        assert line.isprintable()


def test_a_long_key_and_a_long_value_make_short_lines(tmp_path: Path) -> None:
    data = b"%s = '%s'\n[%s]\n[imu]\n%s = 1" % (*(b"k" * 9000,) * 3, b"k" * 9000)
    assert all(len(line) < 400 for line in refused(tmp_path / "c.toml", data))


def test_a_configuration_without_end_is_refused() -> None:
    with at_most(5), pytest.raises(ConfigError, match="longer than"):
        load_config(Path("/dev/zero"))


def test_a_key_of_many_parts_does_not_take_for_ever(tmp_path: Path) -> None:
    # tomllib's time grows with the square of the parts.
    start_s = time.process_time()
    (line,) = refused(tmp_path / "c.toml", b"a." * 30_000 + b"a = 1")
    assert time.process_time() - start_s < 5
    assert len(line) < 200


# -------------------------------------------------------------------------- recordings


@pytest.mark.parametrize("year", ["0001", "1979", "3000", "9999"])
def test_a_recording_that_begins_when_there_is_no_gps_is_refused(
    tmp_path: Path, year: str
) -> None:
    # The rows' year ended in an OverflowError, or had fewer than four digits.
    path = tmp_path / "raw.rec"
    text = START.replace(b"}", b', "start_utc": "%s-01-01T00:00:00Z"}' % year.encode())
    path.write_bytes(text)
    with pytest.raises(RecordingError, match="start_utc"):
        list(read_recording(path))


def test_a_complaint_about_a_header_stays_short(tmp_path: Path) -> None:
    path = tmp_path / "raw.rec"
    path.write_bytes(START.replace(b"100", b'"' + b"x" * 9000 + b'"'))
    with pytest.raises(RecordingError) as caught:
        list(read_recording(path))
    assert len(str(caught.value)) < 500


@pytest.mark.parametrize("head", [b"", START])
def test_ten_gigabytes_of_zeros_are_refused_soon(tmp_path: Path, head: bytes) -> None:
    path = bomb(tmp_path / "zeros.rec.gz", bytes(MB), 200, head)
    with at_most(10), pytest.raises(RecordingError, match="zeros"):
        list(read_recording(path))


def test_silence_of_a_week_takes_no_memory() -> None:
    # All rows of a silence came as one list: 2.4 million of them, a gigabyte.
    def stream() -> Iterator[SessionHeader | Frame]:
        yield SessionHeader(4, 500, 100.0, start_utc_s=1_795_348_800.0)
        for line in (rmc(day="221126"), rmc("120001.00", "221126")):
            yield Frame(10**9, Source.GPS, line)
        yield Frame(1200 * 10**9, Source.EVENT, b"end")

    replay = Replay(Config())
    with at_most(2):
        assert sum(1 for _ in replay.rows(stream())) > 1190 * 4


# --------------------------------------------------------------------------- sentences


@pytest.mark.parametrize("number", ["9" * 99, "100000000", "-99999999"])
def test_a_height_out_of_this_world_is_none(number: str) -> None:
    reader = EpochReader()
    reader.feed(0, gga(altitude=number))
    (fix,) = reader.advance(10**9)
    assert isinstance(fix, GpsFix)
    assert fix.alt_m is None


@pytest.mark.parametrize("number", ["99999.9", "9" * 99])
def test_an_absurd_dilution_is_a_poor_fix_and_not_infinity(number: str) -> None:
    assert 0 < sigma_of(gga(hdop=number)) <= 1e4
    assert sigma_of(gga(hdop="0." + "0" * 99 + "1")) == 1.0  # the floor


def sigma_of(*lines: bytes) -> float:
    reader = EpochReader()
    for line in lines:
        reader.feed(0, line)
    (fix,) = reader.advance(10**9)
    assert isinstance(fix, GpsFix)
    return fix.sigma_h_m


def test_an_absurd_error_estimate_is_poor_and_not_infinity() -> None:
    gst = sentence(f"GPGST,120000.00,,,,,{'9' * 99},1.0,1.0")
    assert 1e4 < sigma_of(gga(), gst) <= 1e5
    gst = sentence(f"GPGST,120000.00,,,,,,,1.0,{'9' * 99},1.0")
    assert sigma_of(gga(), gst) <= 1e5


@pytest.mark.parametrize("year", ["0001", "1970", "3000", "9999"])
def test_a_year_without_gps_is_no_date(year: str) -> None:
    reader = EpochReader()
    reader.feed(0, sentence(f"GPZDA,120000.00,22,11,{year},00,00"))
    reader.feed(0, gga())
    (fix,) = reader.advance(10**9)
    assert isinstance(fix, GpsFix)
    assert fix.utc_s is None


def test_an_epoch_that_never_ends_takes_no_memory() -> None:
    # All sentences of one instant were kept; a stream may stand still for ever.
    reader = EpochReader()
    reader.feed(0, rmc())
    with at_most(1):
        for _ in range(20_000):
            reader.feed(0, gga())


# ---------------------------------------------------------------- logs, truth, status


@pytest.mark.parametrize(
    "row",
    [
        "2026-11-22T12:00:01.250Z,51.9,4.3,5.2,1.38,40.1," + "9" * 400 + ",gps",
        "2026-11-22T12:00:01.250Z,51.9,4.3," + "9" * 400 + ",1.38,40.1,3.94,gps",
        "2026-11-22T12:00:01.250Z,51.9,4.3,5.2," + "9" * 400 + ",40.1,3.94,gps",
        "0001-01-01T00:00:00.000Z,51.9,4.3,5.2,1.38,40.1,3.94,gps",
        "9999-12-31T23:59:59.000Z,51.9,4.3,5.2,1.38,40.1,3.94,gps",
    ],
)
def test_a_log_with_a_number_beyond_all_measure_is_refused(
    tmp_path: Path, row: str
) -> None:
    path = tmp_path / "latlong.csv"
    path.write_text(f"{HEADER}\n{row}\n")
    with pytest.raises(LogError):
        read_log(path)


def test_a_truth_without_line_ends_takes_no_memory(tmp_path: Path) -> None:
    path = bomb(tmp_path / "truth.csv.gz", b"x" * MB, 50)
    with at_most(5), pytest.raises(RecordingError, match="longer than"):
        read_truth(path)


@pytest.mark.parametrize(
    "text",
    [
        '{"t_ns": NaN}',
        '{"t_ns": 1e400}',
        f'{{"t_ns": {"9" * 4000}}}',
        f'{{"t_ns": -{"9" * 4000}}}',
        '{"t_ns": "1"}',
        '{"t_ns": true}',
        "[" * 100_000,
        "[]",
        "",
    ],
)
def test_a_status_that_is_none_means_that_nothing_runs(
    tmp_path: Path, text: str
) -> None:
    path = tmp_path / "status.json"
    path.write_text(text)
    with pytest.raises(NotRunningError):
        read_status(path)
    with at_most(5), pytest.raises(NotRunningError):
        read_status(Path("/dev/zero"))


def test_a_picture_of_damaged_gzip_data_is_refused(tmp_path: Path) -> None:
    # zlib.error is neither an OSError nor an EOFError: it was told as a bug, 70.
    path = tmp_path / "raw.rec.gz"
    path.write_bytes(gzip.compress(START)[:10] + b"\xff" * 50)
    picture = tmp_path / "a.png"
    args = build_parser().parse_args(["plot", str(path), "--output", str(picture)])
    with pytest.raises(LogError, match="damaged"):
        args.run(args)


def test_the_name_of_another_chip_stays_in_its_line() -> None:
    text = (SEEDS / "calibration.json").read_bytes()
    TARGETS["calibration"].run(text.replace(b"MPU-6050", b"M\\u001b[2J\\n0"))


# ------------------------------------------------------------------------------ by kind


@pytest.mark.parametrize(
    "text",
    [
        b"",
        b"\r" * 100_000,
        b"\0" * 100_000,
        b"\xff" * 100_000,
        b"x " * 1_000_000,
        b"[" * 100_000,
        b'{"a":' * 100_000,
        b"1" * 1_000_000,
        "٣٤,".encode() * 100_000,
        json.dumps([1e308] * 1000).encode(),
    ],
    ids=["nothing", "CR", "NUL", "FF", "tokens", "[", "{", "digits", "Arabic", "1e308"],
)
@pytest.mark.parametrize(
    "name", [name for name in TARGETS if not name.endswith("-state")]
)
def test_files_of_one_thing_are_refused_in_no_time(name: str, text: bytes) -> None:
    start_s = time.process_time()
    with at_most(100):
        TARGETS[name].run(text)
    assert time.process_time() - start_s < 10
