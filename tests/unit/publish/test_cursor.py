"""A cursor outlasts its process, and belongs to one."""

import json
import os
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from imu_tracker.errors import OutputError
from imu_tracker.publish.cursor import SAVE_NS, Cursor
from imu_tracker.publish.thinning import Placed
from imu_tracker.storage.log_tail import TailPosition
from support.published import NOON_S, row


def placed(second: float) -> Placed:
    return Placed(row(second), TailPosition(NOON_S + second, 7, 100))


def test_a_cursor_outlasts_its_process(tmp_path: Path) -> None:
    with Cursor(tmp_path / "cursors", "home") as cursor:
        cursor.move(placed(1))
        cursor.move(placed(2))
    with Cursor(tmp_path / "cursors", "home") as again:
        assert again.placed == placed(2)
        assert again.rows == 2
    path = tmp_path / "cursors" / "cursor-home.json"
    assert path.stat().st_mode & 0o777 == 0o640


def test_a_cursor_is_saved_at_most_once_in_four_seconds(tmp_path: Path) -> None:
    path = tmp_path / "cursor-home.json"

    def saved() -> float:
        return float(json.loads(path.read_text())["row"][0]) - NOON_S

    with Cursor(tmp_path, "home") as cursor:
        cursor.move(placed(1))
        cursor.save_if_due(0)
        cursor.move(placed(2))
        cursor.save_if_due(SAVE_NS - 1)
        assert saved() == 1
        cursor.save_if_due(SAVE_NS)
        assert saved() == 2


def test_a_cursor_has_one_process(tmp_path: Path) -> None:
    refused = pytest.raises(OutputError, match="another imu-tracker publish has it")
    with Cursor(tmp_path, "home"), Cursor(tmp_path, "other"), refused:
        Cursor(tmp_path, "home")


@pytest.mark.parametrize(
    "text",
    [
        *("", "{", "[]", '{"version": 2}', '{"version": 1, "position": {}, "row": []}'),
        '{"version":1,"rows":1,"position":{"x":1},"row":[1,2,3,4,5,6,7,"gps"]}',
    ],
)
def test_a_damaged_cursor_begins_again_and_is_told(
    tmp_path: Path, text: str, caplog: pytest.LogCaptureFixture
) -> None:
    (tmp_path / "cursor-home.json").write_text(text)
    with Cursor(tmp_path, "home") as cursor:
        assert cursor.placed is None
    assert "is no cursor" in caplog.text


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write everywhere")
def test_a_directory_that_may_not_be_written_is_told(tmp_path: Path) -> None:
    tmp_path.chmod(0o500)
    with pytest.raises(OutputError, match="cannot be kept there"):
        Cursor(tmp_path / "x", "home")


def test_a_disk_that_refuses_is_told_once_and_tried_again(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    with Cursor(tmp_path / "there", "home") as cursor:
        (tmp_path / "there").rename(tmp_path / "gone")
        for second in range(3):
            cursor.move(placed(second))
            cursor.save()
        assert caplog.text.count("cannot be written") == 1
        (tmp_path / "gone").rename(tmp_path / "there")
        cursor.save()
        saved = json.loads((tmp_path / "there" / "cursor-home.json").read_text())
        assert saved["row"][0] == NOON_S + 2


anything = st.recursive(
    st.one_of(st.none(), st.booleans(), st.integers(), st.floats(), st.text()),
    lambda inner: st.one_of(
        st.lists(inner, max_size=9), st.dictionaries(st.text(), inner, max_size=4)
    ),
    max_leaves=12,
)
keys = st.fixed_dictionaries(
    {},
    optional={
        "version": st.one_of(st.just(1), anything),
        "rows": anything,
        "row": st.one_of(st.lists(anything, min_size=8, max_size=8), anything),
        "position": st.one_of(
            st.fixed_dictionaries(dict.fromkeys(TailPosition._fields, anything)),
            anything,
        ),
    },
)


@given(found=st.one_of(keys, anything))
def test_a_cursor_of_anything_is_a_cursor_or_none(
    tmp_path_factory: pytest.TempPathFactory, found: object
) -> None:
    folder = tmp_path_factory.getbasetemp() / "any"
    folder.mkdir(exist_ok=True)
    (folder / "cursor-home.json").write_text(json.dumps(found))
    with Cursor(folder, "home") as cursor:
        if cursor.placed is not None:
            # What is kept can be sent on, and be saved again.
            cursor.move(cursor.placed)
