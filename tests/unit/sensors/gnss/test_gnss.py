"""Sentences that cannot be used: which field, how often, an example, what to do."""

from typing import Any

import pytest

from imu_tracker.samples import GpsFix
from imu_tracker.sensors.gnss.epoch_reader import EpochReader
from imu_tracker.sensors.gnss.sentences import MAX_REASONS, TOLD_AFTER, Unread
from support.nmea_text import gga, gll, rmc, sentence

S = 1_000_000_000


def heard(*lines: bytes, every_s: float = 1.0) -> tuple[EpochReader, list[GpsFix]]:
    """Return the reader and its fixes after lines that came so far apart."""
    reader = EpochReader()
    found = []
    for k, line in enumerate(lines):
        found += reader.feed(round(k * every_s * S), line)
    found += reader.advance(len(lines) * S + S)
    return reader, [position for position in found if isinstance(position, GpsFix)]


REASONS = {
    # The public report, the sentence (our own), and what is said of it.
    "meshtastic/firmware#1928": (
        rmc(place="3403.130,N,-11814.617,W"),
        "RMC: longitude -11814.617 is not dddmm.mmmm",
    ),
    "ttlappalainen/NMEA0183#56": (rmc("93045"), "RMC: time 93045 is not hhmmss.ss"),
    "SignalK/signalk-to-nmea0183#39": (
        gga(quality="DGNSS fix"),
        "GGA: quality DGNSS fix is not a digit",
    ),
    "Drivetech/node-nmea#7": (rmc(status="L"), "RMC: status L is not A or V"),
    "blank longitude": (
        rmc(place="5159.4,N,,E"),
        "RMC: longitude is blank, not dddmm.mmmm",
    ),
    "letters of the hemisphere": (
        gga(place="5159.4,N,00422.2,O"),
        "GGA: letter of longitude O is not E or W",
    ),
    "a place on no earth": (
        gga(place="9959.4,N,00422.2,E"),
        "GGA: latitude 9959.4 is not ddmm.mmmm",
    ),
    "wellenvogel/esp32-nmea2000#38": (
        rmc(place="0.0,N,0.0,E"),
        "RMC: position 0 N 0 E is no place",
    ),
    "GNS": (
        sentence("GNGNS,120000,5159.4,N,00422.2,,AN,11,1.3,9.9,39.5,,"),
        "GNS: letter of longitude is blank, not E or W",
    ),
}


@pytest.mark.parametrize(("line", "reason"), REASONS.values(), ids=REASONS)
def test_the_field_that_keeps_a_fix_from_being_used_is_named(
    line: bytes, reason: str
) -> None:
    body = line[1:-3].decode()
    later = [body.replace("120000", f"1200{k:02d}") for k in range(TOLD_AFTER)]
    reader, fixes = heard(*map(sentence, later))
    assert fixes == []
    assert reader.unread.reasons() == {reason: TOLD_AFTER}
    assert reader.unread.worst().startswith(f"{reason}, {TOLD_AFTER} times: $")
    (told,) = [text for text in reader.take_notices() if "cannot be used" in text]
    assert f"{reason}: $" in told
    assert reader.take_notices() == []


def test_midnight_at_the_equator_is_a_time_and_a_place() -> None:
    reader, fixes = heard(rmc("000000.00", place="0000.0,N,00422.2,E"))
    assert len(fixes) == 1
    assert reader.unread.reasons() == {}


def test_damaged_lines_are_counted_by_reason() -> None:
    reader, _ = heard(rmc(), rmc()[:-2], rmc()[:-1] + b"x", rmc()[:-3])
    said = " ".join(reader.damaged.reasons())
    assert "damaged lines (noise, a loose wire" in said
    assert "lines without a checksum" in said


def test_noise_makes_no_endless_list_of_reasons() -> None:
    unread = Unread()
    for k in range(10 * MAX_REASONS):
        unread.add(f"field {k}", "is bad", b"$")
    assert len(unread.reasons()) <= MAX_REASONS + 1
    assert sum(unread.reasons().values()) == 10 * MAX_REASONS


# ------------------------------------------------------------- sentences that disagree


def gsa(fix_type: str, talker: str = "GN") -> bytes:
    return sentence(f"{talker}GSA,A,{fix_type},05,07,,,,,,,,,,,1.9,1.1,1.6")


@pytest.mark.parametrize(
    ("lines", "has_fix"),
    [
        ([rmc(status=""), gsa("3")], True),
        ([rmc(status=""), gsa("1")], False),
        ([rmc(status=""), gsa("1", "GL"), gsa("2", "GP")], True),
        ([gga(quality="DGNSS fix"), gsa("3")], True),
        ([rmc(status="V"), gsa("3")], False),
        ([rmc(), gsa("1")], True),  # of a constellation that is not in use
        ([gga(), rmc(status="V"), gsa("3")], False),
    ],
)
def test_gsa_decides_where_the_others_say_nothing(
    lines: list[bytes], has_fix: bool
) -> None:
    _, fixes = heard(*lines, every_s=0.05)
    assert bool(fixes) is has_fix


def test_gsa_tells_the_geometry_of_a_receiver_without_gga() -> None:
    _, (with_gsa,) = heard(rmc(), gsa("3"), every_s=0.05)
    _, (without,) = heard(rmc(), every_s=0.05)
    assert with_gsa.sigma_h_m == pytest.approx(2.0 * 1.1)
    assert without.sigma_h_m > with_gsa.sigma_h_m


def test_gsa_neither_opens_nor_closes_an_epoch() -> None:
    reader = EpochReader()
    for k in range(5):
        times = f"1200{k:02d}.00"
        lines = [rmc(times), gsa("3", "GP"), gsa("3", "GL"), gga(times), gsa("3", "GA")]
        found = [f for line in lines for f in reader.feed(k * S, line)]
        found += reader.advance(k * S + S // 2)
        (fix,) = found
        assert isinstance(fix, GpsFix)
        assert (fix.t_ns, fix.alt_m) == (k * S, 12.5)


def test_gll_in_local_time_dates_nothing() -> None:
    """Reported as SignalK/signalk-to-nmea0183#96."""
    lines = [
        line
        for k in range(12)
        for line in (rmc(f"1200{k:02d}.00"), gll(f"1400{k:02d}.00"))
    ]
    reader, fixes = heard(*lines, every_s=0.5)
    assert len(fixes) == 12
    assert {round(fix.utc_s or 0) % 86_400 for fix in fixes} == set(
        range(43_200, 43_212)
    )
    (reason,) = reader.unread.reasons()
    assert reason == "GLL: time is +7200 s off that of RMC or ZDA: local time?"
    assert reader.counters["foreign_times"] == 12


def test_a_time_without_date_around_midnight_is_not_foreign() -> None:
    """Reported as SignalK/nmea0183-signalk#366."""
    reader, fixes = heard(
        rmc("235959.00", "231126"), gga("235959.00"), gga("000000.00")
    )
    assert reader.counters["foreign_times"] == 0
    assert len(fixes) == 2
    assert (fixes[1].utc_s or 0) - (fixes[0].utc_s or 0) == 1.0


@pytest.mark.parametrize("kinds", [(rmc,), (rmc, gga)], ids=["RMC", "RMC and GGA"])
def test_whole_seconds_at_5_hz_are_noticed(kinds: tuple[Any, ...]) -> None:
    """Reported as mikalhart/TinyGPSPlus#120 and osmandapp/OsmAnd#8489."""
    reader, fixes = EpochReader(), []
    for k in range(50):
        place = f"5159.{4000 + k},N,00422.2000,E"
        for kind in kinds:
            line = kind(f"1200{k // 5:02d}", place=place)
            fixes += reader.feed(k * S // 5, line)
    assert len(fixes) >= 9
    assert reader.counters["cut_times"] == 40 * len(kinds)
    (told,) = [text for text in reader.take_notices() if "whole seconds" in text]
    assert "let it send tenths, or one fix a second" in told


@pytest.mark.parametrize("tenths", [".00", ".20"])
def test_sentences_that_are_sent_twice_are_not_cut_times(tenths: str) -> None:
    reader, _ = heard(*[rmc(f"120000{tenths}")] * 20, every_s=0.05)
    assert reader.counters["cut_times"] == 0
