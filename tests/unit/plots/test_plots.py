"""Pictures: that they are drawn, whatever the track; how they look, people judge."""

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from matplotlib.collections import EllipseCollection
from matplotlib.figure import Figure

from imu_tracker.errors import OutputError
from imu_tracker.plots.chart import choose_circles, draw_map
from imu_tracker.plots.drawing import MAX_POINTS, envelope, runs
from imu_tracker.plots.logs import joined
from imu_tracker.plots.orders import OrderColumns, plot_orders
from imu_tracker.plots.recording import RecordingColumns, plot_recording
from imu_tracker.plots.timelines import shade_modes
from imu_tracker.plots.tracks import LogColumns, plot_tracks
from imu_tracker.recording.scoring import Track
from support.fonts import load_fonts

PNG = b"\x89PNG\r\n\x1a\n"


@pytest.fixture(scope="module", autouse=True)
def _fonts() -> None:
    load_fonts()


def a_log(rows: int, name: str = "drive.csv", start_s: float = 1.8e9) -> LogColumns:
    t_s = np.arange(rows) / 4.0
    phase = t_s / 60.0
    mode = np.array(["still", "gps", "dr", "gpsonly"])[(t_s // 20 % 4).astype(int)]
    return LogColumns(
        name,
        Track(start_s + t_s, 52.0 + 0.01 * np.sin(phase), 4.0 + 0.01 * np.cos(phase)),
        np.full(rows, 5.0),
        np.where(mode == "dr", 4.0 + (t_s % 20.0) ** 2, 4.0),
        mode,
    )


def shifted(track: Track) -> Track:
    return track._replace(lat_deg=track.lat_deg + 1e-5)


@pytest.mark.parametrize("rows", [1, 2, 10, 50_000])
def test_a_log_of_any_length_becomes_a_picture(tmp_path: Path, rows: int) -> None:
    log = a_log(rows)
    plot_tracks([log], tmp_path / "a.png")
    plot_tracks([log], tmp_path / "b.png", shifted(log.track))
    for name in ("a.png", "b.png"):
        assert (tmp_path / name).read_bytes().startswith(PNG)


def test_the_strip_of_modes_has_no_holes_but_where_rows_are_missing() -> None:
    log = a_log(400)
    late = log.track.utc_s + np.where(np.arange(400) < 320, 0.0, 3600.0)
    panel = Figure().subplots()
    shade_modes(panel, log._replace(track=log.track._replace(utc_s=late)))
    boxes = [path.get_extents() for c in panel.collections for path in c.get_paths()]
    strips = sorted((box.x0, box.x1) for box in boxes if box.y1 > 0.99)
    gaps_s = [86400.0 * (after[0] - before[1]) for before, after in pairwise(strips)]
    assert sorted(gaps_s) == pytest.approx([0.0, 0.0, 0.0, 3600.25], abs=0.01)


def test_a_circle_that_holds_the_whole_picture_is_left_out() -> None:
    log = a_log(400)
    wide = np.where(np.arange(400) == 0, 1e5, log.r95_m)
    circles = []
    for r95_m in (log.r95_m, wide):
        chart = Figure().subplots()
        draw_map(chart, [log._replace(r95_m=r95_m)], None)
        (found,) = (c for c in chart.collections if isinstance(c, EllipseCollection))
        circles.append(np.max(found.get_widths()))
    assert circles[0] == circles[1]


def test_a_parked_tracker_becomes_a_picture(tmp_path: Path) -> None:
    log = a_log(400)
    still = log._replace(
        track=Track(log.track.utc_s, np.full(400, 52.0), np.full(400, 4.0)),
        speed_mps=np.zeros(400),
        mode=np.full(400, "still"),
        r95_m=np.full(400, 4.0),
    )
    plot_tracks([still], tmp_path / "a.png")
    assert (tmp_path / "a.png").read_bytes().startswith(PNG)


def test_logs_of_the_same_time_are_compared(tmp_path: Path) -> None:
    logs = [a_log(400, "a.csv"), a_log(500, "b.csv")]
    assert joined(logs) == logs
    plot_tracks(logs, tmp_path / "a.png", shifted(logs[0].track))
    assert (tmp_path / "a.png").read_bytes().startswith(PNG)


def test_logs_that_follow_one_another_are_one_track() -> None:
    late, early = a_log(4, "late.csv", 1.9e9), a_log(8, "early.csv", 1.8e9)
    (one,) = joined([late, early])
    assert one.name == "early.csv to late.csv"
    assert len(one.track.utc_s) == len(one.mode) == 12
    assert (np.diff(one.track.utc_s) > 0).all()


def test_truth_of_another_day_does_not_hurt(tmp_path: Path) -> None:
    log = a_log(400)
    truth = log.track._replace(utc_s=log.track.utc_s + 86400.0)
    plot_tracks([log], tmp_path / "a.png", truth)
    assert (tmp_path / "a.png").exists()


def test_a_parked_tracker_gets_one_circle() -> None:
    log = a_log(10_000)._replace(r95_m=np.full(10_000, 4.0))
    assert len(choose_circles(log, np.zeros((10_000, 2)))) == 1


def test_the_end_of_an_outage_gets_a_circle() -> None:
    log = a_log(1000)
    east_m = np.arange(1000.0) * 100.0
    points = np.column_stack([east_m, east_m])
    last_of_outage = 60 * 4 - 1  # gps from 20 s, dr from 40 s, gpsonly from 60 s on
    assert last_of_outage in choose_circles(log, points)


@pytest.mark.parametrize("n", [0, 100, 50_000])
def test_a_recording_becomes_a_picture(tmp_path: Path, n: int) -> None:
    t_s = np.arange(n) / 100.0
    wave = np.sin(t_s)[:, None] * np.ones(3)
    fixes = np.arange(0.0, n / 100.0)
    columns = RecordingColumns(
        "a.rec", t_s, wave, wave, t_s, fixes, fixes + 1.0, np.empty(0)
    )
    plot_recording(columns, tmp_path / "a.png")
    assert (tmp_path / "a.png").read_bytes().startswith(PNG)


@pytest.mark.parametrize("size_m", [1.9, None])
def test_the_lines_of_the_wheels_become_a_picture(
    tmp_path: Path, size_m: float | None
) -> None:
    imu_s, row_s = np.arange(4000) / 100.0, np.arange(160) / 4.0
    line = np.cos(2.0 * np.pi * 10.0 * imu_s)[:, None] * np.ones(6)
    columns = OrderColumns(
        *("a.rec", imu_s, line, row_s, np.full(160, 19.0), row_s < 30.0, "heard"),
        *(size_m, None if size_m is None else 0.01),
    )
    plot_orders(columns, tmp_path / "a.png")
    assert (tmp_path / "a.png").read_bytes().startswith(PNG)


def test_thinning_keeps_every_peak() -> None:
    values = np.zeros(1_000_000)
    values[123_456], values[765_432] = 1.0, -1.0
    shown = envelope(values)
    assert len(shown) <= MAX_POINTS
    assert {123_456, 765_432} <= set(shown.tolist())


def test_runs_are_found_also_at_the_ends() -> None:
    holds = np.array([True, True, False, True, False, False, True])
    assert list(runs(holds)) == [(0, 2), (3, 4), (6, 7)]
    assert list(runs(~holds)) == [(2, 3), (4, 6)]
    assert list(runs(np.zeros(0, bool))) == []


def test_a_directory_that_is_not_there_is_an_error_of_the_output(
    tmp_path: Path,
) -> None:
    with pytest.raises(OutputError, match="No such file"):
        plot_tracks([a_log(4)], tmp_path / "none" / "a.png")


def test_a_picture_without_a_kind_is_png_under_its_own_name(tmp_path: Path) -> None:
    output = tmp_path / "log"
    plot_tracks([a_log(4)], output)
    assert output.read_bytes().startswith(PNG)


def test_a_kind_of_picture_that_nobody_knows_is_an_error_of_the_output(
    tmp_path: Path,
) -> None:
    with pytest.raises(OutputError, match="not a kind of picture"):
        plot_tracks([a_log(4)], tmp_path / "a.bmpx")
