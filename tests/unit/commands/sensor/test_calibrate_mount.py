"""`calibrate mount` as it guides a driver: level first, then a drive."""

import logging
import math
from collections.abc import Generator, Iterator
from pathlib import Path
from typing import Any

import pytest

from imu_tracker.cli import main
from imu_tracker.geometry.rotation import matrix
from imu_tracker.samples import Frame, SessionHeader, Source
from imu_tracker.simulation import simulate
from imu_tracker.simulation.simulator import Simulated
from imu_tracker.sources import polled as live_imu
from imu_tracker.storage.calibration_file import MountPart, read_calibration
from support.turned_box import Z_DOWN, Z_UP, Box

OUT = ["--output", "c.json"]


@pytest.fixture(autouse=True)
def _folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    monkeypatch.chdir(tmp_path)
    yield
    logging.getLogger("imu_tracker").handlers = []


class Live:
    """Plays frames in place of the chip, and counts what was taken of them."""

    def __init__(self, header: SessionHeader, frames: Iterator[Frame]) -> None:
        self.header, self.frames, self.taken = header, frames, 0

    def stream(
        self, *_: Any, with_gps: bool = False
    ) -> Generator[SessionHeader | Frame, None, None]:
        yield self.header
        for frame in self.frames:
            if with_gps or frame.source is Source.IMU:
                self.taken += 1
                yield frame


def play(monkeypatch: pytest.MonkeyPatch, live: Live) -> Live:
    monkeypatch.setattr(live_imu, "live_frames", live.stream)
    return live


def a_drive(seed: int = 3) -> Simulated:
    return simulate("drive", seed=seed, duration_s=240.0)


def mount_of() -> MountPart:
    mount = read_calibration(Path("c.json")).mount
    assert mount is not None
    return mount


def test_level_then_drive_is_guided_and_finds_the_mounting(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    simulated = a_drive()
    play(monkeypatch, Live(simulated.header, simulated.frames))
    assert main(["calibrate", "mount", "--drive", "200", *OUT]) == 0
    said = capsys.readouterr()
    steps = ("park on level ground", "roll ", "Now drive about for 200 s", "written")
    places = [said.err.index(step) for step in steps]
    assert places == sorted(places)
    assert "yaw   " in said.out
    assert "not measured" not in said.out
    found = mount_of()
    assert found.yaw_sigma_deg is not None
    # Yaw of the vehicle in the box, against how it was glued in.
    true, told = matrix(simulated.chip.q_vb), found.rotation
    error_deg = math.degrees(
        math.atan2(told[1][0], told[0][0]) - math.atan2(true[1][0], true[0][0])
    )
    assert abs(error_deg) < 3.0 * found.yaw_sigma_deg + 0.5


def test_hands_are_waited_for_before_anybody_drives(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    box = Box().lie(Z_UP, 4.0).be_held(Z_UP, 6.0).lie(Z_UP, 12.0)
    play(monkeypatch, Live(SessionHeader(4, 500, 50), iter(box.frames)))
    assert main(["calibrate", "mount", *OUT]) == 0
    assert capsys.readouterr().err.count("it moves: waiting for 10 s") == 1
    assert mount_of().rotation[0][0] == pytest.approx(1.0, abs=1e-4)


def test_what_never_stands_still_is_refused_in_time(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    box = Box().be_held(Z_UP, 200.0)
    live = play(monkeypatch, Live(SessionHeader(4, 500, 50), iter(box.frames)))
    assert main(["calibrate", "mount", "--drive", "600", *OUT, "-q"]) == 65
    assert "it never stood still for 10 s" in capsys.readouterr().err
    assert live.taken < 135 * 50
    assert not Path("c.json").exists()


def test_a_box_on_its_head_is_refused_before_the_drive(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    box = Box().lie(Z_DOWN, 60.0)
    live = play(monkeypatch, Live(SessionHeader(4, 500, 50), iter(box.frames)))
    assert main(["calibrate", "mount", "--drive", "600", *OUT, "-q"]) == 65
    assert "set imu.mount first" in capsys.readouterr().err
    assert live.taken < 12 * 50


def test_a_stop_on_the_way_is_not_taken_for_the_level(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """It stands level, and later on a slope: only the first counts."""
    lean = math.radians(8.0)
    slope = (math.sin(lean), 0.0, math.cos(lean))
    box = Box().lie(Z_UP, 11.0).be_turned(Z_UP, slope).lie(slope, 40.0)
    play(monkeypatch, Live(SessionHeader(4, 500, 50), iter(box.frames)))
    assert main(["calibrate", "mount", *OUT, "-q"]) == 0
    assert mount_of().rotation[0][0] == pytest.approx(1.0, abs=1e-4)


def test_a_drive_without_a_receiver_is_told_at_once_and_refused(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    box = Box().lie(Z_UP, 40.0)
    play(monkeypatch, Live(SessionHeader(4, 500, 50), iter(box.frames)))
    assert main(["calibrate", "mount", "--drive", "20", *OUT]) == 65
    said = capsys.readouterr().err
    assert said.index("nothing is heard of the receiver") < said.index("Now drive")
    assert "only 0 seconds of speeding up" in said


def test_a_recording_says_where_it_was_level(
    capsys: pytest.CaptureFixture[str],
) -> None:
    main(["simulate", "drive", "--duration", "60", "--output", "d.rec", "-q"])
    assert main(["calibrate", "mount", "d.rec", *OUT]) == 0
    assert "level where it stands from second 0 to" in capsys.readouterr().err
