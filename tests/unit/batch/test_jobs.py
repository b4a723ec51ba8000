"""One recording of a batch, and what is left of it."""

import errno
import json
from pathlib import Path

import pytest

from imu_tracker.batch import jobs as module
from imu_tracker.batch.jobs import Job, done_before, find_jobs, run_job
from imu_tracker.cli import main
from imu_tracker.config import load_config
from imu_tracker.errors import InputMissingError, OutputError, UsageError
from imu_tracker.recording.files import RecordingWriter, read_recording
from imu_tracker.report.collect import Tracked
from imu_tracker.samples import SessionHeader
from support.installations import sound


def write(path: Path, duration_s: float = 30.0) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    with RecordingWriter(path) as file:
        for item in sound(duration_s):
            if isinstance(item, SessionHeader):
                file.write_header(item)
            else:
                file.write(item)
    return path


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write(tmp_path_factory.mktemp("in") / "drive.rec.gz")


def job_of(recording: Path, output: Path, *overrides: str) -> Job:
    (job,) = find_jobs([str(recording)], output, None, list(overrides))
    return job


def test_the_log_is_that_of_replay_and_the_figures_those_of_report(
    recording: Path, tmp_path: Path
) -> None:
    job = job_of(recording, tmp_path)
    (tmp_path / ".drive.csv.4711.new").write_text("of a worker that was killed")
    line = run_job(job)
    assert {path.name for path in tmp_path.iterdir()} == {"drive.csv", "drive.json"}
    alone = tmp_path / "alone.csv"
    assert main(["replay", "-q", str(recording), "--output", str(alone)]) == 0
    assert job.log.read_bytes() == alone.read_bytes()
    tracked = Tracked("x", load_config(None, []))
    assert sum(1 for _ in tracked.rows(read_recording(recording))) == line["rows"]
    overall = tracked.collected().track.overall()
    assert overall is not None
    assert line["nis"] == overall.nis
    assert line["failed"] == ""
    assert line["faults"] == ""


def test_a_smoothed_log_is_that_of_smooth_and_the_figures_stay(
    recording: Path, tmp_path: Path
) -> None:
    line = run_job(job_of(recording, tmp_path / "out"))
    job = job_of(recording, tmp_path / "out")._replace(is_smoothed=True)
    assert done_before(job) is None
    smoothed = run_job(job)
    alone = tmp_path / "alone.csv"
    assert main(["smooth", "-q", str(recording), "--output", str(alone)]) == 0
    assert job.log.read_bytes() == alone.read_bytes()
    assert {**smoothed, "job": ""} == {**line, "job": ""}


def test_a_job_that_was_done_is_known_again_until_something_changes(
    recording: Path, tmp_path: Path
) -> None:
    copy = tmp_path / "drive.rec.gz"
    copy.write_bytes(recording.read_bytes())
    out = tmp_path / "out"
    job = job_of(copy, out)
    assert done_before(job) is None
    line = run_job(job)
    assert done_before(job) == line
    assert done_before(job_of(copy, out, "filter.profile=walker")) is None
    job.log.unlink()
    assert done_before(job) is None
    run_job(job)
    copy.write_bytes(recording.read_bytes()[:-50])
    assert done_before(job) is None
    job.result.write_text("{", "utf-8")
    assert done_before(job) is None


def test_a_corrupt_recording_is_told_with_its_line_and_done(tmp_path: Path) -> None:
    bad = tmp_path / "bad.rec"
    bad.write_bytes(b"# imu-tracker recording 1\n# {}\n")
    job = job_of(bad, tmp_path / "out")
    line = run_job(job)
    assert "bad.rec:2" in line["failed"]
    assert not job.log.exists()
    assert done_before(job) == line


def test_a_full_disk_is_told_leaves_nothing_and_is_tried_again(
    recording: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(path: Path, rows: object) -> None:
        path.write_text("half a log", "utf-8")
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(module, "_write", refuse)
    job = job_of(recording, tmp_path)
    with pytest.raises(OutputError, match="No space left on device"):
        run_job(job)
    assert list(tmp_path.iterdir()) == []
    assert done_before(job) is None


def test_recordings_are_found_below_folders_by_globs_and_once(tmp_path: Path) -> None:
    names = [
        "a.rec",
        "sub/a.rec.gz",
        "sub/deep/b.rec",
        "sub/a.txt",
        "c.rec",
        "c.rec.gz",
    ]
    for name in names:
        path = tmp_path / "in" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.touch()
    patterns = [str(tmp_path / "in"), str(tmp_path / "in" / "*.rec")]
    jobs = find_jobs(patterns, tmp_path / "out", None, [])
    assert [job.name for job in jobs] == [
        *("a.rec", "c.rec", "c.rec.gz"),
        *("sub/a.rec.gz", "sub/deep/b.rec"),
    ]
    logs = [str(job.log.relative_to(tmp_path / "out")) for job in jobs]
    assert logs == ["a.csv", "c.csv", "c-gz.csv", "sub/a.csv", "sub/deep/b.csv"]


def test_no_recordings_are_an_error(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="no recording"):
        find_jobs([str(tmp_path)], tmp_path, None, [])
    with pytest.raises(InputMissingError, match="no such file"):
        find_jobs([str(tmp_path / "*.rec")], tmp_path, None, [])


def test_a_line_is_json_that_any_reader_takes(recording: Path, tmp_path: Path) -> None:
    job = job_of(recording, tmp_path)
    line = run_job(job)
    assert json.loads(job.result.read_text("utf-8")) == line
    assert "NaN" not in job.result.read_text("utf-8")
