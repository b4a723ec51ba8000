import gzip
import math
from pathlib import Path

import numpy as np
import pytest

from imu_tracker.errors import InputMissingError, LogError
from imu_tracker.samples import Mode, NavState
from imu_tracker.storage.latlong import HEADER, LatLongLog, format_row, read_log
from support.log_states import START_UTC_S, state

ROW = "2026-11-22T12:00:01.250Z,51.99000012,4.37000034,5.2,1.38,40.1,3.94,gps"


def field(name: str, of: NavState) -> str:
    return dict(zip(HEADER.split(","), format_row(of).split(","), strict=True))[name]


def test_a_row_looks_as_in_the_manual() -> None:
    north, east = (
        1.38 * math.cos(math.radians(40.1)),
        1.38 * math.sin(math.radians(40.1)),
    )
    row = format_row(
        state(
            1.25,
            lat_deg=51.99000012,
            lon_deg=4.37000034,
            v_ne_mps=(north, east),
            r95_m=3.9301,
        )
    )

    assert row == ROW


@pytest.mark.parametrize(
    ("second", "text"),
    [
        (0.0, "2026-11-22T12:00:00.000Z"),
        (0.1, "2026-11-22T12:00:00.100Z"),
        (59.875, "2026-11-22T12:00:59.875Z"),
        (0.9996, "2026-11-22T12:00:01.000Z"),
        (43_199.75, "2026-11-22T23:59:59.750Z"),
        (86_400.0 * 98, "2027-02-28T12:00:00.000Z"),
    ],
)
def test_times_have_milliseconds(second: float, text: str) -> None:
    assert field("time_utc", state(second)) == text


@pytest.mark.parametrize(
    ("lon_deg", "text"),
    [
        (180.0, "180.00000000"),
        (-180.0, "180.00000000"),
        (-179.999999999, "180.00000000"),
        (180.000000004, "180.00000000"),
        (-179.99999999, "-179.99999999"),
        (180.5, "-179.50000000"),
        (-190.0, "170.00000000"),
        (540.0, "180.00000000"),
        (-0.000000001, "0.00000000"),
    ],
)
def test_longitudes_lie_above_minus_180_and_up_to_180(
    lon_deg: float, text: str
) -> None:
    assert field("lon_deg", state(lon_deg=lon_deg)) == text


def test_zero_has_no_sign() -> None:
    row = format_row(state(lat_deg=-1e-10, alt_m=-0.04, v_ne_mps=(-0.0, -0.0)))

    assert "-0.0" not in row.replace("2026-11-22", "")


def test_an_unknown_height_is_empty() -> None:
    assert field("alt_m", state(alt_m=None)) == ""
    assert field("alt_m", state(alt_m=-3.26)) == "-3.3"


@pytest.mark.parametrize(
    ("v_ne_mps", "speed", "course"),
    [
        ((0.0, 0.0), "0.00", ""),
        ((0.29, 0.0), "0.29", ""),
        ((0.294, 0.0), "0.29", ""),
        ((0.296, 0.0), "0.30", "0.0"),  # as printed: a row does not contradict itself
        ((0.0, 1.0), "1.00", "90.0"),
        ((-1.0, -1e-9), "1.00", "180.0"),
        ((0.0, -2.0), "2.00", "270.0"),
        ((1.0, -1e-6), "1.00", "0.0"),  # 359.99994 is not 360.0
        ((1.0, -1e-17), "1.00", "0.0"),
        ((10.0, -0.01), "10.00", "359.9"),
    ],
)
def test_the_course_is_empty_when_slow_and_never_360(
    v_ne_mps: tuple[float, float], speed: str, course: str
) -> None:
    slow = state(v_ne_mps=v_ne_mps)

    assert (field("speed_mps", slow), field("course_deg", slow)) == (speed, course)


@pytest.mark.parametrize(
    ("r95_m", "text"),
    [(3.94, "3.94"), (3.9401, "3.95"), (1.1, "1.10"), (0.0, "0.00"), (2e-3, "0.01")],
)
def test_the_radius_is_rounded_up(r95_m: float, text: str) -> None:
    assert field("r95_m", state(r95_m=r95_m)) == text


def test_the_mode_is_its_word() -> None:
    assert [field("mode", state(mode=mode)) for mode in Mode] == list(Mode)


def test_a_log_is_read_as_columns(tmp_path: Path) -> None:
    path = tmp_path / "latlong.csv"
    path.write_text(f"{HEADER}\n{ROW}\n{format_row(state(2, alt_m=None))}\n")

    track = read_log(path)

    assert track.utc_s.tolist() == [START_UTC_S + 1.25, START_UTC_S + 2]
    assert track.lat_deg.tolist() == [51.99000012, 51.99]
    assert track.lon_deg.tolist() == [4.37000034, 4.37]
    np.testing.assert_array_equal(track.alt_m, [5.2, np.nan])
    assert track.speed_mps.tolist() == [1.38, 1.0]
    assert track.course_deg.tolist() == [40.1, 0.0]
    assert track.r95_m.tolist() == [3.94, 3.9]
    assert track.mode.tolist() == ["gps", "gps"]


def test_a_log_without_rows_has_empty_columns(tmp_path: Path) -> None:
    path = tmp_path / "latlong.csv"
    path.write_text(HEADER + "\n")

    assert [len(column) for column in read_log(path)] == [0] * 8


def test_rotated_logs_can_be_read_alone_and_one_after_another(tmp_path: Path) -> None:
    path = tmp_path / "latlong-20261122T120000Z.csv.gz"
    parts = [f"{HEADER}\n{format_row(state(second))}\n" for second in (0, 1)]
    path.write_bytes(b"".join(gzip.compress(part.encode()) for part in parts))

    assert read_log(path).utc_s.tolist() == [START_UTC_S, START_UTC_S + 1]


def test_a_torn_last_row_is_left_out_with_a_warning(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    path = tmp_path / "latlong.csv"
    path.write_text(f"{HEADER}\n{ROW}\n{ROW[:40]}")

    assert len(read_log(path).utc_s) == 1
    assert [record.levelname for record in caplog.records] == ["WARNING"]


BAD_ROWS = [
    ROW[:40],
    "",
    ROW.replace("gps", "fast"),
    ROW.replace("5.2", "nan"),
    ROW.replace("51.99", "91.99"),
    ROW.replace("4.37", "184.37"),
    ROW.replace("-11-22", "-02-30"),
    ROW + ",",
    "\0" * 40,
]


@pytest.mark.parametrize("bad", BAD_ROWS)
def test_damaged_rows_are_left_out_counted_and_told_where(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, bad: str
) -> None:
    path = tmp_path / "latlong.csv"
    last = format_row(state(2))
    path.write_text(f"{HEADER}\n{ROW}\n{bad}\n{bad}\n{last}\n")

    assert (read_log(path).utc_s - START_UTC_S).tolist() == [1.25, 2.0]
    (told,) = caplog.messages
    assert told.startswith(f"2 damaged rows left out of 4; the first: {path}:3: ")


@pytest.mark.parametrize("bad", BAD_ROWS)
def test_a_log_of_damaged_rows_alone_is_an_error_that_says_where(
    tmp_path: Path, bad: str
) -> None:
    path = tmp_path / "latlong.csv"
    path.write_text(f"{HEADER}\n{bad}\n")

    with pytest.raises(LogError, match=r"latlong\.csv:2: expected .*, not b'") as error:
        read_log(path)

    assert error.value.exit_code == 65


def test_a_log_that_windows_saved_is_read(tmp_path: Path) -> None:
    path = tmp_path / "latlong.csv"
    path.write_bytes(f"\ufeff{HEADER}\r\n{ROW}\r\n".encode())

    assert len(read_log(path).utc_s) == 1


def test_a_log_that_windows_saved_is_put_aside_and_its_last_time_known(
    tmp_path: Path,
) -> None:
    path = tmp_path / "latlong.csv"
    path.write_bytes(f"\ufeff{HEADER}\r\n{ROW}\r\n".encode())
    log = LatLongLog(path)
    log.write(state(1.25))
    log.write(state(1.5))
    log.close()

    assert log.counters == {"skipped_rows": 1, "rows": 1}
    assert len(read_log(path).utc_s) == 1


@pytest.mark.parametrize("content", ["", HEADER, ROW + "\n", "time,lat\n" + ROW + "\n"])
def test_a_file_without_the_header_is_no_log(tmp_path: Path, content: str) -> None:
    path = tmp_path / "latlong.csv"
    path.write_text(content)

    with pytest.raises(LogError, match=r"latlong\.csv:1: expected the header time_utc"):
        read_log(path)


def test_a_log_that_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputMissingError, match=r"latlong\.csv: No such file"):
        read_log(tmp_path / "latlong.csv")
    with pytest.raises(LogError, match="Is a directory"):
        read_log(tmp_path)


def test_times_strictly_grow_over_a_restart(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    path = tmp_path / "latlong.csv"
    log = LatLongLog(path)
    for second in (0.0, 0.25, 0.25, 0.5):
        log.write(state(second))
    log.close()
    log = LatLongLog(path)
    for second in (0.25, 0.5, 0.75):
        log.write(state(second))
    log.close()

    assert (read_log(path).utc_s - START_UTC_S).tolist() == [0, 0.25, 0.5, 0.75]
    assert log.counters == {"skipped_rows": 2, "rows": 1}
    assert caplog.text.count("rows are left out: the log ends later") == 2


def future_log(path: Path, seconds: float) -> LatLongLog:
    """Return a log whose last row lies so far in the future."""
    path.write_text(f"{HEADER}\n{format_row(state(seconds))}\n")
    return LatLongLog(path)


def test_a_log_of_the_future_is_put_aside_once_the_date_is_sure(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    path = tmp_path / "latlong.csv"
    log = future_log(path, 14 * 86_400.0)
    log.write(state(0)._replace(is_date_sure=False))
    assert "2026-12-06T12:00:00.000Z" in log.trouble
    for second in (1, 2):
        log.write(state(second))
    assert log.trouble == ""
    log.close()

    assert (read_log(path).utc_s - START_UTC_S).tolist() == [1, 2]
    assert log.counters == {"skipped_rows": 1, "rows": 2, "logs_put_aside": 1}
    (aside,) = tmp_path.glob("latlong-20261206T120000Z.csv*")
    assert (read_log(aside).utc_s - START_UTC_S).tolist() == [14 * 86_400.0]
    assert "put aside, and begun anew" in caplog.text


def test_rows_less_than_a_minute_back_wait_for_the_log(tmp_path: Path) -> None:
    path = tmp_path / "latlong.csv"
    log = future_log(path, 60.0)
    for second in (0, 60, 61):
        log.write(state(second))
    log.close()

    assert (read_log(path).utc_s - START_UTC_S).tolist() == [60, 61]
    assert log.counters == {"skipped_rows": 2, "rows": 1}


def test_a_log_of_the_future_that_was_put_aside_before_a_crash_keeps_nothing_back(
    tmp_path: Path,
) -> None:
    path = tmp_path / "latlong.csv"
    (tmp_path / "latlong-20261206T120000Z.csv").write_text(
        f"{HEADER}\n{format_row(state(14 * 86_400.0))}\n"
    )
    log = LatLongLog(path)
    log.write(state(0))
    log.close()

    assert log.counters["rows"] == 1
    assert len(list(tmp_path.glob("latlong-*"))) == 1


def test_times_grow_also_when_the_last_row_is_in_a_rotated_file(
    tmp_path: Path,
) -> None:
    rotated = tmp_path / "latlong-20261122T120000Z.csv.gz"
    rotated.write_bytes(gzip.compress(f"{HEADER}\n{ROW}\n".encode()))
    log = LatLongLog(tmp_path / "latlong.csv")
    log.write(state(1.25))
    log.write(state(1.5))
    log.close()

    assert log.counters == {"skipped_rows": 1, "rows": 1}


def test_a_rotated_file_that_is_damaged_does_not_keep_the_log_from_starting(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    (tmp_path / "latlong-20261122T120000Z.csv.gz").write_bytes(b"\x1f\x8bdamaged")

    LatLongLog(tmp_path / "latlong.csv").close()

    assert "20261122T120000Z.csv.gz:1: the gzip data are damaged" in caplog.text
