"""Cursors and what waits: each row once, across restarts and rotations."""

import gzip
from pathlib import Path

import pytest

from imu_tracker.publish.outbox import Outbox, Selection
from imu_tracker.publish.thinning import Rules
from imu_tracker.storage.latlong import HEADER
from support.published import NOON_S, drive, line, row, write_log

EVERY = Selection(Rules(moving_s=0))
NEWEST = Selection(Rules(moving_s=10), is_newest_only=True)


def seconds(outbox: Outbox, limit: int = 10_000) -> list[float]:
    return [entry.row.utc_s - NOON_S for entry in outbox.take(limit)]


@pytest.fixture
def log(tmp_path: Path) -> Path:
    return tmp_path / "latlong.csv"


def test_rows_are_given_once_oldest_first_and_the_last_is_the_newest(
    log: Path,
) -> None:
    write_log(log, drive(5))
    outbox = Outbox(log, EVERY, None)
    assert [entry.is_newest for entry in outbox.take(3)] == [False] * 3
    assert [entry.is_newest for entry in outbox.take(3)] == [False, True]
    assert outbox.is_at_end
    assert outbox.take(3) == []
    assert outbox.read_rows == 5
    outbox.close()


def test_a_restart_goes_on_behind_the_row_that_was_taken(log: Path) -> None:
    write_log(log, drive(5))
    outbox = Outbox(log, EVERY, None)
    taken = outbox.take(2)
    outbox.close()
    again = Outbox(log, EVERY, taken[1].placed)
    assert seconds(again) == [0.5, 0.75, 1.0]
    again.close()


def test_the_newest_is_known_when_just_as_many_are_taken(log: Path) -> None:
    # It was sent as history, and a live map showed the row before for five minutes.
    write_log(log, [row(0), row(10), *(row(11 + n) for n in range(5))])
    outbox = Outbox(log, Selection(Rules()), None)
    assert [entry.is_newest for entry in outbox.take(2)] == [False, True]
    outbox.close()


@pytest.mark.parametrize("is_packed", [False, True])
def test_a_rotated_file_that_is_compressed_while_it_waits_is_read(
    log: Path, is_packed: bool
) -> None:
    write_log(log.with_name("latlong-20261122T120000Z.csv"), drive(4))
    second = log.with_name("latlong-20261122T120001Z.csv")
    write_log(second, drive(4, begin=4))
    write_log(log, drive(2, begin=8))
    outbox = Outbox(log, EVERY, None)
    assert seconds(outbox, 2) == [0, 0.25]
    if is_packed:  # it was found under its old name
        packed = second.with_name(f"{second.name}.gz")
        packed.write_bytes(gzip.compress(second.read_bytes()))
        second.unlink()
    assert seconds(outbox) == [n / 4 for n in range(2, 10)]
    outbox.close()


def test_rows_that_are_too_old_are_left_out_and_counted(log: Path) -> None:
    write_log(log, [row(0), row(10), row(20), row(30)])
    outbox = Outbox(log, EVERY._replace(max_age_s=15.0), None)
    assert seconds(outbox) == [20, 30]
    assert outbox.old_rows == 2
    outbox.close()


def test_of_newest_rows_none_is_of_before_the_start(log: Path) -> None:
    write_log(log, drive(5))
    outbox = Outbox(log, NEWEST, None)
    outbox.begin()
    assert outbox.take(1) == []
    with log.open("a") as file:
        file.writelines(map(line, drive(3, begin=5)))
    assert seconds(outbox, 1) == [7 / 4]
    outbox.close()


def test_of_newest_rows_none_is_of_before_the_connection(log: Path) -> None:
    write_log(log, drive(1))
    outbox = Outbox(log, NEWEST, None)
    with log.open("a") as file:
        file.writelines(map(line, drive(3, begin=1)))
    outbox.begin()
    assert outbox.take(1) == []
    outbox.close()


def test_newest_rows_are_ten_seconds_apart_whatever_happens(log: Path) -> None:
    write_log(log, [])
    outbox = Outbox(log, NEWEST, None)
    outbox.begin()
    sent = []
    for number in range(120):
        with log.open("a") as file:
            mode = "dr" if number % 2 else "gps"  # each row a change
            file.write(line(row(number / 4, mode=mode)))
        for entry in outbox.take(1):
            outbox.settle(entry.row)
            sent.append(entry.row.utc_s - NOON_S)
    assert sent == [0, 10, 20]
    outbox.close()


def test_a_log_that_is_empty_has_nothing(log: Path) -> None:
    log.write_text(f"{HEADER}\n")
    outbox = Outbox(log, EVERY, None)
    assert outbox.take(5) == []
    assert outbox.is_at_end
    outbox.close()
