"""`imu-tracker report` as a user calls it."""

from pathlib import Path

import pytest

from imu_tracker.cli import main
from imu_tracker.recording.files import RecordingWriter
from imu_tracker.samples import SessionHeader
from support.installations import sound


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("recording") / "drive.rec.gz"
    with RecordingWriter(path) as file:
        for item in sound(40.0):
            if isinstance(item, SessionHeader):
                file.write_header(item)
            else:
                file.write(item)
    return path


def test_a_recording_becomes_a_page(recording: Path, tmp_path: Path) -> None:
    page = tmp_path / "drive.html"
    assert main(["report", "-q", str(recording), "--output", str(page)]) == 0
    text = page.read_text(encoding="utf-8")
    assert "Nothing is wrong with this installation." in text
    assert "<h2>The IMU</h2>" in text


def test_the_same_recording_gives_the_same_page(
    recording: Path, tmp_path: Path
) -> None:
    pages = [tmp_path / "1.html", tmp_path / "2.html"]
    for page in pages:
        assert main(["report", "-q", str(recording), "--output", str(page)]) == 0
    assert pages[0].read_bytes() == pages[1].read_bytes()


def test_logs_become_a_page_without_sensors(recording: Path, tmp_path: Path) -> None:
    log, page = tmp_path / "drive.csv", tmp_path / "drive.html"
    assert main(["replay", "-q", str(recording), "--output", str(log)]) == 0
    assert main(["report", "-q", str(log), "--output", str(page)]) == 0
    text = page.read_text(encoding="utf-8")
    assert "A log says nothing of the sensors" in text
    assert "<h2>The IMU</h2>" not in text


def test_a_cut_recording_is_told(recording: Path, tmp_path: Path) -> None:
    cut, page = tmp_path / "cut.rec.gz", tmp_path / "cut.html"
    cut.write_bytes(recording.read_bytes()[:-100])
    assert main(["report", "-q", str(cut), "--output", str(page)]) == 0
    assert "The recording is cut at its end" in page.read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("arguments", "code"),
    [
        (["missing.rec", "--output", "a.html"], 66),
        (["{recording}", "{recording}", "--output", "a.html"], 2),
        (["{recording}", "--output", "{recording}"], 2),
        (["{recording}", "--output", "/nowhere/a.html"], 73),
        (["{recording}", "--output", "a.html", "--set", "filter.profile=boat"], 78),
        (["{garbage}", "--output", "a.html"], 65),
    ],
)
def test_errors_end_in_one_line_and_their_code(
    recording: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    arguments: list[str],
    code: int,
) -> None:
    monkeypatch.chdir(tmp_path)
    garbage = tmp_path / "garbage.rec"
    garbage.write_bytes(b"# imu-tracker recording 1\nno header\n")
    names = {"recording": recording, "garbage": garbage}
    told = [argument.format(**names) for argument in arguments]
    assert main(["report", "-q", *told]) == code
    error = capsys.readouterr().err
    assert len(error.splitlines()) == 1
    assert "Traceback" not in error
    assert not (tmp_path / "a.html").exists()
