"""What is written on the wire, against what those who read it have documented."""

import json
import math
import re
from typing import Any
from urllib.parse import parse_qs

import pytest
from hypothesis import given
from hypothesis import strategies as st

from imu_tracker.publish.senders import home_assistant, payloads
from imu_tracker.storage.latlong import LogRow, format_utc
from support.influx_lines import parse_line
from support.published import NOON_S, row

NAN = math.nan

rows = st.builds(
    LogRow,
    st.integers(0, 400_000_000).map(lambda ms: NOON_S + ms / 1000),
    st.floats(-90, 90).map(lambda x: round(x, 8)),
    st.floats(-180, 180).map(lambda x: round(x, 8)),
    st.one_of(st.just(NAN), st.floats(-400, 9000).map(lambda x: round(x, 1))),
    st.floats(0, 90).map(lambda x: round(x, 2)),
    st.one_of(st.just(NAN), st.floats(0, 359.9).map(lambda x: round(x, 1))),
    st.floats(0.5, 1e6).map(lambda x: round(x, 2)),
    st.sampled_from(["gps", "dr", "still", "gpsonly"]),
)


def test_our_json_is_as_documented() -> None:
    assert json.loads(payloads.json_row("car", row(0.25))) == {
        "v": 1,
        "id": "car",
        "time_utc": "2026-11-22T12:00:00.250Z",
        "lat_deg": 51.99,
        "lon_deg": 4.37,
        "alt_m": 5.2,
        "speed_mps": 13.8,
        "course_deg": 40.1,
        "r95_m": 3.94,
        "mode": "gps",
    }


def test_what_the_log_leaves_empty_our_json_leaves_out() -> None:
    found = json.loads(payloads.json_row("car", row(0, course_deg=NAN)))
    assert "course_deg" not in found


@given(each=rows)
def test_a_row_of_our_json_is_at_most_210_bytes(each: LogRow) -> None:
    assert len(payloads.json_row("twelve345678", each)) <= 210


@given(each=rows)
def test_a_location_of_owntracks_keeps_the_rules_of_its_booklet(each: LogRow) -> None:
    found = json.loads(payloads.owntracks_row("ar", each))
    assert found["_type"] == "location"
    # "tst (integer/epoch/required)", "acc (integer/meters/optional)", and so on; acc is
    # a promise, so never less than the radius.
    for key in {"tst", "acc", "alt", "vel", "cog"} & found.keys():
        assert type(found[key]) is int, key
    assert found["acc"] >= each.r95_m
    assert found["acc"] > 0  # 0 is taken for "not known"
    assert 0 <= found.get("cog", 0) < 360
    assert len(found["tid"]) == 2
    assert abs(found["tst"] - each.utc_s) < 1
    assert abs(found.get("vel", 0) - each.speed_mps * 3.6) <= 0.5


@given(each=rows)
def test_a_form_for_traccar_keeps_the_rules_of_its_decoder(each: LogRow) -> None:
    form = {
        k: v for k, (v,) in parse_qs(payloads.traccar_row("car", each).decode()).items()
    }
    assert form["id"] == "car"
    assert int(form["timestamp"]) >= 2**31  # else it is taken for seconds
    assert int(form["timestamp"]) == round(each.utc_s * 1000)
    assert float(form["speed"]) * 1852 / 3600 == pytest.approx(each.speed_mps, abs=1e-3)
    assert float(form["accuracy"]) == each.r95_m
    assert ("bearing" in form) is not math.isnan(each.course_deg)
    assert ("altitude" in form) is not math.isnan(each.alt_m)


@given(each=rows)
def test_a_line_for_influx_is_what_its_parser_reads(each: LogRow) -> None:
    line = payloads.influx_row("car", each).decode()
    measurement, tags, fields, stamp = parse_line(line.removesuffix("\n"))
    assert (measurement, tags) == ("position", {"id": "car"})
    assert stamp == round(each.utc_s * 1000)
    assert fields.pop("mode") == each.mode
    assert all(type(value) is float for value in fields.values())
    expected = {k: v for k, v in each._asdict().items() if v == v}
    assert fields == {k: v for k, v in expected.items() if k not in ("utc_s", "mode")}


# -------------------------------------------------------------------- Home Assistant

IDS = re.compile(r"[a-zA-Z0-9_-]+")
TOPIC = re.compile(
    r"homeassistant/(?P<component>\w+)/(?:(?P<node>[\w-]+)/)?(?P<object>[\w-]+)/config"
)
RESERVED = {
    *("assumed_state", "attribution", "available", "device_class", "entity_id"),
    *("entity_picture", "friendly_name", "icon", "id", "last_updated", "name"),
    *("restored", "state", "supported_features", "unique_id", "unit_of_measurement"),
}
UNITS = {"distance": {"m", "km"}, "speed": {"m/s", "km/h", "kn"}, "duration": {"s"}}
DEVICE_KEYS = {
    *("identifiers", "connections", "manufacturer", "model", "model_id", "name"),
    *("hw_version", "sw_version", "serial_number", "suggested_area", "via_device"),
    "configuration_url",
}


def entities() -> dict[str, dict[str, Any]]:
    found = home_assistant.discovery("car", "base")
    return {topic: json.loads(payload) for topic, payload in found}


def test_discovery_is_under_the_topics_that_are_listened_to() -> None:
    for topic in entities():
        match = TOPIC.fullmatch(topic)
        assert match, topic
        assert match["component"] in ("device_tracker", "sensor")
        assert all(IDS.fullmatch(part) for part in topic.split("/"))


def test_every_entity_has_an_id_of_its_own_and_the_same_device() -> None:
    found = entities().values()
    assert len({entity["unique_id"] for entity in found}) == len(found)
    (device,) = {json.dumps(entity["device"]) for entity in found}
    assert json.loads(device)["identifiers"]
    assert json.loads(device).keys() <= DEVICE_KEYS
    assert all(entity["origin"]["name"] for entity in found)


def test_the_tracker_takes_its_place_from_attributes_and_never_goes_away() -> None:
    (tracker,) = (e for t, e in entities().items() if "/device_tracker/" in t)
    assert tracker["json_attributes_topic"] == "base/position"
    assert tracker["source_type"] == "gps"
    # With a state_topic the zone would not be worked out; without a place it would be
    # "unavailable", and a car out of coverage would be nowhere.
    assert not tracker.keys() & {"state_topic", "availability", "availability_topic"}


def test_sensors_have_what_their_class_wants() -> None:
    for topic, entity in entities().items():
        if "/sensor/" not in topic:
            continue
        assert entity["availability_topic"] == "base/availability"
        assert entity["state_topic"] in ("base/position", "base/health")
        assert entity["expire_after"] > 300
        kind = entity.get("device_class")
        if kind == "enum":
            assert set(entity["options"]) == {"gps", "dr", "still", "gpsonly"}
            assert not entity.keys() & {"state_class", "unit_of_measurement"}
        elif kind is not None:
            assert entity["unit_of_measurement"] in UNITS[kind]


@given(each=rows)
def test_attributes_are_numbers_always_with_the_radius(each: LogRow) -> None:
    found = json.loads(home_assistant.attributes(each))
    for key in ("latitude", "longitude", "gps_accuracy"):
        assert type(found[key]) in (int, float)
    assert found["gps_accuracy"] == each.r95_m
    assert found["time_utc"] == format_utc(each.utc_s)
    assert not found.keys() & RESERVED


def test_templates_name_what_is_in_the_messages() -> None:
    sent = {
        "base/position": json.loads(home_assistant.attributes(row(0))),
        "base/health": json.loads(home_assistant.health({"state": "x"})),
    }
    for entity in entities().values():
        if "value_template" in entity:
            match = re.fullmatch(
                r"\{\{ value_json\.(\w+) \}\}", entity["value_template"]
            )
            assert match
            assert match[1] in sent[entity["state_topic"]]
    assert json.loads(home_assistant.health(None))["health"] == "not running"
