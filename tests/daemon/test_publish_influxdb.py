"""Rows to a real InfluxDB, Debian's: each once, whatever was sent twice."""

import contextlib
import json
import os
import shutil
import socket
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final
from urllib.parse import urlencode
from urllib.request import urlopen

import pytest

from support.brokers import free_port, until
from support.published import arguments, drive, publish_once, write_log

INFLUXD: Final = shutil.which("influxd", path=f"{os.environ.get('PATH')}:/usr/sbin")

pytestmark = pytest.mark.skipif(
    INFLUXD is None, reason="influxd is not here: apt install influxdb"
)

PASSWORD: Final = "correct horse"
ROWS: Final = 3000


class Database:
    """An influxd with a user, asked by its own query language."""

    def __init__(self, port: int) -> None:
        self.port = port

    def ask(self, query: str, **more: str) -> Any:
        form = {"q": query, "db": "track", "epoch": "ms", **more}
        url = f"http://127.0.0.1:{self.port}/query?{urlencode(form)}"
        with urlopen(url, b"", timeout=60.0) as response:
            return json.load(response)["results"][0]

    def is_there(self) -> bool:
        with contextlib.suppress(OSError):
            socket.create_connection(("127.0.0.1", self.port), 1.0).close()
            return True
        return False


@pytest.fixture
def database(tmp_path: Path) -> Iterator[Database]:
    assert INFLUXD is not None
    port = free_port()
    folder = tmp_path / "influxdb"
    config = tmp_path / "influxdb.conf"
    config.write_text(
        f'reporting-disabled = true\nbind-address = "127.0.0.1:{free_port()}"\n'
        f'[meta]\ndir = "{folder}/meta"\n'
        f'[data]\ndir = "{folder}/data"\nwal-dir = "{folder}/wal"\n'
        f'[http]\nbind-address = "127.0.0.1:{port}"\nauth-enabled = true\n'
        "[monitor]\nstore-enabled = false\n"
    )
    with (tmp_path / "influxd.log").open("wb") as log:
        process = subprocess.Popen(
            [INFLUXD, "-config", str(config)], stdout=log, stderr=log
        )
        try:
            found = Database(port)
            until(found.is_there, "influxd answers")
            found.ask(f"CREATE USER car WITH PASSWORD '{PASSWORD}' WITH ALL PRIVILEGES")
            yield found
        finally:
            process.kill()
            process.wait()


def test_each_row_is_there_once_with_its_time_and_its_values(
    tmp_path: Path, database: Database
) -> None:
    log, secret = tmp_path / "latlong.csv", tmp_path / "credentials"
    write_log(log, drive(ROWS))
    secret.write_text(f'user = "car"\npassword = "{PASSWORD}"\n')
    secret.chmod(0o600)
    url = f"http://127.0.0.1:{database.port}/write?db=track"
    keys = {"kind": "influx", "url": url, "moving_s": 0}
    who = {"u": "car", "p": PASSWORD}

    done = publish_once(*arguments(log, tmp_path, "a", **keys))
    assert done.returncode == 69
    assert "answers 401: see credentials_file" in done.stderr

    keys["credentials_file"] = secret
    done = publish_once(*arguments(log, tmp_path, "a", **keys))
    assert done.returncode == 69
    assert "database not found" in done.stderr
    assert "is this the URL of writing, and the database there?" in done.stderr

    database.ask("CREATE DATABASE track", **who)
    for name in ("a", "b"):  # the second sends what is there already
        done = publish_once(*arguments(log, tmp_path, name, **keys))
        assert done.returncode == 0, done.stderr
    answer = database.ask("SELECT * FROM position", **who)
    (series,) = answer["series"]
    names = "time alt_m course_deg id lat_deg lon_deg mode r95_m speed_mps"
    assert series["columns"] == names.split()
    expected = [
        [round(r.utc_s * 1000), 5.2, 40.1, "car", r.lat_deg, 4.37, "gps", 3.94, 13.8]
        for r in drive(ROWS)
    ]
    assert series["values"] == expected
