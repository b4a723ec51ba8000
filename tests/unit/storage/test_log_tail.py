"""Following a log that is written, rotated, cut and deleted meanwhile."""

import gzip
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest

from imu_tracker.storage.latlong import HEADER
from imu_tracker.storage.log_tail import LogTail, TailPosition

NOON = datetime(2026, 11, 22, 12, tzinfo=UTC)


def line(second: int) -> str:
    time = f"{NOON + timedelta(seconds=second):%Y-%m-%dT%H:%M:%S}.000Z"
    return f"{time},51.99000000,4.37000000,5.2,1.38,40.1,3.94,gps\n"


def text(*seconds: int) -> str:
    return f"{HEADER}\n" + "".join(map(line, seconds))


def append(path: Path, *seconds: int) -> None:
    with path.open("a") as file:
        file.writelines(map(line, seconds))


def given(tail: LogTail) -> list[int]:
    return [round(row.utc_s - NOON.timestamp()) for row in tail.rows()]


def put_aside(path: Path, first: int, *, is_packed: bool) -> Path:
    name = f"{NOON + timedelta(seconds=first):latlong-%Y%m%dT%H%M%SZ.csv}"
    target = path.with_name(name)
    path.rename(target)
    if is_packed:
        packed = target.with_name(f"{name}.gz")
        packed.write_bytes(gzip.compress(target.read_bytes()))
        target.unlink()
        return packed
    return target


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "latlong.csv"


def test_a_log_that_is_not_there_yet_has_no_rows_until_it_is(path: Path) -> None:
    tail = LogTail(path)
    assert given(tail) == []
    path.write_text(text(0, 1))
    assert given(tail) == [0, 1]
    assert given(tail) == []
    append(path, 2)
    assert given(tail) == [2]
    tail.close()


def test_half_a_line_is_given_when_it_is_whole(path: Path) -> None:
    path.write_text(text(0) + line(1)[:40])
    tail = LogTail(path)
    assert given(tail) == [0]
    with path.open("a") as file:
        file.write(line(1)[40:])
    assert given(tail) == [1]
    tail.close()


@pytest.mark.parametrize("is_packed", [False, True])
def test_a_rotation_loses_and_repeats_nothing(path: Path, is_packed: bool) -> None:
    path.write_text(text(0, 1))
    tail = LogTail(path)
    assert given(tail) == [0, 1]
    append(path, 2)
    put_aside(path, 0, is_packed=is_packed)
    path.write_text(text(3))
    assert given(tail) == [2, 3]
    append(path, 4)
    assert given(tail) == [4]
    tail.close()


def test_two_rotations_between_two_looks_are_read_in_order(path: Path) -> None:
    path.write_text(text(0))
    tail = LogTail(path)
    assert given(tail) == [0]
    put_aside(path, 0, is_packed=True)
    path.write_text(text(1, 2))
    put_aside(path, 1, is_packed=True)
    path.write_text(text(3))
    assert given(tail) == [1, 2, 3]
    tail.close()


def test_between_the_rename_and_the_new_file_nothing_is_lost(path: Path) -> None:
    path.write_text(text(0))
    tail = LogTail(path)
    assert given(tail) == [0]
    append(path, 1)
    put_aside(path, 0, is_packed=False)
    assert given(tail) == [1]
    assert given(tail) == []
    path.write_text(text(2))
    assert given(tail) == [2]
    tail.close()


def test_history_begins_with_the_oldest_rotated_file(path: Path) -> None:
    path.write_text(text(0, 1))
    put_aside(path, 0, is_packed=True)
    path.write_text(text(2, 3))
    put_aside(path, 2, is_packed=False)
    path.write_text(text(4))
    tail = LogTail(path)
    assert given(tail) == [0, 1, 2, 3, 4]
    tail.close()


def test_a_time_to_begin_after_leaves_older_files_unread(path: Path) -> None:
    path.write_text("damaged")
    put_aside(path, 0, is_packed=False)
    path.write_text(text(10, 11))
    put_aside(path, 10, is_packed=True)
    path.write_text(text(20, 21))
    tail = LogTail(path, TailPosition(NOON.timestamp() + 10.5))
    assert given(tail) == [11, 20, 21]
    assert not tail.counters
    tail.close()


def test_a_position_goes_on_in_the_same_file(path: Path) -> None:
    path.write_text(text(0, 1, 2))
    tail = LogTail(path)
    rows = tail.rows()
    next(rows), next(rows)
    position = tail.position
    assert position.inode == path.stat().st_ino
    rows.close()
    tail.close()
    again = LogTail(path, position)
    assert given(again) == [2]
    again.close()


@pytest.mark.parametrize("is_packed", [False, True])
def test_a_position_goes_on_in_a_file_that_was_put_aside(
    path: Path, is_packed: bool
) -> None:
    path.write_text(text(0, 1))
    tail = LogTail(path)
    assert given(tail) == [0, 1]
    position = tail.position
    tail.close()
    append(path, 2)
    put_aside(path, 0, is_packed=is_packed)
    path.write_text(text(3))
    again = LogTail(path, position)
    assert given(again) == [2, 3]
    again.close()


def test_a_torn_tail_that_is_cut_off_repeats_nothing(path: Path) -> None:
    path.write_text(text(0, 1))
    tail = LogTail(path)
    assert given(tail) == [0, 1]
    path.write_text(text(0))
    assert given(tail) == []
    append(path, 2)
    assert given(tail) == [2]
    tail.close()


def test_a_log_that_is_deleted_begins_anew(path: Path) -> None:
    path.write_text(text(0))
    tail = LogTail(path)
    assert given(tail) == [0]
    path.unlink()
    assert given(tail) == []
    path.write_text(text(5))
    assert given(tail) == [5]
    tail.close()


def test_a_log_that_begins_earlier_after_the_clock_was_set_back_is_followed(
    path: Path,
) -> None:
    path.write_text(text(1000, 1001))
    tail = LogTail(path)
    assert given(tail) == [1000, 1001]
    put_aside(path, 1000, is_packed=False)
    path.write_text(text(0, 1))
    assert given(tail) == [0, 1]
    tail.close()


@pytest.mark.parametrize("is_packed", [False, True])
def test_a_position_of_a_wrong_future_hides_no_row_of_the_file_after_it(
    path: Path, is_packed: bool
) -> None:
    # A receiver said 2027, the rows were sent, UTC was mended and the reader restarted:
    # everything until 2027 counted as sent.
    path.write_text(text(90_000, 90_001))
    tail = LogTail(path)
    assert given(tail) == [90_000, 90_001]
    position = tail.position
    tail.close()
    put_aside(path, 90_000, is_packed=is_packed)
    path.write_text(text(0, 1))
    again = LogTail(path, position)
    assert given(again) == [0, 1]
    again.close()


def test_a_tail_that_a_power_cut_took_brings_back_no_row(path: Path) -> None:
    path.write_text(text(*range(0, 600, 60)))
    tail = LogTail(path)
    assert len(given(tail)) == 10
    position = tail.position
    tail.close()
    with path.open("r+") as file:
        file.truncate(len(text(*range(0, 300, 60))))
    append(path, 601)
    again = LogTail(path, position)
    assert given(again) == [601]
    again.close()


def test_what_is_no_row_is_counted_and_passed_over(path: Path) -> None:
    path.write_text(text(0) + "nonsense\n" + "x" * 200_000 + "\n" + line(1))
    tail = LogTail(path)
    assert given(tail) == [0, 1]
    assert tail.counters["bad_lines"] == 1
    tail.close()


def test_a_position_whose_file_is_another_one_now_goes_by_time(path: Path) -> None:
    path.write_text(text(0, 1, 2))
    stale = TailPosition(NOON.timestamp() + 1, path.stat().st_ino, 7)
    tail = LogTail(path, stale)
    assert given(tail) == [2]
    tail.close()


@pytest.mark.parametrize("is_packed", [False, True])
def test_a_file_that_begins_in_the_second_of_the_position_hides_no_row(
    path: Path, is_packed: bool
) -> None:
    # Names have whole seconds: the newer file was taken for the one of the position,
    # and the last rows of the older one were never given.
    rows = [line(1).replace(".000Z", f".{ms}Z") for ms in ("000", "250", "500", "750")]
    path.write_text(f"{HEADER}\n{rows[0]}{rows[1]}")
    after_first = TailPosition(NOON.timestamp() + 1.0)
    put_aside(path, 1, is_packed=is_packed)
    path.write_text(f"{HEADER}\n{rows[2]}{rows[3]}")
    path.rename(path.with_name("latlong-20261122T120001Z-2.csv"))
    path.write_text(text(5))
    tail = LogTail(path, after_first)
    found = [row.utc_s - NOON.timestamp() for row in tail.rows()]
    assert found == [1.25, 1.5, 1.75, 5.0]
    tail.close()


@pytest.mark.parametrize("is_packed", [False, True])
def test_a_log_of_the_future_that_was_put_aside_meanwhile_hides_no_row(
    path: Path, is_packed: bool
) -> None:
    path.write_text(text(5000, 5001))
    tail = LogTail(path)
    assert given(tail) == [5000, 5001]
    tail.close()
    append(path, 5002)
    put_aside(path, 5000, is_packed=is_packed)
    path.write_text(text(10, 11))
    later = LogTail(path, TailPosition(tail.position.utc_s))
    assert given(later) == [5002, 10, 11]
    later.close()


def test_damaged_lines_are_told_once_and_counted(
    path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    path.write_bytes(f"\ufeff{HEADER}\r\n".encode() + b"\0\0\n\0\n" + line(1).encode())
    tail = LogTail(path)
    assert given(tail) == [1]
    assert tail.counters["bad_lines"] == 2
    assert len(caplog.messages) == 1
    tail.close()
