"""Sentences to fixes: what joins, what closes, what is refused."""

from datetime import UTC, datetime
from math import degrees, radians

import pytest

from imu_tracker.samples import GpsFix, UtcTime
from imu_tracker.sensors.gnss.epoch_reader import EpochReader, Positions
from imu_tracker.sensors.gnss.fields import MPS_PER_KNOT
from imu_tracker.sensors.gnss.sentences import TOLD_AFTER
from support.nmea_text import gga, gll, rmc, sentence

S = 1_000_000_000
MS = 1_000_000
NOON = datetime(2026, 11, 23, 12, tzinfo=UTC).timestamp()
NO_PLACE = ",,,"


def feed(reader: EpochReader, t_ns: int, *lines: bytes) -> Positions:
    """Feed lines that follow each other by 20 ms."""
    return [
        position
        for index, line in enumerate(lines)
        for position in reader.feed(t_ns + index * 20 * MS, line)
    ]


def gst(tod: str = "120000.00", sigma: str = "0.5") -> bytes:
    return sentence(f"GNGST,{tod},,,,,{sigma},{sigma},1.0")


def vtg(course: str = "90.0", knots: str = "10.0") -> bytes:
    return sentence(f"GNVTG,{course},T,,M,{knots},N,,K,A")


def zda(tod: str = "120000.00", day: str = "23,11,2026") -> bytes:
    return sentence(f"GNZDA,{tod},{day},00,00")


def tod(second: float) -> str:
    return f"1200{second:05.2f}"


def fixes(positions: Positions) -> list[GpsFix]:
    return [position for position in positions if type(position) is GpsFix]


def settled(*kinds: bytes) -> EpochReader:
    """Return a reader that has seen one epoch of these sentences, at 11:59:59."""
    reader = EpochReader()
    feed(reader, -S, *kinds)
    reader.advance(0)
    return reader


def test_sentences_of_one_instant_become_one_fix() -> None:
    reader = EpochReader()
    positions = feed(reader, S, rmc(), gga(), gst(), vtg("0.0", "99.0"))
    positions += reader.advance(2 * S)
    (fix,) = fixes(positions)
    assert (fix.t_ns, fix.utc_s) == (S, NOON)
    assert (degrees(fix.lat_rad), degrees(fix.lon_rad)) == pytest.approx((51.99, 4.37))
    assert (fix.alt_m, fix.sigma_h_m, fix.quality) == (12.5, 0.5, 1)
    assert fix.vel_ne_mps == pytest.approx((0, 10 * MPS_PER_KNOT))


@pytest.mark.parametrize(
    ("lines", "has_date"),
    [
        ([rmc()], True),
        ([gga()], False),
        ([gll()], False),
        ([sentence("GNGNS,120000,5159.4,N,00422.2,E,AN,11,1.3,9.9,39.5,,")], False),
        ([gll(), zda()], True),
    ],
    ids=["RMC", "GGA", "GLL", "GNS", "GLL and ZDA"],
)
def test_any_sentence_with_a_place_will_do(lines: list[bytes], has_date: bool) -> None:
    reader = EpochReader()
    (fix,) = fixes([*feed(reader, 0, *lines), *reader.advance(S)])
    assert fix.utc_s == (NOON if has_date else None)


def test_the_first_epoch_closes_after_its_time_and_is_of_its_first_sentence() -> None:
    reader = EpochReader()
    assert feed(reader, S, rmc(), gga()) == []
    assert reader.advance(S + 300 * MS - 1) == []
    (fix,) = fixes(reader.advance(S + 300 * MS))
    assert fix.t_ns == S


def test_an_epoch_closes_with_the_kind_that_closed_the_one_before() -> None:
    reader = settled(rmc("115959.00"), gga("115959.00"), gst("115959.00"))
    assert feed(reader, S, rmc(), gga()) == []
    assert len(feed(reader, S + 40 * MS, gst())) == 1


def test_another_time_of_day_closes_the_epoch_before() -> None:
    reader = EpochReader()
    assert feed(reader, 0, rmc(tod(0.0)), gga(tod(0.0))) == []
    (fix,) = fixes(feed(reader, 100 * MS, rmc(tod(0.1))))
    assert fix.utc_s == NOON


def test_ten_epochs_a_second_all_close_in_time() -> None:
    reader = EpochReader()
    for index in range(10):
        t_ns, at = index * 100 * MS, tod(index / 10)
        closed = feed(reader, t_ns, rmc(at), gga(at))
        assert len(closed) == (0 if index == 0 else 2 if index == 1 else 1)


def test_when_the_closing_kind_is_missing_time_closes_the_epoch() -> None:
    reader = settled(rmc("115959.00"), gga("115959.00"))
    assert feed(reader, S, rmc()) == []
    assert len(reader.feed(S + 350 * MS, sentence("GPGSV,1,1,00"))) == 1


def test_a_sentence_that_comes_behind_the_closing_one_closes_from_then_on() -> None:
    reader = settled(rmc("115959.00"))
    assert fixes(feed(reader, S, rmc(tod(1)), gga(tod(1))))[0].alt_m is None
    assert fixes(feed(reader, 2 * S, rmc(tod(2)), gga(tod(2))))[0].alt_m == 12.5
    assert reader.counters["fixes"] == 3


def test_sentences_later_than_the_epoch_make_no_second_fix() -> None:
    reader = EpochReader()
    assert len([*feed(reader, 0, gga()), *reader.feed(400 * MS, rmc())]) == 1
    assert reader.advance(S) == []
    assert reader.counters["late_velocities"] == 1
    # the next one does not wait for them
    assert len(feed(reader, S, gga(tod(1)))) == 1


def test_velocity_may_come_ahead_of_the_place() -> None:
    reader = EpochReader()
    positions = feed(reader, 0, vtg(), gga(tod(0))) + feed(
        reader, S, vtg(), gga(tod(1))
    )
    assert [fix.vel_ne_mps is not None for fix in fixes(positions)] == [True, True]
    assert [fix.t_ns for fix in fixes(positions)] == [0, S]


def test_velocity_of_long_ago_is_forgotten() -> None:
    reader = EpochReader()
    reader.feed(0, vtg())
    (fix,) = fixes([*reader.feed(S, gga()), *reader.advance(2 * S)])
    assert (fix.t_ns, fix.vel_ne_mps) == (S, None)


def test_accuracy_of_another_instant_is_not_taken() -> None:
    reader = EpochReader()
    feed(reader, 0, gst(tod(9)), gga())
    assert fixes(reader.advance(S))[0].sigma_h_m == pytest.approx(2.4)


@pytest.mark.parametrize(
    ("quality", "hdop", "sigma_m"),
    [
        ("1", "1.2", 2.4),
        ("1", "0.3", 1.0),
        ("1", "", 5.0),
        ("1", "0.0", 5.0),
        ("2", "1.0", 1.4),
        ("4", "1.0", 0.02),
        ("5", "2.0", 0.6),
        ("9", "1.0", 2.0),
    ],
)
def test_accuracy_without_gst_is_geometry_times_the_kind_of_solution(
    quality: str, hdop: str, sigma_m: float
) -> None:
    reader = EpochReader()
    feed(reader, 0, gga(quality=quality, hdop=hdop))
    (fix,) = fixes(reader.advance(S))
    assert fix.sigma_h_m == pytest.approx(sigma_m)
    assert fix.quality == int(quality)


@pytest.mark.parametrize(
    "lines",
    [
        [rmc(status="V")],
        [rmc(status="V", place=NO_PLACE), gga(quality="0", place=NO_PLACE)],
        [gga(quality="8"), gll(status="V", mode="S"), rmc(status="V", mode="S")],
        [gga(quality="7")],
        [gga(quality="6"), rmc(mode="E")],
        [gga(place=NO_PLACE)],
        [gga(place="0000.0000,N,00000.0000,E"), rmc(place="0000.0,N,00000.0,W")],
        [gga(satellites="00")],
        [gga(quality="")],
        [sentence("GPGLL,5159.4000,N,00422.2000,E,120000")],
        [gga(tod=""), rmc(tod="")],
    ],
)
def test_there_is_no_position_without_a_fix(lines: list[bytes]) -> None:
    reader = EpochReader()
    assert fixes([*feed(reader, 0, *lines), *reader.advance(S)]) == []


@pytest.mark.parametrize(
    "lines",
    [
        [rmc(), gga(quality="0")],
        [rmc(status="V"), gga()],
        [gga(), gll(status="V", mode="N")],
    ],
)
def test_sentences_that_contradict_each_other_are_no_fix(lines: list[bytes]) -> None:
    reader = EpochReader()
    assert fixes([*feed(reader, 0, *lines), *reader.advance(S)]) == []
    assert reader.counters["contradictory_epochs"] == 1


def test_a_receiver_that_always_contradicts_itself_is_named_once() -> None:
    reader = EpochReader()
    for second in range(2 * TOLD_AFTER):
        feed(reader, second * S, rmc(tod(second)), gga(tod(second), quality="0"))
    assert reader.take_notices() == [
        "the receiver's sentences disagree about having a fix"
    ]


def test_one_constellation_without_a_fix_contradicts_nothing() -> None:
    reader = EpochReader()
    feed(
        reader,
        0,
        gga(talker="GP"),
        gga(talker="GL", quality="0", place=NO_PLACE),
        rmc(),
    )
    assert len(fixes(reader.advance(S))) == 1


def test_a_blank_quality_is_decided_by_rmc() -> None:
    reader = EpochReader()
    feed(reader, 0, gga(quality=""), rmc())
    assert len(fixes(reader.advance(S))) == 1


def test_the_kind_of_rtk_is_known_by_gga_alone() -> None:
    reader = EpochReader()
    feed(reader, 0, rmc(mode="R"), gga(quality="4"), gll(mode="D"))
    assert fixes(reader.advance(S))[0].quality == 4


def test_repeated_instants_become_one_fix_and_are_counted() -> None:
    reader = EpochReader()
    positions: Positions = []
    for second in (0, 1, 0, 1, 2):
        positions += feed(reader, second * S, rmc(tod(second)))
    positions += reader.advance(9 * S)
    assert [fix.utc_s for fix in fixes(positions)] == [NOON, NOON + 1, NOON + 2]
    assert reader.counters["repeated_epochs"] == 2


def test_epochs_out_of_order_are_passed_on() -> None:
    reader = EpochReader()
    positions = [p for s in (3, 2, 4) for p in feed(reader, s * S, rmc(tod(s)))]
    positions += reader.advance(9 * S)
    assert [fix.utc_s for fix in fixes(positions)] == [NOON + 3, NOON + 2, NOON + 4]


def test_time_without_a_fix_is_told() -> None:
    reader = EpochReader()
    assert feed(reader, S, rmc(status="V", place=NO_PLACE, mode="N")) == []
    assert reader.advance(2 * S) == [UtcTime(S, NOON)]
    assert reader.counters["epochs_without_fix"] == 1


def test_time_by_zda_is_told_until_there_is_a_fix() -> None:
    reader = EpochReader()
    no_fix = gga(tod="", quality="0", place=NO_PLACE)
    assert feed(reader, S, no_fix, zda()) == [UtcTime(S + 20 * MS, NOON)]
    assert reader.counters["sentences_without_time"] == 1
    feed(reader, 2 * S, gga(tod(1)), zda(tod(1)))
    assert len(fixes(reader.advance(3 * S))) == 1
    assert feed(reader, 4 * S, zda(tod(3))) == []


def test_time_without_a_date_is_not_told() -> None:
    reader = EpochReader()
    feed(reader, 0, gga(quality="0"))
    assert reader.advance(S) == []


def test_a_receiver_without_dates_needs_one_configured() -> None:
    reader = EpochReader(date="2026-11-23")
    (fix,) = fixes([*feed(reader, 0, gga()), *reader.advance(S)])
    assert fix.utc_s == NOON


def test_a_recording_dates_a_receiver_without_dates_across_midnight() -> None:
    reader = EpochReader(reference_utc_s=NOON + 43199)
    reader.advance(0)
    positions = feed(reader, 200 * MS, gga("235959.00"))
    positions += feed(reader, 1200 * MS, gga("000000.00"))
    positions += reader.advance(9 * S)
    assert [fix.utc_s for fix in fixes(positions)] == [NOON + 43199, NOON + 43200]


def test_missing_dates_are_said_once_and_not_at_the_first_fix() -> None:
    reader = EpochReader()
    for second in range(TOLD_AFTER):
        assert reader.take_notices() == []
        feed(reader, second * S, gga(tod(second)))
    reader.advance(99 * S)
    assert reader.take_notices() == ["the receiver sends no date: set gps.date"]
    assert reader.take_notices() == []


def test_a_rollover_is_corrected_and_said_once() -> None:
    reader = EpochReader(earliest_utc_s=NOON - 86400)
    positions = []
    for second in range(3):
        positions += feed(reader, second * S, rmc(tod(second), "090407"))
    assert fixes(positions)[0].utc_s == NOON  # 2007-04-09 and 1024 weeks
    assert reader.take_notices() == [
        "the receiver's dates lie 1024 weeks back; corrected"
    ]
    assert reader.take_notices() == []


def test_a_leap_second_passes() -> None:
    reader = EpochReader()
    times = ["235959.00", "235960.00", "000001.00"]
    positions = []
    for index, at in enumerate(times):
        day = "241126" if at < "1" else "231126"
        positions += feed(reader, index * S, rmc(at, day))
    positions += reader.advance(9 * S)
    assert [(fix.utc_s or 0) - NOON for fix in fixes(positions)] == [
        43199,
        43200,
        43201,
    ]


def test_trouble_is_counted_by_kind() -> None:
    reader = EpochReader()
    feed(
        reader,
        0,
        rmc()[:-1] + b"~",
        rmc()[:-3],
        sentence("GPGGA," + "x" * 255),
        sentence("GP\xe9GA,1"),
        gga(place="9100.0000,N,00422.2000,E"),
        sentence("GPGSV,1,1,00"),
    )
    assert reader.counters == {
        "bad_checksums": 1,
        "missing_checksums": 1,
        "overlong_lines": 1,
        "unparsable_lines": 1,
        "bad_positions": 1,
        "sentences": 2,
    }


def test_a_spliced_line_is_read_from_its_last_dollar() -> None:
    reader = EpochReader()
    feed(reader, 0, rmc()[:20] + gga())
    assert len(fixes(reader.advance(S))) == 1


def test_time_of_day_keeps_its_digits() -> None:
    reader = EpochReader()
    feed(reader, 0, rmc("120000.123456"))
    (fix,) = fixes(reader.advance(S))
    assert fix.utc_s == pytest.approx(NOON + 0.123456, abs=3e-7)
    assert fix.lat_rad == pytest.approx(radians(51.99), abs=1e-15)


def test_where_sentences_differ_in_place_the_one_with_its_own_instant_counts() -> None:
    reader = EpochReader()
    feed(reader, 0, gga(place="5159.5000,N,00422.2000,E"), gll())
    assert degrees(fixes(reader.advance(S))[0].lat_rad) == pytest.approx(51.99)
