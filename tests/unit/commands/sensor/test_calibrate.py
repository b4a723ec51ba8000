"""`calibrate` and `characterise` as users run them: on a fake bus, and recorded."""

import json
import logging
import math
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from fake_i2c import FakeBus, FakeMpu6050
from fake_i2c.world import Feeling
from imu_tracker.cli import main
from imu_tracker.config import load_config
from imu_tracker.recording.files import RecordingWriter
from imu_tracker.samples import Frame
from imu_tracker.sensors import clock as clocks
from imu_tracker.sources import factory as hardware
from imu_tracker.storage.calibration_file import Calibration, read_calibration
from support.fake_clock import FakeClock
from support.fonts import load_fonts
from support.turned_box import SIX, X_UP, Z_DOWN, Z_UP, Box, Vec3

OUT = ["--output", "c.json"]


class Bench:
    """A chip on a bus, lying on a table."""

    def __init__(self) -> None:
        self.clock = FakeClock()
        self.chip = FakeMpu6050(self.clock)
        self.bus = FakeBus(self.clock, {0x68: self.chip})

    def turn(self, *faces: Vec3, each_s: float = 10.0) -> None:
        """Lie on one face after another, with hands between."""
        start_s = self.clock.now_ns() / 1e9

        def feeling(t_s: float) -> Feeling:
            number, since_s = divmod(max(0.0, t_s - start_s - 1.0), each_s)
            face = faces[min(int(number), len(faces) - 1)]
            if since_s < 1.5 and number:
                wobble = 0.3 * math.sin(20.0 * t_s)
                return Feeling((wobble, 0.5, 0.5), (80.0, -60.0, 90.0 * wobble))
            return Feeling(face, (1.0, -2.0, 0.5))

        self.chip.world.follow(feeling)


@pytest.fixture(scope="module", autouse=True)
def _fonts() -> None:
    load_fonts()


@pytest.fixture
def bench(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Iterator[Bench]:
    bench = Bench()
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(clocks, "MonotonicClock", lambda: bench.clock)
    monkeypatch.setattr(hardware, "open_bus", lambda number: bench.bus.open())
    yield bench
    assert bench.bus.open_handles == 0
    logging.getLogger("imu_tracker").handlers = []


def known() -> Calibration:
    return read_calibration(Path("c.json"))


def write(box: Box, name: str = "box.rec") -> str:
    with RecordingWriter(Path(name)) as writer:
        for item in box.stream:
            if isinstance(item, Frame):
                writer.write(item)
            else:
                writer.write_header(item)
    return name


@pytest.mark.parametrize("read", ["fifo", "burst"])
def test_the_bias_of_a_live_gyroscope_is_kept(
    bench: Bench, capsys: pytest.CaptureFixture[str], read: str
) -> None:
    bench.chip.world.feel(gyro_dps=(1.5, -2.0, 0.25), temp_degc=31.0)
    assert main(["calibrate", "gyro", *OUT, "--set", f"imu.read={read}"]) == 0
    gyro = known().gyro
    assert gyro is not None
    bias_dps = [math.degrees(x) for x in gyro.bias_radps]
    assert bias_dps == pytest.approx([1.5, -2.0, 0.25], abs=0.01)
    assert gyro.temp_degc == pytest.approx(31.0, abs=0.1)
    assert gyro.utc is None
    captured = capsys.readouterr()
    assert "+1.5" in captured.out
    assert "do not touch it for 30 s" in captured.err


def test_a_live_gyroscope_that_moves_is_refused(
    bench: Bench, capsys: pytest.CaptureFixture[str]
) -> None:
    bench.turn(Z_UP, X_UP)
    assert main(["calibrate", "gyro", *OUT]) == 65
    captured = capsys.readouterr()
    assert "it moved: lay it on something firm" in captured.err
    assert not Path("c.json").exists()


def test_six_faces_are_guided_live(
    bench: Bench, capsys: pytest.CaptureFixture[str]
) -> None:
    bench.turn(*SIX)
    assert main(["calibrate", "accel", *OUT]) == 0
    said = capsys.readouterr()
    assert said.err.count("is measured: ") == 6
    assert "+z up is measured: now -z up or +x up" in said.err
    assert "all faces are measured" in said.err
    accel = known().accel
    assert accel is not None
    assert accel.bias_mps2 == pytest.approx((0, 0, 0), abs=0.01)


@pytest.mark.parametrize("clock_error", [-0.009, 0.009])
def test_six_faces_are_guided_whatever_the_clock_of_the_chip(
    bench: Bench, clock_error: float
) -> None:
    bench.chip = FakeMpu6050(bench.clock, clock_error=clock_error)
    bench.bus.chips[0x68] = bench.chip
    bench.turn(*SIX)
    assert main(["calibrate", "accel", *OUT, "-q"]) == 0


def test_a_face_seen_twice_is_told_live_and_the_guide_goes_on(
    bench: Bench, capsys: pytest.CaptureFixture[str]
) -> None:
    bench.turn(Z_UP, X_UP, Z_UP, *SIX[2:])
    assert main(["calibrate", "accel", *OUT]) == 0
    assert "+z up was measured already: turn it to" in capsys.readouterr().err


def test_live_faces_that_never_come_end_in_time(
    bench: Bench, capsys: pytest.CaptureFixture[str]
) -> None:
    bench.turn(Z_UP)
    assert main(["calibrate", "accel", *OUT, "--seconds", "30", "-q"]) == 65
    assert "not measured: -z up, +x up" in capsys.readouterr().err


def test_a_level_car_gives_roll_and_pitch(
    bench: Bench, capsys: pytest.CaptureFixture[str]
) -> None:
    lean = math.radians(5.0)
    bench.chip.world.feel(accel_g=(math.sin(lean), 0.0, math.cos(lean)))
    assert main(["calibrate", "mount", *OUT]) == 0
    said = capsys.readouterr().out
    assert "pitch   +5." in said or "pitch   +4.9" in said
    assert "yaw   not measured" in said
    mount = known().mount
    assert mount is not None
    assert mount.rotation[0][0] == pytest.approx(math.cos(lean), abs=1e-3)


def test_a_car_that_stands_on_its_head_is_refused(bench: Bench) -> None:
    bench.chip.world.feel(accel_g=Z_DOWN)
    assert main(["calibrate", "mount", *OUT, "-q"]) == 65


def test_each_part_is_kept_when_another_is_made(bench: Bench) -> None:
    assert main(["calibrate", "gyro", *OUT, "-q"]) == 0
    assert main(["calibrate", "mount", *OUT, "-q"]) == 0
    assert known().gyro is not None
    assert known().mount is not None


def test_a_damaged_file_is_begun_anew(
    bench: Bench, capsys: pytest.CaptureFixture[str]
) -> None:
    Path("c.json").write_text("{")
    assert main(["calibrate", "gyro", *OUT]) == 0
    assert "begun anew" in capsys.readouterr().err
    assert known().gyro is not None


def test_the_file_of_another_chip_is_begun_anew(
    bench: Bench, capsys: pytest.CaptureFixture[str]
) -> None:
    Path("c.json").write_text(Calibration(chip="MPU-6500").model_dump_json())
    assert main(["calibrate", "gyro", *OUT]) == 0
    assert "was of a chip MPU-6500" in capsys.readouterr().err
    assert known().chip == "MPU-6050"


@pytest.mark.parametrize(
    "command", [["calibrate", "gyro"], ["characterise", "--live=5"]]
)
def test_a_chip_that_is_missing_or_dies_is_exit_69(
    bench: Bench, capsys: pytest.CaptureFixture[str], command: list[str]
) -> None:
    bench.bus.nack(after=100, times=1000)
    assert main([*command, "-q"]) == 69
    bench.bus.chips.clear()
    assert main([*command, "-q"]) == 69
    assert capsys.readouterr().err.count("\n") == 2


def test_a_transfer_that_fails_once_is_tried_again(bench: Bench) -> None:
    bench.bus.nack(after=400)
    assert main(["calibrate", "gyro", *OUT, "-q"]) == 0


def test_a_played_source_cannot_be_measured_live(bench: Bench) -> None:
    assert main(["calibrate", "gyro", "-q", "--set", "source.kind=simulation"]) == 78


@pytest.mark.parametrize(
    ("argv", "code"),
    [
        (["calibrate", "gyro", "none.rec"], 66),
        (["calibrate", "gyro", "bad.rec"], 65),
        (["calibrate", "gyro", "bad.rec", "--output", "bad.rec"], 78),
        (["calibrate", "nose"], 2),
        (["calibrate"], 2),
        (["calibrate", "accel", "--latitude", "91"], 2),
        (["calibrate", "gyro", "--set", "imu.calibration="], 78),
        (["characterise"], 2),
        (["characterise", "none.rec"], 66),
        (["characterise", "bad.rec"], 65),
        (["characterise", "empty.rec"], 65),
        (["characterise", "bad.rec", "--live", "5"], 2),
        (["characterise", "--live", "0"], 2),
    ],
)
def test_wrong_use_is_one_line_and_its_exit_code(
    bench: Bench, capsys: pytest.CaptureFixture[str], argv: list[str], code: int
) -> None:
    Path("bad.rec").write_text("garbage\n")
    write(Box(), "empty.rec")
    assert main(argv) == code
    assert capsys.readouterr().err.count("\n") == 1


def test_six_faces_from_a_recording(
    bench: Bench, capsys: pytest.CaptureFixture[str]
) -> None:
    rec = write(Box(bias_g=(0.05, -0.05, 0.05)).be_laid_on(*SIX))
    assert main(["calibrate", "accel", rec, *OUT, "-q"]) == 0
    accel = known().accel
    assert accel is not None
    assert accel.bias_mps2 == pytest.approx((0.49033, -0.49033, 0.49033), abs=0.0098)
    out = capsys.readouterr().out
    assert "residuals" in out
    assert "good" in out


@pytest.mark.parametrize(
    "bias_g",
    [(-0.055, 0.043, -0.18), (0.25, 0.0, -0.1), (-0.25, 0.1, 0.08), (0.0, 0.0, 0.25)],
)
def test_a_clone_that_is_off_by_250_mg_is_measured_and_graded(
    bias_g: Vec3, bench: Bench, capsys: pytest.CaptureFixture[str]
) -> None:
    """Reported as arduino.stackexchange 85054: z is off by 160 mg."""
    rec = write(Box(bias_g=bias_g).be_laid_on(*SIX))
    assert main(["calibrate", "accel", rec, *OUT, "-q"]) == 0
    accel = known().accel
    assert accel is not None
    assert accel.bias_mps2 == pytest.approx([9.80665 * b for b in bias_g], abs=0.01)
    out = capsys.readouterr().out
    limits = (0.05, 0.05, 0.08)
    beyond = sum(abs(b) > limit for b, limit in zip(bias_g, limits, strict=True))
    assert out.count("beyond the datasheet's ") == beyond > 0
    assert "calibrate it where it works" in out


@pytest.mark.parametrize(
    ("box", "problem"),
    [
        (Box().be_laid_on(Z_UP, X_UP, Z_UP), "+z up was measured already"),
        (Box().be_laid_on(Z_UP, Z_DOWN, X_UP, Z_DOWN), "-z up was measured already"),
        (Box().be_laid_on(*SIX, seconds=3.0), "not measured: +z up"),
        (Box().be_held(Z_UP, 60.0), "not measured: +z up"),
        (Box().be_laid_on(*SIX[:5]), "not measured: -y up"),
    ],
)
def test_wrong_use_in_a_recording_is_refused(
    bench: Bench, capsys: pytest.CaptureFixture[str], box: Box, problem: str
) -> None:
    assert main(["calibrate", "accel", write(box), *OUT, "-q"]) == 65
    last = capsys.readouterr().err.splitlines()[-1]
    assert last.startswith("box.rec: ")
    assert problem in last
    assert not Path("c.json").exists()


def test_a_replay_uses_a_calibration_only_when_it_is_named(
    bench: Bench, capsys: pytest.CaptureFixture[str]
) -> None:
    main(["simulate", "still", "--output", "s.rec", "--duration", "40", "-q"])
    assert main(["calibrate", "gyro", "s.rec", *OUT, "-q"]) == 0
    Path("f.toml").write_text('[imu]\ncalibration = "none.json"\n')
    capsys.readouterr()
    biases = []
    for options in ([], ["--config", "f.toml"], ["--set", "imu.calibration=c.json"]):
        assert main(["replay", "s.rec", "--json", "-q", *options]) == 0
        learnt = json.loads(capsys.readouterr().out)["learnt"]
        biases.append([abs(x) for x in _bias_dps(learnt)])
    assert biases[0] == biases[1]
    assert max(biases[0]) > 1.0
    assert max(biases[2]) < 0.05
    Path("c.json").write_text('{"version": 1}')
    assert main(["replay", "s.rec", "-q", "--set", "imu.calibration=c.json"]) == 65


def _bias_dps(learnt: dict[str, Any]) -> list[float]:
    key = next(key for key in learnt if "gyro_bias" in key)
    values: list[float] = learnt[key]
    return values if key.endswith("_dps") else [math.degrees(x) for x in values]


# ----------------------------------------------------------------- characterise


def test_a_live_chip_is_characterised(
    bench: Bench, capsys: pytest.CaptureFixture[str]
) -> None:
    bench.chip.world.feel(gyro_dps=(1.5, 0.0, 0.0))
    argv = ["characterise", "--live", "60", "--json", "--plot", "p.png"]
    assert main(argv) == 0
    found = json.loads(capsys.readouterr().out)
    gyro = found["axes"]["gyro x"]
    assert math.degrees(gyro["mean"]) == pytest.approx(1.5, abs=0.01)
    # The fake's noise: 3 counts of 65.5 per deg/s, and rounding.
    spread = math.hypot(3.0, math.sqrt(1 / 12)) / 65.5
    assert math.degrees(gyro["std"]) == pytest.approx(spread, rel=0.05)
    assert found["rate_hz"] == pytest.approx(100.0, rel=0.001)
    walk = gyro["noise"]["random_walk"]
    assert math.degrees(walk["value"]) == pytest.approx(spread / 10.0, rel=0.05)
    assert walk["low95"] < walk["value"] < walk["high95"]
    assert {axis["verdict"] for axis in found["axes"].values()} <= {"good", "noisy"}
    assert Path("p.png").read_bytes().startswith(b"\x89PNG")


def test_its_last_lines_are_a_configuration(
    bench: Bench, capsys: pytest.CaptureFixture[str]
) -> None:
    rec = write(Box().lie(Z_DOWN, 60.0))
    assert main(["characterise", rec]) == 0
    text = capsys.readouterr().out
    lines = text[text.index("[imu]") :]
    assert tomllib.loads(lines)["imu"]["mount"] == ["+x", "+y", "+z"]
    Path("paste.toml").write_text(lines)
    assert load_config(Path("paste.toml")).imu.rate_hz == 50
    assert "temperature slope: not to be told from" in text


def test_a_recording_that_moves_says_so_and_uses_the_rest(
    bench: Bench, capsys: pytest.CaptureFixture[str]
) -> None:
    rec = write(Box().lie(Z_UP, 20.0).be_held(Z_UP, 20.0).lie(Z_UP, 20.0))
    assert main(["characterise", rec]) == 0
    assert "it moves: only the" in capsys.readouterr().err
    assert main(["characterise", write(Box().be_held(Z_UP, 30.0)), "-q"]) == 65
    assert "box.rec: moves all the time" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("axis", "value", "reason"),
    [
        ("gyro y", 0, "always reads the same"),
        ("accel x", 32767, "at the end of the range"),
        ("gyro z", 3500, "while still"),
    ],
)
def test_a_broken_axis_is_named(
    bench: Bench,
    capsys: pytest.CaptureFixture[str],
    axis: str,
    value: int,
    reason: str,
) -> None:
    box = Box().lie(Z_UP, 30.0)
    place = 2 * {"accel x": 0, "gyro y": 5, "gyro z": 6}[axis]
    for i, frame in enumerate(box.frames):
        noisy = value - (0 if axis == "gyro y" else i % 2)
        data = bytearray(frame.data)
        data[place : place + 2] = noisy.to_bytes(2, "big", signed=True)
        box.frames[i] = frame._replace(data=bytes(data))
    assert main(["characterise", write(box), "--json", "-q"]) == 0
    axes = json.loads(capsys.readouterr().out)["axes"]
    assert axes[axis]["verdict"] == "broken axis"
    assert reason in axes[axis]["reason"]
    assert sum(a["verdict"] == "broken axis" for a in axes.values()) == 1


def test_a_noisy_axis_is_told_from_a_good_one(
    bench: Bench, capsys: pytest.CaptureFixture[str]
) -> None:
    bench.chip = FakeMpu6050(bench.clock, noise_counts=12.0)
    bench.bus.chips[0x68] = bench.chip
    assert main(["characterise", "--live", "30", "--json", "-q"]) == 0
    axes = json.loads(capsys.readouterr().out)["axes"]
    assert {axes[f"gyro {i}"]["verdict"] for i in "xyz"} == {"noisy"}
    assert {axes[f"accel {i}"]["verdict"] for i in "xyz"} == {"good"}


def test_the_shortest_stillness_is_drawn_without_any_fit(
    bench: Bench, capsys: pytest.CaptureFixture[str]
) -> None:
    rec = write(Box().lie(Z_UP, 6.0))
    assert main(["characterise", rec, "--plot", "p.png", "-q"]) == 0
    assert "too short, or always the same" in capsys.readouterr().out
    assert Path("p.png").read_bytes().startswith(b"\x89PNG")
