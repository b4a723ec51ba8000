"""The metrics, read by Prometheus' own parser; the kinds of faults that they sum."""

from pathlib import Path
from typing import Any

import pytest
from prometheus_client.parser import text_string_to_metric_families

import imu_tracker
from imu_tracker.daemon.faults import KINDS, faults_of
from imu_tracker.daemon.prometheus import exposition

STATUS: dict[str, Any] = {
    "source": "hardware",
    "state": "tracking",
    "mode": "dr",
    "uptime_s": 3600,
    "r95_m": 12.34,
    "row_age_s": 0.42,
    "fix_age_s": 17,
    "imu_rate_hz": 100.02,
    "disk_free_mb": 1234,
    "row": {"lat_deg": 51.99000012, "lon_deg": 4.37000034},
    "log": {"path": "/var/log/latlong.csv", "is_failing": True},
    "faults": {"imu_bus": 3, "disk": 0},
    "counters": {"rows": 14_400, "imu_bus_errors": 3},
}


def samples(**changes: Any) -> dict[str, dict[tuple[str, ...], float]]:
    """Values by the name of the sample and the values of its labels."""
    found: dict[str, dict[tuple[str, ...], float]] = {}
    for family in text_string_to_metric_families(exposition(STATUS | changes)):
        assert family.documentation
        assert family.type in ("gauge", "counter")
        assert family.samples
        for sample in family.samples:
            labels = tuple(sample.labels.values())
            values = found.setdefault(sample.name.removeprefix("imu_tracker_"), {})
            assert labels not in values
            values[labels] = sample.value
    return found


def test_the_metrics_say_what_the_status_says() -> None:
    assert samples() == {
        "info": {(imu_tracker.__version__, "hardware"): 1},
        "uptime_seconds": {(): 3600},
        "r95_meters": {(): 12.34},
        "row_age_seconds": {(): 0.42},
        "fix_age_seconds": {(): 17},
        "imu_rate_hertz": {(): 100.02},
        "disk_free_bytes": {(): 1.234e9},
        "state": {
            ("starting",): 0,
            ("waiting for the first fix",): 0,
            ("tracking",): 1,
            ("not logging",): 0,
        },
        "mode": {("gps",): 0, ("dr",): 1, ("still",): 0, ("gpsonly",): 0},
        "log_failing": {(): 1},
        "faults_total": {("imu_bus",): 3, ("disk",): 0},
        "counted_total": {("rows",): 14_400, ("imu_bus_errors",): 3},
    }


def test_what_is_not_known_is_left_out() -> None:
    unknown = dict.fromkeys(("r95_m", "row_age_s", "fix_age_s", "imu_rate_hz", "mode"))
    found = samples(**unknown, state="waiting for the first fix")
    assert not {"r95_meters", "row_age_seconds", "imu_rate_hertz"} & set(found)
    assert set(found["mode"].values()) == {0}
    assert found["state"][("waiting for the first fix",)] == 1


def test_no_position_leaves_the_tracker() -> None:
    assert "51.99" not in exposition(STATUS)
    assert "4.37" not in exposition(STATUS)


def test_odd_names_are_escaped() -> None:
    odd = 'a "b" \\ c\nd'
    assert samples(counters={odd: 1})["counted_total"] == {(odd,): 1}


def test_each_fault_is_of_one_kind() -> None:
    names = [name for kind in KINDS.values() for name in kind]
    assert len(names) == len(set(names))
    counters = {"imu_bus_errors": 2, "imu_missed_ticks": 3, "rows": 100}
    assert faults_of(counters)["imu_bus"] == 5
    assert sum(faults_of(counters).values()) == 5


@pytest.mark.parametrize("name", [name for kind in KINDS.values() for name in kind])
def test_each_fault_is_really_counted_somewhere(name: str) -> None:
    root = Path(imu_tracker.__file__).parent
    sources = [p for p in root.rglob("*.py") if p.name not in ("faults.py", "cli.py")]
    text = "\n".join(path.read_text("utf-8") for path in sources)
    bare = name
    for prefix in ("recording_", "fixes_", "gps_", "imu_"):
        if f'"{name}"' not in text:
            bare = name.removeprefix(prefix) if name.startswith(prefix) else bare
    assert f'"{bare}"' in text
