"""Tiles of an .mbtiles file."""

from contextlib import closing
from pathlib import Path

import pytest

from imu_tracker.errors import ConfigError
from imu_tracker.serve.tiles import Tiles
from support.mbtiles import mbtiles

PNG = b"\x89PNG\r\n\x1a\n"


def test_rows_are_counted_from_the_north(tmp_path: Path) -> None:
    path = mbtiles(tmp_path / "a.mbtiles", (1, 0, 1, PNG), (2, 3, 0, b"<script>"))
    with closing(Tiles(path)) as tiles:
        assert tiles.get(1, 0, 0) == ("image/png", PNG)
        assert tiles.get(1, 0, 1) is None
        assert tiles.get(2, 3, 3) is None  # no picture
        assert tiles.get(30, 0, 0) is None
        assert (tiles.zooms, tiles.attribution) == ((1, 2), "(c) somebody")


@pytest.mark.parametrize("data", [None, b"nonsense" * 100, b""])
def test_a_file_that_is_none_is_refused(data: bytes | None, tmp_path: Path) -> None:
    path = tmp_path / "a.mbtiles"
    if data is not None:
        path.write_bytes(data)
    with pytest.raises(ConfigError, match=r"serve\.tiles = "):
        Tiles(path)


def test_a_file_without_tiles_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="no raster tiles"):
        Tiles(mbtiles(tmp_path / "a.mbtiles"))
