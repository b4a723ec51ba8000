"""`[[publish]]`: what is accepted, and how everything else is refused."""

import re
import tomllib
from pathlib import Path

import pytest

from imu_tracker.config import Config, load_config
from imu_tracker.config.publishing import PublishConfig, endpoint_of
from imu_tracker.errors import ConfigError
from support.paths import REPOSITORY

DOCUMENTED = REPOSITORY / "config" / "imu-tracker.toml"
HOME = ("publish.home.kind=mqtt", "publish.home.url=mqtt://broker")


def problems(*overrides: str, path: Path | None = None) -> list[str]:
    with pytest.raises(ConfigError) as caught:
        load_config(path, overrides)
    assert caught.value.exit_code == 78
    return str(caught.value).splitlines()


def documented_table() -> str:
    """Return the commented `[[publish]]` of the documented file, without the marks."""
    text = DOCUMENTED.read_text("utf-8")
    block = text[text.index("\n# [[publish]]\n") :]
    return re.sub(r"^# ?", "", block, flags=re.MULTILINE)


def test_the_documented_table_holds_every_key_and_the_defaults_of_the_code() -> None:
    (table,) = tomllib.loads(documented_table())["publish"]
    assert list(table) == list(PublishConfig.model_fields)
    given = {key: table[key] for key in ("name", "kind", "url")}
    assert PublishConfig(**table) == PublishConfig(**given)


def test_there_is_no_destination_until_one_is_written() -> None:
    assert Config().publish == ()


def test_any_number_of_tables_is_read(tmp_path: Path) -> None:
    path = tmp_path / "config.toml"
    path.write_text(
        '[[publish]]\nname = "a"\nkind = "mqtt"\nurl = "mqtts://b"\n'
        '[[publish]]\nname = "b"\nkind = "influx"\nurl = "http://h/write?db=x"\n'
    )
    first, second = load_config(path).publish
    assert (first.endpoint.port, first.endpoint.is_tls) == (8883, True)
    assert (second.endpoint.port, second.endpoint.target) == (8086, "/write?db=x")


def test_set_changes_a_table_by_its_name_or_makes_one(tmp_path: Path) -> None:
    path = tmp_path / "config.toml"
    path.write_text('[[publish]]\nname = "a"\nkind = "mqtt"\nurl = "mqtt://b"\n')
    a, home = load_config(path, ["publish.a.moving_s=3", *HOME]).publish
    assert (a.name, a.moving_s) == ("a", 3.0)
    assert (home.name, str(home.endpoint)) == ("home", "broker:1883")


@pytest.mark.parametrize(
    ("override", "problem"),
    [
        ("publish.home.kind=smoke", 'publish.home.kind = "smoke": must be "mqtt", "tr'),
        ("publish.home.moving_s=-1", "publish.home.moving_s = -1: must be from 0 to"),
        ("publish.home.mvoing_s=1", "publish.home.mvoing_s: no such key; did you mean"),
        ("publish.home.topic=a/#", "publish.home.topic = "),
        ("publish.home.topic=/a", "publish.home.topic = "),
        ("publish.home.device=a b", "publish.home.device = "),
        ("publish.home.key_file=/k", "must stand beside a cert_file"),
        ("publish.home.url=http://broker", "must be a URL like mqtts://"),
        ("publish.home.url=mqtt://", "must be a URL like mqtts://"),
        ("publish.home.url=mqtt://b:99999", "must be a URL like mqtts://"),
        ("publish.home.url=mqtt://b/path", "without a path"),
        ("publish.home=3", "must be publish.NAME.KEY=VALUE"),
    ],
)
def test_a_bad_value_is_named_with_its_destination(override: str, problem: str) -> None:
    (line,) = problems(*HOME, override)
    assert problem in line


@pytest.mark.parametrize(
    "url",
    [
        "mqtt://car:hunter2@broker",
        "mqtt://hunter2@broker",
    ],
)
def test_a_password_in_a_url_is_refused_and_not_repeated(url: str) -> None:
    (line,) = problems(HOME[0], f"publish.home.url={url}")
    assert "credentials_file" in line
    assert "hunter2" not in line


@pytest.mark.parametrize("query", ["u=car&p=hunter2", "db=x&token=hunter2"])
def test_a_token_in_a_query_is_refused_and_not_repeated(query: str) -> None:
    (line,) = problems(
        "publish.home.kind=influx", f"publish.home.url=http://h/write?{query}"
    )
    assert "credentials_file" in line
    assert "hunter2" not in line


def test_a_missing_key_is_named() -> None:
    assert problems("publish.home.kind=mqtt") == [
        "publish.home.url: is missing; must be a URL"
    ]


def test_two_of_one_name_would_share_a_cursor(tmp_path: Path) -> None:
    path = tmp_path / "config.toml"
    path.write_text('[[publish]]\nname = "a"\nkind = "mqtt"\nurl = "mqtt://b"\n' * 2)
    (line,) = problems(path=path)
    assert 'two are named "a"' in line


@pytest.mark.parametrize("text", ["publish = 3", "publish = [3]", "[publish]\na = 1"])
def test_what_is_no_table_is_refused(tmp_path: Path, text: str) -> None:
    path = tmp_path / "config.toml"
    path.write_text(text)
    (line,) = problems(path=path)
    assert "[[publish]]" in line


def test_a_format_is_only_for_mqtt() -> None:
    (line,) = problems(
        "publish.home.kind=traccar",
        "publish.home.url=http://h",
        "publish.home.format=json",
    )
    assert line == 'publish.home: format must be left out unless kind = "mqtt"'


@pytest.mark.parametrize(
    ("kind", "url", "host", "port"),
    [
        ("mqtt", "mqtt://[fe80::1]:99", "fe80::1", 99),
        ("traccar", "http://h", "h", 5055),
        ("traccar", "https://h/osmand", "h", 443),
        ("influx", "https://h:8181/api/v3/write_lp?db=x", "h", 8181),
    ],
)
def test_ports_and_hosts_are_as_usual(
    kind: str, url: str, host: str, port: int
) -> None:
    endpoint = endpoint_of(kind, url)
    assert (endpoint.host, endpoint.port) == (host, port)


@pytest.mark.parametrize(
    ("url", "port"),
    [("mqtt://broker", 8883), ("mqtt://broker:1234", 1234), ("mqtts://broker", 8883)],
)
def test_tls_encrypts_whatever_the_url_begins_with(url: str, port: int) -> None:
    settings = [HOME[0], f"publish.home.url={url}", "publish.home.tls=true"]
    (home,) = load_config(None, settings).publish
    assert (home.endpoint.port, home.endpoint.is_tls) == (port, True)
