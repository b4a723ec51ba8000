"""Rows to a real Mosquitto: each once and in order, whatever happens meanwhile."""

import json
import re
import shutil
import signal
import subprocess
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from math import cos, sin
from pathlib import Path
from random import Random
from typing import Any

import pytest

from imu_tracker.check.destinations import check_destinations
from imu_tracker.config import load_config
from imu_tracker.publish import worker as worker_module
from imu_tracker.publish.senders import security
from imu_tracker.publish.senders.mqtt import WINDOW
from imu_tracker.publish.thinning import Placed, Rules, Thinner
from imu_tracker.samples import Mode
from imu_tracker.storage.latlong import LatLongLog, LogRow, format_utc, read_rows
from imu_tracker.storage.log_tail import TailPosition
from support.brokers import (
    Broker,
    Certificates,
    Sent,
    Wire,
    certificates,
    certificates_of_2040,
    mosquitto,
    needs_mosquitto,
    until,
)
from support.log_states import state
from support.paths import REPOSITORY
from support.published import (
    NOON_S,
    arguments,
    drive,
    line,
    publish_once,
    publishing,
    row,
    working,
    write_log,
)

pytestmark = [
    needs_mosquitto,
    pytest.mark.skipif(
        shutil.which("mosquitto_sub") is None,
        reason="mosquitto_sub is not here: apt install mosquitto-clients",
    ),
]

ACCEPTANCE = pytest.mark.acceptance
PASSWORD = "correct horse"
HOUR_S = 3600.0
REST = (0.0, 0.0)


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """A destination that fails is tried again at once: tests have no time."""
    monkeypatch.setattr(worker_module, "FIRST_DELAY_S", 0.05)
    monkeypatch.setattr(worker_module, "LONGEST_DELAY_S", 0.05)
    monkeypatch.setattr(worker_module, "IDLE_S", 0.05)


@contextmanager
def subscribed(port: int, folder: Path, topic: str, *options: str) -> Iterator[Path]:
    """Write what arrives, as `TOPIC PAYLOAD` in lines, from now on."""
    path = folder / "arrived"
    to = ["-h", "localhost", "-p", str(port), *options]
    mark = ["-t", topic.replace("#", "mark").replace("+", "mark"), "-m", "mark"]
    subprocess.run(["mosquitto_pub", *to, "-r", "-q", "1", *mark], check=True)
    with path.open("wb") as file:
        process = subprocess.Popen(
            ["mosquitto_sub", *to, "-q", "1", "-t", topic, "-F", "%t %p"], stdout=file
        )
        try:
            until(lambda: path.read_bytes().endswith(b"mark\n"), "it is subscribed")
            yield path
        finally:
            process.kill()
            process.wait()


def arrived(path: Path) -> list[tuple[str, Any]]:
    lines = [each.partition(" ") for each in path.read_text().splitlines()]
    return [(topic, json.loads(text)) for topic, _, text in lines if text[:1] == "{"]


def times(rows: list[LogRow]) -> list[str]:
    return [format_utc(each.utc_s) for each in rows]


def acknowledged(wire: Wire) -> list[str]:
    return [json.loads(sent.payload)["time_utc"] for sent in rows_of(wire.acknowledged)]


def rows_of(passed: list[Sent]) -> list[Sent]:
    return [sent for sent in passed if b"time_utc" in sent.payload]


def guarded(folder: Path, made: Certificates) -> list[str]:
    """Return the lines of a broker with TLS and a password for everybody."""
    passwords = folder / "passwords"
    passwords.touch(0o600)
    subprocess.run(
        ["mosquitto_passwd", "-b", str(passwords), "car", PASSWORD], check=True
    )
    return [
        f"cafile {made.ca}",
        f"certfile {made.certificate}",
        f"keyfile {made.key}",
        f"password_file {passwords}",
    ]


def credentials(folder: Path, password: str = PASSWORD) -> Path:
    path = folder / "credentials"
    path.write_text(f'user = "car"\npassword = "{password}"\n')
    path.chmod(0o600)
    return path


@pytest.mark.parametrize("rows", [10_000, pytest.param(100_000, marks=ACCEPTANCE)])
def test_a_backlog_arrives_once_each_and_in_order_by_tls_and_password(
    tmp_path: Path, rows: int
) -> None:
    made = certificates(tmp_path / "certificates")
    log = tmp_path / "latlong.csv"
    write_log(log, drive(rows))
    options = ("--cafile", str(made.ca), "-u", "car", "-P", PASSWORD)
    with (
        mosquitto(tmp_path / "broker", *guarded(tmp_path, made)) as broker,
        subscribed(broker.port, tmp_path, "imu-tracker/car/+", *options) as path,
    ):
        chosen = arguments(
            log,
            tmp_path,
            "home",
            kind="mqtt",
            url=f"mqtts://localhost:{broker.port}",
            ca_file=made.ca,
            credentials_file=credentials(tmp_path),
            moving_s=0,
        )
        done = publish_once(*chosen)
        assert done.returncode == 0, done.stderr
        assert PASSWORD not in done.stderr
        until(lambda: path.read_bytes().count(b"time_utc") >= rows, "all arrived")
        again = publish_once(*chosen)
        assert again.returncode == 0, again.stderr
        assert again.stderr.endswith("rows sent: home 0\n")
        found = [(t, p) for t, p in arrived(path) if "time_utc" in p]
    assert [p["time_utc"] for _, p in found] == times(drive(rows))
    assert {p["id"] for _, p in found} == {"car"}
    assert Counter(topic for topic, _ in found) == {
        "imu-tracker/car/history": rows - 1,
        "imu-tracker/car/position": 1,
    }


@pytest.mark.usefixtures("quick")
@pytest.mark.parametrize("kills", [6, pytest.param(50, marks=ACCEPTANCE)])
def test_a_broker_that_is_killed_gets_every_row_in_order(
    tmp_path: Path, kills: int
) -> None:
    rng = Random(5)
    rows = drive(kills * 400)
    log = tmp_path / "latlong.csv"
    write_log(log, rows)
    with mosquitto(tmp_path / "broker") as broker:
        wire = Wire(broker.port)
        try:
            url = f"mqtt://127.0.0.1:{wire.port}"
            chosen = arguments(log, tmp_path, "a", kind="mqtt", url=url, moving_s=0)
            with working(*chosen) as worker:
                for _ in range(kills):
                    goal = len(wire.acknowledged) + rng.randrange(1, 400)
                    until(
                        lambda goal=goal: (
                            len(wire.acknowledged) >= goal  # type: ignore[misc]
                            or worker.sent_rows == len(rows)
                        ),
                        "rows are acknowledged",
                    )
                    broker.kill(rng.choice([signal.SIGKILL, signal.SIGTERM]))
                    broker.start()
                until(lambda: worker.sent_rows == len(rows), "every row is taken")
        finally:
            wire.close()
    # What the broker has said it has. Mosquitto may lose what it has not written to its
    # disk when it is killed: that is between it and its disk.
    found = acknowledged(wire)
    assert list(dict.fromkeys(found)) == times(rows)
    # An acknowledgement that was on its way when the broker died never reached us.
    repeated = len(found) - len(rows)
    assert repeated <= WINDOW * worker.errors
    print(f"{kills} kills, {worker.errors} losses, {repeated} rows acknowledged twice")


@pytest.mark.usefixtures("quick")
def test_a_publisher_that_is_killed_loses_nothing_and_repeats_equal_rows(
    tmp_path: Path,
) -> None:
    rng = Random(6)
    rows = drive(6000)
    log = tmp_path / "latlong.csv"
    write_log(log, rows)
    with mosquitto(tmp_path / "broker") as broker:
        wire = Wire(broker.port)
        try:
            url = f"mqtt://127.0.0.1:{wire.port}"
            chosen = arguments(log, tmp_path, "a", kind="mqtt", url=url, moving_s=0)
            for _ in range(4):
                goal = len(rows_of(wire.acknowledged)) + rng.randrange(1, 1200)
                with publishing(*chosen) as process:
                    until(
                        lambda goal=goal: len(rows_of(wire.acknowledged)) >= goal,  # type: ignore[misc]
                        "rows are acknowledged",
                    )
                    process.kill()
            done = publish_once(*chosen)
            assert done.returncode == 0, done.stderr
        finally:
            wire.close()
    found: dict[str, set[bytes]] = {}
    for sent in rows_of(wire.acknowledged):
        found.setdefault(json.loads(sent.payload)["time_utc"], set()).add(sent.payload)
    assert sorted(found) == times(rows)
    assert all(len(payloads) == 1 for payloads in found.values())


def week(writer: LatLongLog, apart_s: float, begin_s: float, end_s: float) -> None:
    """Write rows: each day four hours in a circle of two kilometres, then rest."""
    for number in range(int(begin_s / apart_s), int(end_s / apart_s)):
        second = number * apart_s
        is_moving = 8.0 <= second / 3600.0 % 24.0 < 12.0
        angle = second / 154.0 if is_moving else 0.0
        writer.write(
            state(
                second,
                lat_deg=51.99 + 0.018 * sin(angle),
                lon_deg=4.37 + 0.029 * cos(angle),
                v_ne_mps=(13.0 * cos(angle), -13.0 * sin(angle)) if is_moving else REST,
                mode=Mode.GPS if is_moving else Mode.STILL,
            )
        )
        writer.tick(int(second * 1e9))


def logged(path: Path) -> list[LogRow]:
    """Return every row of a log, those of rotated files first."""
    rotated = sorted(path.parent.glob("latlong-*"))
    return [each for file in [*rotated, path] for each in read_rows(file)]


def thinned(rows: list[LogRow], rules: Rules) -> list[LogRow]:
    thinner = Thinner(rules)
    placed = (Placed(each, TailPosition()) for each in rows)
    return [due.row for each in placed for due in thinner.feed(each)]


@pytest.mark.usefixtures("quick")
@pytest.mark.parametrize(
    ("apart_s", "max_mb"), [(30.0, 0.05), pytest.param(0.25, 16, marks=ACCEPTANCE)]
)
def test_a_week_without_a_network_is_sent_when_there_is_one(
    tmp_path: Path, apart_s: float, max_mb: float
) -> None:
    log = tmp_path / "latlong.csv"
    writer = LatLongLog(log, sync_s=3600.0, min_free_mb=0.0, max_mb=max_mb)
    with mosquitto(tmp_path / "broker") as broker:
        wire = Wire(broker.port)
        try:
            week(writer, apart_s, 0.0, HOUR_S)
            url = f"mqtt://127.0.0.1:{wire.port}"
            with working(
                *arguments(log, tmp_path, "a", kind="mqtt", url=url)
            ) as worker:
                until(lambda: worker.sent_rows > 5, "the first hour is sent")
                wire.cut()
                week(writer, apart_s, HOUR_S, 7 * 24 * HOUR_S)
                writer.close()
                wire.mend()
                expected = thinned(logged(log), Rules())
                until(lambda: worker.sent_rows == len(expected), "the week is sent")
        finally:
            wire.close()
    assert len(list(tmp_path.glob("latlong-*"))) >= 9
    assert acknowledged(wire) == times(expected)


@pytest.mark.usefixtures("quick")
def test_rows_that_were_deleted_unsent_are_counted_and_the_rest_goes_on(
    tmp_path: Path,
) -> None:
    log, status = tmp_path / "latlong.csv", tmp_path / "publish.json"
    names = [f"latlong-20261122T12{n:02d}00Z.csv" for n in range(3)]
    for number, name in enumerate(names):
        write_log(tmp_path / name, drive(240, begin=240 * number))
    write_log(log, drive(240, begin=720))

    def told() -> Any:
        return json.loads(status.read_text())["destinations"]["a"]

    broker = Broker(tmp_path / "broker")
    try:
        url = f"mqtt://127.0.0.1:{broker.port}"
        chosen = arguments(log, tmp_path, "a", kind="mqtt", url=url, moving_s=0)
        with publishing(*chosen):
            until(lambda: status.exists() and told()["unsent_rows"] == 960, "counted")
            assert told()["oldest_unsent"] == times(drive(1))[0]
            assert "refused" in told()["last_error"]
            (tmp_path / names[1]).unlink()
            broker.start()
            until(lambda: told()["deleted_rows"] == 240, "the deleted rows are counted")
            until(lambda: told()["unsent_rows"] == 0, "the rest is sent")
            assert told()["sent_rows"] == 720
            assert told()["last_row"] == times(drive(1, begin=959))[0]
    finally:
        broker.close()


def refusals(tmp_path: Path, **keys: object) -> str:
    """Return what is said of a destination that does not want us."""
    log = tmp_path / "latlong.csv"
    write_log(log, drive(3))
    done = publish_once(*arguments(log, tmp_path, "home", kind="mqtt", **keys))
    assert done.returncode == 69
    assert PASSWORD not in done.stderr
    assert "hunter2" not in done.stderr
    *_, said = (each for each in done.stderr.splitlines() if each[:8] == "warning:")
    return said


def test_what_is_wrong_with_a_broker_is_said(tmp_path: Path) -> None:
    made = certificates(tmp_path / "certificates")
    right = credentials(tmp_path)
    with mosquitto(tmp_path / "broker", *guarded(tmp_path, made)) as broker:
        here = f"localhost:{broker.port}"
        good = {"url": f"mqtts://{here}", "ca_file": made.ca}
        said = refusals(tmp_path, url=f"mqtts://{here}", credentials_file=right)
        assert "its certificate is not trusted" in said
        assert "ca_file" in said
        said = refusals(tmp_path, url=f"mqtt://{here}")
        assert "is this the port for plain MQTT?" in said
        assert "not authorized; see credentials_file" in refusals(tmp_path, **good)
        wrong = credentials(tmp_path / "certificates", "hunter2")
        said = refusals(tmp_path, **good, credentials_file=wrong)
        assert "see credentials_file" in said
        wrong.chmod(0o644)
        said = refusals(tmp_path, **good, credentials_file=wrong)
        assert "others may read or change it: chmod 640" in said
        wrong.chmod(0o600)
        wrong.write_text('password = "hunter2\n')
        said = refusals(tmp_path, **good, credentials_file=wrong)
        assert "must hold lines like" in said
        said = refusals(tmp_path, **good, credentials_file=tmp_path / "none")
        assert "No such file" in said
        other = {**good, "url": f"mqtts://127.0.0.2:{broker.port}"}
        assert "refused: nobody listens there" in refusals(tmp_path, **other)


@pytest.mark.usefixtures("quick")
# paho leaves the socket of a handshake that failed to the garbage collector.
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
def test_a_clock_that_is_not_set_is_waited_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    # To a Pi that woke up in 1970, or 2026, every certificate is of the future.
    monkeypatch.setattr(security, "CLOCK_S", 0.05)
    made = certificates_of_2040(tmp_path / "certificates")
    log = tmp_path / "latlong.csv"
    write_log(log, drive(3))
    with mosquitto(tmp_path / "broker", *guarded(tmp_path, made)) as broker:
        keys = {"url": f"mqtts://localhost:{broker.port}", "ca_file": made.ca}
        keys |= {"kind": "mqtt", "credentials_file": credentials(tmp_path)}
        with working(*arguments(log, tmp_path, "a", **keys)) as worker:
            until(lambda: worker.errors > 3, "it is tried again and again")
    assert caplog.text.count("the clock of this computer is not set") == 1
    assert "waits until it is" in worker.last_error


def test_check_logs_in_beside_a_publisher_and_disturbs_nothing(tmp_path: Path) -> None:
    made = certificates(tmp_path / "certificates")
    log = tmp_path / "latlong.csv"
    write_log(log, drive(3))
    with mosquitto(tmp_path / "broker", *guarded(tmp_path, made)) as broker:
        keys = {"url": f"mqtts://localhost:{broker.port}", "ca_file": made.ca}
        keys |= {"kind": "mqtt", "credentials_file": credentials(tmp_path)}
        chosen = arguments(log, tmp_path, "a", **keys)
        with working(*chosen) as worker:
            until(lambda: worker.sent_rows > 0, "it is connected")
            (found,) = check_destinations(load_config(None, chosen[1::2]))
            assert found.exit_code == 0
            assert found.text.endswith("logged in, MQTT 5, TLS")
            write_log(log, drive(99))
            until(lambda: worker.sent_rows > 1, "it goes on")
            assert worker.errors == 0


def test_a_broker_that_lets_nobody_write_is_told_and_takes_nothing(
    tmp_path: Path,
) -> None:
    acl = tmp_path / "acl"
    acl.write_text("topic read #\ntopic write imu-tracker/car/availability\n")
    acl.chmod(0o600)
    with mosquitto(tmp_path / "broker", f"acl_file {acl}") as broker:
        said = refusals(tmp_path, url=f"mqtt://127.0.0.1:{broker.port}")
        assert "refuses a message: not authorized" in said


def test_the_broker_of_the_fleet_page_lets_a_tracker_write_below_its_name_alone(
    tmp_path: Path,
) -> None:
    text = (REPOSITORY / "docs" / "fleet.md").read_text("utf-8")
    block = r"^`([\w./]+)`(?:(?!```).)*?:\n\n```\n(.*?)```"
    blocks = dict(re.findall(block, text, re.MULTILINE | re.DOTALL))
    made = certificates(tmp_path / "secrets")
    secrets = made.ca.parent
    guarded(secrets, made)
    (secrets / "acl").write_text(blocks["secrets/acl"])
    (secrets / "acl").chmod(0o600)
    own = ("listener", "allow_anonymous", "max_queued_messages")
    lines = [
        each.replace("/secrets/", f"{secrets}/").replace(
            "/mosquitto/data/", f"{tmp_path}/"
        )
        for each in blocks["mosquitto.conf"].splitlines()
        if not each.startswith(own)
    ]
    assert len(lines) >= 7
    log = tmp_path / "latlong.csv"
    write_log(log, drive(3))
    with mosquitto(tmp_path / "broker", *lines) as broker:
        url = f"mqtts://localhost:{broker.port}"
        keys: dict[str, object] = {"kind": "mqtt", "url": url, "ca_file": made.ca}
        keys["credentials_file"] = credentials(tmp_path)
        done = publish_once(*arguments(log, tmp_path, "mine", **keys))
        assert done.returncode == 0, done.stderr
        keys["device"] = "another"
        done = publish_once(*arguments(log, tmp_path, "other", **keys))
        assert done.returncode == 69
        assert "not authorized" in done.stderr


def test_a_broker_that_knows_only_the_older_protocol_is_spoken_to_in_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    log = tmp_path / "latlong.csv"
    write_log(log, drive(3))
    monkeypatch.setattr(worker_module, "FIRST_DELAY_S", 0.05)
    with mosquitto(tmp_path / "broker") as broker:
        wire = Wire(broker.port, versions=(4,))
        try:
            url = f"mqtt://127.0.0.1:{wire.port}"
            chosen = arguments(log, tmp_path, "a", kind="mqtt", url=url, moving_s=0)
            with working(*chosen) as worker:
                until(lambda: worker.sent_rows == 3, "the rows are taken")
                assert worker.errors == 1
        finally:
            wire.close()


def test_home_assistant_gets_entities_and_the_newest_row_alone(tmp_path: Path) -> None:
    log = tmp_path / "latlong.csv"
    write_log(log, drive(1000))
    with (
        mosquitto(tmp_path / "broker") as broker,
        subscribed(broker.port, tmp_path, "#") as path,
    ):
        url = f"mqtt://127.0.0.1:{broker.port}"
        keys = {"kind": "mqtt", "url": url, "format": "home-assistant"}
        base = "imu-tracker/car/home-assistant"

        def count(topic: str) -> int:
            return sum(found == topic for found, _ in arrived(path))

        with publishing(*arguments(log, tmp_path, "ha", **keys)) as process:
            until(lambda: count(f"{base}/health") > 0, "it is there")
            assert count(f"{base}/position") == 0
            with log.open("a") as file:
                file.writelines(line(each) for each in drive(2, begin=1000))
            until(lambda: count(f"{base}/position") > 0, "the newest row is there")
            tracker = "homeassistant/device_tracker/imu-tracker-car/config"
            assert count(tracker) == 1
            born = ["-t", "homeassistant/status", "-m", "online"]
            to = ["-h", "127.0.0.1", "-p", str(broker.port)]
            subprocess.run(["mosquitto_pub", *to, *born], check=True)
            until(lambda: count(tracker) == 2, "the entities are told again")
            process.kill()
            gone = f"{base}/availability offline"
            until(lambda: gone in path.read_text(), "the broker says that it is gone")
        positions = [p for topic, p in arrived(path) if topic == f"{base}/position"]
    assert [p["time_utc"] for p in positions] == times(drive(1, begin=1001))
    # No entity of the tracker becomes unavailable: it stays where it was last.
    (config,) = {json.dumps(p) for topic, p in arrived(path) if topic == tracker}
    assert "availability" not in config


def test_owntracks_gets_at_most_one_location_a_second(tmp_path: Path) -> None:
    log = tmp_path / "latlong.csv"
    write_log(log, drive(20))
    with (
        mosquitto(tmp_path / "broker") as broker,
        subscribed(broker.port, tmp_path, "owntracks/#") as path,
    ):
        url = f"mqtt://127.0.0.1:{broker.port}"
        keys = {"kind": "mqtt", "url": url, "format": "owntracks", "moving_s": 0}
        done = publish_once(*arguments(log, tmp_path, "ot", **keys))
        assert done.returncode == 0, done.stderr
        until(lambda: len(arrived(path)) >= 5, "the locations are there")
    assert [p["tst"] - NOON_S for _, p in arrived(path)] == [0, 1, 2, 3, 4]
    assert {topic for topic, _ in arrived(path)} == {"owntracks/imu-tracker/car"}


def test_a_row_that_is_newest_stays_with_the_broker(tmp_path: Path) -> None:
    log = tmp_path / "latlong.csv"
    write_log(log, [row(0), row(60)])
    with mosquitto(tmp_path / "broker") as broker:
        url = f"mqtt://127.0.0.1:{broker.port}"
        done = publish_once(*arguments(log, tmp_path, "a", kind="mqtt", url=url))
        assert done.returncode == 0, done.stderr
        with subscribed(broker.port, tmp_path, "imu-tracker/car/+") as path:
            until(lambda: b"time_utc" in path.read_bytes(), "it is retained")
        (kept,) = [p for topic, p in arrived(path) if topic.endswith("/position")]
    assert kept["time_utc"] == times([row(60)])[0]


def test_another_program_may_not_have_the_same_cursor(tmp_path: Path) -> None:
    log = tmp_path / "latlong.csv"
    write_log(log, drive(3))
    with mosquitto(tmp_path / "broker") as broker:
        url = f"mqtt://127.0.0.1:{broker.port}"
        chosen = arguments(log, tmp_path, "a", kind="mqtt", url=url)
        with working(*chosen):
            done = publish_once(*chosen)
    assert done.returncode == 73
    assert "another imu-tracker publish has it" in done.stderr
