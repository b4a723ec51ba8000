"""Edited streams: what is hidden, what is kept, and when it comes."""

from typing import TypeAlias

import pytest

from imu_tracker.recording.edit import (
    Outage,
    Stopwatch,
    hide_gps,
    keep_every_nth_epoch,
    pace,
)
from imu_tracker.samples import Frame, SessionHeader, Source
from support.fake_clock import FakeClock

Items: TypeAlias = list[SessionHeader | Frame]

HEADER = SessionHeader(4, 500, 100.0)
SECOND = 1_000_000_000
START = 50 * SECOND


def sentence(body: str) -> bytes:
    checksum = 0
    for byte in body.encode():
        checksum ^= byte
    return f"${body}*{checksum:02X}".encode()


def gps(at_s: float, body: str) -> Frame:
    return Frame(START + round(at_s * SECOND), Source.GPS, sentence(body))


def imu(at_s: float) -> Frame:
    return Frame(START + round(at_s * SECOND), Source.IMU, bytes(14))


def rmc(second: float) -> str:
    return f"GNRMC,1200{second:05.2f},A,5200.0,N,00400.0,E,0.0,,221126,,,A"


def gga(second: float) -> str:
    return f"GNGGA,1200{second:05.2f},5200.0,N,00400.0,E,1,9,1.0,5.0,M,,M,,"


VTG = "GNVTG,,T,,M,0.0,N,0.0,K,A"


def test_an_outage_hides_the_receiver_half_open_and_nothing_else() -> None:
    stream: Items = [
        HEADER,
        *(f(t) for t in range(6) for f in (imu, lambda t: gps(t, VTG))),
    ]
    kept = list(hide_gps(stream, [Outage(2.0, 2.0)]))
    hidden = [item for item in stream if item not in kept]
    assert hidden == [gps(2, VTG), gps(3, VTG)]


def test_outages_may_overlap_and_come_in_any_order() -> None:
    stream: Items = [HEADER, *(gps(t, VTG) for t in range(10))]
    kept = hide_gps(stream, [Outage(5.0, 2.0), Outage(1.0, 1.0), Outage(6.0, 2.0)])
    assert list(kept) == [HEADER, *(gps(t, VTG) for t in (0, 2, 3, 4, 8, 9))]


def test_every_nth_epoch_is_kept_with_all_its_sentences() -> None:
    epochs = [
        [gps(t, rmc(t)), gps(t + 0.05, VTG), imu(t + 0.06), gps(t + 0.1, gga(t))]
        for t in range(5)
    ]
    stream: Items = [HEADER, *(frame for epoch in epochs for frame in epoch)]
    kept = list(keep_every_nth_epoch(stream, 2))
    away = [f for epoch in epochs[1::2] for f in epoch if f.source is Source.GPS]
    assert kept == [item for item in stream if item not in away]


def test_keeping_every_epoch_keeps_everything() -> None:
    stream: Items = [HEADER, *(gps(t, rmc(t)) for t in range(5)), gps(5, VTG)]
    assert list(keep_every_nth_epoch(stream, 1)) == stream


def test_an_untimed_sentence_that_comes_first_belongs_to_what_follows() -> None:
    epochs = [[gps(t, VTG), gps(t + 0.05, rmc(t))] for t in range(4)]
    stream: Items = [HEADER, *(frame for epoch in epochs for frame in epoch)]
    assert list(keep_every_nth_epoch(stream, 2)) == [HEADER, *epochs[0], *epochs[2]]


def test_a_timed_sentence_that_is_no_position_begins_no_epoch() -> None:
    gst = "GNGST,1200{:05.2f},1.0,,,,1.0,1.0,1.0"
    epochs = [[gps(t, gst.format(t)), gps(t + 0.05, rmc(t))] for t in range(4)]
    stream: Items = [HEADER, *(frame for epoch in epochs for frame in epoch)]
    assert list(keep_every_nth_epoch(stream, 2)) == [HEADER, *epochs[0], *epochs[2]]


def test_a_damaged_line_belongs_to_the_epoch_in_which_it_came() -> None:
    def damaged(at_s: float) -> Frame:
        frame = gps(at_s, rmc(at_s + 7))
        return frame._replace(data=frame.data.replace(b",A,", b",B,", 1))

    epochs = [[gps(t, rmc(t)), damaged(t + 0.1)] for t in range(4)]
    stream: Items = [HEADER, *(frame for epoch in epochs for frame in epoch)]
    assert list(keep_every_nth_epoch(stream, 2)) == [HEADER, *epochs[0], *epochs[2]]


def test_frames_come_when_they_are_due_at_the_speed() -> None:
    clock = FakeClock()
    begin_ns = clock.now_ns()
    stream: Items = [HEADER, imu(0), imu(1), imu(3)]
    paced = pace(stream, 2.0, clock)
    assert [(clock.now_ns() - begin_ns, item) for item in paced] == [
        (0, HEADER),
        (0, imu(0)),
        (SECOND // 2, imu(1)),
        (3 * SECOND // 2, imu(3)),
    ]


def test_a_late_consumer_is_not_held_up_further() -> None:
    clock = FakeClock()
    stream = pace([imu(0), imu(1), imu(2)], 1.0, clock)
    next(stream)
    clock.advance(s=1.5)
    next(stream)
    before_ns = clock.now_ns()
    next(stream)
    assert clock.now_ns() - before_ns == SECOND // 2


def test_the_stopwatch_goes_on_when_the_clock_begins_anew() -> None:
    stopwatch = Stopwatch()
    after = [Frame(5 + n * SECOND, Source.IMU, b"") for n in range(2)]
    stream: Items = [HEADER, imu(0), imu(2), HEADER, *after]
    seconds = [stopwatch.read(item) for item in stream]
    assert seconds == pytest.approx([0, 0, 2, 2, 2, 3])


def test_the_stopwatch_counts_the_pause_between_sessions_of_one_clock() -> None:
    stopwatch = Stopwatch()
    stream: Items = [HEADER, imu(0), imu(2), HEADER, imu(60)]
    seconds = [stopwatch.read(item) for item in stream]
    assert seconds == pytest.approx([0, 0, 2, 2, 60])
