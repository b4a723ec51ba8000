"""The configuration: what is accepted, and how everything else is refused."""

import itertools
import math
import tomllib
from datetime import UTC, datetime
from pathlib import Path
from typing import get_args

import pytest

from imu_tracker.config import Config, keys, load_config
from imu_tracker.config.values import Scenario
from imu_tracker.errors import ConfigError
from imu_tracker.samples import SessionHeader
from imu_tracker.simulation import SCENARIOS
from support.paths import REPOSITORY

DOCUMENTED = REPOSITORY / "config" / "imu-tracker.toml"


def problems(*overrides: str, path: Path | None = None) -> list[str]:
    """Return the lines with which a configuration is refused."""
    with pytest.raises(ConfigError) as caught:
        load_config(path, overrides)
    assert caught.value.exit_code == 78
    return str(caught.value).splitlines()


def written(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "config.toml"
    path.write_text(text, "utf-8")
    return path


def test_the_documented_file_holds_the_defaults_of_the_code() -> None:
    assert load_config(DOCUMENTED) == Config()


def test_the_documented_file_names_every_key_of_the_code_and_no_other() -> None:
    tables = tomllib.loads(DOCUMENTED.read_text("utf-8"))
    documented = {(table, key) for table in tables for key in tables[table]}
    assert documented == {(table, key) for table, key, _ in keys()}


def test_every_documented_key_has_a_comment_above_it() -> None:
    lines = DOCUMENTED.read_text("utf-8").splitlines()
    for above, line in itertools.pairwise(lines):
        if " = " in line and not line.startswith("#"):
            assert above.startswith("#"), line


def test_the_demo_is_a_simulated_drive_of_less_than_a_minute() -> None:
    demo = load_config(REPOSITORY / "config" / "demo.toml")
    assert demo.source.kind == "simulation"
    assert 0 < demo.source.duration_s / demo.source.speed < 60
    assert not demo.log.path.is_absolute()
    assert not demo.status.path.is_absolute()


def test_the_scenarios_are_those_of_the_simulation() -> None:
    assert set(get_args(Scenario)) == set(SCENARIOS)


def test_without_file_and_overrides_there_are_the_defaults() -> None:
    assert load_config() == Config()


@pytest.mark.parametrize(
    ("override", "problem"),
    [
        ("imu.rate_hz=5000", "imu.rate_hz = 5000: must be 1000 / n for a whole n"),
        ("imu.rate_hz=300", "imu.rate_hz = 300: must be 1000 / n"),
        ("imu.rate_hz=0", "imu.rate_hz = 0: must be"),
        ("imu.rate_hz=-100", "imu.rate_hz = -100: must be"),
        ("imu.rate_hz=7.9", "imu.rate_hz = 7.9: must be"),
        ("imu.rate_hz=nan", "imu.rate_hz = nan: must be"),
        ("imu.rate_hz=true", "imu.rate_hz = true: must be"),
        ('imu.rate_hz="100"', 'imu.rate_hz = "100": must be'),
        ("imu.bus=true", "imu.bus = true: must be"),
        ("imu.bus=1.0", "imu.bus = 1.0: must be"),
        ("imu.bus=-1", "imu.bus = -1: must be"),
        ("imu.address=0x67", "imu.address = 0x67: must be 0x68"),
        ("imu.address=0x70", "imu.address = 0x70: must be 0x68"),
        ("imu.accel_range_g=3", "imu.accel_range_g = 3: must be 2, 4, 8 or 16"),
        ("imu.accel_range_g=4.0", "imu.accel_range_g = 4.0: must be 2, 4, 8 or 16"),
        ("imu.gyro_range_dps=360", "imu.gyro_range_dps = 360: must be 250"),
        ("imu.bandwidth_hz=50", "imu.bandwidth_hz = 50: must be"),
        ("imu.read=dma", 'imu.read = "dma": must be "fifo" or "burst"'),
        ("imu.mount=+x", 'imu.mount = "+x": must be three'),
        ('imu.mount=["+x","-y"]', 'imu.mount = ["+x", "-y"]: must be three'),
        ('imu.mount=["+x","+y","-z"]', "mirror image"),
        ('imu.mount=["+x","+x","-z"]', "each chip axis once"),
        ('imu.mount=["x","y","z"]', "one of +x"),
        ("imu.calibration=5", "imu.calibration = 5: must be a path"),
        ("imu.allow_unknown_chip=1", "must be true or false"),
        ("gps.port=", 'gps.port = "": must be'),
        ("gps.port=socket://here", "must be socket://HOST:PORT"),
        ("gps.baud=9601", "gps.baud = 9601: must be"),
        ('gps.baud="9600"', 'gps.baud = "9600": must be'),
        ("gps.latency_s=2.5", "gps.latency_s = 2.5: must be from 0 to 2 s"),
        ("gps.latency_s=-0.1", "gps.latency_s = -0.1: must be from 0 to 2 s"),
        ("gps.latency_s=soon", 'gps.latency_s = "soon": must be from 0 to 2 s, or'),
        ("gps.lever_arm_m=[1, 2]", "gps.lever_arm_m = [1, 2]: must be three numbers"),
        ("gps.lever_arm_m=[1, 2, true]", "must be three numbers"),
        ("gps.lever_arm_m=[1, 2, 1000]", "from -100 to 100 m"),
        ("gps.date=2026-02-30", 'gps.date = "2026-02-30": must be a date'),
        ("gps.date=20", "gps.date = 20: must be a date"),
        ("filter.estimator=ekf", 'must be "error-state" or "six-state"'),
        ("filter.profile=boat", '"auto", "free", "vehicle" or "walker"'),
        ("filter.start=51.99", "filter.start = 51.99: must be"),
        ("filter.start=here", 'filter.start = "here": must be a position'),
        ("filter.start=91,4", "must be a position"),
        ("filter.start=nan,nan", "must be a position"),
        ("filter.start_radius_m=0", "filter.start_radius_m = 0: must be"),
        ("log.path=", 'log.path = "": must be the path of a file'),
        ('log.path="a\\u0000b"', "must be the path of a file"),
        ("log.path=5", "log.path = 5: must be the path of a file"),
        ("log.rate_hz=3", "log.rate_hz = 3: must be 1, 2, 4, 5, 8 or 10"),
        ("log.rate_hz=true", "log.rate_hz = true: must be 1, 2, 4, 5, 8 or 10"),
        ("log.sync_s=-1", "log.sync_s = -1: must be"),
        ("log.max_mb=inf", "log.max_mb = inf: must be"),
        ("record.path=/var/log/imu-tracker/latlong.csv", "must be different files"),
        ("source.kind=recording", 'source.path = "": must name the recording'),
        ("source.scenario=fly", "source.scenario = "),
        ("source.speed=0", "source.speed = 0: must be from 0.01"),
        ("source.start_utc=0001-01-01T00:00:00+14:00", "must be an instant"),
        ("gps.date=1970-01-01", "must be a date"),
        ("log.path=~nobody.at.all/log.csv", "must be the path of a file"),
        (f"imu.bus={'9' * 5000}", "must be the number N of /dev/i2c-N"),
        (f"imu.mount={'[' * 5000}", "must be three chip axes"),
        ("source.start_utc=noon", 'source.start_utc = "noon": must be an instant'),
    ],
)
def test_a_bad_value_is_named_with_its_key_and_what_is_allowed(
    override: str, problem: str
) -> None:
    (line,) = problems(override)
    assert problem in line
    assert override.partition("=")[0].split(".")[0] in line


def test_all_problems_of_a_file_and_of_set_are_reported_at_once(tmp_path: Path) -> None:
    path = written(
        tmp_path,
        "nonsense = 1\nrate_hz = 4\n"
        "[imu]\nrate_hz = 5000\naddres = 0x68\n[gpx]\nport = 'x'\n[log]\nsync_s = 'a'",
    )
    assert sorted(problems("filter.profile=boat", "sync", path=path)) == sorted(
        [
            "--set sync: must be TABLE.KEY=VALUE, like filter.profile=vehicle",
            "imu.rate_hz = 5000: must be 1000 / n for a whole n from 1 to 125: "
            "1000, 500, 250, 200, 125, 100 ...",
            "imu.addres: no such key; did you mean address?",
            'filter.profile = "boat": must be "auto", "free", "vehicle" or "walker"',
            'log.sync_s = "a": must be from 0 to 3600 s',
            "nonsense = 1: stands outside of a table; every key has one",
            "rate_hz = 4: stands outside of a table; it belongs below [imu] or [log]",
            "[gpx]: no such table; did you mean gps?",
        ]
    )


def test_a_key_far_from_all_others_gets_the_list_of_them() -> None:
    (line,) = problems("record.zzz=1")
    assert line == "record.zzz: no such key; there are path"


def test_a_table_must_be_a_table(tmp_path: Path) -> None:
    path = written(tmp_path, "imu = 3")
    assert problems("imu.bus=1", path=path) == ["imu = 3: must be a table, [imu]"]


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("[imu]\nrate_hz = \n", "line 2, column 11: invalid value"),
        ("[imu\n", "line 1, column 5: "),
        ("[imu]\nbus = 1\nbus = 2\n", "line 3, column 8: "),
        ("[imu]\nread = 'fifo", "end of the file: "),
        (f"[imu]\nbus = {'9' * 4400}", "Exceeds the limit"),
        (f"[imu]\nmount = {'[' * 4400}", "maximum recursion depth exceeded"),
    ],
)
def test_a_syntax_error_is_told_with_file_line_and_column(
    tmp_path: Path, text: str, problem: str
) -> None:
    path = written(tmp_path, text)
    (line,) = problems(path=path)
    assert line.startswith(f"{path}: {problem}")


def test_a_file_that_is_not_utf8_is_told_with_its_line(tmp_path: Path) -> None:
    path = tmp_path / "config.toml"
    path.write_bytes(b"[imu]\n# caf\xe9\n")
    assert problems(path=path) == [f"{path}: line 2: not UTF-8 text"]


def test_a_byte_order_mark_and_crlf_are_read_over(tmp_path: Path) -> None:
    path = tmp_path / "config.toml"
    path.write_bytes(b"\xef\xbb\xbf[log]\r\nrate_hz = 5\r\n")
    assert load_config(path).log.rate_hz == 5


def test_a_missing_file_is_a_bad_configuration(tmp_path: Path) -> None:
    path = tmp_path / "none.toml"
    assert problems(path=path) == [f"{path}: no such file"]


def test_a_directory_is_a_bad_configuration(tmp_path: Path) -> None:
    assert problems(path=tmp_path) == [f"{tmp_path}: Is a directory"]


@pytest.mark.parametrize("override", ["", "=", "imu", "imu=1", "imu.=1", ".bus=1"])
def test_an_override_must_be_table_key_and_value(override: str) -> None:
    (line,) = problems(override)
    assert line.startswith(f"--set {override}: must be TABLE.KEY=VALUE")


def test_an_override_goes_before_the_file(tmp_path: Path) -> None:
    path = written(tmp_path, "[filter]\nprofile = 'walker'\nstart_radius_m = 7")
    config = load_config(path, ["filter.profile=vehicle"])
    assert (config.filter.profile, config.filter.start_radius_m) == ("vehicle", 7.0)


def test_an_override_mends_what_the_file_has_wrong(tmp_path: Path) -> None:
    path = written(tmp_path, "[imu]\nrate_hz = 'fast'")
    assert load_config(path, ["imu.rate_hz=200"]).imu.rate_hz == 200.0


@pytest.mark.parametrize(
    ("override", "value"),
    [
        ("imu.address=0x69", 0x69),
        ("imu.rate_hz=333.33", 333.33),
        ("imu.bandwidth_hz=260", 260),
        ('imu.mount=["+y", "+x", "-z"]', ("+y", "+x", "-z")),
        ("imu.calibration=", None),
        ("imu.calibration=c.json", Path("c.json")),
        ("gps.port = socket://localhost:2947", "socket://localhost:2947"),
        ("gps.baud=115200", 115200),
        ("gps.latency_s=1", 1.0),
        ("gps.lever_arm_m=[0.5, 0, -1]", (0.5, 0.0, -1.0)),
        ("gps.date=2026-11-22", "2026-11-22"),
        ('gps.date="2026-11-22"', "2026-11-22"),
        ("source.start_utc=2026-11-22T12:00:00Z", "2026-11-22T12:00:00Z"),
        ("source.start_utc=2026-11-22T13:00:00+01:00", "2026-11-22T12:00:00Z"),
        ("source.start_utc=2026-11-22", "2026-11-22T00:00:00Z"),
        ("log.path=a=b#c.csv", Path("a=b#c.csv")),
        ("log.path=~/x.csv", Path("~/x.csv").expanduser()),
        ("record.path=raw.rec.gz", Path("raw.rec.gz")),
        ("filter.start=51.99,-4.37", "51.99,-4.37"),
    ],
)
def test_an_override_is_toml_or_a_bare_word(override: str, value: object) -> None:
    config = load_config(None, [override])
    table, _, key = override.partition("=")[0].strip().partition(".")
    assert getattr(getattr(config, table), key) == value


def test_what_the_error_state_filter_learns_may_be_left_to_it() -> None:
    config = load_config(
        None,
        ["filter.estimator=error-state", "filter.profile=auto", "gps.latency_s=auto"],
    )
    settings = config.tracker_settings()
    assert (settings.estimator, settings.profile) == ("error-state", "auto")
    assert settings.latency_s is None


def test_a_configuration_cannot_be_changed() -> None:
    with pytest.raises(ValueError, match="frozen"):
        Config().imu.__setattr__("bus", 2)


HEADER = SessionHeader(4, 500, 100.0, ("+y", "+x", "-z"), "vehicle", 1.0e9)


def test_the_headers_mount_and_profile_hold_when_nothing_else_is_written() -> None:
    settings = load_config(None, ["imu.rate_hz=200"]).tracker_settings(HEADER)
    assert (settings.mount, settings.profile) == (("+y", "+x", "-z"), "vehicle")


def test_what_is_written_goes_before_the_header_even_if_it_is_the_default() -> None:
    overrides = ['imu.mount=["+x","-y","-z"]', "filter.profile=free"]
    settings = load_config(None, overrides).tracker_settings(HEADER)
    assert (settings.mount, settings.profile) == (("+x", "-y", "-z"), "free")


def test_a_header_that_says_nothing_leaves_the_defaults() -> None:
    settings = Config().tracker_settings(SessionHeader(4, 500, 100.0))
    assert (settings.mount, settings.profile) == (("+x", "-y", "-z"), "auto")


def test_the_start_of_a_recording_is_the_headers_unless_written() -> None:
    assert Config().amended(HEADER) == HEADER
    config = load_config(None, ["source.start_utc=2026-11-22T12:00:00Z"])
    start = datetime(2026, 11, 22, 12, tzinfo=UTC)
    assert config.amended(HEADER).start_utc_s == start.timestamp()


def test_the_tracker_gets_what_was_configured() -> None:
    settings = load_config(
        None,
        [
            "filter.start=45,-90",
            "filter.start_radius_m=7",
            "gps.latency_s=0.5",
            "gps.date=2026-11-22",
            "log.rate_hz=10",
        ],
    ).tracker_settings()
    assert settings.start == pytest.approx((math.pi / 4, -math.pi / 2))
    assert settings.start_radius_m == 7.0
    assert settings.latency_s == 0.5
    assert settings.gps_date == "2026-11-22"
    assert settings.rate_hz == 10
    assert Config().tracker_settings().start is None


def test_a_filter_as_wide_as_the_rate_is_advised_against() -> None:
    assert Config().advice() == []
    (line,) = load_config(None, ["imu.rate_hz=50"]).advice()
    assert line.startswith("imu.bandwidth_hz = 42: ")
