"""Real workers: each batch in a process of its own, for Dask leaves threads behind."""

import csv
import json
import os
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pytest

from support.paths import REPOSITORY
from unit.batch.test_jobs import write

pytestmark = pytest.mark.skipif(
    find_spec("distributed") is None, reason="no dask.distributed here"
)

ENVIRONMENT = {
    **os.environ,
    "PYTHONPATH": f"{REPOSITORY / 'src'}:{REPOSITORY / 'tests'}",
}


def python(*arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, *arguments],
        env=ENVIRONMENT,
        cwd=REPOSITORY,
        capture_output=True,
        text=True,
        check=False,
    )


def batch(*arguments: str) -> subprocess.CompletedProcess[str]:
    return python("-m", "imu_tracker", "batch", *arguments)


def table(output: Path) -> dict[str, dict[str, str]]:
    with (output / "batch.csv").open(encoding="utf-8", newline="") as file:
        return {row["recording"]: row for row in csv.DictReader(file)}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("recordings")
    whole = write(folder / "a.rec.gz", 20.0)
    (folder / "b").mkdir()
    (folder / "b" / "c.rec.gz").write_bytes(whole.read_bytes())
    (folder / "cut.rec.gz").write_bytes(whole.read_bytes()[:-2000])
    (folder / "empty.rec").touch()
    (folder / "bad.rec.gz").write_bytes(b"\x1f\x8bnot gzip")
    return folder


def test_bad_files_fail_alone_and_what_is_done_is_not_done_again(
    folder: Path, tmp_path: Path
) -> None:
    first = batch(str(folder), "--output", str(tmp_path), "--workers", "2")
    assert first.returncode == 0, first.stderr
    assert "Traceback" not in first.stderr
    rows = table(tmp_path)
    failed = {name for name, row in rows.items() if row["failed"]}
    assert failed == {"empty.rec", "bad.rec.gz"}
    assert set(rows) - failed == {"a.rec.gz", "b/c.rec.gz", "cut.rec.gz"}
    assert {**rows["a.rec.gz"], "recording": ""} == {
        **rows["b/c.rec.gz"],
        "recording": "",
    }
    assert "cut" in rows["cut.rec.gz"]["faults"].split()

    # As after a kill -9: one result is missing, and so is the table.
    before = (tmp_path / "b" / "c.csv").stat().st_mtime_ns
    whole = (tmp_path / "batch.csv").read_bytes()
    for name in ("a.json", "batch.csv"):
        (tmp_path / name).unlink()
    second = batch(str(folder), "--output", str(tmp_path), "--workers", "1", "--resume")
    assert second.returncode == 0, second.stderr
    assert "4 of 5 were done before" in second.stderr
    assert (tmp_path / "batch.csv").read_bytes() == whole
    assert (tmp_path / "b" / "c.csv").stat().st_mtime_ns == before


def test_a_recording_that_kills_its_worker_fails_alone(
    folder: Path, tmp_path: Path
) -> None:
    recordings = tmp_path / "in"
    for name in ("a", "deadly", "z"):
        path = recordings / f"{name}.rec.gz"
        path.parent.mkdir(exist_ok=True)
        path.write_bytes((folder / "a.rec.gz").read_bytes())
    done = python("-m", "support.deadly", str(recordings), str(tmp_path / "out"))
    assert done.returncode == 0, done.stderr
    lines: list[dict[str, Any]] = json.loads(done.stdout)
    reasons = {line["recording"]: line["failed"] for line in lines}
    assert reasons.pop("deadly.rec.gz").startswith("its worker was killed")
    assert reasons == {"a.rec.gz": "", "z.rec.gz": ""}


def test_a_scheduler_that_is_not_there_is_told(folder: Path, tmp_path: Path) -> None:
    code = (
        "import imu_tracker.batch.cluster as c; c.PATIENCE_S = 1;"
        "from imu_tracker.cli import main;"
        f"raise SystemExit(main(['batch', '-q', {str(folder)!r}, '--output',"
        f" {str(tmp_path)!r}, '--scheduler', 'tcp://127.0.0.1:9']))"
    )
    done = python("-c", code)
    assert done.returncode == 2
    assert "no scheduler answers there" in done.stderr
    assert len(done.stderr.splitlines()) == 1
