"""Simulate, replay and plot: from a scenario to a score and a picture."""

import gzip
import json
import os
from pathlib import Path

import pytest

from imu_tracker.cli import main
from imu_tracker.recording.files import read_recording
from imu_tracker.samples import Frame, SessionHeader, Source
from imu_tracker.sensors import clock
from support.fonts import load_fonts

HEADER = "time_utc,lat_deg,lon_deg,alt_m,speed_mps,course_deg,r95_m,mode"


@pytest.fixture(scope="module", autouse=True)
def _fonts() -> None:
    load_fonts()


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with drive.rec, two minutes of a drive, and truth.csv."""
    folder = tmp_path_factory.mktemp("drive")
    argv = ["simulate", "drive", "-q", "--duration", "120", "--seed", "3"]
    output = [
        "--output",
        str(folder / "drive.rec"),
        "--truth",
        str(folder / "truth.csv"),
    ]
    assert main([*argv, *output]) == 0
    return folder


@pytest.fixture
def drive(folder: Path) -> str:
    return str(folder / "drive.rec")


@pytest.fixture
def truth(folder: Path) -> str:
    return str(folder / "truth.csv")


@pytest.fixture(autouse=True)
def _in_a_folder_of_its_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def test_a_simulation_is_the_same_for_the_same_seed(folder: Path) -> None:
    argv = ["simulate", "drive", "-q", "--duration", "120"]
    assert main([*argv, "--seed", "3", "--output", "again.rec"]) == 0
    assert main([*argv, "--seed", "4", "--output", "other.rec"]) == 0
    assert Path("again.rec").read_bytes() == (folder / "drive.rec").read_bytes()
    assert Path("other.rec").read_bytes() != Path("again.rec").read_bytes()


def test_a_simulation_follows_the_configuration() -> None:
    overrides = ["imu.rate_hz=200", "imu.accel_range_g=8", 'imu.mount=["+y","+x","-z"]']
    argv = [part for override in overrides for part in ("--set", override)]
    main(["simulate", "still", "-q", "--duration", "5", "--output", "a.rec.gz", *argv])
    header, *frames = read_recording(Path("a.rec.gz"))
    assert isinstance(header, SessionHeader)
    assert (header.imu_rate_hz, header.accel_range_g) == (200.0, 8)
    assert header.mount == ("+y", "+x", "-z")
    samples = [f for f in frames if isinstance(f, Frame) and f.source is Source.IMU]
    assert len(samples) == pytest.approx(1000, rel=0.02)
    assert Path("a.rec.gz").read_bytes().startswith(b"\x1f\x8b")


def test_the_truth_of_a_simulation_is_a_table(truth: str) -> None:
    lines = Path(truth).read_text().splitlines()
    assert lines[0] == "time_utc,lat_deg,lon_deg,alt_m"
    assert lines[1].startswith("2026-11-22T12:00:00.000Z,52.0")
    assert len(lines) == 1 + 120 * 4 + 1


@pytest.mark.parametrize(
    ("argv", "problem"),
    [
        (["simulate", "fly", "--output", "a.rec"], "fly: no such scenario; there are"),
        (
            ["simulate", "still", "--output", "a.rec", "--gps-every", "0.33"],
            "--gps-every 0.33: must be a multiple of 0.05",
        ),
        (
            ["simulate", "still", "--output", "a.rec", "--gps-every", "1e30"],
            "--gps-every 1e+30: must be a multiple of 0.05, 3600 at most",
        ),
        (["simulate", "still", "--output", "-"], "must be a file, not stdout"),
        (
            ["simulate", "still", "--output", "a.rec", "--truth", "a.rec"],
            "a.rec: would be overwritten",
        ),
    ],
)
def test_a_simulation_that_cannot_be_is_wrong_usage(
    argv: list[str], problem: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(argv) == 2
    err = capsys.readouterr().err
    assert problem in err
    assert err.count("\n") == 1


def test_a_replay_writes_the_log_to_stdout_by_itself(
    drive: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["replay", drive]) == 0
    captured = capsys.readouterr()
    lines = captured.out.splitlines()
    assert lines[0] == HEADER
    assert len(lines) > 400
    assert captured.err.splitlines()[-1].startswith(f"{drive}: 120 s, ")


def test_a_replay_to_a_file_says_nothing_on_stdout_and_replaces_it(
    drive: str, capsys: pytest.CaptureFixture[str]
) -> None:
    Path("log.csv").write_text("old\n" * 100_000)
    assert main(["replay", drive, "-q", "--output", "log.csv"]) == 0
    captured = capsys.readouterr()
    assert (captured.out, captured.err) == ("", "")
    assert main(["replay", drive, "-q", "--output", "-"]) == 0
    assert capsys.readouterr().out == Path("log.csv").read_text()


def test_a_score_is_a_table_and_no_log(
    drive: str, truth: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["replay", drive, "-q", "--truth", truth]) == 0
    out = capsys.readouterr().out
    assert "inside r95" in out
    assert HEADER not in out


def test_the_score_and_what_was_learnt_are_one_json_object(
    drive: str, truth: str, capsys: pytest.CaptureFixture[str]
) -> None:
    argv = ["replay", drive, "-q", "--truth", truth, "--json"]
    assert main([*argv, "--gps-outage", "60:20", "--gps-outage", "90:10"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert result["recording"] == drive
    assert result["sessions"] == 1
    assert result["duration_s"] == pytest.approx(120, abs=0.1)
    assert result["learnt"]["profile"] == "vehicle"
    assert result["counters"]["fixes"] > 70
    score = result["score"]
    assert score["with_gps"]["rms"] < 10
    assert len(score["outage_end_error"]) == 2
    assert score["outage"]["n"] == 81 + 41


def test_outages_are_scored_without_a_start_in_the_header_as_well(
    folder: Path, truth: str, capsys: pytest.CaptureFixture[str]
) -> None:
    text = (folder / "drive.rec").read_text()
    Path("a.rec").write_text(text.replace(', "start_utc": "2026-11-22T12:00:00Z"', ""))
    scores = []
    for recording in ("a.rec", str(folder / "drive.rec")):
        argv = ["replay", recording, "-q", "--truth", truth, "--json"]
        assert main([*argv, "--gps-outage", "60:20"]) == 0
        scores.append(json.loads(capsys.readouterr().out)["score"]["outage"])
    assert scores[0]["n"] == pytest.approx(scores[1]["n"], abs=1)
    assert scores[0]["rms"] == pytest.approx(scores[1]["rms"], rel=0.05)


def test_a_person_at_a_terminal_sees_how_far_it_is(
    drive: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("sys.stderr.isatty", lambda: True)
    monkeypatch.setattr("tqdm.tqdm.monitor_interval", 0)  # no thread that stays
    assert main(["replay", drive, "--output", "log.csv"]) == 0
    assert " records/s" in capsys.readouterr().err


def test_json_without_truth_has_no_score(
    drive: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["replay", drive, "-q", "--json", "--output", "log.csv"]) == 0
    assert "score" not in json.loads(capsys.readouterr().out)
    assert Path("log.csv").read_text().startswith(HEADER)


def fixes(argv: list[str], capsys: pytest.CaptureFixture[str]) -> int:
    assert main(["replay", "-q", "--json", *argv]) == 0
    count = json.loads(capsys.readouterr().out)["counters"]["fixes"]
    assert isinstance(count, int)
    return count


def test_outages_and_thinning_take_fixes_away(
    drive: str, capsys: pytest.CaptureFixture[str]
) -> None:
    everything = fixes([drive], capsys)
    assert fixes([drive, "--gps-outage", "60:20"], capsys) == everything - 20
    assert fixes([drive, "--gps-every", "5"], capsys) == pytest.approx(
        everything / 5, abs=1
    )


def test_what_is_set_goes_before_the_header(
    drive: str, capsys: pytest.CaptureFixture[str]
) -> None:
    argv = ["replay", drive, "-q", "--json", "--set", "filter.profile=walker"]
    assert main(argv) == 0
    assert json.loads(capsys.readouterr().out)["learnt"]["profile"] == "walker"


def test_the_start_may_be_set(drive: str, capsys: pytest.CaptureFixture[str]) -> None:
    # The receiver says 2026; what is told is that 1024 weeks had rolled over by then.
    argv = ["replay", drive, "-q", "--set", "source.start_utc=2046-07-08T12:00:00Z"]
    assert main(argv) == 0
    assert capsys.readouterr().out.splitlines()[1].startswith("2046-07-08T12:00:")


def test_a_recording_without_any_fix_is_a_log_with_its_header_alone(
    drive: str, truth: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["replay", drive, "-q", "--gps-outage", "0:1000"]) == 0
    assert capsys.readouterr().out == f"{HEADER}\n"
    argv = ["replay", drive, "-q", "--gps-outage", "0:1000", "--truth", truth]
    assert main([*argv, "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["score"]["outage_end_error"] == [None]


def test_sessions_follow_one_another_and_time_never_goes_back(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    twice = (folder / "drive.rec").read_bytes() * 2
    Path("twice.rec.gz").write_bytes(gzip.compress(twice))
    assert main(["replay", "twice.rec.gz", "-q"]) == 0
    times = [line.split(",")[0] for line in capsys.readouterr().out.splitlines()[1:]]
    assert times == sorted(set(times))
    assert main(["replay", "twice.rec.gz", "--json"]) == 0
    captured = capsys.readouterr()
    result = json.loads(captured.out)
    assert result["counters"]["skipped_rows"] > 300
    assert "left out (their times are those of earlier rows)" in captured.err
    assert result["sessions"] == 2
    assert result["duration_s"] == pytest.approx(240, abs=1)


def test_a_replay_at_a_speed_waits_for_the_frames(
    drive: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    from support.fake_clock import FakeClock

    fake = FakeClock(0)
    monkeypatch.setattr(clock, "MonotonicClock", lambda: fake)
    assert main(["replay", drive, "-q", "--speed", "4"]) == 0
    assert fake.now_ns() / 1e9 == pytest.approx(30, abs=0.1)
    at_once = capsys.readouterr().out
    assert main(["replay", drive, "-q"]) == 0
    assert capsys.readouterr().out == at_once


def test_a_recording_that_is_not_there_is_exit_66_and_leaves_no_log(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main(["replay", "none.rec", "--output", "log.csv"]) == 66
    assert capsys.readouterr().err == "none.rec: No such file or directory\n"
    assert not Path("log.csv").exists()


def test_a_malformed_recording_is_exit_65_with_path_and_line(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    lines = (folder / "drive.rec").read_bytes().splitlines(keepends=True)
    lines[99] = b"I 12 xyz\n"
    Path("bad.rec").write_bytes(b"".join(lines))
    assert main(["replay", "bad.rec", "-q"]) == 65
    assert capsys.readouterr().err.startswith("bad.rec:100: ")


@pytest.mark.parametrize(
    ("argv", "code", "problem"),
    [
        (["--output", "none/log.csv"], 73, "none/log.csv: No such file"),
        (["--output", "."], 73, ".: Is a directory"),
        (["--truth", "none.csv"], 66, "none.csv: No such file"),
        (["--config", "none.toml"], 78, "none.toml: no such file"),
        (["--set", "imu.rate_hz=5000"], 78, "imu.rate_hz = 5000: must be"),
        (["--set", "imu.calibration=c.json"], 66, "c.json: No such file"),
    ],
)
def test_a_replay_that_cannot_be_is_one_line(
    argv: list[str],
    code: int,
    problem: str,
    drive: str,
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main(["replay", drive, "-q", *argv]) == code
    captured = capsys.readouterr()
    assert captured.out == ""
    assert problem in captured.err
    assert captured.err.count("\n") == 1


def test_a_log_never_overwrites_what_it_comes_from(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    Path("link.csv").symlink_to(folder / "drive.rec")
    before = (folder / "drive.rec").read_bytes()
    argv = ["replay", str(folder / "drive.rec"), "--output", "link.csv"]
    assert main(argv) == 2
    assert "would be overwritten" in capsys.readouterr().err
    assert (folder / "drive.rec").read_bytes() == before


def test_logs_and_recordings_become_pictures(
    drive: str, truth: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["replay", drive, "-q", "--output", "log.csv"]) == 0
    assert main(["plot", "log.csv", "--truth", truth, "--output", "log.png"]) == 0
    assert main(["plot", drive, "--output", "raw.png"]) == 0
    assert capsys.readouterr().err == "log.png: written\nraw.png: written\n"
    for name in ("log.png", "raw.png"):
        assert Path(name).read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize("name", [b"d\xff.rec", rb"$\no{$.rec", b"_.rec"])
def test_a_picture_is_drawn_of_a_file_of_any_name(drive: str, name: bytes) -> None:
    recording = os.fsdecode(name)
    Path(recording).write_bytes(Path(drive).read_bytes())
    assert main(["replay", recording, "-q", "--output", f"{recording}.csv"]) == 0
    assert main(["plot", recording, "--output", "raw.png"]) == 0
    assert main(["plot", f"{recording}.csv", "--output", "log.png"]) == 0


def test_a_picture_does_not_go_to_stdout(
    drive: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["plot", drive, "--output", "-"]) == 2
    assert "--output: must be a file, not stdout" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("argv", "code", "problem"),
    [
        (["none.csv"], 66, "none.csv: No such file"),
        (["TRUTH"], 65, "expected the header time_utc,lat_deg,lon_deg,alt_m,speed"),
        (["DRIVE", "TRUTH"], 2, "a recording is drawn alone"),
        (["DRIVE", "--truth", "TRUTH"], 2, "a recording is drawn alone"),
        (["empty.csv"], 65, "empty.csv: no rows to draw"),
        (["a.png"], 2, "a.png: would be overwritten"),
    ],
)
def test_what_cannot_be_drawn_is_one_line(
    argv: list[str],
    code: int,
    problem: str,
    drive: str,
    truth: str,
    capsys: pytest.CaptureFixture[str],
) -> None:
    Path("empty.csv").write_text(f"{HEADER}\n")
    names = {"DRIVE": drive, "TRUTH": truth}
    argv = [names.get(word, word) for word in argv]
    assert main(["plot", *argv, "--output", "a.png"]) == code
    err = capsys.readouterr().err
    assert problem in err
    assert err.count("\n") == 1


def test_smooth_has_the_rows_of_replay_and_is_nearer_in_the_outage(
    drive: str, truth: str, capsys: pytest.CaptureFixture[str]
) -> None:
    scores, rows = [], []
    for command in ("replay", "smooth"):
        argv = [command, drive, "-q", "--truth", truth, "--json", "--gps-outage"]
        assert main([*argv, "60:30", "--output", f"{command}.csv"]) == 0
        scores.append(json.loads(capsys.readouterr().out)["score"]["outage"])
        rows.append(Path(f"{command}.csv").read_text().splitlines())
    assert rows[1][0] == HEADER
    assert [row.partition(",")[0] for row in rows[0]] == [
        row.partition(",")[0] for row in rows[1]
    ]
    assert scores[1]["rms"] < scores[0]["rms"]


def test_only_the_error_state_filter_can_be_smoothed(
    drive: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["smooth", drive, "--set", "filter.estimator=six-state"]) == 78
    assert "filter.estimator = six-state" in capsys.readouterr().err
