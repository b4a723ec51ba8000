"""A file of raster tiles, as `serve.tiles` names one."""

import base64
import sqlite3
from contextlib import closing
from pathlib import Path

BLUE_PNG = base64.b64decode(
    "iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAIAAACQd1PeAAAADElEQVR4nGNgYPgPAAEDAQAIicLsAAAA"
    "AElFTkSuQmCC"
)


def mbtiles(path: Path, *tiles: tuple[int, int, int, bytes]) -> Path:
    """Write tiles of a zoom, a column, and a row from the south; return the path."""
    with closing(sqlite3.connect(path)) as db:
        db.execute("CREATE TABLE metadata (name text, value text)")
        db.execute(
            "CREATE TABLE tiles (zoom_level integer, tile_column integer, "
            "tile_row integer, tile_data blob)"
        )
        db.execute("INSERT INTO metadata VALUES ('attribution', '(c) somebody')")
        db.executemany("INSERT INTO tiles VALUES (?, ?, ?, ?)", tiles)
        db.commit()
    return path
