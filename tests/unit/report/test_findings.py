"""The five worst installations, and some broken recordings, are each named."""

from collections.abc import Callable, Iterable

import pytest

from imu_tracker.config import load_config
from imu_tracker.report.collect import Collected, Tracked
from imu_tracker.report.finding import Finding, Weight
from imu_tracker.report.findings import findings_of
from imu_tracker.samples import Frame, SessionHeader, Source
from support import installations
from support.installations import half_dead, sentence, sound, without

Stream = Iterable[SessionHeader | Frame]


def collected(stream: Stream) -> Collected:
    tracked = Tracked("drive.rec", load_config(None, []))
    for _ in tracked.rows(stream):
        pass
    return tracked.collected()


def found(stream: Stream) -> dict[str, Finding]:
    return {finding.kind: finding for finding in findings_of(collected(stream))}


def test_nothing_is_said_of_a_sound_installation() -> None:
    assert found(sound()) == {}


def test_a_box_on_its_side_is_named_with_the_mount_that_gravity_asks_for() -> None:
    findings = found(installations.lying_on_its_side())
    assert list(findings) == ["box_turned"]
    # The chip is turned by 90 deg about its x: what pointed up (z) is now its -y.
    assert 'imu.mount = ["+x", "-z", "+y"]' in findings["box_turned"].what_to_do
    assert "90 deg away from down" in findings["box_turned"].how_it_shows


def test_a_box_that_looks_to_the_side_is_named() -> None:
    findings = found(installations.turned_about_the_vertical())
    assert "about the vertical" in findings["box_turned"].what
    assert "deg to the right" in findings["box_turned"].how_it_shows


def test_a_box_that_was_knocked_over_is_named_turned_and_not_loose() -> None:
    findings = found(installations.turned_once(40.0))
    assert "during the drive" in findings["box_turned"].what
    assert "loose_box" not in findings


def test_a_loose_box_is_named() -> None:
    findings = found(installations.loose_box())
    assert findings["loose_box"].weight is Weight.BAD
    assert "box_turned" not in findings


def test_a_line_too_slow_for_ten_fixes_a_second_is_named() -> None:
    finding = found(installations.slow_line())["gps_line_full"]
    assert "9600 baud" in finding.how_it_shows
    assert "10 fixes a second" in finding.how_it_shows
    assert "115200" in finding.what_to_do


def test_a_cold_clone_chip_is_named() -> None:
    finding = found(installations.cold_clone())["chip"]
    assert finding.weight is Weight.BAD
    assert "it was cold" in finding.what


@pytest.mark.parametrize("tells_signals", [False, True])
def test_a_bad_antenna_cable_is_named(*, tells_signals: bool) -> None:
    stream = installations.bad_antenna_cable(tells_signals=tells_signals)
    finding = found(stream)["antenna"]
    assert "cable" in finding.what
    assert ("dB-Hz" in finding.how_it_shows) is tells_signals


def test_a_silent_receiver_is_told_in_the_words_of_check() -> None:
    findings = found(without(sound(20.0), Source.GPS))
    assert set(findings) == {"gps_silent", "no_rows"}
    assert findings["gps_silent"].what_to_do.startswith("Not a byte: is the receiver")


def test_a_half_dead_imu_is_told_with_its_axis() -> None:
    finding = found(half_dead(sound(60.0), from_s=40.0))["imu_stuck"]
    assert "gyro y" in finding.how_it_shows


def test_no_samples_are_told() -> None:
    assert "imu_silent" in found(without(sound(60.0), Source.IMU))


@pytest.mark.parametrize(
    ("rewrite", "kind"),
    [
        (lambda line: line[:-1] + b"Z", "gps_garbage"),
        (lambda line: sentence("GPTXT,01,01,02,HW"), "gps_no_position"),
    ],
)
def test_a_receiver_without_a_position_is_told_why(
    rewrite: Callable[[bytes], bytes], kind: str
) -> None:
    def edited() -> Iterable[SessionHeader | Frame]:
        for item in sound(20.0):
            if isinstance(item, Frame) and item.source is Source.GPS:
                item = item._replace(data=rewrite(item.data))
            yield item

    assert kind in found(edited())


def test_the_worst_comes_first() -> None:
    findings = findings_of(collected(without(sound(60.0), Source.IMU)))
    weights = [finding.weight for finding in findings]
    assert weights == sorted(weights)
