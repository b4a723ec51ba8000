"""Map tiles of an .mbtiles file that the user names.

Source: MBTiles 1.3: SQLite, rows counted from the south.
"""

import sqlite3
from pathlib import Path
from typing import Final

from imu_tracker.errors import ConfigError

MAX_ZOOM: Final = 22
_TYPES: Final = {
    b"\x89PNG": "image/png",
    b"\xff\xd8\xff": "image/jpeg",
    b"RIFF": "image/webp",
}


class Tiles:
    """An open file of raster tiles.

    Attributes
    ----------
    attribution : str
        Whom to thank, as plain text.
    zooms : tuple of int
        The least and the greatest zoom that it has.

    Raises
    ------
    ConfigError
        When it is no such file.
    """

    def __init__(self, path: Path) -> None:
        try:
            self._db = sqlite3.connect(f"{path.resolve().as_uri()}?mode=ro", uri=True)
        except sqlite3.Error as error:
            raise ConfigError(f'serve.tiles = "{path}": {error}') from error
        try:
            told = dict(self._db.execute("SELECT name, value FROM metadata LIMIT 100"))
            zooms = self._db.execute(
                "SELECT min(zoom_level), max(zoom_level) FROM tiles"
            ).fetchone()
        except sqlite3.Error as error:
            self.close()
            raise ConfigError(f'serve.tiles = "{path}": {error}') from error
        if zooms[0] is None or told.get("format") == "pbf":
            self.close()
            raise ConfigError(f'serve.tiles = "{path}": has no raster tiles')
        self.attribution = str(told.get("attribution", ""))[:500]
        self.zooms = (int(zooms[0]), int(zooms[1]))

    def get(self, zoom: int, x: int, y: int) -> tuple[str, bytes] | None:
        """Return the kind of a tile and its bytes; rows are counted from the north."""
        if not (0 <= zoom <= MAX_ZOOM and 0 <= x < 1 << zoom and 0 <= y < 1 << zoom):
            return None
        place = (zoom, x, (1 << zoom) - 1 - y)
        try:
            found = self._db.execute(
                "SELECT tile_data FROM tiles WHERE zoom_level = ? AND tile_column = ? "
                "AND tile_row = ?",
                place,
            ).fetchone()
        except sqlite3.Error:
            return None
        if found is None or not isinstance(found[0], bytes):
            return None
        kind = next((t for head, t in _TYPES.items() if found[0].startswith(head)), "")
        return (kind, found[0]) if kind else None

    def close(self) -> None:
        """Close the file."""
        self._db.close()
