"""`imu-tracker status`: what the daemon wrote, and whether it is of now."""

import json
import os
import subprocess
from pathlib import Path
from typing import Any

import pytest

from imu_tracker.cli import main
from imu_tracker.commands.status import _with_sigmas

NOW_NS = 500_000_000_000


@pytest.fixture(autouse=True)
def _time(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("time.monotonic_ns", lambda: NOW_NS)


def status(tmp_path: Path, **fields: Any) -> list[str]:
    """Write a status file; return the arguments that read it."""
    path = tmp_path / "status.json"
    path.write_text(json.dumps({"t_ns": NOW_NS - 1_000_000_000, "pid": 1} | fields))
    return ["status", "--set", f"status.path={path}"]


def test_the_status_is_a_table(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    row = {"time_utc": "2026-11-22T12:00:01.250Z", "r95_m": 3.94, "mode": "gps"}
    argv = status(tmp_path, version="0.1.0", row=row, counters={"lost_rows": 0})
    assert main(argv) == 0
    assert capsys.readouterr().out.splitlines() == [
        "pid      1",
        "version  0.1.0",
        "",
        "row",
        "  time utc  2026-11-22T12:00:01.250Z",
        "  r95 m     3.94",
        "  mode      gps",
        "",
        "counters",
        "  lost rows  0",
    ]


def test_values_read_like_words(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    argv = status(tmp_path, a=None, b=True, c=[], d=[1, 2.5], e=False)
    assert main(argv) == 0
    values = [line.split("  ")[-1] for line in capsys.readouterr().out.splitlines()]
    assert values == ["1", "-", "yes", "-", "1, 2.5", "no"]


def test_a_prediction_is_a_line_for_each_instant(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    ahead = {"after_s": [1, 60], "lat_deg": [52.0, 52.5], "r95_m": [4.1, 835.7]}
    assert main(status(tmp_path, prediction=ahead)) == 0
    assert capsys.readouterr().out.splitlines()[-4:] == [
        "prediction",
        "  after s  lat deg  r95 m",
        "        1       52    4.1",
        "       60     52.5  835.7",
    ]


@pytest.mark.parametrize("ahead", [{"a": [1], "b": [1, 2]}, {"a": [], "b": 3}])
def test_a_prediction_of_another_shape_is_shown_all_the_same(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], ahead: dict[str, Any]
) -> None:
    assert main(status(tmp_path, prediction=ahead)) == 0
    assert "prediction" in capsys.readouterr().out


def test_json_is_passed_on_as_it_is(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([*status(tmp_path, row={"mode": "dr"}), "--json"]) == 0
    out = capsys.readouterr().out
    assert json.loads(out)["row"] == {"mode": "dr"}
    assert out.count("\n") == 1


@pytest.mark.parametrize(
    ("age_s", "pid", "problem"),
    [
        (60, os.getpid(), "hangs"),
        (60, 2**30, "not running"),
        (60, None, "not running"),
        (-60, 1, "before the last start of this computer"),
    ],
    ids=["alive", "gone", "never there", "before the last boot"],
)
def test_a_stale_status_is_exit_69(
    age_s: int,
    pid: int | None,
    problem: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    argv = status(tmp_path, t_ns=NOW_NS - age_s * 1_000_000_000, pid=pid)
    assert main(argv) == 69
    captured = capsys.readouterr()
    assert captured.out == ""
    assert problem in captured.err


def test_a_daemon_that_was_killed_is_known_to_be_gone_at_once(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    killed = subprocess.Popen(["sleep", "1000"])
    argv = status(tmp_path, pid=killed.pid, state="tracking")
    assert main(argv) == 0
    killed.kill()
    killed.wait()
    assert main(argv) == 69
    assert f"left by process {killed.pid}, which was killed" in capsys.readouterr().err


def test_a_daemon_of_another_user_is_alive(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def kill(pid: int, signal: int) -> None:
        assert signal == 0
        raise PermissionError

    monkeypatch.setattr(os, "kill", kill)
    assert main(status(tmp_path)) == 0


@pytest.mark.parametrize(
    ("fields", "line"),
    [
        (
            {"state": "waiting for the first fix", "mode": None, "r95_m": None}
            | {"imu_rate_hz": 100.02, "faults": {"imu_bus": 0}, "uptime_s": 17},
            "waiting for the first fix; 100 samples/s; faults: none; up 0:00:17",
        ),
        (
            {"state": "tracking", "mode": "dr", "r95_m": 12.34, "fix_age_s": 20}
            | {"imu_rate_hz": 0.0, "disk_free_mb": 1234, "uptime_s": 90_061}
            | {"faults": {"imu_bus": 3, "gps_line": 0, "disk": 1}},
            "tracking: dr, r95 12.34 m; last fix 20 s ago; 0 samples/s; "
            "faults: imu bus 3, disk 1; 1.2 GB free; up 1 day, 1:01:01",
        ),
    ],
    ids=["waiting", "tracking"],
)
def test_the_first_line_says_how_it_is(
    fields: dict[str, Any],
    line: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main(status(tmp_path, **fields)) == 0
    assert capsys.readouterr().out.splitlines()[:2] == [line, ""]


def test_who_may_not_read_it_is_told_which_group_may(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    argv = status(tmp_path)

    def denied(*_: object, **__: object) -> None:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(Path, "open", denied)
    assert main(argv) == 69
    assert "into the group imu-tracker: sudo usermod -aG" in capsys.readouterr().err


def test_without_a_daemon_it_is_exit_69(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "none.json"
    assert main(["status", "--set", f"status.path={path}"]) == 69
    assert capsys.readouterr().err == f"imu-tracker is not running: no {path}\n"


@pytest.mark.parametrize("text", ["", "{", "[]", "{}", '{"t_ns": "x"}', "\x80"])
def test_a_file_of_somebody_else_is_no_status(
    text: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "status.json"
    path.write_text(text, "latin-1")
    assert main(["status", "--set", f"status.path={path}"]) == 69
    assert "not a status of imu-tracker" in capsys.readouterr().err


def test_watching_goes_on_until_interrupted(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    pauses: list[float] = []

    def sleep(seconds: float) -> None:
        pauses.append(seconds)
        if len(pauses) == 3:
            raise KeyboardInterrupt

    monkeypatch.setattr("time.sleep", sleep)
    assert main([*status(tmp_path), "--watch"]) == 0
    assert capsys.readouterr().out == "pid  1\n" * 3


def test_what_was_learnt_is_told_with_its_doubts() -> None:
    shown = _with_sigmas(
        {"delay_s": 0.2734567, "delay_sigma_s": 0.0512345, "yaw_sigma_deg": 0.5}
    )
    assert shown == {"delay_s": "0.273  +- 0.0512", "yaw_sigma_deg": "0.5"}


def test_a_route_is_shown_beside_the_row(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    route = tmp_path / "way.gpx"
    route.write_text(
        '<gpx version="1.1" xmlns="http://www.topografix.com/GPX/1/1"><rte>'
        '<rtept lat="0" lon="0"/><rtept lat="0.1" lon="0"><name>pier</name></rtept>'
        "</rte></gpx>"
    )
    row = {"lat_deg": 0.05, "lon_deg": 0.0, "speed_mps": 10.0, "course_deg": 0.0}
    argv = status(tmp_path, row=row | {"alt_m": None, "r95_m": 4.0, "mode": "gps"})
    argv += ["--set", f"guide.route={route}"]
    assert main([*argv, "--json"]) == 0
    told = json.loads(capsys.readouterr().out)["guide"]
    assert (told["waypoint"], told["distance_m"]) == ("pier", 5556.0)
    assert told["time_to_go_s"] == 556
    route.unlink()
    assert main([*argv, "--json"]) == 0
    assert "guide" not in json.loads(capsys.readouterr().out)


def published(tmp_path: Path, **fields: Any) -> list[str]:
    """Write a status of `imu-tracker publish`; return the arguments that read it."""
    path = tmp_path / "publish.json"
    path.write_text(
        json.dumps({"t_ns": NOW_NS, "pid": 1, "destinations": {"home": fields}})
    )
    return ["--set", f"status.publish={path}"]


def test_each_destination_of_publish_is_shown(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    argv = status(tmp_path) + published(tmp_path, unsent_rows=3, last_error="refused")
    assert main(argv) == 0
    assert capsys.readouterr().out.splitlines()[2:] == [
        "publish home",
        "  unsent rows  3",
        "  last error   refused",
    ]
    assert main([*argv, "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["publish"] == {"home": {"unsent_rows": 3, "last_error": "refused"}}


def test_a_publish_that_should_run_and_does_not_is_told(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    argv = [*status(tmp_path), "--set", f"status.publish={tmp_path / 'none'}"]
    assert main(argv) == 0
    assert "publish" not in capsys.readouterr().out
    argv += ["--set", "publish.a.kind=mqtt", "--set", "publish.a.url=mqtt://b"]
    assert main(argv) == 0
    assert "imu-tracker publish is not running" in capsys.readouterr().out
