"""The score: tracks whose errors are known by construction."""

import gzip
import math
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest

from imu_tracker.errors import InputMissingError, RecordingError
from imu_tracker.recording.edit import Outage
from imu_tracker.recording.scoring import (
    Array,
    Track,
    answer,
    describe,
    metres_per_degree,
    read_truth,
    score,
)

NOON = datetime(2026, 11, 22, 12, tzinfo=UTC).timestamp()
LAT, LON = 52.0, 4.37


def track(
    times_s: Array, north_m: Array | float = 0.0, east_m: Array | float = 0.0
) -> Track:
    """Return a track by its metres from a place."""
    per_north, per_east = metres_per_degree(np.array([LAT]))
    zero = np.zeros(len(times_s))
    return Track(
        NOON + times_s,
        LAT + (zero + north_m) / per_north,
        LON + (zero + east_m) / per_east,
    )


SECONDS = np.arange(0.0, 300.0, 0.25)
TRUTH = track(np.arange(0.0, 299.0, 0.2), east_m=10.0 * np.arange(0.0, 299.0, 0.2))


def logged(offset_m: Array | float) -> Track:
    return track(SECONDS, north_m=offset_m, east_m=10.0 * SECONDS)


def r95(radius_m: float) -> Array:
    return np.full(len(SECONDS), radius_m)


def test_a_degree_is_as_long_as_the_ellipsoid_says() -> None:
    # 1/180 of pi times the radii of curvature at 45 degrees: 6367382 m and 6388838 m
    north_m, east_m = metres_per_degree(np.array([45.0]))
    assert north_m[0] == pytest.approx(111131.8, abs=0.1)
    assert east_m[0] == pytest.approx(78846.8, abs=0.1)


def test_a_constant_offset_is_every_figure() -> None:
    figures = score(logged(3.0), r95(4.0), TRUTH)
    part = figures["with_gps"]
    for key in ("rms", "p50", "p95", "max"):
        assert part[key] == pytest.approx(3.0, abs=1e-3)
    assert part["inside_r95"] == 1.0
    assert part["r95_median"] == 4.0
    assert figures["answered"] == 1.0
    assert figures["outage"] == {}
    assert "outage_end_rms" not in figures


def test_a_radius_smaller_than_the_error_holds_nothing() -> None:
    part = score(logged(3.0), r95(2.9), TRUTH)["with_gps"]
    assert part["inside_r95"] == 0.0


def test_the_first_half_minute_does_not_count() -> None:
    early = np.where(SECONDS < 29.0, 1000.0, 1.0)
    assert score(logged(early), r95(4.0), TRUTH)["with_gps"]["max"] < 1.01
    late = np.where(SECONDS < 31.0, 1000.0, 1.0)
    assert score(logged(late), r95(4.0), TRUTH)["with_gps"]["max"] > 999.0


def test_outages_are_scored_apart_and_at_their_ends() -> None:
    in_outage = (SECONDS >= 100.0) & (SECONDS <= 160.0)
    offset_m = np.where(in_outage, (SECONDS - 100.0) / 2.0, 1.0)
    outages = [Outage(100.0, 60.0), Outage(200.0, 20.0)]
    figures = score(logged(offset_m), r95(15.0), TRUTH, outages, NOON)
    assert figures["with_gps"]["max"] < 30.0
    assert figures["with_gps"]["p50"] == pytest.approx(1.0, abs=1e-3)
    assert figures["outage"]["max"] == pytest.approx(30.0, abs=0.01)
    assert figures["outage_end_error"] == pytest.approx([30.0, 1.0], abs=0.01)
    assert figures["outage_end_r95"] == [15.0, 15.0]
    assert figures["outage_end_rms"] == pytest.approx(math.sqrt(450.5), abs=0.01)
    n = figures["with_gps"]["n"] + figures["outage"]["n"]
    assert n == (TRUTH.utc_s >= NOON + 30.0).sum()


def test_outages_count_from_the_instant_that_is_given() -> None:
    offset_m = np.where((SECONDS >= 110.0) & (SECONDS <= 120.0), 9.0, 1.0)
    outages = [Outage(10.0, 10.0)]
    figures = score(logged(offset_m), r95(5.0), TRUTH, outages, NOON + 100.0)
    assert figures["outage"]["rms"] == pytest.approx(9.0, abs=1e-3)


def test_an_end_without_an_answer_is_infinitely_wrong() -> None:
    cut = Track(*(column[SECONDS < 150.0] for column in logged(1.0)))
    figures = score(cut, r95(5.0)[SECONDS < 150.0], TRUTH, [Outage(120.0, 60.0)], NOON)
    assert figures["outage_end_error"] == [math.inf]
    assert figures["answered"] < 0.5


def test_an_outage_after_the_truth_is_no_outage() -> None:
    figures = score(logged(1.0), r95(5.0), TRUTH, [Outage(1000.0, 60.0)], NOON)
    assert figures["outage_end_error"] == []


def test_rows_more_than_two_seconds_apart_do_not_answer_for_the_time_between() -> None:
    kept = (SECONDS < 100.0) | (SECONDS >= 110.0)
    log = Track(*(column[kept] for column in logged(1.0)))
    answers = answer(log, r95(5.0)[kept], TRUTH)
    unanswered_s = TRUTH.utc_s[~answers.is_answered] - NOON
    assert unanswered_s.min() == pytest.approx(99.8)
    assert unanswered_s.max() == pytest.approx(110.0, abs=0.21)


def test_the_track_is_linear_between_its_rows() -> None:
    rows = track(np.array([0.0, 2.0]), north_m=np.array([0.0, 8.0]))
    answers = answer(rows, np.array([1.0, 3.0]), track(np.array([0.5])))
    assert answers.error_m[0] == pytest.approx(2.0, abs=1e-3)
    assert answers.r95_m[0] == pytest.approx(1.5)


def test_longitudes_may_cross_the_date_line() -> None:
    times = NOON + np.array([0.0, 1.0])
    rows = Track(times, np.zeros(2), np.array([179.9999, -179.9999]))
    truth = Track(NOON + np.array([0.5]), np.zeros(1), np.array([-180.0]))
    assert answer(rows, np.ones(2), truth).error_m[0] == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize("n", [0, 1])
def test_a_log_of_no_or_one_row_answers_nothing(n: int) -> None:
    log = Track(*(column[:n] for column in logged(1.0)))
    figures = score(log, r95(5.0)[:n], TRUTH, [Outage(100.0, 10.0)], NOON)
    assert figures["answered"] == 0.0
    assert figures["with_gps"] == {}
    assert figures["outage_end_error"] == [math.inf]
    assert "no answer" in "\n".join(describe(figures))


def test_the_table_for_people_says_it_all() -> None:
    figures = score(logged(3.0), r95(4.0), TRUTH, [Outage(100.0, 10.0)], NOON)
    table = "\n".join(describe(figures))
    assert "with GPS" in table
    assert "in outages" in table
    assert "end of outage 1: 3.00 m off, r95 4.00 m" in table
    assert "answered: 100.0%" in table


def test_columns_of_the_table_never_run_together() -> None:
    figures = score(logged(3.0), r95(4.0), TRUTH, [], NOON)
    errors = dict.fromkeys(("rms", "p50", "p95", "max"), 123_456_789.012)
    figures["with_gps"] |= errors | {"n": 12_345_678, "r95_median": 1e8}
    row = list(describe(figures))[1].removeprefix("with GPS").split()
    assert row == [
        "12345678",
        *["123456789.01", "m"] * 4,
        "100.0%",
        "100000000.00",
        "m",
    ]


ROWS = (
    "time_utc,lat_deg,lon_deg,alt_m\n"
    "2026-11-22T12:00:00.000Z,52.0,4.37,5\n"
    "2026-11-22T12:00:01.000Z,52.1,4.38,5"
)


@pytest.mark.parametrize("is_packed", [False, True])
def test_truth_is_read_plain_or_packed_and_more_columns_are_ignored(
    tmp_path: Path, is_packed: bool
) -> None:
    path = tmp_path / "truth.csv"
    path.write_bytes(gzip.compress(ROWS.encode()) if is_packed else ROWS.encode())
    truth = read_truth(path)
    assert truth.utc_s.tolist() == [NOON, NOON + 1.0]
    assert truth.lat_deg.tolist() == [52.0, 52.1]
    assert truth.lon_deg.tolist() == [4.37, 4.38]


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("", "no rows"),
        ("time_utc,lat_deg,lon_deg\n", "no rows"),
        ("time,lat,lon\n1,2,3\n", ":2: no column time_utc"),
        ("time_utc,lat_deg,lon_deg\nnoon,52,4\n", ":2: not a row"),
        ("time_utc,lat_deg,lon_deg\n2026-11-22T12:00:00Z,52\n", ":2: not a row"),
        ("time_utc,lat_deg,lon_deg\n2026-11-22T12:00:00Z,nan,4\n", ":2: not a row"),
        ("time_utc,lat_deg,lon_deg\n2026-11-22T12:00:00Z,52,1e9\n", ":2: not a row"),
        (f"{ROWS}\n2026-11-22T12:00:01Z,52,4\n", ":4: time must grow"),
    ],
)
def test_bad_truth_is_told_with_its_line(
    tmp_path: Path, text: str, problem: str
) -> None:
    path = tmp_path / "truth.csv"
    path.write_text(text, "utf-8")
    with pytest.raises(RecordingError) as caught:
        read_truth(path)
    assert problem in str(caught.value)
    assert str(caught.value).startswith(str(path))


@pytest.mark.parametrize(
    ("data", "problem"),
    [
        (b"\x1f\x8b\x08 no gzip", ""),
        (gzip.compress(ROWS.encode(), mtime=0)[:-20], ""),
        (b"\xff\xfe,", "truth.csv: not UTF-8 text"),
    ],
    ids=["no gzip", "cut gzip", "no text"],
)
def test_truth_that_is_no_text_is_bad_data(
    tmp_path: Path, data: bytes, problem: str
) -> None:
    path = tmp_path / "truth.csv"
    path.write_bytes(data)
    with pytest.raises(RecordingError) as caught:
        read_truth(path)
    assert problem in str(caught.value)


def test_truth_that_is_a_directory_is_bad_data(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match=r": Is a directory$"):
        read_truth(tmp_path)


def test_a_time_without_zone_is_utc(tmp_path: Path) -> None:
    path = tmp_path / "truth.csv"
    path.write_text("time_utc,lat_deg,lon_deg\n2026-11-22T12:00:00,52,4\n")
    assert read_truth(path).utc_s.tolist() == [NOON]


def test_truth_that_is_not_there_is_missing(tmp_path: Path) -> None:
    with pytest.raises(InputMissingError, match="No such file"):
        read_truth(tmp_path / "none.csv")
