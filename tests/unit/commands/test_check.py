"""`check`, `record` and `selftest` on a fake bus and a scripted receiver."""

import errno
import json
import logging
import os
import shutil
import signal
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from fake_i2c import FakeBus, FakeMpu6050
from fake_i2c.world import Feeling
from imu_tracker.cli import main
from imu_tracker.recording.files import read_recording
from imu_tracker.samples import Frame, SessionHeader, Source
from imu_tracker.sensors import clock as clocks
from imu_tracker.sensors import pi_advice as mending
from imu_tracker.sensors.gnss.reader import GpsHealth, GpsState
from imu_tracker.sources import factory as hardware
from imu_tracker.storage.latlong import HEADER as LOG_HEADER
from support.fake_clock import FakeClock
from support.nmea_text import rmc

RMC = b"$GNRMC,120001.00,A,5159.4000000,N,00422.2000000,E,0.012,,221126,,,A*61"
GGA = b"$GNGGA,120001.00,5159.4000000,N,00422.2000000,E,1,09,1.0,5.0,M,47.0,M,,*"


def checked(line: bytes) -> bytes:
    """Complete a sentence by its checksum."""
    total = 0
    for byte in line[1:-1]:
        total ^= byte
    return b"%s%02X" % (line, total)


class FakeReader:
    """Says what it is told to say when it starts."""

    def __init__(self, put: Callable[[Frame], None], health: GpsHealth) -> None:
        self._put, self._health = put, health
        self.frames: list[Frame] = []
        self.on_start: Callable[[], object] = lambda: None
        self.error: BaseException | None = None
        self.is_stopped = False

    def start(self) -> None:
        for frame in self.frames:
            self._put(frame)
        self.on_start()

    def stop(self) -> None:
        self.is_stopped = True

    def join(self) -> None:
        assert self.is_stopped

    def health(self) -> GpsHealth:
        return self._health


class Bench:
    """A clock, a chip on a bus, and a receiver."""

    def __init__(self) -> None:
        self.clock = FakeClock()
        self.chip = FakeMpu6050(self.clock)
        self.bus = FakeBus(self.clock, {0x68: self.chip})
        self.health = GpsHealth(GpsState.OK, "", 9600, 1, 1, 1, 0)
        self.lines = [RMC, checked(GGA)]
        self.end_at_start = False
        self.bug: BaseException | None = None

    def open_bus(self, number: int) -> Any:
        return self.bus.open()

    def gps_reader(
        self, config: object, put: Callable[[Frame], None], clock: object
    ) -> FakeReader:
        reader = FakeReader(put, self.health)
        t_ns = self.clock.now_ns()
        reader.frames = [Frame(t_ns, Source.GPS, line) for line in self.lines]
        reader.frames.append(Frame(t_ns, Source.EVENT, b"gps_open /dev/serial0"))
        if self.end_at_start:
            reader.on_start = lambda: signal.raise_signal(signal.SIGINT)
        reader.error = self.bug
        return reader

    def imu_reader(
        self, config: object, put: Callable[[Frame], None], clock: object
    ) -> FakeReader:
        reader = FakeReader(put, self.health)
        reader.frames = [Frame(n, Source.IMU, bytes(14)) for n in range(250)]
        return reader


@pytest.fixture
def bench(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Iterator[Bench]:
    bench = Bench()
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(clocks, "MonotonicClock", lambda: bench.clock)
    monkeypatch.setattr(hardware, "open_bus", bench.open_bus)
    monkeypatch.setattr(hardware, "gps_reader", bench.gps_reader)
    monkeypatch.setattr(hardware, "imu_reader", bench.imu_reader)
    monkeypatch.setattr(mending, "CMDLINE", tmp_path / "cmdline")
    (tmp_path / "cmdline").write_text("root=/dev/mmcblk0p2 console=tty1")
    yield bench
    assert bench.bus.open_handles == 0
    logging.getLogger("imu_tracker").handlers = []


HERE = ["--set", "log.path=log.csv", "--set", "status.path=status.json"]


def check(
    capsys: pytest.CaptureFixture[str], *overrides: str
) -> tuple[int, dict[str, str]]:
    """Return the exit code, and the findings by what they are about."""
    argv = [part for override in overrides for part in ("--set", override)]
    code = main(["check", *HERE, "--set", "log.min_free_mb=0", *argv])
    lines = capsys.readouterr().out.splitlines()
    return code, {line[9:24].strip(): line[:9] + line[24:] for line in lines}


def test_the_findings_as_json_are_those_of_the_table(
    bench: Bench, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    argv = ["check", "--set", "log.path=log.csv", "--set", "status.path=none.json"]
    assert main(argv) == 0
    table = capsys.readouterr().out.splitlines()
    assert main([*argv, "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["exit_code"] == 0
    rows = [(row["verdict"], row["what"]) for row in found["findings"]]
    assert rows == [(line[:8].strip(), line[9:23].strip()) for line in table]


def test_when_everything_is_there_every_line_is_ok(
    bench: Bench, capsys: pytest.CaptureFixture[str]
) -> None:
    code, found = check(capsys)
    assert code == 0
    assert all(text.startswith("ok ") for text in found.values())
    assert list(found) == ["configuration", "IMU", "GPS port", "GPS", "log"]
    assert "MPU-6050 at 0x68 on /dev/i2c-1: 1.00 g" in found["IMU"]
    assert "/dev/serial0 at 9600 baud: GGA RMC" in found["GPS port"]


def test_a_chip_that_is_not_there_is_exit_69(
    bench: Bench, capsys: pytest.CaptureFixture[str]
) -> None:
    bench.bus.chips.clear()
    code, found = check(capsys)
    assert code == 69
    assert "nobody answers at address 0x68: check wiring" in found["IMU"]
    assert found["IMU"].startswith("FAILED ")
    assert found["GPS"].startswith("ok ")


def test_a_chip_at_the_other_address_is_found(
    bench: Bench, capsys: pytest.CaptureFixture[str]
) -> None:
    code, found = check(capsys, "imu.address=0x69")
    assert code == 69
    assert "something answers at 0x68: set imu.address" in found["IMU"]


def test_a_bus_that_hangs_is_explained(
    bench: Bench, capsys: pytest.CaptureFixture[str]
) -> None:
    bench.bus.nack(after=20, times=1000)
    code, found = check(capsys)
    assert code == 69
    assert "(EREMOTEIO: nobody answers: check wiring" in found["IMU"]


@pytest.mark.parametrize(
    "feeling",
    [
        Feeling(accel_g=(0.0, 0.0, 1.5)),
        Feeling(accel_g=(0.0, 0.0, 1.0), gyro_dps=(0.0, 0.0, 90.0)),
    ],
)
def test_a_chip_that_moves_is_a_warning(
    feeling: Feeling, bench: Bench, capsys: pytest.CaptureFixture[str]
) -> None:
    bench.chip.world.feel(feeling.accel_g, feeling.gyro_dps)
    code, found = check(capsys)
    assert code == 0
    assert found["IMU"].startswith("warning ")
    assert "hold it still" in found["IMU"]


def test_a_chip_of_zeros_is_broken_and_not_moving(
    bench: Bench, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(bench.chip, "_measure", lambda t_ns: bytes(14))
    code, found = check(capsys)
    assert code == 69
    assert found["IMU"].startswith("FAILED ")
    assert "exactly zero, the chip is broken: run imu-tracker selftest" in found["IMU"]


@pytest.mark.parametrize(("felt_g", "factor"), [(0.5, "0.5"), (2.0, "2")])
def test_a_chip_of_another_scale_that_lies_still_is_told(
    felt_g: float, factor: str, bench: Bench, capsys: pytest.CaptureFixture[str]
) -> None:
    bench.chip.world.feel((0.0, 0.0, felt_g), (0.0, 0.0, 0.0))
    code, found = check(capsys)
    assert code == 69
    assert f"has {factor} times the scale of its name" in found["IMU"]


@pytest.mark.parametrize("axis", [0, 2, 4, 8, 10, 12])
def test_an_axis_that_stands_is_broken_though_the_chip_lies_still(
    axis: int,
    bench: Bench,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    measure = bench.chip._measure

    def standing(t_ns: int) -> bytes:
        burst = measure(t_ns)
        return burst[:axis] + b"\x01\x23" + burst[axis + 2 :]

    monkeypatch.setattr(bench.chip, "_measure", standing)
    code, found = check(capsys)
    assert code == 69
    assert "stands, the chip is broken: run imu-tracker selftest" in found["IMU"]


@pytest.mark.parametrize(
    ("counts", "said"),
    [
        # m-rtijn/mpu6050#28: accelerometer zero, gyro x -156.18 deg/s, always.
        ("000000000000 0cb2 d80000000000", "the accelerometer never changes"),
        # hybridgroup/gobot#236: plausible values that stay though it is moved.
        ("000000000002 0cb2 00010002ffff", "the accelerometer never changes"),
        ("0000000000000000000000000000", "all axes give exactly zero"),
    ],
)
def test_a_chip_whose_values_never_change_is_broken(
    counts: str,
    said: str,
    bench: Bench,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(bench.chip, "_measure", lambda t_ns: bytes.fromhex(counts))
    code, found = check(capsys)
    assert code == 69
    assert said in found["IMU"]
    assert "run imu-tracker selftest" in found["IMU"]


class _Clock(FakeMpu6050):
    """A clock chip: 19 registers that repeat."""

    registers_hex = ""

    def read(self, register: int, length: int) -> bytes:
        data = bytes.fromhex(self.registers_hex)
        return bytes(data[(register + i) % 19] for i in range(length))

    def write(self, register: int, value: int) -> None:
        raise AssertionError("a clock was written to")


CLOCKS = {
    "DS3231": "25 14 12 05 27 11 26 000000000000001c00001940",
    "DS3231, 12-hour clock": "25 14 71 01 01 01 00 000000000000001c00001940",
    "DS1307 that stands": "80 00 00 01 01 01 00 93 0102030405060708090a0b",
    "PCF8523": "00 00 e0 25 14 12 27 00 11 26 808080800000000000",
}


@pytest.mark.parametrize("registers_hex", CLOCKS.values(), ids=CLOCKS)
@pytest.mark.parametrize("allow", ["true", "false"])
def test_a_clock_chip_is_named_and_never_written_to(
    allow: str,
    registers_hex: str,
    bench: Bench,
    capsys: pytest.CaptureFixture[str],
) -> None:
    clock = _Clock(bench.clock)
    clock.registers_hex = registers_hex
    bench.bus.chips = {0x68: clock, 0x69: bench.chip}
    code, found = check(capsys, f"imu.allow_unknown_chip={allow}")
    assert code == 69
    assert "a clock chip (DS1307, DS3231, PCF8523) at address 0x68" in found["IMU"]
    assert "something answers at 0x69: set imu.address = 0x69" in found["IMU"]


class _Owned(FakeMpu6050):
    """A chip that a kernel driver has."""

    def read(self, register: int, length: int) -> bytes:
        raise OSError(errno.EBUSY, os.strerror(errno.EBUSY))


@pytest.mark.parametrize("has_neighbour", [True, False])
def test_an_address_that_the_kernel_owns_names_the_other_one(
    has_neighbour: bool, bench: Bench, capsys: pytest.CaptureFixture[str]
) -> None:
    bench.bus.chips = {0x68: _Owned(bench.clock)}
    if has_neighbour:
        bench.bus.chips[0x69] = bench.chip
    code, found = check(capsys)
    assert code == 69
    assert "kernel driver" in found["IMU"]
    assert ("set imu.address = 0x69" in found["IMU"]) is has_neighbour


def test_a_log_of_the_future_is_told(
    bench: Bench, capsys: pytest.CaptureFixture[str]
) -> None:
    row = "2030-01-01T00:00:00.000Z,51.99000000,4.37000000,5.2,0.00,,3.90,gps"
    Path("log.csv").write_text(f"{LOG_HEADER}\n{row}\n")
    assert main(["check", *HERE, "--set", "log.min_free_mb=0"]) == 0
    lines = capsys.readouterr().out.splitlines()
    (told,) = [line for line in lines if "ends at 2030-01-01T00:00:00" in line]
    assert told.startswith("warning  log ")
    assert "later than the receiver's time, 20" in told
    assert "run puts it aside and begins a new one" in told


def test_a_fix_that_cannot_be_read_is_no_matter_of_the_antenna(
    bench: Bench, capsys: pytest.CaptureFixture[str]
) -> None:
    bad = rmc(place="3403.130,N,-11814.617,W")
    bench.lines = [bad, bad]
    _, found = check(capsys)
    assert "antenna" not in found["GPS"]
    assert "RMC: longitude -11814.617 is not dddmm.mmmm, 2 times" in found["GPS"]
    assert "set the receiver, or what relays it, to plain NMEA 0183" in found["GPS"]


def test_damaged_lines_are_told_beside_a_good_fix(
    bench: Bench, capsys: pytest.CaptureFixture[str]
) -> None:
    bench.lines = [RMC, RMC[:20] + RMC[24:], checked(GGA)]
    main(["check", *HERE, "--set", "log.min_free_mb=0"])
    out = capsys.readouterr().out
    assert "damaged lines (noise, a loose wire, or more sentences" in out
    assert "a fix, at 20" in out


def test_a_network_port_that_is_silent_gets_no_advice_for_wires(
    bench: Bench, capsys: pytest.CaptureFixture[str]
) -> None:
    bench.health, bench.lines = bench.health._replace(state=GpsState.SILENT), []
    code, found = check(capsys, "gps.port=socket://127.0.0.1:2948")
    assert code == 69
    assert "does the other side send NMEA" in found["GPS port"]
    assert "powered" not in found["GPS port"]


@pytest.mark.parametrize(
    ("state", "advice"),
    [
        (GpsState.SILENT, "not a byte: is the receiver powered"),
        (GpsState.SEARCHING, "no sentence at any speed"),
        (GpsState.GARBAGE, "a wrong gps.baud"),
        (GpsState.CLOSED, "/dev/serial0 does not exist (there is "),
    ],
)
def test_a_receiver_that_is_not_understood_is_exit_69(
    state: GpsState, advice: str, bench: Bench, capsys: pytest.CaptureFixture[str]
) -> None:
    bench.health = bench.health._replace(state=state, detail="it is gone")
    bench.lines = []
    code, found = check(capsys)
    assert code == 69
    assert advice in found["GPS port"]
    assert "GPS" not in found


def test_a_port_that_is_there_and_closed_says_why(
    bench: Bench, capsys: pytest.CaptureFixture[str]
) -> None:
    bench.health = bench.health._replace(state=GpsState.CLOSED, detail="busy")
    Path("port").touch()
    found = check(capsys, "gps.port=port")[1]
    assert (
        "port: busy: another program has it; if that is gpsd, set gps.port"
        in found["GPS port"]
    )
    found = check(capsys, "gps.port=socket://nowhere:1")[1]
    assert "socket://nowhere:1: busy: is the other side there" in found["GPS port"]
    found = check(capsys, "gps.port=gpsd://nowhere:1")[1]
    assert "gpsd://nowhere:1: busy: does gpsd run there" in found["GPS port"]
    found = check(capsys, "gps.port=udp://:10110")[1]
    assert "udp://:10110: busy: has another program this port?" in found["GPS port"]


@pytest.mark.parametrize(
    ("port", "advice"),
    [
        ("socket://pi:10110", "does the other side send NMEA?"),
        ("gpsd://pi:2947", "has it a receiver? See gpspipe -r"),
        ("udp://:10110", "no datagram"),
    ],
)
def test_a_silent_port_on_the_network_has_no_wires_to_check(
    port: str, advice: str, bench: Bench, capsys: pytest.CaptureFixture[str]
) -> None:
    bench.health = bench.health._replace(state=GpsState.SILENT)
    bench.lines = []
    code, found = check(capsys, f"gps.port={port}")
    assert code == 69
    assert advice in found["GPS port"]
    assert "TX" not in found["GPS port"]


def test_a_port_without_permission_names_the_group(
    bench: Bench, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    bench.health = bench.health._replace(state=GpsState.CLOSED, detail="denied")
    Path("port").touch()
    monkeypatch.setattr("os.access", lambda path, mode: str(path) != "port")
    _, found = check(capsys, "gps.port=port")
    assert "group dialout" in found["GPS port"]


@pytest.mark.parametrize("console", ["serial0,115200", "ttyAMA0"])
def test_a_console_on_the_port_is_told_before_listening(
    console: str, bench: Bench, capsys: pytest.CaptureFixture[str]
) -> None:
    Path("cmdline").write_text(f"console={console} console=tty1")
    code, found = check(capsys, "gps.port=/dev/ttyAMA0")
    assert code == 69
    assert f"console ({f'console={console}'})" in found["GPS port"]
    assert "sudo raspi-config nonint do_serial_cons 1" in found["GPS port"]


@pytest.mark.parametrize(
    ("lines", "code", "text"),
    [
        ([b"$GNRMC,120001.00,V,,,,,,,,,,N*"], 0, "warning  no fix yet"),
        ([GGA], 0, "warning  a fix without a date"),
        ([b"$GNVTG,,T,,M,0.0,N,0.0,K,A*"], 69, "FAILED   no sentence has a position"),
    ],
)
def test_a_receiver_that_says_too_little_is_told(
    lines: list[bytes],
    code: int,
    text: str,
    bench: Bench,
    capsys: pytest.CaptureFixture[str],
) -> None:
    bench.lines = [b"noise", *map(checked, lines)]
    exit_code, found = check(capsys)
    assert exit_code == code
    assert found["GPS"].startswith(text)


def test_a_log_that_cannot_be_written_is_exit_73(
    bench: Bench, capsys: pytest.CaptureFixture[str]
) -> None:
    code, found = check(capsys, "log.path=cmdline/log.csv", "record.path=raw.rec")
    assert code == 73
    assert "this user cannot write to cmdline" in found["log"]
    assert found["recording"].startswith("ok ")


def test_a_log_path_with_a_file_of_somebody_else_is_exit_73(
    bench: Bench, capsys: pytest.CaptureFixture[str]
) -> None:
    Path("log.csv").write_text("my shopping list")
    code, found = check(capsys)
    assert code == 73
    assert "imu-tracker did not write this file" in found["log"]


def test_a_disk_that_is_nearly_full_is_a_warning(
    bench: Bench, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    usage = shutil.disk_usage(".")._replace(free=10_000_000)
    monkeypatch.setattr("shutil.disk_usage", lambda path: usage)
    code, found = check(capsys, "log.min_free_mb=500")
    assert code == 0
    assert "10 MB free: below log.min_free_mb" in found["log"]


def test_unwise_settings_are_told(
    bench: Bench, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["check", *HERE, "--set", "imu.rate_hz=50"]) == 0
    assert "warning  configuration  imu.bandwidth_hz = 42" in capsys.readouterr().out


def test_the_sensors_of_a_daemon_that_runs_are_left_alone(
    bench: Bench,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    Path("status.json").write_text(f'{{"t_ns": 5, "pid": {os.getpid()}}}')
    monkeypatch.setattr("time.monotonic_ns", lambda: 6)
    code, found = check(capsys)
    assert code == 0
    assert f"it runs (process {os.getpid()})" in found["daemon"]
    assert bench.bus.transfers == 0


@pytest.mark.parametrize(
    ("overrides", "code", "text"),
    [
        (["source.kind=simulation"], 0, "ok       simulation: drive"),
        (["source.kind=recording", "source.path=a.rec"], 66, "FAILED   a.rec: No such"),
        (["source.kind=recording", "source.path=b.rec"], 0, "ok       recording: b"),
    ],
)
def test_without_hardware_the_source_is_checked(
    overrides: list[str],
    code: int,
    text: str,
    bench: Bench,
    capsys: pytest.CaptureFixture[str],
) -> None:
    main(["simulate", "still", "-q", "--duration", "1", "--output", "b.rec"])
    exit_code, found = check(capsys, *overrides)
    assert exit_code == code
    assert found["source"].startswith(text)


def test_a_recording_holds_what_the_sensors_said_until_the_interrupt(
    bench: Bench, capsys: pytest.CaptureFixture[str]
) -> None:
    bench.end_at_start = True
    handler = signal.getsignal(signal.SIGINT)
    assert main(["record", "--output", "a.rec", "--set", "imu.rate_hz=200"]) == 0
    assert signal.getsignal(signal.SIGINT) is handler
    header, *frames = read_recording(Path("a.rec"))
    assert isinstance(header, SessionHeader)
    assert (header.chip, header.imu_rate_hz) == ("MPU-6050", 200.0)
    assert header.start_utc_s is None
    sources = [frame.source for frame in frames if isinstance(frame, Frame)]
    assert {source: sources.count(source) for source in Source} == {
        Source.IMU: 250,
        Source.GPS: 2,
        Source.EVENT: 1,
    }
    assert capsys.readouterr().err.splitlines() == [
        "gps_open /dev/serial0",
        "a.rec: 250 samples, 2 lines of GPS",
    ]


def test_a_recording_ends_after_its_duration(bench: Bench) -> None:
    assert main(["record", "-q", "--output", "a.rec", "--duration", "1e-9"]) == 0
    assert len(list(read_recording(Path("a.rec")))) == 254


def test_nothing_is_recorded_without_a_chip(
    bench: Bench, capsys: pytest.CaptureFixture[str]
) -> None:
    bench.bus.chips.clear()
    assert main(["record", "--output", "a.rec"]) == 69
    assert "nobody answers" in capsys.readouterr().err
    assert not Path("a.rec").exists()


def test_a_recording_is_never_written_over(
    bench: Bench, capsys: pytest.CaptureFixture[str]
) -> None:
    Path("a.rec").write_text("precious")
    assert main(["record", "--output", "a.rec"]) == 73
    assert capsys.readouterr().err == "a.rec: exists; a recording is a new file\n"
    assert Path("a.rec").read_text() == "precious"


def test_only_hardware_is_recorded(capsys: pytest.CaptureFixture[str]) -> None:
    argv = ["record", "--output", "a.rec", "--set", "source.kind=simulation"]
    assert main(argv) == 78
    assert 'must be "hardware" to record' in capsys.readouterr().err


def test_a_bug_in_a_reader_is_a_bug_of_the_program(
    bench: Bench, capsys: pytest.CaptureFixture[str]
) -> None:
    bench.bug = RuntimeError("oh")
    assert main(["record", "-q", "--output", "a.rec"]) == 70
    assert "RuntimeError: oh" in capsys.readouterr().err


def test_a_good_chip_passes_its_own_test(
    bench: Bench, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["selftest"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == 6
    assert lines[0].startswith("accel x  passed")
    assert "of the factory's response" in lines[0]


def test_the_self_test_names_the_chip_and_why_a_clone_is_not_graded(
    bench: Bench, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["selftest"]) == 0
    assert capsys.readouterr().err == "MPU-6050 (WHO_AM_I 0x68)\n"
    bench.bus.chips[0x68] = FakeMpu6050(bench.clock, who_am_i=0x70)
    assert main(["selftest"]) == 0
    said = capsys.readouterr()
    assert "MPU-6500 (WHO_AM_I 0x70)\nno MPU-6050:" in said.err
    assert said.out.count("not applicable") == 6


def test_a_broken_axis_is_exit_69(
    bench: Bench, capsys: pytest.CaptureFixture[str]
) -> None:
    bench.chip.self_test.health["yg"] = 0.5
    assert main(["selftest"]) == 69
    assert "gyro y   failed" in capsys.readouterr().out
