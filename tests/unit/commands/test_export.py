"""`imu-tracker export`: what files come of it, and what of files that are no logs."""

import gzip
import json
import os
import threading
from pathlib import Path
from xml.etree import ElementTree as ET

import pytest

from imu_tracker.cli import main

HEADER = "time_utc,lat_deg,lon_deg,alt_m,speed_mps,course_deg,r95_m,mode\n"
FORMATS = ("gpx", "kml", "geojson", "nmea", "html")


@pytest.fixture(autouse=True)
def _in_a_folder_of_its_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def rows(*seconds: int) -> str:
    return HEADER + "".join(
        f"2026-11-22T12:00:{second:02d}.000Z,51.99000012,4.37000034,5.2,1.38,40.1,"
        "3.94,gps\n"
        for second in seconds
    )


def files() -> list[str]:
    return sorted(path.name for path in Path().iterdir())


def export(kind: str, *more: str) -> int:
    return main(["export", "--format", kind, *more])


@pytest.mark.parametrize("kind", FORMATS)
def test_rotated_logs_become_one_file(
    kind: str, capsys: pytest.CaptureFixture[str]
) -> None:
    Path("a-20261122T120000Z.csv.gz").write_bytes(gzip.compress(rows(0, 1).encode()))
    Path("a.csv").write_text(rows(2, 3))
    logs = ["a.csv", "a-20261122T120000Z.csv.gz"]
    assert export(kind, *logs, "--output", "out") == 0
    text = Path("out").read_text()
    assert "a-20261122T120000Z.csv.gz" in text or kind == "nmea"
    assert capsys.readouterr().err == "out: written, 4 rows\n"
    assert files() == sorted([*logs, "out"])


@pytest.mark.parametrize("kind", FORMATS)
def test_a_bad_row_is_left_out_and_told(
    kind: str, capsys: pytest.CaptureFixture[str]
) -> None:
    Path("a.csv").write_text(rows(0, 1) + "nonsense\n" + rows(2))
    assert export(kind, "a.csv", "--output", "out") == 0
    told, written = capsys.readouterr().err.splitlines()
    assert told.startswith("warning: 1 damaged row left out of 4; the first: a.csv:4: ")
    assert written == "out: written, 3 rows"


def test_a_log_of_bad_rows_alone_is_exit_65_and_leaves_what_was_there(
    capsys: pytest.CaptureFixture[str],
) -> None:
    Path("a.csv").write_text(f"{HEADER}\nnonsense\n")
    Path("out").write_text("of yesterday")
    assert export("gpx", "a.csv", "--output", "out") == 65
    assert "a.csv:2: expected a row of time_utc" in capsys.readouterr().err
    assert Path("out").read_text() == "of yesterday"
    assert files() == ["a.csv", "out"]


def test_a_torn_tail_is_dropped_with_a_warning(
    capsys: pytest.CaptureFixture[str],
) -> None:
    Path("a.csv").write_text(rows(0, 1) + "2026-11-22T12:0")
    assert export("geojson", "a.csv", "--output", "-") == 0
    captured = capsys.readouterr()
    features = json.loads(captured.out)["features"]
    assert [f["geometry"]["type"] for f in features] == ["Point"] * 2 + ["LineString"]
    assert captured.err.startswith("warning: a.csv: the end is cut")


@pytest.mark.parametrize("text", ["", "a,b,c\n1,2,3\n"])
def test_what_is_no_log_is_exit_65(
    text: str, capsys: pytest.CaptureFixture[str]
) -> None:
    Path("a.csv").write_text(text)
    assert export("gpx", "a.csv", "--output", "out") == 65
    assert capsys.readouterr().err.startswith("a.csv:1: ")
    assert files() == ["a.csv"]


def test_a_log_that_is_not_there_is_exit_66() -> None:
    assert export("gpx", "none.csv", "--output", "out") == 66
    assert files() == []


@pytest.mark.parametrize("kind", FORMATS)
def test_a_log_without_rows_is_an_empty_file_of_its_kind(
    kind: str, capsys: pytest.CaptureFixture[str]
) -> None:
    Path("a.csv").write_text(HEADER)
    assert export(kind, "a.csv", "--output", "out") == 0
    assert "no rows" in capsys.readouterr().err
    text = Path("out").read_text()
    if kind in ("gpx", "kml"):
        ET.fromstring(text)
    elif kind == "geojson":
        assert json.loads(text) == {"type": "FeatureCollection", "features": []}


@pytest.mark.parametrize(
    ("output", "code"), [("a.csv", 2), ("none/out", 73), (".", 73)]
)
def test_an_output_that_cannot_be_is_refused(output: str, code: int) -> None:
    Path("a.csv").write_text(rows(0))
    assert export("gpx", "a.csv", "--output", output) == code
    assert Path("a.csv").read_text() == rows(0)
    assert files() == ["a.csv"]


def test_a_link_stays_a_link_and_a_pipe_a_pipe() -> None:
    Path("a.csv").write_text(rows(0))
    Path("link").symlink_to("target")
    assert export("nmea", "a.csv", "--output", "link") == 0
    assert Path("link").is_symlink()
    assert Path("target").read_text().startswith("$GPRMC,120000.000,A,5159.400007,N")
    os.mkfifo("pipe")
    heard: list[str] = []
    reader = threading.Thread(target=lambda: heard.append(Path("pipe").read_text()))
    reader.start()
    assert export("nmea", "a.csv", "--output", "pipe") == 0
    reader.join()
    assert heard == [Path("target").read_text()]
    assert Path("pipe").is_fifo()


def test_every_so_many_seconds_is_enough_when_said_so() -> None:
    Path("a.csv").write_text(rows(*range(60)))
    assert export("nmea", "a.csv", "--every", "20", "--output", "out") == 0
    assert Path("out").read_text().count("RMC") == 3


@pytest.mark.parametrize(
    "argv", [["--format", "shp"], ["--format", "gpx", "--every", "0"], []]
)
def test_wrong_usage_is_exit_2(argv: list[str]) -> None:
    assert main(["export", "a.csv", "--output", "out", *argv]) == 2
