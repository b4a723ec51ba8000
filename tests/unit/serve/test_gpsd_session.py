"""gpsd's protocol: what is asked, and what is answered."""

import json
import math
from typing import Any

import pytest

from imu_tracker.serve.gpsd_session import GpsdSession, greeting, tpv
from imu_tracker.serve.view import Shown
from imu_tracker.storage.latlong import LogRow

ROW = LogRow(1795348801.25, 51.99, 4.37, 5.2, 1.38, 40.1, 3.94, "gps")
SHOWN = Shown(ROW, has_fix=True, guidance=None)


def asked(session: GpsdSession, request: bytes, *, is_on: bool = True) -> list[Any]:
    answer = session.feed(request, SHOWN, is_on=is_on)
    assert not answer or answer.endswith(b"\r\n")
    return [json.loads(text) for text in answer.splitlines()]


def test_a_row_with_gps_is_fused_and_its_r95_is_eph() -> None:
    report = tpv(SHOWN)
    assert report["status"] == 6
    assert report["mode"] == 3
    assert report["eph"] == 3.94
    assert report["epx"] == pytest.approx(3.94 * 1.96 / 2.4477, abs=0.01)
    assert report["time"] == "2026-11-22T12:00:01.250Z"
    assert (report["altMSL"], report["alt"], report["speed"]) == (5.2, 5.2, 1.38)
    assert report["track"] == 40.1


def test_dead_reckoning_is_5_and_what_is_not_known_is_left_out() -> None:
    row = ROW._replace(mode="dr", alt_m=math.nan, course_deg=math.nan)
    report = tpv(Shown(row, has_fix=False, guidance=None))
    assert (report["status"], report["mode"]) == (5, 2)
    assert not {"alt", "altMSL", "track"} & report.keys()


def test_gps_alone_has_no_status_which_means_a_plain_fix() -> None:
    row = ROW._replace(mode="gpsonly")
    assert "status" not in tpv(Shown(row, has_fix=True, guidance=None))


@pytest.mark.parametrize("end", [b";", b"\n", b";\r\n", b""])
def test_a_watch_is_answered_with_devices_watch_and_the_last_report(end: bytes) -> None:
    session = GpsdSession()
    said = asked(session, b'?WATCH={"enable":true,"json":true}' + end)
    assert [message["class"] for message in said] == ["DEVICES", "WATCH", "TPV"]
    assert said[0]["devices"][0]["path"] == "imu-tracker"
    assert session.wants_json
    assert not session.wants_nmea
    asked(session, b'?WATCH={"enable":false};')
    assert not session.wants_json


def test_signal_k_gets_nmea_and_no_json() -> None:
    session = GpsdSession()
    asked(session, b'?WATCH={"class":"WATCH","nmea":true,"json":false}\n')
    assert session.wants_nmea
    assert not session.wants_json


def test_a_request_may_come_in_pieces_and_several_at_once() -> None:
    session = GpsdSession()
    assert asked(session, b"?VERS") == []
    said = asked(session, b"ION;?DEVICES;?DEVICE;?POLL;?FOO;")
    assert [message["class"] for message in said] == [
        "VERSION",
        "DEVICES",
        "DEVICE",
        "POLL",
        "ERROR",
    ]
    assert said[3]["active"] == 1
    assert said[3]["tpv"][0]["lat"] == 51.99
    assert said[4]["message"] == "Unrecognized request '?FOO'"


def test_without_a_daemon_there_is_no_fix() -> None:
    (poll,) = asked(GpsdSession(), b"?POLL;", is_on=False)
    assert poll["active"] == 0
    assert poll["tpv"] == [{"class": "TPV", "device": "imu-tracker", "mode": 1}]


@pytest.mark.parametrize("text", [b"?WATCH={nonsense};", b"?WATCH=[];", b"?WATCH=1;"])
def test_a_watch_that_makes_no_sense_is_an_error(text: bytes) -> None:
    assert asked(GpsdSession(), text)[0]["class"] == "ERROR"


def test_a_request_without_end_is_refused() -> None:
    session = GpsdSession()
    with pytest.raises(ValueError, match="without an end"):
        session.feed(b"?" * 5000, None, is_on=True)


def test_the_greeting_says_whose_output_it_is() -> None:
    said = json.loads(greeting())
    assert said["class"] == "VERSION"
    assert said["release"].startswith("imu-tracker")
