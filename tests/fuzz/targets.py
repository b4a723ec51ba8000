"""What is fed with hostile bytes, and what must hold of it whatever they are.

Each target takes bytes and returns, or raises what is a finding: an assertion, or any
exception but those that a command ends in with one line. The bounded runs of the test
suite (hypothesis) and the long ones of `make fuzz` (atheris) share them. Where pure
noise would be refused at the first byte, the bytes are read as choices instead: of
well-formed bursts, and of sentences whose checksum is right.
"""

import gzip
import json
import math
import os
import re
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from functools import cache
from itertools import pairwise
from pathlib import Path
from struct import pack
from typing import Final, NamedTuple, TypeVar

from imu_tracker.commands.status import read_status
from imu_tracker.config import load_config
from imu_tracker.errors import ConfigError, TrackerError
from imu_tracker.estimation.settings import TrackerSettings
from imu_tracker.pipeline import Pipeline
from imu_tracker.recording.files import read_recording
from imu_tracker.recording.scoring import read_truth
from imu_tracker.samples import (
    DEFAULT_MOUNT,
    Frame,
    GpsFix,
    NavState,
    SessionHeader,
    Source,
)
from imu_tracker.sensors.gnss.epoch_reader import EpochReader, LineSplitter, Positions
from imu_tracker.sensors.gnss.network_port import GpsdFilter
from imu_tracker.serve.gpsd_session import GpsdSession
from imu_tracker.serve.http_request import Refused, parse
from imu_tracker.storage.calibration_file import read_calibration
from imu_tracker.storage.latlong import HEADER, format_row, read_log
from imu_tracker.storage.state_file import read_state
from imu_tracker.storage.state_model import Sensor
from support.nmea_text import gga, gll, rmc, sentence
from support.paths import REPOSITORY

T = TypeVar("T")

SEEDS: Final = Path(__file__).parent / "seeds"

MAX_MESSAGE: Final = 1000
"""Characters of one line that a person shall read."""

_SECOND_NS: Final = 1_000_000_000
_MILLISECOND_NS: Final = 1_000_000


class Target(NamedTuple):
    """Something that takes bytes; the seeds are good, and what else may come."""

    run: Callable[[bytes], None]
    seeds: tuple[bytes, ...]
    words: tuple[bytes, ...] = ()
    max_bytes: int = 2048


# ---------------------------------------------------------------------------- the lines


def _wire(data: bytes) -> None:
    """Raw bytes of a receiver, in chunks, at the pace of 115200 baud."""
    splitter, reader = LineSplitter(), EpochReader()
    step = 1 + (data[0] if data else 0)
    for start in range(0, len(data), step):
        for line in splitter.split(data[start : start + step]):
            _check_positions(reader.feed(line.offset * 87_000, line.data))
    _check_positions(reader.advance(10**12))
    assert len(splitter._tail) <= 255
    assert splitter.counters["bytes"] == len(data)


def _sentences(data: bytes) -> None:
    """Bodies of sentences, a line each, with the checksum that they need."""
    reader, t_ns = EpochReader(), 0
    for body in data.split(b"\n"):
        t_ns += 1 + (len(body) % 5) * 100 * _MILLISECOND_NS
        line = sentence(body.decode("latin-1"))
        _check_positions(reader.feed(t_ns, line))
    _check_positions(reader.advance(t_ns + _SECOND_NS))
    assert all(notice.isprintable() for notice in reader.take_notices())


def _check_positions(positions: Positions) -> None:
    for position in positions:
        assert position.utc_s is None or 0 < position.utc_s < 4e10
        if isinstance(position, GpsFix):
            assert abs(position.lat_rad) <= math.pi / 2
            assert abs(position.lon_rad) <= math.pi
            assert 0 < position.sigma_h_m <= 1e5
            assert position.alt_m is None or abs(position.alt_m) <= 1e5
            assert position.vel_ne_mps is None or math.hypot(*position.vel_ne_mps) < 601


def _http(data: bytes) -> None:
    """The head of a request."""
    with suppress(Refused):
        request = parse(data, ("pi.example",))
        assert len(request.path) <= 2000


def _gpsd_requests(data: bytes) -> None:
    """What a client of our gpsd sends, in pieces."""
    session = GpsdSession()
    step = 1 + (data[0] % 64 if data else 0)
    for start in range(0, len(data), step):
        try:
            answer = session.feed(data[start : start + step], None, is_on=True)
        except ValueError:
            return
        for text in answer.splitlines():
            assert json.loads(text)["class"]


def _gpsd_stream(data: bytes) -> None:
    """What a gpsd sends us, in pieces."""
    gpsd_filter, passed = GpsdFilter(), 0
    step = 1 + (data[0] % 64 if data else 0)
    for start in range(0, len(data), step):
        try:
            passed += len(gpsd_filter.feed(data[start : start + step]))
        except ConnectionError:
            return
    assert passed <= len(data)


# ---------------------------------------------------------------------------- the files


@cache
def _scratch(name: str) -> Path:
    """A file of this process, in memory where that can be."""
    shm = Path("/dev/shm")
    folder = tempfile.mkdtemp(dir=shm if shm.is_dir() else None)
    return Path(folder) / f"{os.getpid()}-{name}"


def _file(name: str, read: Callable[[Path], object]) -> Callable[[bytes], None]:
    """Return a target that reads a file of these bytes."""

    def run(data: bytes) -> None:
        path = _scratch(name)
        path.write_bytes(data)
        try:
            _or_refused(lambda: read(path))
        finally:
            path.unlink()

    return run


def _or_refused(read: Callable[[], object]) -> None:
    """Do it, or refuse in the way in which a command does."""
    try:
        read()
    except TrackerError as error:
        refusal = error
    else:
        return
    lines = str(refusal).split("\n")
    # All problems of a configuration are told at once, a line each.
    assert len(lines) == 1 or isinstance(refusal, ConfigError), lines
    for line in lines:
        assert line
        assert len(line) < MAX_MESSAGE, line
        assert line.isprintable(), line
    assert refusal.exit_code in {65, 66, 69, 78}


def _recording(path: Path) -> None:
    for item in read_recording(path):
        assert isinstance(item, SessionHeader | Frame)


def _log(path: Path) -> None:
    track = read_log(path)
    for column in (track.utc_s, track.lat_deg, track.lon_deg, track.r95_m):
        assert all(map(math.isfinite, column.tolist()))


def _truth(path: Path) -> None:
    track = read_truth(path)
    assert all(a < b for a, b in pairwise(track.utc_s.tolist()))


def _status(path: Path) -> None:
    read_status(path)


def _configuration(path: Path) -> None:
    load_config(path)


def _calibration(path: Path) -> None:
    """What is read must correct: samples stay finite, rows as well."""
    corrections = read_calibration(path).corrections()
    header = SessionHeader(4, 500, 100.0, start_utc_s=1.8e9)
    pipeline = Pipeline(header, TrackerSettings(), corrections=corrections)
    for frame in hostile_frames(_DRIVE_SEEDS[0][:20]):
        for row in pipeline.feed(frame):
            check_row(row)


def _state(path: Path) -> None:
    """What is read must be a start: the filter begins with it, and stays finite."""
    learnt = read_state(path, Sensor("", DEFAULT_MOUNT, ""))
    if learnt is None:
        return
    settings = TrackerSettings(
        estimator="error-state", profile="auto", latency_s=None, prior=learnt
    )
    pipeline = Pipeline(SessionHeader(4, 500, 100.0, start_utc_s=1.8e9), settings)
    for frame in hostile_frames(_DRIVE_SEEDS[0][:20]):
        for row in pipeline.feed(frame):
            check_row(row)


def _override(data: bytes) -> None:
    """What a shell may hand over after --set."""
    texts = os.fsdecode(data.replace(b"\0", b"")).split("\n")
    _or_refused(lambda: load_config(None, texts))


# ----------------------------------------------------------------------- the whole way

_TIMES: Final = (
    0.1,
    0.2,
    1.0,
    1.0,
    1.0,
    1.0,
    2.0,
    0.0,
    -1.0,
    7.0,
    61.0,
    -3600.0,
    86399.0,
)
_WAITS_MS: Final = (0, 1, 5, 50, 100, 300, 399, 400, 1000, 2500, 20000, -1, -300, -5000)
_DATES: Final = (
    "221126",
    "221126",
    "221126",
    "",
    "060180",
    "311299",
    "310226",
    "070419",
)
_PLACES: Final = (
    ("5200.0000", "N", "00422.0000", "E"),
    ("8959.9999", "N", "00000.0000", "E"),
    ("9000.0000", "S", "18000.0000", "W"),
    ("0000.0000", "N", "17959.9999", "E"),
    ("0000.0001", "S", "17959.9999", "W"),
    ("0000.0000", "N", "00000.0000", "E"),
    ("", "", "", ""),
)
_NUMBERS: Final = (
    *("0.0", "0", "1", "1.5", "12.5", "359.9", "360", "99.99", "-0.0", "-400", "8848"),
    *(
        "100000",
        "99999",
        "1e9",
        "1000000000",
        "9" * 200,
        "0." + "0" * 100 + "1",
        "-1",
        "",
    ),
    *("nan", "inf", "1_0", "--1", "600", "1166", "0.01"),
)
_AXES: Final = (0, 0, 1, -1, 100, -100, 8192, -8192, 32767, -32768, 2730)


class _Choices:
    """Bytes as choices; at their end everything is the first of its kind."""

    def __init__(self, data: bytes) -> None:
        self._data, self._at = data, 0

    @property
    def are_left(self) -> bool:
        return self._at < len(self._data)

    def byte(self) -> int:
        value = self._data[self._at] if self.are_left else 0
        self._at += 1
        return value

    def of(self, values: tuple[T, ...]) -> T:
        return values[self.byte() % len(values)]

    def take(self, n: int) -> bytes:
        self._at += n
        return self._data[self._at - n : self._at].ljust(n, b"\0")


MAX_STREAM_NS: Final = 30 * _SECOND_NS
"""The work of the estimation is that of the time that passes, not of the bytes: a
million cases shall take hours, not days. Who goes on for longer is `test_long_runs`."""


def hostile_frames(data: bytes) -> Iterator[Frame]:
    """Well-formed frames that no sensor would send."""
    choices = _Choices(data)
    t_ns, tod_s, last_ns, n = _SECOND_NS, 43_200.0, 0, 0
    while choices.are_left and last_ns < MAX_STREAM_NS:
        kind = choices.byte()
        if kind % 8 < 3:  # a train of samples
            axes = [choices.of(_AXES) for _ in range(3)]
            if kind & 64:  # at rest and level, the chip's z up
                axes[:3] = [0, 0, 8192]
            turns = [choices.of(_AXES) if kind & 128 else 0 for _ in range(3)]
            for n in range(1 + (kind >> 3) % 8 * 12):
                t_ns += 10 * _MILLISECOND_NS
                noise = n * 7 % 5 - 2 if kind & 32 else 0
                counts = [
                    min(max(a + noise, -32768), 32767) for a in (*axes, 0, *turns)
                ]
                yield Frame(t_ns, Source.IMU, pack(">7h", *counts))
        elif kind % 8 < 6:
            tod_s = (tod_s + choices.of(_TIMES)) % 86_400.0
            t_ns += choices.of((0, 0, 10, 300, 1000)) * _MILLISECOND_NS
            for line in _epoch(choices, tod_s):
                yield Frame(t_ns, Source.GPS, line)
        elif kind % 8 == 6:
            t_ns = max(0, t_ns + choices.of(_WAITS_MS) * _MILLISECOND_NS)
            yield Frame(t_ns, Source.EVENT, b"imu_lost \x00" + choices.take(3))
        else:
            yield Frame(t_ns, Source.IMU, choices.take(14))
            t_ns += 10 * _MILLISECOND_NS
        last_ns = max(last_ns, t_ns)


def _epoch(choices: _Choices, tod_s: float) -> Iterator[bytes]:
    whole, seconds = divmod(tod_s, 60.0)
    tod = f"{whole // 60:02.0f}{whole % 60:02.0f}{seconds:05.2f}"
    if choices.byte() % 16 == 15:
        tod = choices.of(("235960.00", "240000", "", "000000.000", "9" * 30))
    place = list(choices.of(_PLACES))
    if place[0] == "5200.0000":  # a receiver that moves, somehow
        place[0] = (
            f"52{choices.byte() * 59 / 255:07.4f}" if choices.byte() & 64 else place[0]
        )
    told = choices.byte()
    speed, course = choices.of(_NUMBERS), choices.of(_NUMBERS)
    if told & 1:
        fields = {"place": ",".join(place), "speed": speed, "course": course}
        yield rmc(tod, choices.of(_DATES), **fields)
    if told & 2:
        fields = {"hdop": choices.of(_NUMBERS), "altitude": choices.of(_NUMBERS)}
        quality = choices.of(("1", "2", "4", "5", "0", "3", "6", "9"))
        yield gga(tod, place=",".join(place), quality=quality, **fields)
    if told & 4:
        sigma = choices.of(_NUMBERS)
        yield sentence(f"GPGST,{tod},,,,,{sigma},{choices.of(_NUMBERS)},1.0")
    if told & 8:
        yield sentence(f"GPVTG,{course},T,,M,{speed},N,,K,A")
    if told & 16:
        year = choices.of(("2026", "9999", "0001", "1970", "2999", "1980", "99999"))
        yield sentence(f"GPZDA,{tod},22,11,{year},00,00")
    if told & 32:
        yield gll(tod)


def _pipeline(estimator: str) -> Callable[[bytes], None]:
    """Return a target that tracks hostile frames."""

    def run(data: bytes) -> None:
        profile = ("free", "vehicle", "walker")[len(data) % 3]
        is_auto = estimator == "error-state" and len(data) % 2 == 1
        settings = TrackerSettings(
            estimator=estimator,
            profile="auto" if is_auto else profile,
            latency_s=None if is_auto else 0.2,
            rate_hz=10,
            start=(0.9, 0.07) if len(data) % 5 == 0 else None,
        )
        start_utc_s = 1_795_348_800.0 if len(data) % 7 else None
        pipeline = Pipeline(
            SessionHeader(4, 500, 100.0, None, None, start_utc_s), settings
        )
        last_utc_s = -math.inf
        for frame in hostile_frames(data):
            for row in pipeline.feed(frame):
                assert row.utc_s > last_utc_s
                last_utc_s = row.utc_s
                check_row(row)
        assert all(notice.isprintable() for notice in pipeline.take_notices())
        json.dumps(pipeline.report())

    return run


_ROW: Final = re.compile(
    r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d\.\d{3}Z,-?\d{1,2}\.\d{8},-?\d{1,3}\.\d{8},"
    r"(-?\d{1,6}\.\d)?,\d{1,5}\.\d\d,(\d{1,3}\.\d)?,\d{1,8}\.\d\d,(gpsonly|still|gps|dr)"
)


def check_row(row: NavState) -> None:
    """Numbers, on earth, and a line of the log."""
    assert all(map(math.isfinite, (*row.v_n_mps, *row.q_nb, row.r95_m)))
    assert abs(row.lat_rad) <= math.pi / 2
    assert abs(row.lon_rad) <= math.pi + 1e-9
    assert row.r95_m >= 0.0
    assert _ROW.fullmatch(format_row(row)), format_row(row)


# --------------------------------------------------------------------------- the seeds

_HEADER: Final = (
    b'# imu-tracker recording 1\n# {"chip": "MPU-6050", "accel_range_g": 4, '
    b'"gyro_range_dps": 500, "imu_rate_hz": 100, "mount": ["+x", "-y", "-z"], '
    b'"profile": "vehicle", "start_utc": "2026-11-22T12:00:00Z"}\n'
)
_FRAMES: Final = (
    b"I 1000000000 fff40012200001c40003fffe0001\n"
    b"G 1180000000 " + rmc() + b"\nE 1190000000 imu_lost read failed\n"
    b"I 1200000000 fff40012200001c40003fffe0002\nG 1210000000 \\xff\\x5c\n"
)
_LOG: Final = (
    f"{HEADER}\n"
    "2026-11-22T12:00:01.250Z,51.99000012,4.37000034,5.2,1.38,40.1,3.94,gps\n"
    "2026-11-22T12:00:01.500Z,51.99000012,-179.37000034,,0.00,,13.94,still\n"
).encode()
_TRUTH: Final = b"time_utc,lat_deg,lon_deg\n2026-11-22T12:00:01Z,52.0,4.3\n"
_STATUS: Final = json.dumps(
    {"t_ns": time.monotonic_ns(), "pid": 1, "row": None}
).encode()
_BODIES: Final = b"\n".join(
    line[1:-3]
    for line in (
        *(rmc(), gga(), gll(), rmc("120001.00"), gga("235960.00", quality="0")),
        sentence("GPZDA,120002.00,23,11,2026,00,00"),
        sentence("GPVTG,90.0,T,,M,10.0,N,,K,A"),
        sentence("GPGST,120001.00,,,,,1.0,1.0,1.0"),
        sentence("GNGNS,120001.00,5159.4,N,00422.2,E,AA,08,1.2,12.5,47.0,,"),
    )
)
_NUMBER_WORDS: Final = tuple(
    word.encode()
    for word in (*_NUMBERS, "1e308", "-1e400", "0x" + "f" * 99, "9" * 20, "2e9", "true")
)
_TEXT_WORDS: Final = (
    *(
        b"\x00",
        b"\r",
        b"\r\n",
        b"\n",
        b"\xd9\xa5",
        b"\xed\xa0\x80",
        b"\xff",
        b"\x1b[2J",
    ),
    *(b"[" * 40, b"{" * 40, b'"' * 3, b"'''", b"\\u0000", b"\\ud800", b"a." * 40),
)
_CONFIG_WORDS: Final = (
    *(b"[imu]\n", b"[log]\n", b"[filter]\n", b"[gps]\n", b"[source]\n", b"path = "),
    *(b'"recording"', b"rate_hz = ", b"mount = ", b"start = ", b"1979-05-27T07:32:00Z"),
    *(b"estimator = ", b"[[imu]]\n", b"imu.bus = ", b"0001-01-01T00:00:00+14:00"),
)


_CONFIGURATIONS: Final = (
    (REPOSITORY / "config" / "demo.toml").read_bytes(),
    b'[imu]\nrate_hz = 100\nmount = ["+x", "-y", "-z"]\naddress = 0x68\n',
    b'[gps]\nbaud = 9600\nlatency_s = 0.1\nlever_arm_m = [0.1, 0, -1]\ndate = ""\n',
    b'[filter]\nestimator = "error-state"\nprofile = "auto"\nstart = "51.9,4.3"\n',
    b'[source]\nkind = "recording"\npath = "a.rec"\nstart_utc = 2026-11-22\n',
    b'[log]\nrate_hz = 10\nsync_s = 1.5\nmax_mb = 16\npath = "/tmp/x.csv"\n',
)


_DRIVE_SEEDS: Final = (
    bytes([96 + 56] * 3 + [3, 2, 0, 0, 0, 0, 3, 2, 5] * 8),
    bytes(range(256)),
    bytes([216, 0, 0, 1, 1, 1, 1, 3, 2, 4, 0, 0, 64, 7, 3, 2, 5, 0, 0, 3, 3, 3] * 12),
)

TARGETS: Final[dict[str, Target]] = {
    "wire": Target(
        _wire, (b"\r\n".join((rmc(), gga(), gll())),), (*_TEXT_WORDS, b"$", b"*")
    ),
    "sentences": Target(_sentences, (_BODIES,), (*_NUMBER_WORDS, *_TEXT_WORDS, b",")),
    "http": Target(
        _http,
        (b"GET /events?token=abc HTTP/1.1\r\nHost: localhost:8086\r\nCookie: a=b\r\n",),
        (b"Host: ", b"\r\n", b"HTTP/1.1", b"GET ", b"?token=", b"%00", b"["),
    ),
    "gpsd-requests": Target(
        _gpsd_requests,
        (b'?WATCH={"enable":true,"json":true,"nmea":true};?POLL;?DEVICES;',),
        (*_NUMBER_WORDS, b"?WATCH=", b"?POLL;", b"{", b"}", b"true", b"null", b";"),
    ),
    "gpsd-stream": Target(
        _gpsd_stream,
        (
            b'{"class":"VERSION","release":"3.22"}\r\n{"class":"DEVICES","devices":'
            b'[{"class":"DEVICE","path":"/dev/gps"}]}\r\n' + rmc() + b"\r\n",
        ),
        (*_NUMBER_WORDS, b'{"class":"', b"imu-tracker", b"\n", b"}", b"[["),
    ),
    "recording": Target(
        _file("raw.rec", _recording),
        (_HEADER + _FRAMES, gzip.compress(_HEADER + _FRAMES, mtime=0), _HEADER * 2),
        (*_NUMBER_WORDS, *_TEXT_WORDS, _HEADER, b"I 9223372036854775807 ", b'"name": '),
    ),
    "configuration": Target(
        _file("config.toml", _configuration),
        _CONFIGURATIONS,
        (*_NUMBER_WORDS, *_TEXT_WORDS, *_CONFIG_WORDS),
    ),
    "override": Target(
        _override,
        (b"imu.rate_hz=100", b'filter.start="51.9,4.3"', b"imu.mount=['+x','-y','-z']"),
        (*_NUMBER_WORDS, *_TEXT_WORDS, b"imu.bus=", b"gps.date=", b"log.path="),
    ),
    "log": Target(
        _file("latlong.csv", _log),
        (_LOG, gzip.compress(_LOG, mtime=0)),
        (*_NUMBER_WORDS, *_TEXT_WORDS, b"9999-12-31T23:59:60.999Z", b"0001-01-01T"),
    ),
    "truth": Target(
        _file("truth.csv", _truth),
        (_TRUTH, gzip.compress(_TRUTH, mtime=0)),
        (*_NUMBER_WORDS, *_TEXT_WORDS, b"0001-01-01T00:00:00+14:00", b'"'),
    ),
    "status": Target(
        _file("status.json", _status), (_STATUS,), (*_NUMBER_WORDS, *_TEXT_WORDS, b"{}")
    ),
    "calibration": Target(
        _file("calibration.json", _calibration),
        ((SEEDS / "calibration.json").read_bytes(),),
        (*_NUMBER_WORDS, *_TEXT_WORDS, b"null", b"NaN", b'"mount": ', b"[1, 0, 0]"),
        max_bytes=4096,
    ),
    "state": Target(
        _file("state.json", _state),
        ((SEEDS / "state.json").read_bytes(),),
        (*_NUMBER_WORDS, *_TEXT_WORDS, b"null", b"NaN", b'"place": ', b"[1, 0, 0, 0]"),
        max_bytes=4096,
    ),
    "six-state": Target(_pipeline("six-state"), _DRIVE_SEEDS, max_bytes=96),
    "error-state": Target(_pipeline("error-state"), _DRIVE_SEEDS, max_bytes=96),
}
