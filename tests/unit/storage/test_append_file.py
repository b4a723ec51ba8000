"""What befalls a log in the field: power cuts, full disks, rotation, two daemons."""

import gzip
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from imu_tracker.errors import OutputError
from imu_tracker.storage import append_file as appendfile
from imu_tracker.storage.latlong import HEADER, LatLongLog, format_row, read_log
from support.log_states import SECOND_NS, START_UTC_S, state
from support.small_disk import SmallDisk

ROTATED = "latlong-20261122T120000Z"
ROW_BYTES = len(format_row(state())) + 1


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "latlong.csv"


@pytest.fixture
def disk(monkeypatch: pytest.MonkeyPatch) -> SmallDisk:
    return SmallDisk(monkeypatch)


@pytest.fixture(autouse=True)
def no_descriptor_is_left_open() -> Iterator[None]:
    before = len(os.listdir("/proc/self/fd"))  # noqa: PTH208
    yield
    assert len(os.listdir("/proc/self/fd")) == before  # noqa: PTH208


def content(*seconds: float) -> str:
    return "".join(
        f"{row}\n" for row in [HEADER, *map(format_row, map(state, seconds))]
    )


def logged_seconds(path: Path) -> list[float]:
    return list(read_log(path).utc_s - START_UTC_S)


def write(log: LatLongLog, *seconds: float) -> None:
    for second in seconds:
        log.write(state(second))


def opened(path: Path, *seconds: float, max_mb: float = 16.0) -> LatLongLog:
    log = LatLongLog(path, max_mb=max_mb, min_free_mb=0.0)
    write(log, *seconds)
    return log


def pack(log: LatLongLog, blocks: int = 100) -> None:
    """Let the log compress so many blocks: one in each tenth of a second."""
    for tenth in range(blocks):
        log.tick(tenth * SECOND_NS // 10)


# -- an ordinary day


def test_a_new_log_has_its_header_before_there_is_a_row(path: Path) -> None:
    log = opened(path)

    assert path.read_text() == content()
    log.close()


def test_each_row_can_be_seen_at_once(path: Path) -> None:
    log = opened(path)
    for second in range(3):
        write(log, second)
        assert path.read_text() == content(*range(second + 1))
    log.close()


def test_the_log_is_not_for_strangers_eyes(path: Path) -> None:
    nested = path.parent / "var" / "log" / path.name
    old_mask = os.umask(0)
    try:
        opened(nested, 0).close()
    finally:
        os.umask(old_mask)

    assert nested.stat().st_mode & 0o777 == 0o640
    assert nested.parent.stat().st_mode & 0o777 == 0o750
    assert nested.parent.parent.stat().st_mode & 0o777 == 0o750


def test_rows_are_synced_every_few_seconds(path: Path, disk: SmallDisk) -> None:
    log = opened(path)
    disk.synced.clear()
    for quarter in range(40):
        write(log, quarter / 4)
        log.tick(quarter * SECOND_NS // 4)

    assert disk.synced == [path, path]  # in 10 s, with sync_s = 5
    log.tick(10 * SECOND_NS)
    disk.synced.clear()
    log.tick(20 * SECOND_NS)
    assert disk.synced == []  # nothing new, nothing to wear the card for
    log.close()


def test_a_restart_appends(path: Path) -> None:
    opened(path, 0, 1).close()
    opened(path, 2).close()

    assert path.read_text() == content(0, 1, 2)


# -- power cuts


@pytest.mark.parametrize(
    "torn",
    [
        format_row(state(2))[:30],
        format_row(state(2)),  # whole but for its newline: nobody can know
        format_row(state(2))[:30] + "\n",
        "\0" * 5000,
        format_row(state(2))[:30] + "\n\n\0\n",
    ],
)
def test_a_torn_tail_is_cut_off(
    path: Path, torn: str, caplog: pytest.LogCaptureFixture
) -> None:
    path.write_text(content(0, 1) + torn)

    opened(path, 3).close()

    assert path.read_text() == content(0, 1, 3)
    assert f"cut off a torn tail of {len(torn)} bytes" in caplog.text


@pytest.mark.parametrize("zeros", [0, 99])
@pytest.mark.parametrize("kept", [0, 1, 30, len(HEADER)])
def test_a_torn_header_is_written_again(path: Path, kept: int, zeros: int) -> None:
    path.write_text(HEADER[:kept] + "\0" * zeros)

    opened(path, 0).close()

    assert path.read_text() == content(0)


def test_a_tail_of_nothing_but_garbage_is_moved_away_not_cut(path: Path) -> None:
    damaged = content(0) + "x" * 100_000
    path.write_text(damaged)

    opened(path, 1).close()

    assert path.read_text() == content(1)
    assert path.with_name(f"{ROTATED}.csv").read_text() == damaged


# -- what is not ours


@pytest.mark.parametrize(
    ("old", "name"),
    [
        ("time_utc,lat\n2026-11-22T12:00:00Z,51.9\n", f"{ROTATED}.csv"),
        ("time_utc,lat\n", "latlong-undated.csv"),
        ("x" * 30 + content(0)[30:], f"{ROTATED}.csv"),
    ],
    ids=["an older header", "nothing but one", "a damaged header"],
)
def test_a_log_with_another_header_is_moved_away_not_mixed(
    path: Path, old: str, name: str, caplog: pytest.LogCaptureFixture
) -> None:
    path.write_text(old)

    log = opened(path, 1)

    assert path.read_text() == content(1)
    assert path.with_name(name).read_text() == old
    assert f"had another format, moved to {path.with_name(name)}" in caplog.text
    log.close()


@pytest.mark.parametrize(
    "foreign",
    [
        b"my shopping list",
        b"a,b,c\n1,2,3\n",
        b"\0\0\0\0a disk image",
        gzip.compress(b"somebody's backup", mtime=0),
    ],
)
def test_a_file_of_somebody_else_is_refused_and_left_alone(
    path: Path, foreign: bytes
) -> None:
    path.write_bytes(foreign)

    with pytest.raises(
        OutputError, match="did not write this file; move it away"
    ) as error:
        opened(path)

    assert error.value.exit_code == 73
    assert path.read_bytes() == foreign
    assert {found.name for found in path.parent.iterdir()} == {
        *("latlong.csv", ".latlong.csv.lock"),
    }


def test_a_foreign_file_put_in_its_place_later_is_left_alone_and_rows_wait(
    path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    log = opened(path, 0)
    path.unlink()
    path.write_text("my shopping list")
    log.reopen()
    write(log, 1)
    assert log.is_failing
    assert "did not write" in caplog.text
    assert path.read_text() == "my shopping list"
    path.unlink()
    log.reopen()
    log.close()
    assert path.read_text() == content(1)


def test_a_second_daemon_on_the_same_log_is_refused(path: Path) -> None:
    first = opened(path, 0)
    with pytest.raises(OutputError, match="another process is writing it") as error:
        opened(path)
    assert error.value.exit_code == 73
    path.rename(path.with_name("moved.csv"))
    first.reopen()
    with pytest.raises(OutputError, match="another process is writing it"):
        opened(path)
    first.close()

    opened(path, 1).close()


def test_a_daemon_that_was_killed_does_not_keep_the_next_one_out(path: Path) -> None:
    script = (
        "import os, sys; from pathlib import Path;"
        "from imu_tracker.storage.latlong import LatLongLog;"
        "log = LatLongLog(Path(sys.argv[1])); os.kill(os.getpid(), 9)"
    )
    subprocess.run([sys.executable, "-c", script, str(path)], check=False)
    assert path.exists()

    opened(path, 0).close()


def test_a_log_that_cannot_be_opened_is_named_with_the_reason(
    path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path.mkdir()
    with pytest.raises(OutputError, match=rf"{path}: cannot be opened: Is a directory"):
        opened(path)
    with pytest.raises(OutputError, match=r"cannot be opened: Not a directory"):
        opened(Path("/dev/null/latlong.csv"))

    def refuse(*_: object) -> int:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(os, "open", refuse)  # tests may run as root
    with pytest.raises(OutputError, match=r"cannot be opened: Permission denied"):
        opened(path.with_name("other.csv"))


def test_a_device_is_no_log(path: Path) -> None:
    os.mkfifo(path)
    with pytest.raises(OutputError, match="must be a regular file"):
        opened(path)


# -- disks that are full, fail or vanish


@pytest.mark.parametrize("fitting", [0, 1, 40, ROW_BYTES - 1])
def test_a_full_disk_is_reported_once_and_loses_nothing(
    path: Path, disk: SmallDisk, fitting: int, caplog: pytest.LogCaptureFixture
) -> None:
    log = opened(path, 0)
    disk.free_bytes = fitting
    for second in range(1, 30):
        write(log, second)
        log.tick(second * SECOND_NS)
    assert log.is_failing
    assert caplog.text.count("cannot be written: No space left on device") == 1

    disk.free_bytes = 10_000
    log.tick(100 * SECOND_NS)
    write(log, 30)
    log.close()

    assert path.read_text() == content(*range(31))
    assert caplog.text.count("is written again") == 1
    assert log.counters["rows"] == 31
    assert 0 < log.counters["write_failures"] <= 10


def test_a_disk_with_little_room_takes_what_fits(path: Path, disk: SmallDisk) -> None:
    log = opened(path, 0)
    disk.free_bytes = 0
    write(log, *range(1, 100))
    for second in range(0, 500, 5):
        disk.free_bytes = 2 * ROW_BYTES - 1  # a row and most of another
        log.tick(second * SECOND_NS)
    assert not log.is_failing
    log.close()

    assert path.read_text() == content(*range(100))


def test_a_clean_end_on_a_full_disk_leaves_whole_rows(
    path: Path, disk: SmallDisk
) -> None:
    log = opened(path, 0)
    disk.free_bytes = ROW_BYTES + ROW_BYTES // 2
    write(log, 1, 2, 3)
    log.close()

    assert path.read_text() == content(0, 1)


def test_a_failing_disk_is_survived(
    path: Path, disk: SmallDisk, caplog: pytest.LogCaptureFixture
) -> None:
    log = opened(path, 0)
    disk.fails = True
    write(log, 1, 2)
    log.tick(10 * SECOND_NS)
    disk.fails = False
    log.tick(20 * SECOND_NS)
    log.close()

    assert path.read_text() == content(0, 1, 2)
    assert caplog.text.count("cannot be written: Input/output error") == 1


def test_a_sync_that_fails_is_reported_and_the_file_opened_again(
    path: Path, disk: SmallDisk, caplog: pytest.LogCaptureFixture
) -> None:
    log = opened(path, 0)
    disk.fails = True
    log.tick(SECOND_NS)
    assert log.is_failing
    disk.fails = False
    log.tick(10 * SECOND_NS)
    write(log, 1)
    log.close()

    assert path.read_text() == content(0, 1)
    assert caplog.text.count("cannot be written") == 1


def test_memory_is_bounded_while_the_disk_fails(
    path: Path, disk: SmallDisk, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(appendfile, "MAX_WAITING_BYTES", 5 * ROW_BYTES)
    log = opened(path)
    disk.free_bytes = 0
    write(log, *range(9))
    disk.free_bytes = 10_000
    log.tick(SECOND_NS)
    log.close()

    assert path.read_text() == content(*range(5))
    assert log.counters["lost_rows"] == 4


def test_rows_that_no_disk_takes_until_the_end_are_reported(
    path: Path, disk: SmallDisk, caplog: pytest.LogCaptureFixture
) -> None:
    log = opened(path, 0)
    disk.free_bytes = 0
    write(log, 1)
    log.close()

    assert path.read_text() == content(0)
    assert f"{ROW_BYTES} bytes are lost" in caplog.text


def test_a_directory_that_vanishes_is_made_again(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    path = tmp_path / "logs" / "latlong.csv"
    log = opened(path, 0)
    path.parent.rename(tmp_path / "gone")
    path.parent.write_text("in the way")
    log.tick(SECOND_NS)
    write(log, 1)
    path.parent.unlink()
    log.tick(10 * SECOND_NS)
    write(log, 2)
    log.close()

    assert path.read_text() == content(1, 2)
    assert caplog.text.count("cannot be written: ") == 1


# -- SIGHUP


def test_a_log_that_was_moved_is_begun_anew_on_reopening(path: Path) -> None:
    log = opened(path, 0)
    path.rename(path.with_name("latlong.csv.1"))
    log.reopen()
    write(log, 1)
    log.close()

    assert path.with_name("latlong.csv.1").read_text() == content(0)
    assert path.read_text() == content(1)


def test_reopening_a_log_that_was_not_moved_changes_nothing(path: Path) -> None:
    log = opened(path, 0)
    log.reopen()
    write(log, 1)
    log.close()

    assert path.read_text() == content(0, 1)


def test_a_log_that_was_deleted_comes_back_by_itself(
    path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    log = opened(path, 0)
    path.unlink()
    log.tick(SECOND_NS)
    write(log, 1)
    log.close()

    assert path.read_text() == content(1)
    assert "was moved or deleted, begun anew" in caplog.text


# -- rotation


def test_a_log_that_is_full_is_rotated_and_compressed(path: Path) -> None:
    log = opened(path, *range(30), max_mb=10 * ROW_BYTES / 1e6)
    pack(log)
    log.close()

    rotated = sorted(path.parent.glob("latlong-*"))
    assert [file.name for file in rotated] == [
        "latlong-20261122T120000Z.csv.gz",
        "latlong-20261122T120010Z.csv.gz",
        "latlong-20261122T120020Z.csv.gz",
    ]
    assert all(file.stat().st_mode & 0o777 == 0o640 for file in rotated)
    assert gzip.decompress(rotated[1].read_bytes()).decode() == content(*range(10, 20))
    assert path.read_text() == content()


def test_a_name_that_is_taken_gets_a_number(path: Path) -> None:
    for name in (f"{ROTATED}.csv.gz", f"{ROTATED}-2.csv.gz"):
        path.with_name(name).write_bytes(gzip.compress(content().encode()))
    log = opened(path, 0, max_mb=0)
    pack(log)
    log.close()

    assert logged_seconds(path.with_name(f"{ROTATED}-3.csv.gz")) == [0]


@pytest.mark.parametrize("blocks", range(6))
def test_a_power_cut_in_a_rotation_neither_loses_nor_doubles_a_row(
    path: Path, blocks: int
) -> None:
    seconds = range(4 * (1 << 16) // ROW_BYTES)  # four blocks to compress
    log = opened(path, *seconds, max_mb=(len(seconds) - 1) * ROW_BYTES / 1e6)
    pack(log, blocks)
    after = path.parent / "after"
    shutil.copytree(path.parent, after)  # what is on the disk at this moment
    log.close()

    path = after / path.name
    log = opened(path)
    pack(log)
    log.close()

    rotated = path.with_name(f"{ROTATED}.csv.gz")
    assert [*logged_seconds(rotated), *logged_seconds(path)] == [*seconds]
    assert {file.name for file in after.iterdir()} == {
        rotated.name,
        path.name,
        ".latlong.csv.lock",
    }


def test_a_power_cut_before_the_uncompressed_file_is_deleted_doubles_no_row(
    path: Path,
) -> None:
    path.with_name(f"{ROTATED}.csv").write_text(content(0, 1))
    rotated = path.with_name(f"{ROTATED}.csv.gz")
    rotated.write_bytes(gzip.compress(content(0, 1).encode()))
    log = opened(path, 2)
    pack(log)
    log.close()

    assert not path.with_name(f"{ROTATED}.csv").exists()
    assert logged_seconds(rotated) == [0, 1]


def test_a_log_that_cannot_be_rotated_grows_on(
    path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    def refuse(*_: object) -> Path:
        raise PermissionError(13, "Permission denied")

    with monkeypatch.context() as patch:
        patch.setattr(Path, "rename", refuse)
        log = opened(path, *range(40), max_mb=16 * ROW_BYTES / 1e6)
    assert path.read_text() == content(*range(40))
    assert "cannot be rotated: Permission denied" in caplog.text

    write(log, 40, 41)
    assert path.read_text() == content(41)
    log.close()


def test_a_compression_that_fails_is_left_to_the_next_start(
    path: Path, disk: SmallDisk, caplog: pytest.LogCaptureFixture
) -> None:
    log = opened(path, 0, max_mb=0)
    disk.fails = True
    log.tick(0)
    pack(log)
    disk.fails = False
    log.close()
    assert "not compressed before the next start" in caplog.text
    assert path.with_name(f"{ROTATED}.csv").read_text() == content(0)
    assert not path.with_name(f"{ROTATED}.csv.gz.tmp").exists()

    log = opened(path)
    pack(log)
    log.close()
    assert logged_seconds(path.with_name(f"{ROTATED}.csv.gz")) == [0]


def test_the_oldest_rotated_file_goes_when_the_disk_is_nearly_full(
    path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    names = [
        "latlong-20261122T120000Z-2.csv.gz",
        "latlong-20261122T120000Z.csv.gz",
        "latlong-20261121T120000Z.csv.gz",
        "latlong-undated.csv.gz",
        "latlong-notes.csv.gz",  # not ours
    ]
    for name in names:
        path.with_name(name).write_bytes(gzip.compress(content().encode()))
    log = LatLongLog(path, min_free_mb=1e12)
    gone = []
    for second in range(0, 60, 10):
        log.tick(second * SECOND_NS)
        gone += [n for n in names if not path.with_name(n).exists() and n not in gone]
    log.close()

    assert gone == [names[3], names[2], names[1], names[0]]
    assert caplog.text.count("deleted, the disk has less than") == 4


def test_rotated_files_are_kept_while_there_is_room(path: Path) -> None:
    kept = path.with_name("latlong-20261121T120000Z.csv.gz")
    kept.write_bytes(gzip.compress(content().encode()))
    log = LatLongLog(path, min_free_mb=0.001)
    log.tick(SECOND_NS)
    log.close()

    assert kept.exists()
