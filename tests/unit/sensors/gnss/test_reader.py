"""The GPS thread, against a receiver in a clock that costs no time."""

import os
import threading
from collections.abc import Callable

import pytest

from imu_tracker.errors import ConfigError
from imu_tracker.samples import Frame, Source
from imu_tracker.sensors.gnss.baud import BAUDS
from imu_tracker.sensors.gnss.port import SerialPort
from imu_tracker.sensors.gnss.reader import DEAD_NS, Baud, GpsReader, GpsState
from support.fake_clock import FakeClock
from support.fake_receiver import FakeReceiver, S
from support.nmea_text import gga, rmc

MS = 1_000_000


def two_sentences(second: int) -> bytes:
    tod = f"{second // 3600:02}{second // 60 % 60:02}{second % 60:02}.00"
    return rmc(tod) + b"\r\n" + gga(tod) + b"\r\n"


class Desk:
    """A receiver, a reader, and what it put."""

    def __init__(self, *, says: Callable[[int], bytes] = two_sentences, **line: object):
        self.clock = FakeClock(now_ns=500 * MS)
        self.receiver = FakeReceiver(self.clock, says, **line)  # type: ignore[arg-type]
        self.frames: list[Frame] = []
        self.reader: GpsReader

    def listen(self, seconds: float, baud: Baud = 9600) -> GpsReader:
        """Let a reader run until so many seconds on the clock, in the foreground."""
        self.reader = GpsReader(
            "/dev/gps",
            baud,
            self.frames.append,
            self.clock,
            open_port=self.receiver.open,
        )
        self.at(seconds, self.reader.stop)
        self.reader.run()
        assert not any(port.is_open for port in self.receiver.ports)
        return self.reader

    def at(self, seconds: float, action: Callable[[], object]) -> None:
        self.clock.at(round(seconds * S), action)

    @property
    def lines(self) -> list[Frame]:
        return [frame for frame in self.frames if frame.source is Source.GPS]

    @property
    def events(self) -> list[str]:
        frames = [frame for frame in self.frames if frame.source is Source.EVENT]
        return [frame.data.decode() for frame in frames]

    def state_at(self, seconds: float) -> list[GpsState]:
        """Ask for the state at an instant; the list fills when it comes."""
        states: list[GpsState] = []
        self.at(seconds, lambda: states.append(self.reader.health().state))
        return states


def test_each_line_bears_the_time_of_its_first_byte() -> None:
    desk = Desk()
    desk.listen(2.9)
    byte_ns = 10 * S // 9600
    first, second = two_sentences(1).split(b"\r\n")[:2]
    assert [frame.data for frame in desk.lines[:2]] == [first, second]
    for frame, index in zip(desk.lines, (0, len(first) + 2), strict=False):
        arrived_ns = S + (index + 1) * byte_ns
        # a wake-up each 5 ms does not blur it: the line's speed is known
        assert abs(frame.t_ns - arrived_ns) <= 5 * MS


def test_bytes_from_before_the_opening_are_not_taken_for_new() -> None:
    desk = Desk()
    desk.listen(1.9)
    assert desk.lines[0].data == two_sentences(1).split(b"\r\n")[0]


def test_health_counts_what_came() -> None:
    desk = Desk(says=lambda second: two_sentences(second) + b"$GPRMC,torn*00\r\n")
    health = desk.listen(3.9).health()
    assert (health.state, health.baud, health.detail) == (GpsState.OK, 9600, "")
    assert (health.lines, health.sentences, health.reopens) == (9, 6, 0)
    assert health.bytes == 3 * len(two_sentences(1) + b"$GPRMC,torn*00\r\n")
    assert desk.events == ["gps_open /dev/gps"]


@pytest.mark.parametrize("baud", [9600, 115200, 4800, 230400, 921600])
def test_the_speed_is_found_by_listening(baud: int) -> None:
    desk = Desk(baud=baud)
    tries = BAUDS.index(baud) + 1
    reader = desk.listen(3.5 * tries + 3, "auto")
    assert reader.health().baud == baud
    assert reader.health().state is GpsState.OK
    assert desk.events == ["gps_open /dev/gps", f"gps_baud {baud}"]
    assert len(desk.lines) >= 4


def test_a_receiver_that_falls_back_to_another_speed_is_found_again() -> None:
    desk = Desk(baud=38400)
    desk.at(10, lambda: setattr(desk.receiver, "baud", 9600))
    assert desk.listen(50, "auto").health().baud == 9600
    assert desk.events[1:] == ["gps_baud 38400", "gps_baud 9600"]


def test_silence_says_nothing_about_the_speed() -> None:
    desk = Desk(baud=38400)
    desk.at(10, lambda: setattr(desk.receiver, "is_mute", True))
    silent = desk.state_at(20)
    desk.at(25, lambda: setattr(desk.receiver, "is_mute", False))
    assert desk.listen(27, "auto").health().state is GpsState.OK
    assert silent == [GpsState.SILENT]
    assert desk.events == ["gps_open /dev/gps", "gps_baud 38400"]


def test_a_fixed_speed_is_kept_and_garbage_is_named() -> None:
    desk = Desk(baud=38400)
    assert desk.listen(30, 9600).health().state is GpsState.GARBAGE
    assert desk.receiver.opened == [9600]
    assert desk.lines == []


def test_while_no_speed_fits_it_says_that_it_searches() -> None:
    desk = Desk(baud=1200)
    assert desk.listen(30, "auto").health().state is GpsState.SEARCHING
    assert desk.receiver.ports[0].bauds[: len(BAUDS)] == list(BAUDS)


def test_unplugging_is_told_once_and_plugging_is_noticed_within_two_seconds() -> None:
    desk = Desk()
    desk.at(3.5, desk.receiver.unplug)
    closed = desk.state_at(60)
    desk.at(100.2, desk.receiver.plug)
    reader = desk.listen(105)
    assert closed == [GpsState.CLOSED]
    assert [event.split()[0] for event in desk.events] == [
        "gps_open",
        "gps_lost",
        "gps_open",
    ]
    after = [frame.t_ns for frame in desk.lines if frame.t_ns > 60 * S]
    assert after[0] < 102.2 * S
    assert reader.health().reopens == 1
    assert "gone" in desk.events[1] or "could not open" in desk.events[1]


def test_a_port_that_is_not_there_is_told_with_its_reason() -> None:
    desk = Desk()
    desk.receiver.unplug()
    health = desk.listen(30).health()
    assert health.state is GpsState.CLOSED
    assert "could not open port /dev/gps" in health.detail
    assert len(desk.events) == 1
    assert desk.events[0].startswith("gps_lost ")


def test_the_speed_that_was_found_is_tried_first_after_unplugging() -> None:
    desk = Desk(baud=115200)
    desk.at(20, desk.receiver.unplug)
    desk.at(21, desk.receiver.plug)
    desk.listen(25, "auto")
    assert desk.receiver.opened == [9600, 115200]


def test_a_port_that_stays_silent_is_opened_again() -> None:
    desk = Desk()
    desk.receiver.is_mute = True
    reader = desk.listen(2.2 * DEAD_NS / S)
    assert len(desk.receiver.opened) == 3
    assert reader.health().detail == "silent for 30 s"
    assert reader.turned_ns > 2 * DEAD_NS


def test_a_usb_receiver_delivers_at_once_whatever_speed_is_set() -> None:
    desk = Desk(usb=True, says=lambda second: two_sentences(second) * 4)
    desk.listen(2.9, 4800)
    late_ns = {frame.t_ns % S for frame in desk.lines if frame.t_ns >= 2 * S}
    assert late_ns <= set(range(5 * MS + 1))


def test_a_bug_ends_the_thread_and_is_handed_over() -> None:
    def open_port(path: str, baud: int) -> SerialPort:
        raise ZeroDivisionError("a bug")

    frames: list[Frame] = []
    reader = GpsReader(
        "/dev/gps", 9600, frames.append, FakeClock(), open_port=open_port
    )
    reader.start()
    reader.join(10)
    assert not reader.is_alive()
    assert isinstance(reader.error, ZeroDivisionError)
    assert [frame.data for frame in frames] == [
        b"gps_failed ZeroDivisionError('a bug')"
    ]


def test_a_port_that_cannot_exist_is_a_configuration_error() -> None:
    with pytest.raises(ConfigError, match=r"gps.port = 'carrier-pigeon://x'"):
        GpsReader("carrier-pigeon://x", 9600, print, FakeClock()).run()


def test_a_reader_that_is_stopped_while_the_port_settles_reads_nothing() -> None:
    desk = Desk()
    desk.at(0.55, lambda: desk.reader.stop())
    desk.listen(9)
    assert desk.frames == []
    assert desk.clock.now_ns() < S


def test_lines_come_through_a_real_terminal_and_a_real_thread() -> None:
    master, slave = os.openpty()
    done = threading.Event()
    frames: list[Frame] = []

    class Port(SerialPort):
        """Speaks as soon as somebody listens."""

        def discard(self) -> None:
            super().discard()
            os.write(master, b"\xff\x00" + two_sentences(1))

    def put(frame: Frame) -> None:
        frames.append(frame)
        if len(frames) == 3:
            done.set()

    try:
        reader = GpsReader(os.ttyname(slave), "auto", put, FakeClock(), open_port=Port)
        reader.start()
        assert done.wait(10)
        reader.stop()
        reader.join(10)
    finally:
        os.close(master)
        os.close(slave)
    assert reader.error is None
    assert [frame.data for frame in frames[1:3]] == two_sentences(1).split(b"\r\n")[:2]
    assert frames[0].data.startswith(b"gps_open /dev/")
